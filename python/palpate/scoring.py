"""How far each simulated curve is from the measured one.

NMSE of a channel = (1/N) Σ (sim − exp)² / normaliser². Simulated curves are
interpolated onto the measured abscissae branch by branch, because a twist is a
path and not a function of the angle.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from palpate import _core
from palpate.domain import Curve, FloatArray, Normaliser, Response, Simulation, Status
from palpate.errors import CurveError, ScoringError

SCHEMA = {
    "spot": pl.String,
    "set_id": pl.Int64,
    "channel": pl.String,
    "nmse": pl.Float64,
    "r2": pl.Float64,
    "coverage": pl.Float64,
    "status": pl.String,
    "seconds": pl.Float64,
    "message": pl.String,
}
"""Columns of the scores. ``nmse`` is null where a set is not to be ranked."""


def check_scorable(measured: Mapping[str, Response], normaliser: Normaliser) -> None:
    """Refuse, before anything is simulated, a measured curve with a degenerate normaliser.

    Raises
    ------
    ScoringError
        Naming spot, channel and normaliser.
    """
    for spot, response in measured.items():
        for name, curve in response.curves.items():
            try:
                _core.nmse(curve.ordinate, curve.ordinate, normaliser.value)
            except ScoringError as error:
                raise ScoringError(f"spot '{spot}', channel '{name}': {error}") from error


def score(
    simulations: Iterable[Simulation],
    measured: Mapping[str, Response],
    *,
    normaliser: Normaliser,
    minimum_coverage: float,
) -> pl.DataFrame:
    """Score every simulation in every measured channel.

    Parameters
    ----------
    simulations : iterable of Simulation
    measured : mapping of spot name to Response
    normaliser : Normaliser
    minimum_coverage : float
        Smallest share of measured points that a simulated curve must reach to be ranked.

    Returns
    -------
    DataFrame
        Columns as in ``SCHEMA``, one row per simulation and measured channel, ordered by
        spot as measured, then set_id, then channel. ``nmse`` is null unless the status is
        ok and the coverage enough. ``r2`` is the coefficient of determination.

    Raises
    ------
    ScoringError
        A degenerate normaliser.
    """
    check_scorable(measured, normaliser)
    by_spot: dict[str, list[Simulation]] = {spot: [] for spot in measured}
    for simulation in simulations:
        by_spot[simulation.job.spot].append(simulation)
    rows: list[dict[str, object]] = []
    for spot, of_spot in by_spot.items():
        of_spot.sort(key=lambda s: s.job.set_id)
        columns = [
            _score_channel(of_spot, curve, normaliser, minimum_coverage)
            for curve in measured[spot].curves.values()
        ]
        rows += [row for of_set in zip(*columns, strict=True) for row in of_set]
    return pl.DataFrame(rows, schema=SCHEMA)


def _score_channel(
    simulations: Sequence[Simulation], measured: Curve, normaliser: Normaliser, minimum_coverage: float
) -> list[dict[str, object]]:
    compared = [compare(s, measured) for s in simulations]
    if not compared:
        return []
    values = np.stack([c.values for c in compared])
    nmse, coverage = _core.nmse_batch(values, measured.ordinate, normaliser.value)
    r2 = _r2(values, measured.ordinate)
    return [
        _row(s, measured.channel, c, minimum_coverage, tuple(map(float, numbers)))
        for s, c, *numbers in zip(simulations, compared, nmse, r2, coverage, strict=True)
    ]


@dataclass(frozen=True, slots=True)
class Compared:
    """A simulated curve at the measured abscissae: (n,), NaN where it did not get to."""

    values: FloatArray
    status: Status
    message: str


def compare(simulation: Simulation, measured: Curve) -> Compared:
    """Bring a simulated curve onto the measured abscissae, branch by branch."""
    nothing = np.full(measured.abscissa.shape, np.nan)
    if simulation.response is None:
        return Compared(nothing, simulation.status, simulation.message)
    curve = simulation.response.curves.get(measured.channel)
    if curve is None:
        status = Status.UNREADABLE if simulation.status is Status.OK else simulation.status
        message = simulation.message or f"the solver gave no curve '{measured.channel}'"
        return Compared(nothing, status, message)
    try:
        values, _ = _core.interpolate(curve.abscissa, curve.ordinate, measured.abscissa, 0.0)
    except CurveError as error:
        status = Status.UNREADABLE if simulation.status is Status.OK else simulation.status
        return Compared(nothing, status, simulation.message or str(error))
    return Compared(values, simulation.status, simulation.message)


def _r2(values: FloatArray, ordinate: FloatArray) -> FloatArray:
    """1 − Σ(sim − exp)²/Σ(exp − mean)²; NaN for a flat measured curve, which has no variance."""
    try:
        of_std, _ = _core.nmse_batch(values, ordinate, Normaliser.STD.value)
    except ScoringError:
        return np.full(len(values), np.nan)
    return 1.0 - of_std


def _row(
    simulation: Simulation,
    channel: str,
    compared: Compared,
    minimum_coverage: float,
    numbers: tuple[float, ...],
) -> dict[str, object]:
    nmse, r2, coverage = numbers
    message = compared.message
    # A share of counted points is exact only up to rounding.
    if compared.status is Status.OK and coverage < minimum_coverage - 1e-12:
        message = f"covers {coverage:.3f} of the measured '{channel}', less than {minimum_coverage:g}"
    ranked = compared.status is Status.OK and coverage >= minimum_coverage - 1e-12 and np.isfinite(nmse)
    return {
        "spot": simulation.job.spot,
        "set_id": simulation.job.set_id,
        "channel": channel,
        "nmse": nmse if ranked else None,
        "r2": r2 if ranked and np.isfinite(r2) else None,
        "coverage": coverage,
        "status": compared.status.value,
        "seconds": simulation.seconds,
        "message": message,
    }
