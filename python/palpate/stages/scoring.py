"""How far each simulated curve is from the measured one.

NMSE of a channel = Σ w (sim − exp)² / (Σ w · normaliser²), with equal weights or with
w = 1/std² of each measured point. Simulated curves are interpolated onto the measured
abscissae branch by branch, because a twist is a path and not a function of the angle.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import polars as pl

from palpate import _core
from palpate.domain import Curve, FloatArray, Normaliser, PointWeights, Response, Simulation, Status
from palpate.errors import CurveError, ScoringError

if TYPE_CHECKING:
    from palpate.study.reading import Study

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
"""Columns of the scores. ``nmse`` is null where a set is not to be ranked; ``status`` marks what failed."""


LEAST_STD_SHARE = 0.1
"""Share of a curve's root mean square std below which no point's std counts.

Otherwise one point that happens to have next to none would count for all the others.
"""


def point_weights(curve: Curve, weights: PointWeights) -> FloatArray | None:
    """How much each measured point counts: (n,), or None where all count the same.

    Raises
    ------
    ScoringError
        The curve has no standard deviation, or only zeros, to weigh by.
    """
    if weights is PointWeights.EQUAL:
        return None
    if curve.std is None:
        raise ScoringError(
            "no point has a standard deviation; give repeated presses or a loader that states one, "
            'or set scoring.weights = "equal"'
        )
    scale = float(np.sqrt(np.mean(curve.std**2)))
    if scale == 0.0:
        raise ScoringError('every standard deviation is zero; set scoring.weights = "equal"')
    return 1.0 / np.maximum(curve.std / scale, LEAST_STD_SHARE) ** 2


def is_enough(coverage: float, minimum_coverage: float) -> bool:
    """Whether a coverage suffices; a share of counted points is exact only up to rounding."""
    return coverage >= minimum_coverage - 1e-12


def ranked_statuses(*, rank_partial: bool) -> tuple[Status, ...]:
    """Statuses of simulations whose curves are ranked."""
    return (Status.OK, Status.DIVERGED) if rank_partial else (Status.OK,)


def check_scorable(
    measured: Mapping[str, Response], normaliser: Normaliser, weights: PointWeights = PointWeights.EQUAL
) -> None:
    """Refuse, before anything is simulated, a measured curve that cannot be normalised or weighed.

    Raises
    ------
    ScoringError
        Naming spot, channel and normaliser.
    """
    for spot, response in measured.items():
        for name, curve in response.curves.items():
            try:
                _core.nmse(curve.ordinate, curve.ordinate, normaliser.value, point_weights(curve, weights))
            except ScoringError as error:
                raise ScoringError(f"spot '{spot}', channel '{name}': {error}") from error


def score(
    simulations: Iterable[Simulation],
    measured: Mapping[str, Response],
    *,
    normaliser: Normaliser,
    minimum_coverage: float,
    weights: PointWeights = PointWeights.EQUAL,
    rank_partial: bool = False,
) -> pl.DataFrame:
    """Score every simulation in every measured channel.

    Parameters
    ----------
    simulations : iterable of Simulation
    measured : mapping of spot name to Response
    normaliser : Normaliser
    minimum_coverage : float
        Smallest share of measured points, each counted with its weight, that a simulated curve
        must reach to be ranked.
    weights : PointWeights
    rank_partial : bool
        Whether to rank what a simulation that diverged had reached, where that covers enough.

    Returns
    -------
    DataFrame
        Columns as in ``SCHEMA``, one row per simulation and measured channel, ordered by
        spot as measured, then set_id, then channel. ``nmse`` is null unless the status is
        ok, or diverged with ``rank_partial``, and the coverage enough. ``r2`` is the
        coefficient of determination, with the same weights.

    Raises
    ------
    ScoringError
        A degenerate normaliser, or no standard deviation to weigh by.
    """
    check_scorable(measured, normaliser, weights)
    by_spot: dict[str, list[Simulation]] = {spot: [] for spot in measured}
    for simulation in simulations:
        by_spot[simulation.job.spot].append(simulation)
    rows: list[dict[str, object]] = []
    ranked = ranked_statuses(rank_partial=rank_partial)
    for spot, of_spot in by_spot.items():
        of_spot.sort(key=lambda s: s.job.set_id)
        columns = [
            _score_channel(
                of_spot, curve, normaliser, point_weights(curve, weights), minimum_coverage, ranked
            )
            for curve in measured[spot].curves.values()
        ]
        rows += [row for of_set in zip(*columns, strict=True) for row in of_set]
    return pl.DataFrame(rows, schema=SCHEMA)


def score_as_studied(
    study: "Study", simulations: Iterable[Simulation], measured: Mapping[str, Response]
) -> pl.DataFrame:
    """Score with the normaliser, weights, coverage and ranking that a study asks for."""
    return score(
        simulations,
        measured,
        normaliser=study.normaliser,
        minimum_coverage=study.minimum_coverage,
        weights=study.weights,
        rank_partial=study.rank_partial,
    )


def _score_channel(
    simulations: Sequence[Simulation],
    measured: Curve,
    normaliser: Normaliser,
    weights: FloatArray | None,
    minimum_coverage: float,
    ranked: Collection[Status],
) -> list[dict[str, object]]:
    variance = _variance(measured.ordinate, normaliser, weights)
    scored = _scored(simulations, measured, normaliser, weights)
    return [
        _row(s, measured.channel, score, minimum_coverage, 1.0 - score.nmse / variance, ranked)
        for s, score in zip(simulations, scored, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class _Scored:
    """NMSE and coverage of one simulation, NaN and 0 where there is no curve."""

    status: Status
    message: str
    nmse: float = np.nan
    coverage: float = 0.0


def _scored(
    simulations: Sequence[Simulation], measured: Curve, normaliser: Normaliser, weights: FloatArray | None
) -> list[_Scored]:
    """Score all sets together that were simulated at the same abscissae, as those of a sweep are."""
    curves = [_curve(s, measured.channel) for s in simulations]
    scored = [_Scored(status, message) for _, status, message in curves]
    ordinates: dict[bytes, dict[int, FloatArray]] = {}
    for i, (curve, _, _) in enumerate(curves):
        if curve is not None:
            ordinates.setdefault(curve.abscissa.tobytes(), {})[i] = curve.ordinate
    ready = _core.Measured(measured.abscissa, measured.ordinate, normaliser.value, weights=weights)
    for abscissa, by_set in ordinates.items():
        try:
            path = ready.along(np.frombuffer(abscissa))
        except CurveError as error:
            for i in by_set:
                scored[i] = _Scored(*_unreadable(simulations[i], str(error)))
            continue
        for i, *numbers in zip(by_set, *path.score(np.stack(list(by_set.values()))), strict=True):
            scored[i] = _Scored(scored[i].status, scored[i].message, *map(float, numbers))
    return scored


@dataclass(frozen=True, slots=True)
class Compared:
    """A simulated curve at the measured abscissae: (n,), NaN where it did not get to."""

    values: FloatArray
    status: Status
    message: str


def compare(simulation: Simulation, measured: Curve) -> Compared:
    """Bring a simulated curve onto the measured abscissae, branch by branch."""
    nothing = np.full(measured.abscissa.shape, np.nan)
    curve, status, message = _curve(simulation, measured.channel)
    if curve is None:
        return Compared(nothing, status, message)
    try:
        values, _ = _core.interpolate(curve.abscissa, curve.ordinate, measured.abscissa)
    except CurveError as error:
        return Compared(nothing, *_unreadable(simulation, str(error)))
    return Compared(values, status, message)


def _curve(simulation: Simulation, channel: str) -> tuple[Curve | None, Status, str]:
    """Find the curve of a channel, or why there is none."""
    if simulation.response is None:
        return None, simulation.status, simulation.message
    curve = simulation.response.curves.get(channel)
    if curve is None:
        return None, *_unreadable(simulation, f"the solver gave no curve '{channel}'")
    return curve, simulation.status, simulation.message


def _unreadable(simulation: Simulation, message: str) -> tuple[Status, str]:
    """Say why a curve cannot be used, unless the simulation failed and said so itself."""
    status = Status.UNREADABLE if simulation.status is Status.OK else simulation.status
    return status, simulation.message or message


def _variance(ordinate: FloatArray, normaliser: Normaliser, weights: FloatArray | None) -> float:
    """Σw(exp − mean)²/Σw over normaliser², which is NMSE/(1 − R²); NaN for a flat measured curve."""
    try:
        _core.normaliser(ordinate, Normaliser.STD.value)
    except ScoringError:
        return np.nan
    mean = np.average(ordinate, weights=weights)
    variance = float(np.average((ordinate - mean) ** 2, weights=weights))
    return variance / _core.normaliser(ordinate, normaliser.value) ** 2


def _row(
    simulation: Simulation,
    channel: str,
    scored: _Scored,
    minimum_coverage: float,
    r2: float,
    statuses: Collection[Status],
) -> dict[str, object]:
    nmse, coverage, message = scored.nmse, scored.coverage, scored.message
    if scored.status is Status.OK and not is_enough(coverage, minimum_coverage):
        message = f"covers {coverage:.3f} of the measured '{channel}', less than {minimum_coverage:g}"
    ranked = scored.status in statuses and is_enough(coverage, minimum_coverage) and np.isfinite(nmse)
    return {
        "spot": simulation.job.spot,
        "set_id": simulation.job.set_id,
        "channel": channel,
        "nmse": nmse if ranked else None,
        "r2": r2 if ranked and np.isfinite(r2) else None,
        "coverage": coverage,
        "status": scored.status.value,
        "message": message,
    }
