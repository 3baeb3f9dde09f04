"""Stiffness scaling: one simulation scores all multiples of its set.

Multiply every modulus by s, and with the same motion, friction and a contact
penalty in proportion to the stiffness, force and torque are multiplied by s; a
channel of degree 0, such as a displacement, does not change. So Fopt is a parabola
in s whose minimum is known from the simulation at s = 1. The scaled set is
simulated before it is reported.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl

from palpate.domain import (
    Design,
    FloatArray,
    Job,
    Parameter,
    Response,
    Scenario,
    Simulation,
    SimulationId,
    Status,
)
from palpate.stages.sampling import NO_ROW, accepted_by_all
from palpate.stages.scoring import score
from palpate.stages.selection import least_fopt, objectives
from palpate.stages.simulation import job_for
from palpate.stages.sweep import Simulations
from palpate.study.reading import Study

LEAST_SCALE = 1e-3
"""Smallest multiple for a range that starts at 0."""

SAME = 1e-3
"""Difference of curves, over the normaliser, up to which a simulation is as expected."""

_KEYS = ("spot", "scenario", "set_id")


def best_scales(
    study: Study, simulations: Sequence[Simulation], design: Design, measured: Mapping[str, Response]
) -> pl.DataFrame:
    """Find the multiple of every set at which it fits best, within the ranges.

    Parameters
    ----------
    study : Study
        Every modulus of every region must be searched.
    simulations : sequence of Simulation
    design : Design
    measured : mapping of spot name to Response

    Returns
    -------
    DataFrame
        Columns spot, scenario, set_id, scale and fopt, in the order of
        :func:`palpate.stages.selection.objectives`. No searched modulus leaves its range, and
        ``scale`` is 1 where a filter refuses the multiple.
    """
    # Fopt(s) = a s² - 2 b s + c, of which a, b and c are Fopt at s = 0, 1 and -1.
    c, here, mirrored = (_fopts(study, _scaled(study, simulations, s), measured) for s in (0.0, 1.0, -1.0))
    together = here.join(c, on=_KEYS, suffix="_c", maintain_order="left")
    together = together.join(mirrored, on=_KEYS, suffix="_mirrored", maintain_order="left")
    at_0, at_1, at_minus_1 = (together[name].to_numpy() for name in ("fopt_c", "fopt", "fopt_mirrored"))
    a, b = (at_1 + at_minus_1) / 2.0 - at_0, (at_minus_1 - at_1) / 4.0
    sets = together["set_id"].to_numpy()
    lower, upper = scale_bounds(design)
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.where(a > 0.0, b / a, 1.0)
    scale = np.clip(best, lower[sets], upper[sets])
    values = scaled_sets(design.parameters, design.values[sets], scale)
    scale[~accepted_by_all(study.filters, study.space, values)] = 1.0
    fopt = at_1 + (scale - 1.0) * (a * (scale + 1.0) - 2.0 * b)
    return together.select(_KEYS).with_columns(scale=pl.Series(scale), fopt=pl.Series(fopt))


def best_scaled_sets(
    simulations: Simulations,
    sweep: Sequence[Simulation],
    design: Design,
    measured: Mapping[str, Response],
) -> pl.DataFrame:
    """Choose the best multiple of any set for each spot and scenario, and simulate it.

    Parameters
    ----------
    simulations : Simulations
    sweep : sequence of Simulation
        Of every set at every spot.
    design : Design
    measured : mapping of spot name to Response

    Returns
    -------
    DataFrame
        One row per spot and scenario: spot, scenario, set_id, scale, fopt_scaled (of the
        multiplied curves), fopt, nmse_<channel> and r2_<channel> (of the simulation of that
        set), message and <region.parameter>. Ties go to the lower set_id. Where the simulation
        differs from what is expected, the message reports it.
    """
    study = simulations.study
    best = least_fopt(best_scales(study, sweep, design, measured))
    swept = {s.id: s for s in sweep}
    scenarios = {scenario.name: scenario for scenario in study.scenarios}
    winners = []
    for row in best.iter_rows(named=True):
        spot, set_id = row["spot"], row["set_id"]
        winner = _Winner(
            study=study,
            found=row,
            scenario=scenarios[row["scenario"]],
            simulation=swept[SimulationId(spot, set_id)],
            measured={spot: measured[spot]},
            values=scaled_sets(design.parameters, design.values[[set_id]], np.array([row["scale"]]))[0],
        )
        winners.append(winner)
    simulations.progress.begin("stiffness_scaling", len(winners))
    again = simulations.of([winner.job for winner in winners])
    rows = [winner.row(simulation) for winner, simulation in zip(winners, again, strict=True)]
    return pl.concat(rows, how="diagonal") if rows else pl.DataFrame()


@dataclass(frozen=True, kw_only=True)
class _Winner:
    """The best multiple at one spot in one scenario."""

    study: Study
    found: Mapping[str, Any]
    scenario: Scenario
    simulation: Simulation
    measured: Mapping[str, Response]
    values: FloatArray

    @property
    def job(self) -> Job:
        return job_for(self.study, self.found["spot"], NO_ROW, self.values, self.measured)

    def row(self, simulation: Simulation) -> pl.DataFrame:
        expected = self._scored(next(_scaled(self.study, [self.simulation], self.found["scale"])))
        kept = self._scored(simulation)
        head = {name: self.found[name] for name in (*_KEYS, "scale")}
        head |= {"fopt_scaled": expected["fopt"][0], "message": self._message(expected, kept, simulation)}
        values = {p.name: float(v) for p, v in zip(self.study.space.parameters, self.values, strict=True)}
        end = [] if kept.is_empty() else [kept.drop(_KEYS)]
        return pl.concat([pl.DataFrame([head]), *end, pl.DataFrame([values])], how="horizontal")

    def _scored(self, simulation: Simulation) -> pl.DataFrame:
        return objectives(
            score([simulation], self.measured, self.study.scoring, [self.scenario]), [self.scenario]
        )

    def _message(self, expected: pl.DataFrame, kept: pl.DataFrame, simulation: Simulation) -> str:
        if kept.is_empty():
            why = simulation.message or simulation.status.remedy
            why = why if simulation.status is not Status.OK else "its curves do not reach far enough"
            return f"this multiple could not be simulated ({simulation.status}: {why})"
        scaled, fopt = expected["fopt"][0], kept["fopt"][0]
        # Curves that differ by δ normalisers change a sum of squares F by at most 2 δ √F + δ².
        weight = sum(self.scenario.weights.values())
        if abs(fopt - scaled) <= 2.0 * SAME * np.sqrt(weight * scaled) + weight * SAME**2:
            return "as expected"
        return (
            f"expected Fopt = {scaled:.4g}: the response of solver '{self.study.solver.name}' is "
            "not in proportion to the moduli (is its contact penalty?)"
        )


def scale_bounds(design: Design) -> tuple[FloatArray, FloatArray]:
    """Least and largest multiple of each set (n_sets,) that keeps every modulus in its range."""
    lower, upper = np.full(design.n_sets, LEAST_SCALE), np.full(design.n_sets, np.inf)
    for parameter, values in zip(design.parameters, design.values.T, strict=True):
        if parameter.kind != "modulus":
            continue
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([parameter.lower / values, parameter.upper / values])
        # A modulus of 0 does not change.
        ends[:, values == 0.0] = [[-np.inf], [np.inf]]
        lower, upper = np.maximum(lower, ends.min(axis=0)), np.minimum(upper, ends.max(axis=0))
    # Rounding, or a multiple that the limit above forbids: the set itself always fits.
    return np.minimum(lower, 1.0), np.maximum(upper, 1.0)


def scaled_sets(parameters: Sequence[Parameter], values: FloatArray, scale: FloatArray) -> FloatArray:
    """Multiply the moduli of each set (n_sets, n_parameters) by its scale (n_sets,)."""
    columns = [
        np.clip(column * scale, p.lower, p.upper) if p.kind == "modulus" else column
        for p, column in zip(parameters, values.T, strict=True)
    ]
    return np.stack(columns, axis=1)


def _fopts(study: Study, simulations: Iterable[Simulation], measured: Mapping[str, Response]) -> pl.DataFrame:
    scores = score(simulations, measured, study.scoring, study.scenarios)
    return objectives(scores, study.scenarios).select(*_KEYS, "fopt")


def _scaled(study: Study, simulations: Iterable[Simulation], scale: float) -> Iterator[Simulation]:
    for simulation in simulations:
        if simulation.response is None:
            yield simulation
            continue
        multiplied = {
            name: replace(curve, ordinate=scale ** study.degree(name) * curve.ordinate)
            for name, curve in simulation.response.curves.items()
        }
        yield replace(simulation, response=Response(curves=multiplied))
