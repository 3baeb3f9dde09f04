"""How well a sweep has determined its parameters, from the curves that it has already.

Around the best set every simulated curve, read at the measured points, is fitted as a
polynomial of the parameters u, each scaled to its range. The slopes J of the residuals r
make Fopt a quadratic, Fopt(u) ≈ |r + J u|², and "about as good" an ellipsoid: how far that
reaches along an axis, the other parameters adjusting themselves, is the parameter's interval.
No simulation is made for it.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from palpate import _core
from palpate.domain import Design, FloatArray, Parameter, Response, Scenario, Simulation
from palpate.refinement import Refined
from palpate.scoring import compare, point_weights
from palpate.selection import objectives
from palpate.study import Study

WORDS: tuple[tuple[float, str], ...] = ((0.1, "well"), (0.3, "roughly"), (0.8, "poorly"), (np.inf, "not"))
"""What is said of an interval up to each share of the parameter's range."""

UNCLEAR = "unclear"
"""What is said where the sweep has too few sets, or curves that no polynomial follows."""

LEAST_Q2 = 0.8
"""Share of the curves' variation that must be predicted at sets left out of the fit."""

SETS_PER_COEFFICIENT = 1.5
"""Sets that a fit needs for each of its coefficients."""

_SCHEMA = {
    "spot": pl.String,
    "scenario": pl.String,
    "parameter": pl.String,
    "unit": pl.String,
    "value": pl.Float64,
    "lower": pl.Float64,
    "upper": pl.Float64,
    "share": pl.Float64,
    "determined": pl.String,
    "moves_with": pl.String,
    "correlation": pl.Float64,
    "limit": pl.Float64,
    "n_as_good": pl.Int64,
    "q2": pl.Float64,
}

Swept = Mapping[tuple[str, str], FloatArray]
"""Simulated ordinates at the measured points by spot and channel: (n_sets, n_points), NaN where none."""


def at_measured(simulations: Iterable[Simulation], measured: Mapping[str, Response], n_sets: int) -> Swept:
    """Read every simulated curve at the measured points.

    Parameters
    ----------
    simulations : iterable of Simulation
        Of the sweep; what they did not get to is NaN.
    measured : mapping of spot name to Response
    n_sets : int
        Rows of the design.
    """
    swept = {
        (spot, name): np.full((n_sets, curve.abscissa.size), np.nan)
        for spot, response in measured.items()
        for name, curve in response.curves.items()
    }
    for simulation in simulations:
        spot = simulation.job.spot
        if simulation.response is not None:
            for name, curve in measured[spot].curves.items():
                swept[spot, name][simulation.job.set_id] = compare(simulation, curve).values
    return swept


def determine(
    study: Study,
    design: Design,
    measured: Mapping[str, Response],
    swept: Swept,
    scores: pl.DataFrame,
    selection: pl.DataFrame,
    refined: Refined,
) -> pl.DataFrame:
    """Find the interval of every parameter at every spot in every scenario.

    Parameters
    ----------
    study : Study
    design : Design
    measured : mapping of spot name to Response
    swept : mapping of (spot, channel) to (n_sets, n_points) array
        As :func:`at_measured` returns it.
    scores, selection : DataFrame
        As :mod:`palpate.scoring` and :mod:`palpate.selection` return them.
    refined : Refined
        Where it has a row, that is the best set.

    Returns
    -------
    DataFrame
        One row per row of ``selection`` and parameter: spot, scenario, parameter, unit, value;
        lower and upper, the interval within the range; share, its length over that of the range;
        determined, the word for it; moves_with and correlation, the parameter that it trades
        with most; limit, the Fopt up to which a set is about as good (the least plus itself, or
        plus what the measured spread makes, whichever is more); n_as_good, sets of the sweep
        within it; q2, the share of variation that the fit predicts at sets left out of it.
        What cannot be told is null, and its word is "unclear".
    """
    ranked = objectives(scores, study.scenarios)
    refinements = {(row["spot"], row["scenario"]): row for row in refined.table.iter_rows(named=True)}
    scenarios = {scenario.name: scenario for scenario in study.scenarios}
    rows: list[dict[str, Any]] = []
    for chosen in selection.iter_rows(named=True):
        key = chosen["spot"], chosen["scenario"]
        end = refinements.get(key, {})
        best = end if end.get("fopt") is not None else chosen
        sets = ranked.filter((pl.col("spot") == key[0]) & (pl.col("scenario") == key[1]))
        rows += _Neighbourhood(
            study=study,
            design=design,
            scenario=scenarios[key[1]],
            measured=measured[key[0]],
            swept={name: values for (spot, name), values in swept.items() if spot == key[0]},
            sets=sets["set_id"].to_numpy(),
            fopt=sets["fopt"].to_numpy(),
            best=best,
        ).rows()
    return pl.DataFrame(rows, schema=_SCHEMA)


