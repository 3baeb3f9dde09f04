"""A local search from each selected set, for a more exact optimum than the sweep's.

Bounded least squares on r = √(weight/N) · (sim − exp)/normaliser over all
channels of a scenario, whose Σ r² is exactly that scenario's Fopt. The result is
a separate row, never one of the design.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic
from types import MappingProxyType
from typing import Any

import numpy as np
import polars as pl
from scipy.optimize import least_squares

from palpate.domain import Design, FloatArray, Limb, Response, Scenario, Simulation
from palpate.executors.attempts import simulate_alone
from palpate.progress import SILENT, Progress
from palpate.run.result import FitResult
from palpate.stages.sampling import NO_ROW
from palpate.stages.scoring import compare, point_weights, residual_scale, score
from palpate.stages.selection import objectives
from palpate.stages.simulation import job_for
from palpate.study.reading import Study

PROBE = 1e-3
"""Step of the central differences as a share of each range: above a solver's tolerance."""

TOLERANCE = 1e-3
"""Relative change of Fopt, and step as a share of the ranges, at which a search ends.

A solver balances its forces to about 1e-4; a tighter search would follow its rounding.
"""

NOTE_S = 10.0
"""Shortest time between two progress messages of a search."""

MOST_STEPS = 40
"""Most trial steps of one search, each with two simulations per parameter for the slopes."""


def refine(
    study: Study,
    selection: pl.DataFrame,
    design: Design,
    limbs: Mapping[str, Limb],
    measured: Mapping[str, Response],
    progress: Progress = SILENT,
) -> FitResult:
    """Search locally, within the ranges, from each selected set.

    Parameters
    ----------
    study : Study
    selection : DataFrame
        As :func:`palpate.stages.selection.select` returns it.
    design : Design
    limbs, measured : mapping of spot name to Limb, Response
    """
    scenarios = {scenario.name: scenario for scenario in study.scenarios}
    progress.begin("refine", len(selection))
    rows: list[pl.DataFrame] = []
    responses: dict[tuple[str, str], Response] = {}
    for start in selection.iter_rows(named=True):
        spot, name = start["spot"], start["scenario"]
        search = _Search(
            study=study,
            spot=spot,
            scenario=scenarios[name],
            limb=limbs.get(spot),
            measured=measured[spot],
            progress=progress,
        )
        message = search.run(design.values[start["set_id"]])
        rows.append(search.row(start, message))
        if search.best is not None and search.best.response is not None:
            responses[spot, name] = search.best.response
        progress.step(message)
    table = pl.concat(rows, how="diagonal") if rows else pl.DataFrame()
    return FitResult(table=table, responses=MappingProxyType(responses))


