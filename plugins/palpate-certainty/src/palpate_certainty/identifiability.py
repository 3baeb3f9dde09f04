"""Identifiability of the parameters, from the curves of the sweep.

The curves of each spot, read at the measured points, are emulated between the sets
(:mod:`~palpate_certainty.emulator`). The optimum is where emulated curves fit best. By their slopes Fopt is
a quadratic over the box of the ranges: the interval of a parameter ends where it passes a threshold, with the
other parameters adjusted. It needs no further simulation.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
import scipy

from palpate.api import BoolArray, Design, FloatArray, IntArray, Parameter, Response, Scenario
from palpate.api.fit import (
    ALL_SPOTS,
    UNCLEAR,
    FitResult,
    channel_of,
    linear_least,
    share_of_range,
    word_of,
)
from palpate.api.runs import Study, Swept, answering_for, objectives, scored_points
from palpate_certainty.bounded import Residuals, least_near, slopes_at
from palpate_certainty.declared import DECLARED
from palpate_certainty.emulated_curves import best_and_first
from palpate_certainty.emulator import Emulator, Runs

LEAST_Q2 = 0.8
"""Smallest share of the curves' variation that is predicted at sets left out of the emulator."""


def assess_identifiability(
    study: Study,
    design: Design,
    measured: Mapping[str, Response],
    swept: Swept,
    scores: pl.DataFrame,
    selection: pl.DataFrame,
    generalisation: pl.DataFrame,
    fit: FitResult,
) -> dict[str, pl.DataFrame]:
    """Find the interval of every parameter at every spot in every scenario, and over all spots.

    What is ``swept`` is as :func:`palpate.scoring.scores.at_measured` returns it; the tables are as
    :mod:`~palpate.scoring.scores`, :mod:`~palpate.scoring.selection` and
    :mod:`~palpate.scoring.generalisation` return them. Where the fit has a row for a spot, or for all of them
    together, that is the best set. No interval is narrower than what the mesh leaves open.
    """
    curves = _Curves(
        study=study, design=design, measured=measured, swept=swept, ranked=objectives(scores, study.scenarios)
    )
    chosen = {(row["spot"], row["scenario"]): row for row in selection.iter_rows(named=True)} | fit.of_spots()
    scenarios = {scenario.name: scenario for scenario in study.scenarios}
    cases = [curves.case(spot, scenarios[name], [spot], best, fit) for (spot, name), best in chosen.items()]
    joint = fit.joint(study.generalise_by)
    of_all = generalisation if joint.is_empty() else joint
    if len(measured) > 1 and not of_all.is_empty():
        spots = of_all["spot"].to_list()
        best = of_all.row(0, named=True) | {"fopt": of_all["fopt"].mean()}
        cases.append(curves.case(ALL_SPOTS, scenarios[study.generalise_by], spots, best, fit))
    table = DECLARED["identifiability"]["identifiability"]
    return {"identifiability": table.frame([row for case in cases for row in case.rows()])}


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticForm:
    """Fopt(u) = |matrix u + offset|² + rest over the box 0 ≤ u ≤ 1.

    Parameters
    ----------
    matrix : (p, p) array
    offset : (p,) array
    """

    matrix: FloatArray
    offset: FloatArray
    rest: float

    @classmethod
    def near(cls, residuals: Residuals, origin: FloatArray) -> "QuadraticForm":
        """Sum of squares of residuals that go on from a point (p,) as they do there."""
        (here,) = residuals(origin[None])
        (slopes,) = slopes_at(residuals, origin[None], here[None], np.ones(origin.size, dtype=bool))
        q, matrix = np.linalg.qr(slopes)
        along = q.T @ here
        rest = max(0.0, float(here @ here - along @ along))
        return cls(matrix=matrix, offset=along - matrix @ origin, rest=rest)

    def __call__(self, u: FloatArray) -> float:
        """Fopt at ``u`` (p,)."""
        return float(((self.matrix @ u + self.offset) ** 2).sum()) + self.rest

    def minimum(self) -> FloatArray:
        """Point (p,) of the box where Fopt is least."""
        return _least_in_box(self.matrix, self.offset)

    def interval(self, i: int, limit: float) -> tuple[float, float]:
        """Find the least and largest u_i at which Fopt ≤ limit, the others free within the box."""
        optimum = self.minimum()

        def excess(value: float) -> float:
            u = np.insert(self._profile(i, value), i, value)
            return self(u) - limit

        low, high = (_end(excess, float(optimum[i]), bound) for bound in (0.0, 1.0))
        return low, high

    def _profile(self, i: int, value: float) -> FloatArray:
        """Best values of the other parameters where the i-th is given."""
        others = np.delete(self.matrix, i, axis=1)
        return _least_in_box(others, self.offset + self.matrix[:, i] * value)

    def correlation(self) -> FloatArray:
        """Correlation (p, p) of the parameters among sets that fit about as well, the box aside."""
        sizes, axes = np.linalg.eigh(self.matrix.T @ self.matrix)
        # A direction without effect has a very large width, not an infinite one.
        covariance = (axes / np.maximum(sizes, 1e-12 * max(sizes[-1], 1e-300))) @ axes.T
        widths = np.sqrt(np.diag(covariance))
        return covariance / np.outer(widths, widths)


