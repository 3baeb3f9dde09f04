"""Time alignment of wrench and pose: the wrench turns when the tool turns.

Where the tool starts, reverses or stops its twist at once, the moment about the normal bends
at once too, in an elastic and in a relaxing tissue. The lag is the mean time from the bends of
the rotation to those of the moment.
"""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.rotation import continuous
from palpate_robot_log.processing.strokes import Stroke
from palpate_robot_log.processing.transitions import speed_change
from palpate_robot_log.recording import Recording, rows_between

LARGEST_LAG_S = 0.5
"""A lag beyond this is no delay of a device but a mistake in a clock."""

SIGNIFICANT = 3.0
"""Standard deviations that an estimated lag must exceed to be taken out."""

_WINDOW_SHARE = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag:
    """How far the wrench comes after the pose [s], its standard deviation, and bends that gave it."""

    seconds: float
    std_s: float
    n_bends: int

    @property
    def significant(self) -> bool:
        """Whether the lag differs from none."""
        return self.n_bends > 0 and abs(self.seconds) > SIGNIFICANT * self.std_s


def estimate_lag(time_s: FloatArray, moment_Nmm: FloatArray, twists: tuple[Stroke, ...]) -> Lag:
    """Lag of the moment about the normal (n,) behind the twist's strokes; no bends without a twist."""
    pairs = [pair for k in range(len(twists)) for pair in _bends(time_s, moment_Nmm, twists, k)]
    if not pairs:
        return Lag(seconds=0.0, std_s=float("inf"), n_bends=0)
    lags, stds = np.array(pairs).T
    weights = 1.0 / stds**2
    mean = float(weights @ lags / weights.sum())
    formal = float(1.0 / np.sqrt(weights.sum()))
    scatter = float(np.sqrt(weights @ (lags - mean) ** 2 / weights.sum() / max(len(pairs) - 1, 1)))
    return Lag(seconds=mean, std_s=max(formal, scatter), n_bends=len(pairs))


def shifted(recording: Recording, lag_s: float) -> Recording:
    """Recording whose wrench is taken ``lag_s`` later, without the rows that then have none.

    Raises
    ------
    CurveError
        The lag is larger than any delay.
    """
    if abs(lag_s) > LARGEST_LAG_S:
        raise recording.fault(
            f"the wrench comes {lag_s:.3f} s after the pose; correct the clock of one of them, or give "
            "alignment.lag"
        )
    if lag_s == 0.0:
        return recording
    time = recording.time_s
    kept = np.flatnonzero((time + lag_s >= time[0]) & (time + lag_s <= time[-1]))
    at = time[kept] + lag_s
    wrench = {
        name: np.stack([np.interp(at, time, column) for column in getattr(recording, name).T], axis=1)
        for name in ("force_N", "moment_Nmm")
    }
    quaternion = continuous(recording.quaternion)[kept]
    return recording.part(kept).changed(quaternion=quaternion, **wrench)


def _bends(
    time: FloatArray, moment: FloatArray, twists: tuple[Stroke, ...], k: int
) -> list[tuple[float, float]]:
    """Lag and standard deviation at the start of stroke k, and at the end of the last stroke."""
    moving = [stroke.stop.time_s - stroke.start.time_s for stroke in twists]
    instants = [twists[k].start] + ([twists[k].stop] if k == len(twists) - 1 else [])
    found = []
    for instant in instants:
        if instant.kind != "kink":
            continue
        reach = _WINDOW_SHARE * min(moving[max(k - 1, 0) : k + 1])
        rows = rows_between(time, instant.time_s - reach, instant.time_s + reach)
        margin = min(LARGEST_LAG_S * 1.5, 0.6 * reach)
        bend = speed_change(time[rows], moment[rows], (instant.time_s - margin, instant.time_s + margin))
        if bend is not None and abs(bend.time_s - instant.time_s) < 0.98 * margin:
            found.append((bend.time_s - instant.time_s, float(np.hypot(bend.std_s, instant.std_s)) or 1e-6))
    return found