@dataclass(frozen=True, kw_only=True)
class _Neighbourhood:
    """What is known around the best set of one spot in one scenario."""

    study: Study
    design: Design
    scenario: Scenario
    measured: Response
    swept: Mapping[str, FloatArray]
    sets: Any
    fopt: FloatArray
    best: Mapping[str, Any]

    def rows(self) -> Iterator[dict[str, Any]]:
        residuals = self._residuals()
        complete = np.isfinite(residuals).all(axis=1)
        at = _scaled(self.design.parameters, self._values(self.sets[complete]))
        centre = _scaled(self.design.parameters, self._best_values()[None])[0]
        limit = self._limit()
        slopes = fit_slopes(at - centre, residuals[complete], self.fopt[complete])
        found = None if slopes is None else slopes.ellipsoid(limit)
        for i, parameter in enumerate(self.design.parameters):
            row = {
                "spot": self.best["spot"],
                "scenario": self.scenario.name,
                "parameter": parameter.name,
                "unit": parameter.unit,
                "value": self.best[parameter.name],
                "determined": UNCLEAR,
                "limit": limit,
                "n_as_good": int((self.fopt <= limit).sum()),
                "q2": None if slopes is None else slopes.q2,
            }
            yield row if found is None else row | self._told(parameter, i, centre[i], found)

    def _told(self, parameter: Parameter, i: int, at: float, found: "Ellipsoid") -> dict[str, Any]:
        reach = at + found.centre[i] + np.array([-1.0, 1.0]) * found.half_widths[i]
        low, high = np.clip([min(reach[0], at), max(reach[1], at)], 0.0, 1.0)
        partner = found.partner(i)
        lower, upper = (_value(parameter, end) for end in (low, high))
        return {
            "lower": lower,
            "upper": upper,
            "share": high - low,
            "determined": next(word for most, word in WORDS if high - low <= most),
            "moves_with": None if partner is None else self.design.parameters[partner].name,
            "correlation": None if partner is None else found.correlation[i, partner],
        }

    def _values(self, sets: Any) -> FloatArray:  # noqa: ANN401 - an integer array
        values: FloatArray = self.design.values[sets]
        return values

    def _best_values(self) -> FloatArray:
        return np.array([self.best[p.name] for p in self.design.parameters])

    def _limit(self) -> float:
        """Fopt up to which a set is about as good as the best."""
        least = float(self.best["fopt"])
        return least + max(least, sum(self._spread(name) * w for name, w in self._weighted()))

    def _weighted(self) -> list[tuple[str, float]]:
        return [(name, weight) for name, weight in self.scenario.weights.items() if weight > 0.0]

    def _spread(self, channel: str) -> float:
        """NMSE between curves that are one measured standard deviation apart."""
        curve = self.measured[channel]
        if curve.std is None:
            return 0.0
        squares = float(np.average(curve.std**2, weights=point_weights(curve, self.study.weights)))
        return squares / self._normaliser(channel) ** 2

    def _normaliser(self, channel: str) -> float:
        return float(_core.normaliser(self.measured[channel].ordinate, self.study.normaliser.value))

    def _residuals(self) -> FloatArray:
        """Residuals (n_sets, n_points) of the ranked sets, whose sum of squares is Fopt."""
        return np.concatenate([self._of_channel(*weighted) for weighted in self._weighted()], axis=1)

    def _of_channel(self, channel: str, weight: float) -> FloatArray:
        curve, values = self.measured[channel], self.swept[channel][self.sets]
        points = point_weights(curve, self.study.weights)
        points = np.ones(curve.abscissa.size) if points is None else points
        # A point that hardly any set reaches says nothing of the others.
        reached = np.isfinite(values).mean(axis=0) > 0.5
        points, values = points[reached], values[:, reached]
        scale = np.sqrt(weight * points / points.sum()) / self._normaliser(channel)
        residuals: FloatArray = (values - curve.ordinate[reached]) * scale
        return residuals


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipsoid:
    """Parameters that fit about as well: its centre (p,), half widths (p,) and correlation (p, p)."""

    centre: FloatArray
    half_widths: FloatArray
    correlation: FloatArray

    def partner(self, i: int) -> int | None:
        """Index of the parameter that trades most with the i-th; None where there is no other."""
        others = np.abs(self.correlation[i]).copy()
        others[i] = -1.0
        return int(np.argmax(others)) if others.size > 1 else None


