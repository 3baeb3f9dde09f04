"""Curves of force over depth and torque over rotation, branch by branch."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import Curve, FloatArray
from palpate_robot_log.processing.smoothing import Smoothed

_SLOPE_POINTS = 31


@dataclass(frozen=True, slots=True, eq=False)
class Branch:
    """A monotone part of a curve; arrays (n,) in the order travelled."""

    abscissa: FloatArray
    ordinate: FloatArray
    std: FloatArray
    time_s: FloatArray


def branch(
    time_s: FloatArray,
    abscissa: FloatArray,
    ordinate: Smoothed,
    extra_std: FloatArray,
    points: int | None,
    start: float = -np.inf,
) -> Branch:
    """Branch at evenly spaced abscissae, or at those of the log where ``points`` is None.

    Parameters
    ----------
    time_s : (n,) array
    abscissa : (n,) array
        Smoothed; what noise is left in its sense of travel is levelled.
    ordinate : Smoothed
    extra_std : (n,) array
        Standard deviation from elsewhere (bias, drift, onset), added in squares.
    points : int, optional
    start : float
        Of a rising branch: what is before this abscissa is left out.
    """
    sense = 1.0 if abscissa[-1] >= abscissa[0] else -1.0
    # Noise in a slow start would make the path turn where the tool did not.
    level = sense * np.minimum(np.maximum.accumulate(sense * abscissa), sense * abscissa[-1])
    inside = level >= start
    level, values = level[inside], ordinate.values[inside]
    std, time = np.hypot(ordinate.std, extra_std)[inside], time_s[inside]
    if points is None:
        return Branch(level, values, std, time)
    grid = np.linspace(level[0], level[-1], points)
    resampled = (np.interp(sense * grid, sense * level, each) for each in (values, std, time))
    return Branch(grid, *resampled)


def with_shift_std(part: Branch, shift_std: float) -> Branch:
    """Add what a shift of the whole abscissa would do to the ordinate: its slope times the shift."""
    low, high = part.abscissa[0], part.abscissa[-1]
    grid = np.linspace(low, high, min(_SLOPE_POINTS, part.abscissa.size))
    rising = np.concatenate([[True], np.diff(part.abscissa) > 0.0])
    slope = np.gradient(np.interp(grid, part.abscissa[rising], part.ordinate[rising]), grid)
    extra = shift_std * np.interp(part.abscissa, grid, np.abs(slope))
    return replace(part, std=np.hypot(part.std, extra))


def joined(channel: str, branches: Sequence[Branch]) -> Curve:
    """One curve of successive branches, which share their turning points."""
    abscissa, ordinate, std, time = (
        [np.array(getattr(part, name)) for part in branches]
        for name in ("abscissa", "ordinate", "std", "time_s")
    )
    for k in range(1, len(branches)):
        for values in (abscissa, ordinate, time):
            values[k - 1][-1] = (values[k - 1][-1] + values[k][0]) / 2.0
        std[k - 1][-1] = max(std[k - 1][-1], std[k][0])
    kept = [slice(0 if k == 0 else 1, None) for k in range(len(branches))]
    return Curve(
        channel=channel,
        abscissa=np.concatenate([a[s] for a, s in zip(abscissa, kept, strict=True)]),
        ordinate=np.concatenate([o[s] for o, s in zip(ordinate, kept, strict=True)]),
        std=np.concatenate([d[s] for d, s in zip(std, kept, strict=True)]),
        time_s=np.concatenate([t[s] for t, s in zip(time, kept, strict=True)]),
    )