@dataclass(kw_only=True)
class _Search:
    """One local search, and its best simulation."""

    study: Study
    spot: str
    scenario: Scenario
    limb: Limb | None
    measured: Response
    progress: Progress = SILENT
    n_simulations: int = 0
    failure: str = ""
    noted: float = field(default_factory=monotonic)
    best_fopt: float = np.inf
    best_values: FloatArray = field(default_factory=lambda: np.zeros(0))
    best: Simulation | None = None
    _seen: dict[bytes, FloatArray] = field(default_factory=dict)

    @property
    def lower(self) -> FloatArray:
        return np.array([p.lower for p in self.study.space.parameters])

    @property
    def upper(self) -> FloatArray:
        return np.array([p.upper for p in self.study.space.parameters])

    def run(self, values: FloatArray) -> str:
        """Search from ``values`` (n_parameters,); returns why the search ended."""
        span = self.upper - self.lower
        start = np.clip((values - self.lower) / span, 0.0, 1.0)
        # The start itself, exactly as the sweep simulated it.
        if self.residuals(values) is None:
            return (
                f"the selected set could not be simulated again ({self.failure}); the sweep's result is kept"
            )
        try:
            found = least_squares(
                self._vector,
                start,
                jac=self._slopes,
                bounds=(0.0, 1.0),
                xtol=TOLERANCE,
                ftol=TOLERANCE,
                gtol=None,
                max_nfev=MOST_STEPS,
            )
        except _NoSlopeError as error:
            return str(error)
        return "converged" if found.status > 0 else f"stopped after {MOST_STEPS} steps; the best set is kept"

    def row(self, start: Mapping[str, Any], message: str) -> pl.DataFrame:
        """Make the row of :class:`FitResult` for the best simulation seen."""
        begin = pl.DataFrame(
            {"spot": [self.spot], "scenario": [self.scenario.name]}
            | {"start_set_id": [start["set_id"]], "start_fopt": [start["fopt"]], "message": [message]}
        )
        if self.best is None:
            return begin
        scores = score([self.best], {self.spot: self.measured}, self.study.scoring)
        end = objectives(scores, [self.scenario]).drop("spot", "scenario", "set_id")
        values = pl.DataFrame(
            {p.name: [float(v)] for p, v in zip(self.study.space.parameters, self.best_values, strict=True)}
        )
        n_simulations = pl.DataFrame({"n_simulations": [self.n_simulations]})
        return pl.concat([begin, end, n_simulations, values], how="horizontal")

    # ------------------------------------------------------------- for the search

    def _values(self, u: FloatArray) -> FloatArray:
        return np.clip(self.lower + u * (self.upper - self.lower), self.lower, self.upper)

    def _vector(self, u: FloatArray) -> FloatArray:
        """Residuals; so large for a set that cannot be simulated that the step is rejected."""
        residuals = self.residuals(self._values(u))
        if residuals is None:
            n_points = next(iter(self._seen.values())).size
            return np.full(n_points, np.sqrt(10.0 * (1.0 + self.best_fopt) / n_points))
        return residuals

    def _slopes(self, u: FloatArray) -> FloatArray:
        """Central differences (n_points, n_parameters), one-sided of second order at a bound."""
        columns = []
        for i in range(u.size):
            shifts = (-1.0, 1.0) if PROBE <= u[i] <= 1.0 - PROBE else (0.0, 1.0, 2.0)
            direction = 1.0 if u[i] < 0.5 else -1.0
            points = []
            for shift in shifts:
                probe = u.copy()
                probe[i] += direction * shift * PROBE
                residuals = self.residuals(self._values(probe))
                if residuals is None:
                    raise _NoSlopeError(
                        f"stopped: a set next to {self._values(u).tolist()} could not be simulated "
                        f"({self.failure}); the best set so far is kept"
                    )
                points.append(residuals)
            columns.append(_derivative(points) * direction / PROBE)
        return np.stack(columns, axis=1)

    def residuals(self, values: FloatArray) -> FloatArray | None:
        """Weighted residuals (n_points,) of one set, or None where it is not to be ranked."""
        key = values.tobytes()
        if key not in self._seen:
            residuals = self._simulated_residuals(values)
            if residuals is None:
                return None
            self._seen[key] = residuals
        return self._seen[key]

    def _simulated_residuals(self, values: FloatArray) -> FloatArray | None:
        job = job_for(self.study, self.spot, NO_ROW, values, {self.spot: self.measured})
        self.n_simulations += 1
        simulation = simulate_alone(self.study.solver, job, self.limb)
        self._note()
        if simulation.status not in self.study.scoring.ranked_statuses:
            self.failure = f"{simulation.status}: {simulation.message or simulation.status.remedy}"
            return None
        parts = [
            self._channel_residuals(simulation, channel, weight)
            for channel, weight in self.scenario.weights.items()
            if weight > 0.0
        ]
        if any(part is None for part in parts):
            self.failure = "its curves do not reach far enough"
            return None
        residuals = np.concatenate([part for part in parts if part is not None])
        if (fopt := float(residuals @ residuals)) < self.best_fopt:
            self.best_fopt, self.best_values, self.best = fopt, values, simulation
        return residuals

    def _note(self) -> None:
        if monotonic() - self.noted > NOTE_S:
            self.noted = monotonic()
            self.progress.note(
                f"refine {self.spot}, scenario {self.scenario.name}: {self.n_simulations} simulations, "
                f"Fopt {self.best_fopt:.4g}"
            )

    def _channel_residuals(self, simulation: Simulation, channel: str, weight: float) -> FloatArray | None:
        """√(weight·w/Σw)·(sim − exp)/normaliser (n,); points that are not covered have residual 0."""
        curve, rules = self.measured[channel], self.study.scoring
        compared = compare(simulation, curve)
        covered = np.isfinite(compared.values)
        coverage = float(np.average(covered, weights=point_weights(curve, rules.point_weighting)))
        if compared.status not in rules.ranked_statuses or not rules.is_enough(coverage):
            return None
        differences = np.where(covered, compared.values - curve.ordinate, 0.0)
        residuals: FloatArray = differences * residual_scale(curve, rules, weight, covered)
        return residuals


class _NoSlopeError(Exception):
    """A set of the central differences cannot be simulated."""


def _derivative(points: Sequence[FloatArray]) -> FloatArray:
    if len(points) == 2:
        difference: FloatArray = (points[1] - points[0]) / 2.0
        return difference
    one_sided: FloatArray = (-3.0 * points[0] + 4.0 * points[1] - points[2]) / 2.0
    return one_sided