def _least_in_box(matrix: FloatArray, offset: FloatArray) -> FloatArray:
    """Minimise |matrix u + offset| over 0 ≤ u ≤ 1; the middle along directions without effect."""
    n = matrix.shape[1]
    if n == 0:
        return np.zeros(0)
    weak = 1e-8 * max(float(np.linalg.norm(matrix)), 1e-150)
    return linear_least(
        np.concatenate([matrix, weak * np.eye(n)]), np.concatenate([-offset, np.full(n, 0.5 * weak)])
    )


def _end(excess: Callable[[float], float], inside: float, bound: float) -> float:
    if inside == bound or excess(bound) <= 0.0:
        return bound
    if excess(inside) >= 0.0:
        return inside
    return float(scipy.optimize.brentq(excess, inside, bound, xtol=1e-6))


@dataclass(frozen=True, kw_only=True)
class _Curves:
    """Simulated, emulated and measured curves."""

    study: Study
    design: Design
    measured: Mapping[str, Response]
    swept: Swept
    ranked: pl.DataFrame

    def case(
        self, label: str, scenario: Scenario, spots: Sequence[str], best: Mapping[str, Any], fit: FitResult
    ) -> "_Case":
        """Collect the fits of some spots together in a scenario."""
        rows = self.ranked.filter(pl.col("scenario") == scenario.name, pl.col("spot").is_in(list(spots)))
        means = rows.group_by("set_id").agg(pl.len(), pl.col("fopt").mean())
        means = means.filter(pl.col("len") == len(spots)).sort("set_id")
        weighed = [
            (spot, name, weight)
            for spot in spots
            for name, weight in scenario.weighed.items()
            if channel_of(name) in self.measured[spot].curves
        ]
        return _Case(
            curves=self,
            spot=label,
            scenario=scenario,
            spots=spots,
            fopt=dict(means.select("set_id", "fopt").iter_rows()),
            spread=sum(self._spread(*each) for each in weighed) / len(spots),
            best=best,
            is_fitted="fit" in best,
            mesh=fit.mesh_errors(label, scenario.name),
        )

    @cached_property
    def emulated(self) -> Mapping[str, "_Emulated | None"]:
        """Emulated curves of each spot; None where there are too few sets for it."""
        return {spot: self._emulated(spot) for spot in self.measured}

    def _emulated(self, spot: str) -> "_Emulated | None":
        curves = self.measured[spot].curves
        values = np.concatenate([self.swept[spot, name] for name in curves], axis=1)
        if not len(values):
            return None
        measured = np.concatenate([curve.ordinate for curve in curves.values()])
        peaks = [np.full(c.ordinate.size, np.abs(c.ordinate).max() or 1.0) for c in curves.values()]
        peak = np.concatenate(peaks)
        # A point that hardly any set reaches is left out, and then a set that does not reach all others.
        reached = np.isfinite(values).mean(axis=0) > 0.5
        ranked = np.isin(np.arange(len(values)), self.ranked.filter(spot=spot)["set_id"].to_numpy())
        complete = np.flatnonzero(ranked & np.isfinite(values[:, reached]).all(axis=1))
        parameters = self.design.parameters
        # Sets that an emulator needs for each coefficient of a linear polynomial of the parameters.
        if not reached.any() or complete.size < 1.5 * (1 + len(parameters)):
            return None
        misfit = (((values[complete] - measured) / peak)[:, reached] ** 2).sum(axis=1)
        sets = complete[best_and_first(misfit)]
        at, ordinates = _scaled(parameters, self.design.values[sets]), values[np.ix_(sets, reached)]
        none = np.full((*ordinates.shape, len(parameters)), np.nan)
        runs = Runs(values=at, ordinates=ordinates, slopes=none)
        process = Emulator(parameters, runs, peak[reached])
        return _Emulated(sets=sets, ordinates=ordinates, reached=reached, process=process)

    def _spread(self, spot: str, name: str, weight: float) -> float:
        """Weighted NMSE between curves that are one measured standard deviation apart."""
        curve = self.measured[spot][channel_of(name)]
        if curve.std is None:
            return 0.0
        score = self.study.scoring.score
        scale = score.scale(curve, scored_points(score, curve, name) > 0.0, weight)
        return float(((scale * curve.std) ** 2).sum())

    def residuals(self, scenario: Scenario, spot: str, ordinates: FloatArray) -> FloatArray:
        """Residuals (n, n_points) of a scenario by the ordinates of all reached points of a spot."""
        emulated, response, score = self.emulated[spot], self.measured[spot], self.study.scoring.score
        assert emulated is not None
        values = np.full((len(ordinates), emulated.reached.size), np.nan)
        values[:, emulated.reached] = ordinates
        sizes = [curve.ordinate.size for curve in response.curves.values()]
        places = {n: slice(sum(sizes[:i]), sum(sizes[: i + 1])) for i, n in enumerate(response.curves)}
        parts = []
        for name, weight in scenario.weighed.items():
            if (place := places.get(channel_of(name))) is None:
                continue
            curve = response[channel_of(name)]
            reached = emulated.reached[place] & (scored_points(score, curve, name) > 0.0)
            with answering_for(score, f"scoring '{name}'"):
                parts.append(score.weighted(curve, values[:, place], reached, weight)[:, reached])
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True, kw_only=True)
class _Emulated:
    """Curves of a spot: sets (n,) of the design, their ordinates at the points that are reached."""

    sets: IntArray
    ordinates: FloatArray
    reached: BoolArray
    process: Emulator


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Fopt as a quadratic over the box of the ranges."""

    form: QuadraticForm
    optimum: FloatArray
    least: float
    margin: float
    q2: float


@dataclass(frozen=True, kw_only=True)
class _Case:
    """The fit of one spot, or of all, in one scenario."""

    curves: _Curves
    spot: str
    scenario: Scenario
    spots: Sequence[str]
    fopt: Mapping[int, float]
    spread: float
    best: Mapping[str, Any]
    is_fitted: bool
    mesh: Mapping[str, float]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the design."""
        return self.curves.design.parameters

    def residuals(self, points: FloatArray) -> FloatArray:
        """Residuals (n, m) whose sum of squares is Fopt, by emulated curves at points (n, p) of the box."""
        parts = []
        for spot in self.spots:
            emulated = self.curves.emulated[spot]
            assert emulated is not None
            parts.append(self.curves.residuals(self.scenario, spot, emulated.process(points)))
        return np.concatenate(parts, axis=1) / np.sqrt(len(self.spots))

    @cached_property
    def fit(self) -> _Fit | None:
        """Fopt around the optimum of the emulated curves; None where there are too few sets for them."""
        emulated = [self.curves.emulated[spot] for spot in self.spots]
        if not all(each is not None and self.fopt.keys() & set(each.sets.tolist()) for each in emulated):
            return None
        errors = [self._errors(spot) for spot in self.spots]
        missed, variation = (float(np.mean(each)) for each in zip(*errors, strict=True))
        origin, _ = least_near(self.residuals, self.at, np.ones(self.at.size, dtype=bool))
        form = QuadraticForm.near(self.residuals, origin)
        optimum = form.minimum()
        least = form(optimum)
        known = float(self.best["fopt"]) if self.is_fitted else least
        # Smallest threshold, as a share of the median Fopt: simulated curves are not exact.
        margin = max(known, self.spread, missed, 1e-6 * float(np.median(list(self.fopt.values()))))
        q2 = 1.0 - missed / variation if variation > 0.0 else -np.inf
        return _Fit(form=form, optimum=optimum, least=least, margin=margin, q2=q2)

    def _errors(self, spot: str) -> tuple[float, float]:
        """Mean square error at a set left out of the emulator, and variation; sets that fit count more."""
        emulated = self.curves.emulated[spot]
        assert emulated is not None
        rows = np.flatnonzero([i in self.fopt for i in emulated.sets.tolist()])
        ordinates, left_out = emulated.ordinates[rows], emulated.process.left_out[rows]
        here, there = (
            self.curves.residuals(self.scenario, spot, each) for each in (ordinates, ordinates - left_out)
        )
        fopt = np.array([self.fopt[i] for i in emulated.sets[rows].tolist()])
        weights = 1.0 / (fopt + max(float(fopt.min()), 1e-3 * float(np.median(fopt)), 1e-300))
        mean = np.average(here, axis=0, weights=weights)
        squares = ((each**2).sum(axis=1) for each in (here - there, here - mean))
        missed, variation = (float(np.average(each, weights=weights)) for each in squares)
        return missed, variation

    @property
    def at(self) -> FloatArray:
        """Point of the box where the best set is."""
        values = np.array([[self.best[p.name] for p in self.parameters]])
        return _scaled(self.parameters, values)[0]

    def rows(self) -> Iterator[dict[str, Any]]:
        fit = self.fit
        fopt = float(self.best["fopt"])
        threshold = 2.0 * fopt if fit is None else (fopt if self.is_fitted else fit.least) + fit.margin
        for i, parameter in enumerate(self.parameters):
            row = {
                "spot": self.spot,
                "scenario": self.scenario.name,
                "parameter": parameter.name,
                "unit": parameter.unit,
                "value": self.best[parameter.name],
                "identifiability": UNCLEAR,
                "fopt_threshold": threshold,
                "n_as_good": sum(fopt <= threshold for fopt in self.fopt.values()),
                "q2": None if fit is None else fit.q2,
            }
            yield row | self._interval(parameter, i, fit) if fit is not None and fit.q2 >= LEAST_Q2 else row

    def _interval(self, parameter: Parameter, i: int, fit: _Fit) -> dict[str, Any]:
        low, high = fit.form.interval(i, fit.least + fit.margin)
        if self.is_fitted:
            value, error = self.best[parameter.name], self.mesh.get(parameter.name, 0.0)
            ends = np.clip([value - error, value + error], parameter.lower, parameter.upper).tolist()
            low = min(low, share_of_range(parameter, ends[0]))
            high = max(high, share_of_range(parameter, ends[1]))
        correlation = fit.form.correlation()
        others = np.abs(correlation[i])
        others[i] = -1.0
        partner = int(np.argmax(others)) if others.size > 1 else None
        return {
            "optimum": _value(parameter, float(fit.optimum[i])),
            "lower": _value(parameter, low),
            "upper": _value(parameter, high),
            "relative_width": high - low,
            "identifiability": word_of(high - low),
            "most_correlated_with": None if partner is None else self.parameters[partner].name,
            "correlation": None if partner is None else correlation[i, partner],
        }


def _scaled(parameters: tuple[Parameter, ...], values: FloatArray) -> FloatArray:
    """Values (n, p) as shares of their ranges, or of the logarithms of them."""
    columns = [
        [share_of_range(parameter, value) for value in column]
        for parameter, column in zip(parameters, values.T.tolist(), strict=True)
    ]
    return np.array(columns, dtype=np.float64).T


def _value(parameter: Parameter, share: float) -> float:
    if parameter.scale == "log":
        return float(parameter.lower * (parameter.upper / parameter.lower) ** share)
    return float(parameter.lower + share * (parameter.upper - parameter.lower))
