"""Identifiability of the parameters, from the curves of the sweep.

Every simulated curve, read at the measured points, is fitted as a polynomial of the parameters
(:mod:`~palpate_certainty.surrogate`), which makes Fopt a quadratic over the box of their ranges. Its minimum
is the fitted optimum. The interval of a parameter ends where Fopt passes a threshold, with the other
parameters adjusted within their ranges. It needs no further simulation.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import polars as pl

from palpate.api import Design, FloatArray, IntArray, Parameter, Response, Scenario
from palpate.api.fit import (
    ALL_SPOTS,
    DISAGREEMENTS,
    IDENTIFIABILITY,
    UNCLEAR,
    FitResult,
    IdentifiabilityResult,
    channel_of,
    share_of_range,
    word_of,
)
from palpate.api.runs import Study, Swept, answering_for, objectives, scored_points
from palpate_certainty.surrogate import LEAST_Q2, QuadraticForm, fit_slopes, together

FLOOR = 1e-6
"""Smallest threshold, as a share of the median Fopt: simulated curves are not exact."""

APART = 0.05
"""Share of a range by which two fits must differ to be called in disagreement."""

N_MOVES = 3
"""Iterations that move the polynomial to its optimum, where its slopes are most accurate."""


def assess_identifiability(
    study: Study,
    design: Design,
    measured: Mapping[str, Response],
    swept: Swept,
    scores: pl.DataFrame,
    selection: pl.DataFrame,
    generalisation: pl.DataFrame,
    fit: FitResult,
) -> IdentifiabilityResult:
    """Find the interval of every parameter at every spot in every scenario, and over all spots.

    Parameters
    ----------
    study : Study
    design : Design
    measured : mapping of spot name to Response
    swept : mapping of (spot, channel) to (n_sets, n_points) array
        As :func:`palpate.scoring.scores.at_measured` returns it.
    scores, selection, generalisation : DataFrame
        As :mod:`~palpate.scoring.scores`, :mod:`~palpate.scoring.selection` and
        :mod:`~palpate.scoring.generalisation` return them.
    fit : FitResult
        Where it has a row for a spot, or for all of them together, that is the best set. No interval
        is narrower than what the mesh leaves open.
    """
    curves = _Curves(study=study, measured=measured, swept=swept, ranked=objectives(scores, study.scenarios))
    chosen = {(row["spot"], row["scenario"]): row for row in selection.iter_rows(named=True)} | fit.of_spots()
    scenarios = {scenario.name: scenario for scenario in study.scenarios}
    cases = [
        curves.case(spot, scenarios[name], [spot], best, design, fit) for (spot, name), best in chosen.items()
    ]
    joint = fit.joint(study.generalise_by)
    of_all = generalisation if joint.is_empty() else joint
    if len(measured) > 1 and not of_all.is_empty():
        spots = of_all["spot"].to_list()
        best = of_all.row(0, named=True) | {"fopt": of_all["fopt"].mean()}
        cases.append(curves.case(ALL_SPOTS, scenarios[study.generalise_by], spots, best, design, fit))
    return IdentifiabilityResult(
        identifiability=pl.DataFrame([row for case in cases for row in case.rows()], schema=IDENTIFIABILITY),
        disagreements=pl.DataFrame(
            [row for a, b in combinations(cases, 2) for row in _disagreement(a, b)], schema=DISAGREEMENTS
        ),
    )


@dataclass(frozen=True, kw_only=True)
class _Curves:
    """Simulated and measured curves as residuals whose sum of squares is Fopt."""

    study: Study
    measured: Mapping[str, Response]
    swept: Swept
    ranked: pl.DataFrame

    def case(
        self,
        label: str,
        scenario: Scenario,
        spots: Sequence[str],
        best: Mapping[str, Any],
        design: Design,
        fit: FitResult,
    ) -> "_Case":
        """Collect the fits of some spots together in a scenario."""
        rows = self.ranked.filter(pl.col("scenario") == scenario.name, pl.col("spot").is_in(list(spots)))
        means = rows.group_by("set_id").agg(pl.len(), pl.col("fopt").mean())
        means = means.filter(pl.col("len") == len(spots)).sort("set_id")
        sets = means["set_id"].to_numpy()
        weighted = [
            (spot, name, weight)
            for spot in spots
            for name, weight in scenario.weighed.items()
            if channel_of(name) in self.measured[spot].curves
        ]
        parts = [self._residuals(*each, sets) for each in weighted]
        spread = sum(self._spread(*each) for each in weighted)
        return _Case(
            spot=label,
            scenario=scenario,
            design=design,
            sets=sets,
            fopt=means["fopt"].to_numpy(),
            residuals=np.concatenate(parts, axis=1) / np.sqrt(len(spots)),
            spread=spread / len(spots),
            best=best,
            is_fitted="fit" in best,
            mesh=fit.mesh_errors(label, scenario.name),
        )

    def _spread(self, spot: str, name: str, weight: float) -> float:
        """Weighted NMSE between curves that are one measured standard deviation apart."""
        curve = self.measured[spot][channel_of(name)]
        if curve.std is None:
            return 0.0
        score = self.study.scoring.score
        scale = score.scale(curve, scored_points(score, curve, name) > 0.0, weight)
        return float(((scale * curve.std) ** 2).sum())

    def _residuals(self, spot: str, name: str, weight: float, sets: IntArray) -> FloatArray:
        """Residuals (n_sets, n_points) of one channel, or phase, at one spot."""
        channel = channel_of(name)
        curve, values = self.measured[spot][channel], self.swept[spot, channel][sets]
        # A point that hardly any set reaches is left out.
        if not sets.size:
            return values
        score = self.study.scoring.score
        reached = (np.isfinite(values).mean(axis=0) > 0.5) & (scored_points(score, curve, name) > 0.0)
        # A set that does not reach all of them has residuals that are NaN.
        with answering_for(score, f"scoring '{name}'"):
            return score.weighted(curve, values, reached, weight)[:, reached]


@dataclass(frozen=True, kw_only=True)
class _Fit:
    """Fopt as a quadratic over the box of the ranges."""

    form: QuadraticForm
    optimum: FloatArray
    least: float
    margin: float
    q2: float

    def beyond(self) -> QuadraticForm:
        """Fopt above the least, in margins: up to 1 a set is about as good."""
        scale = np.sqrt(self.margin)
        rest = (self.form.rest - self.least) / self.margin
        return QuadraticForm(matrix=self.form.matrix / scale, offset=self.form.offset / scale, rest=rest)


@dataclass(frozen=True, kw_only=True)
class _Case:
    """The fit of one spot, or of all, in one scenario."""

    spot: str
    scenario: Scenario
    design: Design
    sets: IntArray
    fopt: FloatArray
    residuals: FloatArray
    spread: float
    best: Mapping[str, Any]
    is_fitted: bool
    mesh: Mapping[str, float]

    @cached_property
    def fit(self) -> _Fit | None:
        """Fitted Fopt, moved to its optimum; None if it is not reliable."""
        complete = np.isfinite(self.residuals).all(axis=1)
        at = _scaled(self.design.parameters, self.design.values[self.sets[complete]])
        origin, found = self.at, None
        for _ in range(N_MOVES):
            slopes = fit_slopes(at - origin, self.residuals[complete], self.fopt[complete])
            if slopes is None:
                return None
            form = slopes.form(origin)
            origin = form.minimum()
            least = form(origin)
            known = float(self.best["fopt"]) if self.is_fitted else least
            margin = max(known, self.spread, slopes.error, FLOOR * float(np.median(self.fopt)))
            found = _Fit(form=form, optimum=origin, least=least, margin=margin, q2=slopes.q2)
        return found

    @property
    def is_usable(self) -> bool:
        """Whether the fit predicts sets that were left out of it."""
        return self.fit is not None and self.fit.q2 >= LEAST_Q2

    @property
    def at(self) -> FloatArray:
        """Where the best set is in the box."""
        values = np.array([[self.best[p.name] for p in self.design.parameters]])
        at: FloatArray = _scaled(self.design.parameters, values)[0]
        return at

    def rows(self) -> Iterator[dict[str, Any]]:
        fit = self.fit
        fopt = float(self.best["fopt"])
        threshold = 2.0 * fopt if fit is None else (fopt if self.is_fitted else fit.least) + fit.margin
        for i, parameter in enumerate(self.design.parameters):
            row = {
                "spot": self.spot,
                "scenario": self.scenario.name,
                "parameter": parameter.name,
                "unit": parameter.unit,
                "value": self.best[parameter.name],
                "identifiability": UNCLEAR,
                "fopt_threshold": threshold,
                "n_as_good": int((self.fopt <= threshold).sum()),
                "q2": None if fit is None else fit.q2,
            }
            yield row | self._interval(parameter, i, fit) if fit is not None and self.is_usable else row

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
            "most_correlated_with": None if partner is None else self.design.parameters[partner].name,
            "correlation": None if partner is None else correlation[i, partner],
        }


def _disagreement(a: _Case, b: _Case) -> Iterator[dict[str, Any]]:
    """Rows on two fits at a spot that have no point in common, where no set is about as good in both."""
    channels = [list(case.scenario.weighed) for case in (a, b)]
    is_shared = any(map(a.scenario.fits, channels[1])) or any(map(b.scenario.fits, channels[0]))
    if a.spot != b.spot or is_shared or not (a.is_usable and b.is_usable):
        return
    fits = [case.fit for case in (a, b) if case.fit is not None]
    first, second = (fit.beyond() for fit in fits)
    if max(together([(w, first), (1.0 - w, second)]) for w in np.linspace(0.05, 0.95, 19)) <= 1.0:
        return
    by_name = [{row["parameter"]: row for row in case.rows()} for case in (a, b)]
    seen = [
        (i, parameter)
        for i, parameter in enumerate(a.design.parameters)
        if all(rows[parameter.name]["identifiability"] != "not" for rows in by_name)
    ]
    if seen and max(abs(fits[0].optimum[i] - fits[1].optimum[i]) for i, _ in seen) <= APART:
        return
    head = {"spot": a.spot, "first": " + ".join(channels[0]), "second": " + ".join(channels[1])}
    if not seen:
        yield head
    for _, parameter in seen:
        optima = (rows[parameter.name]["optimum"] for rows in by_name)
        values = dict(zip(("first_optimum", "second_optimum"), optima, strict=True))
        yield {**head, "parameter": parameter.name, "unit": parameter.unit, **values}


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