@dataclass(frozen=True, kw_only=True, eq=False)
class Slopes:
    """Residuals (n_points,) at the best set, their slopes (p, n_points), and how good the fit is."""

    residuals: FloatArray
    slopes: FloatArray
    q2: float

    def ellipsoid(self, limit: float) -> Ellipsoid | None:
        """Where |r + J u|² stays within the limit; None where the fit is not to be relied on."""
        hessian, gradient = self.slopes @ self.slopes.T, self.slopes @ self.residuals
        sizes, axes = np.linalg.eigh(hessian)
        if self.q2 < LEAST_Q2 or not sizes[-1] > 0.0:
            return None
        # A direction without any effect has a width far beyond every range, and not an infinite one.
        covariance = (axes / np.maximum(sizes, 1e-12 * sizes[-1])) @ axes.T
        centre = -covariance @ gradient
        least = float(self.residuals @ self.residuals + gradient @ centre)
        if least > limit:
            return None
        widths = np.sqrt(np.diag(covariance))
        correlation = covariance / np.outer(widths, widths)
        half_widths = np.sqrt(limit - least) * widths
        return Ellipsoid(centre=centre, half_widths=half_widths, correlation=correlation)


def fit_slopes(steps: FloatArray, residuals: FloatArray, fopt: FloatArray) -> Slopes | None:
    """Fit residuals as a polynomial of the steps from the best set, sets that fit well counting more.

    Parameters
    ----------
    steps : (n, p) array
        Of each set from the best one, as a share of the ranges.
    residuals : (n, n_points) array
    fopt : (n,) array

    Returns
    -------
    Slopes or None
        Of second degree, or of first where the sets do not suffice; None where they do not
        suffice for that either.
    """
    for columns in (_quadratic(steps), _linear(steps)):
        if len(steps) >= SETS_PER_COEFFICIENT * columns.shape[1]:
            break
    else:
        return None
    weights = np.sqrt(1.0 / (fopt + max(float(fopt.min()), 1e-3 * float(np.median(fopt)), 1e-300)))[:, None]
    q, r = np.linalg.qr(weights * columns)
    if np.abs(np.diag(r)).min() <= 1e-10 * np.abs(np.diag(r)).max():
        return None
    target = weights * residuals
    coefficients = np.linalg.solve(r, q.T @ target)
    # What each set would miss by, had it been left out of the fit.
    left_out = (target - q @ (q.T @ target)) / np.maximum(1.0 - (q**2).sum(axis=1), 1e-9)[:, None]
    mean = (weights * target).sum(axis=0) / (weights**2).sum()
    variation = float(((target - weights * mean) ** 2).sum())
    q2 = 1.0 - float((left_out**2).sum()) / variation if variation > 0.0 else -np.inf
    n_parameters = steps.shape[1]
    return Slopes(residuals=coefficients[0], slopes=coefficients[1 : 1 + n_parameters], q2=q2)


def _linear(steps: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(steps)), steps])


def _quadratic(steps: FloatArray) -> FloatArray:
    i, j = np.triu_indices(steps.shape[1])
    return np.column_stack([_linear(steps), steps[:, i] * steps[:, j]])


def _scaled(parameters: tuple[Parameter, ...], values: FloatArray) -> FloatArray:
    """Values (n, p) as shares of their ranges, or of the logarithms of them."""
    columns = [
        [share_of_range(parameter, value) for value in column]
        for parameter, column in zip(parameters, values.T.tolist(), strict=True)
    ]
    return np.array(columns, dtype=np.float64).T


def share_of_range(parameter: Parameter, value: float) -> float:
    """Where a value lies in its range, 0 to 1, or in that of the logarithms where these are spread evenly."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.lower) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.lower) / (parameter.upper - parameter.lower)


def _value(parameter: Parameter, share: float) -> float:
    if parameter.scale == "log":
        return float(parameter.lower * (parameter.upper / parameter.lower) ** share)
    return float(parameter.lower + share * (parameter.upper - parameter.lower))
