"""Scores of simulated curves against the measured ones, by the score of the study.

Simulated curves are interpolated onto the measured abscissae branch by branch, because a twist is a path
and not a function of the angle. A phase is scored over its own points, with the rest of its curve at hand.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from palpate import _core
from palpate.domain import (
    BoolArray,
    Curve,
    FloatArray,
    Normaliser,
    Response,
    Scenario,
    Simulation,
    Status,
    channel_of,
    weighed_phases,
)
from palpate.errors import CurveError, PluginError, ScoringError
from palpate.plugins.guard import answering_for
from palpate.plugins.score import Score, ScoringRules, weighted

Swept = Mapping[tuple[str, str], FloatArray]
"""Simulated ordinates at the measured points by spot and channel: (n_sets, n_points), NaN where none."""

SCHEMA = {
    "spot": pl.String,
    "set_id": pl.Int64,
    "channel": pl.String,
    "nmse": pl.Float64,
    "r2": pl.Float64,
    "coverage": pl.Float64,
    "status": pl.String,
    "message": pl.String,
}
"""Columns of the scores. ``nmse`` is the misfit by the study's score, NMSE by itself, and null where a set is
not to be ranked; ``status`` marks what failed."""


def scored_points(score: Score, curve: Curve, name: str) -> FloatArray:
    """Weight (n,) of each measured point of a channel, or phase such as ``torque/unload``.

    Raises
    ------
    ScoringError
        No point counts, or the curve lacks what the weights are made from.
    """
    counted = curve.counted(name)
    if not counted.any():
        raise ScoringError("no measured point is in this phase; weigh the channel, or its other phase")
    with answering_for(score, f"weighing the points of '{name}'"):
        points = np.asarray(score.weights(curve) * counted, dtype=np.float64)
    if points.shape != counted.shape or not (np.isfinite(points) & (points >= 0.0)).all():
        raise PluginError(f"score '{score.name}': weights(measured) gives one number ≥ 0 for each point")
    if not points.any():
        raise ScoringError(f"score '{score.name}' has no residual there; weigh something else")
    return points


def check_scorable(
    measured: Mapping[str, Response], rules: ScoringRules, scenarios: Sequence[Scenario] = ()
) -> None:
    """Refuse, before anything is simulated, a measured curve that cannot be scored or weighed.

    Raises
    ------
    ScoringError
        Naming spot and channel.
    """
    for spot, response in measured.items():
        for name, curve in _curves(response, scenarios).items():
            try:
                used = scored_points(rules.score, curve, name) > 0.0
                same = weighted(rules.score, curve, curve.ordinate, used, 1.0)
            except ScoringError as error:
                raise ScoringError(f"spot '{spot}', channel '{name}': {error}") from error
            if same.any():
                raise PluginError(
                    f"score '{rules.score.name}': the measured curve of spot '{spot}', channel '{name}', has "
                    "residuals against itself; they must be zero"
                )


def _curves(response: Response, scenarios: Sequence[Scenario]) -> dict[str, Curve]:
    """Measured curve of each channel, and of each phase that a scenario weighs."""
    phases = {name: response.curves.get(channel_of(name)) for name in weighed_phases(scenarios)}
    return {**response.curves, **{name: curve for name, curve in phases.items() if curve is not None}}


def score(
    simulations: Iterable[Simulation],
    measured: Mapping[str, Response],
    rules: ScoringRules,
    scenarios: Sequence[Scenario] = (),
) -> pl.DataFrame:
    """Score every simulation in every measured channel.

    Parameters
    ----------
    scenarios : sequence of Scenario
        The phases that they weigh are scored too, under names such as ``torque/unload``.

    Returns
    -------
    DataFrame
        Columns as in ``SCHEMA``, one row per simulation and measured channel, or phase, ordered by
        spot as measured, then set_id, then channel. ``nmse`` is null unless the status is
        one that ``rules`` rank, and the coverage enough. ``r2`` is the
        coefficient of determination, with the same weights.

    Raises
    ------
    ScoringError
        A degenerate normaliser, or no standard deviation to weigh by.
    """
    check_scorable(measured, rules, scenarios)
    by_spot: dict[str, list[Simulation]] = {spot: [] for spot in measured}
    for simulation in simulations:
        by_spot[simulation.id.spot].append(simulation)
    rows: list[dict[str, object]] = []
    for spot, of_spot in by_spot.items():
        of_spot.sort(key=lambda s: s.id.set_id)
        named = _curves(measured[spot], scenarios).items()
        columns = [_score_channel(of_spot, name, curve, rules) for name, curve in named]
        rows += [row for of_set in zip(*columns, strict=True) for row in of_set]
    return pl.DataFrame(rows, schema=SCHEMA)


def _score_channel(
    simulations: Sequence[Simulation], name: str, measured: Curve, rules: ScoringRules
) -> list[dict[str, object]]:
    variance = relative_variance(measured, rules.score, name)
    scored = _scored(simulations, measured, rules.score, measured.counted(name))
    return [
        _row(s, name, score, 1.0 - score.nmse / variance, rules)
        for s, score in zip(simulations, scored, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _Scored:
    """Misfit and coverage of one simulation, NaN and 0 where there is no curve."""

    status: Status
    message: str
    nmse: float = np.nan
    coverage: float = 0.0


def _scored(
    simulations: Sequence[Simulation], measured: Curve, score: Score, counted: BoolArray
) -> list[_Scored]:
    """Score all sets together that were simulated at the same abscissae, as in a sweep."""
    curves = [_curve(s, measured.channel) for s in simulations]
    scored = [_Scored(status, message) for _, status, message in curves]
    ordinates: dict[bytes, dict[int, FloatArray]] = {}
    for i, (curve, _, _) in enumerate(curves):
        if curve is not None:
            ordinates.setdefault(curve.abscissa.tobytes(), {})[i] = curve.ordinate
    for abscissa, by_set in ordinates.items():
        batch = np.stack(list(by_set.values()))
        try:
            with answering_for(score, f"scoring '{measured.channel}'"):
                found = score.misfits(measured, counted, np.frombuffer(abscissa), batch)
        except CurveError as error:
            for i in by_set:
                scored[i] = _Scored(*_unreadable(simulations[i], str(error)))
            continue
        for i, *numbers in zip(by_set, *found, strict=True):
            scored[i] = _Scored(scored[i].status, scored[i].message, *map(float, numbers))
    return scored


@dataclass(frozen=True, slots=True)
class Compared:
    """A simulated curve at the measured abscissae: (n,), NaN where it does not reach."""

    values: FloatArray
    status: Status
    message: str


def compare(simulation: Simulation, measured: Curve) -> Compared:
    """Interpolate a simulated curve at the measured abscissae, branch by branch."""
    nothing = np.full(measured.abscissa.shape, np.nan)
    curve, status, message = _curve(simulation, measured.channel)
    if curve is None:
        return Compared(nothing, status, message)
    try:
        values, _ = _core.interpolate(curve.abscissa, curve.ordinate, measured.abscissa)
    except CurveError as error:
        return Compared(nothing, *_unreadable(simulation, str(error)))
    return Compared(values, status, message)


def at_measured(simulations: Iterable[Simulation], measured: Mapping[str, Response], n_sets: int) -> Swept:
    """Read every simulated curve at the measured points.

    Parameters
    ----------
    simulations : iterable of Simulation
        Of the sweep; points that they did not reach are NaN.
    n_sets : int
        Rows of the design.
    """
    swept = {
        (spot, name): np.full((n_sets, curve.abscissa.size), np.nan)
        for spot, response in measured.items()
        for name, curve in response.curves.items()
    }
    for simulation in simulations:
        spot, set_id = simulation.id
        if simulation.response is not None:
            for name, curve in measured[spot].curves.items():
                swept[spot, name][set_id] = compare(simulation, curve).values
    return swept


def _curve(simulation: Simulation, channel: str) -> tuple[Curve | None, Status, str]:
    """Find the curve of a channel, or why there is none."""
    if simulation.response is None:
        return None, simulation.status, simulation.message
    curve = simulation.response.curves.get(channel)
    if curve is None:
        return None, *_unreadable(simulation, f"the solver gave no curve '{channel}'")
    return curve, simulation.status, simulation.message


def _unreadable(simulation: Simulation, message: str) -> tuple[Status, str]:
    """Reason why a curve cannot be used, unless the simulation failed with its message."""
    status = Status.UNREADABLE if simulation.status is Status.OK else simulation.status
    return status, simulation.message or message


def relative_variance(measured: Curve, score: Score, name: str) -> float:
    """Misfit of the constant curve at the mean, which is misfit/(1 − R²).

    NaN for a flat measured curve, and for a score that is not linear, which has no R².
    """
    counted, ordinate = measured.counted(name), measured.ordinate
    try:
        _core.normaliser(ordinate[counted], Normaliser.STD.value)
    except ScoringError:
        return np.nan
    if not score.linear:
        return np.nan
    points = scored_points(score, measured, name)
    return score.misfit_of(measured, ordinate - np.average(ordinate, weights=points), points > 0.0)


def _row(
    simulation: Simulation, channel: str, scored: _Scored, r2: float, rules: ScoringRules
) -> dict[str, object]:
    nmse, coverage, message = scored.nmse, scored.coverage, scored.message
    is_enough = rules.is_enough(coverage)
    if scored.status is Status.OK and not is_enough:
        message = f"covers {coverage:.3f} of the measured '{channel}', less than {rules.minimum_coverage:g}"
    ranked = scored.status in rules.ranked_statuses and is_enough and np.isfinite(nmse)
    return {
        "spot": simulation.id.spot,
        "set_id": simulation.id.set_id,
        "channel": channel,
        "nmse": nmse if ranked else None,
        "r2": r2 if ranked and np.isfinite(r2) else None,
        "coverage": coverage,
        "status": scored.status.value,
        "message": message,
    }
