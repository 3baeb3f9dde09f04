"""Corrections of the wrench: spikes, a lag, the tool's weight, the sensor's drift and its bias.

Lag: where the tool starts, reverses or stops its twist at once, the moment about the normal bends at
once too, in an elastic and in a relaxing tissue. The lag is the mean time from the bends of the
rotation to the bends of the moment.

Weight: in free air the sensor shows  f = b_f + Rᵀ g W  and  m = b_m + c × (Rᵀ g W)  with biases b,
weight W, centre c in the sensor's frame and direction g of gravity in the base frame: linear in
b_f, W, b_m and W c, so that a few orientations determine them all.

Drift: a straight line through the rows in free air before and after the press.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from palpate.api import BoolArray, FloatArray, IntArray
from palpate_robot_log.checks import check
from palpate_robot_log.press_measures import LARGEST_LAG_S
from palpate_robot_log.processing.change_points import speed_change
from palpate_robot_log.processing.settings import Gravity
from palpate_robot_log.processing.strokes import Stroke
from palpate_robot_log.recording import (
    Recording,
    continuous,
    correlation_factor,
    cross,
    gravity_in_sensor,
    noise_std,
    rows_between,
    thinned,
)


def without_spikes(recording: Recording) -> tuple[Recording, IntArray]:
    """Wrench with spikes replaced by the median of their neighbours, and the rows that had one."""
    force, force_hit = _repaired(recording.force_N)
    moment, moment_hit = _repaired(recording.moment_Nmm)
    hit = np.flatnonzero(force_hit | moment_hit)
    words = {"hit": hit.size, "n_rows": recording.n_rows}
    check(recording, "spikes", hit.size / recording.n_rows, *hit[:1], **words)
    return (recording.changed(force_N=force, moment_Nmm=moment) if hit.size else recording), hit


def _repaired(values: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Columns (n, 3) with their spikes replaced, and which rows had one."""
    middle = median_filter(values, size=(5, 1), mode="mirror")
    # A range without the spikes themselves.
    spans = np.ptp(middle, axis=0)
    noises = np.array([noise_std(column) for column in values.T])
    # a spike exceeds its neighbours by 8 standard deviations of the noise, and by 2 % of the channel's range
    # where noise is less than a digit
    least = np.maximum(8.0 * noises, 0.02 * spans)
    off: BoolArray = np.abs(values - middle) > np.maximum(least, 1e-300)
    hit: BoolArray = np.any(off, axis=1)
    return np.where(off, middle, values), hit


# ---------------------------------------------------------------------------------- lag


@dataclass(frozen=True, slots=True, kw_only=True)
class Lag:
    """Lag of the wrench after the pose [s], its standard deviation, and how many bends gave it."""

    seconds: float = 0.0
    std_s: float = float("inf")
    n_bends: int = 0
    taken_out: bool = False

    @property
    def significant(self) -> bool:
        """Whether the lag differs from none; a single bend, by chance, is not checked by another one."""
        # standard deviations that an estimated lag must exceed to be taken out
        return self.n_bends > 1 and abs(self.seconds) > 3.0 * self.std_s


def estimate_lag(time_s: FloatArray, moment_Nmm: FloatArray, twists: tuple[Stroke, ...]) -> Lag:
    """Lag of the moment about the normal (n,) behind the twist's strokes; no bends without a twist."""
    moving = [twist.stop.time_s - twist.start.time_s for twist in twists]
    starts = [(k, twist.start) for k, twist in enumerate(twists)]
    lags, stds = [], []
    for k, instant in [*starts, *((len(twists) - 1, twist.stop) for twist in twists[-1:])]:
        if instant.kind != "kink":
            continue
        reach = 0.25 * min(moving[max(k - 1, 0) : k + 1])
        rows = rows_between(time_s, instant.time_s - reach, instant.time_s + reach)
        margin = min(LARGEST_LAG_S * 1.5, 0.6 * reach)
        between_s = (instant.time_s - margin, instant.time_s + margin)
        bend = speed_change(time_s[rows], moment_Nmm[rows], between_s)
        if bend is not None and abs(bend.time_s - instant.time_s) < 0.98 * margin:
            lags.append(bend.time_s - instant.time_s)
            stds.append(float(np.hypot(bend.std_s, instant.std_s)) or 1e-6)
    if not lags:
        return Lag()
    weights = 1.0 / np.array(stds) ** 2
    mean = float(weights @ lags / weights.sum())
    formal = float(1.0 / np.sqrt(weights.sum()))
    squares = weights @ (np.array(lags) - mean) ** 2
    scatter = float(np.sqrt(squares / weights.sum() / max(len(lags) - 1, 1)))
    return Lag(seconds=mean, std_s=max(formal, scatter), n_bends=len(lags))


def shifted(recording: Recording, lag_s: float) -> Recording:
    """Recording whose wrench is taken ``lag_s`` later, without the rows that then have none."""
    check(recording, "lag", lag_s)
    time = recording.time_s
    kept = np.flatnonzero((time + lag_s >= time[0]) & (time + lag_s <= time[-1]))
    at = time[kept] + lag_s
    wrench = {
        name: np.stack([np.interp(at, time, column) for column in getattr(recording, name).T], axis=1)
        for name in ("force_N", "moment_Nmm")
    }
    quaternion = continuous(recording.quaternion)[kept]
    return recording.part(kept).changed(quaternion=quaternion, **wrench)


# ------------------------------------------------------------------------------- weight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolLoad:
    """Weight [N] and centre (3,) of the tool [mm, sensor frame], with standard deviations where fitted."""

    weight_N: float
    centre_mm: FloatArray
    weight_std_N: float = 0.0
    centre_std_mm: float = 0.0


def without_weight(recording: Recording, tool: ToolLoad, direction: FloatArray) -> Recording:
    """Wrench without the tool's weight; ``direction`` (3,) is of gravity, in the base frame."""
    pull = tool.weight_N * gravity_in_sensor(recording, direction)
    return recording.less(pull, cross(tool.centre_mm, pull))


def tool_of(recording: Recording, free: IntArray, gravity: Gravity) -> ToolLoad | None:
    """The tool of the settings, fitted to the rows ``free`` in free air where its weight is left out."""
    if gravity.method == "off":
        return None
    if gravity.weight is None:
        return fit_tool(recording, free, np.array(gravity.direction))
    tool = ToolLoad(weight_N=gravity.weight, centre_mm=np.array(gravity.centre))
    check(recording, "tool", tool)
    check(recording, "weight", tool, free)
    return tool


def fit_tool(recording: Recording, free: IntArray, direction: FloatArray) -> ToolLoad:
    """Weight and centre from the rows ``free`` in free air; ``direction`` (3,) is of gravity."""
    # Rows by which a weight is fitted.
    part, _ = thinned(recording.part(free), 5000)
    down = gravity_in_sensor(part, direction)
    # Without its mean, what the bias imitates is gone from the unknown weight.
    lever = down - down.mean(axis=0)
    power = float(np.einsum("ij,ij->", lever, lever))
    force = part.force_N - part.force_N.mean(axis=0)
    weight = float(np.einsum("ij,ij->", lever, force) / power) if power > 0.0 else 0.0
    residual = force - weight * lever
    noise = float(residual.std()) * max(correlation_factor(column) for column in residual.T)
    std = noise / np.sqrt(power) if power > 0.0 else float("inf")
    share = std / max(0.1 * abs(weight), 1e-3)
    check(recording, "orientations", share, int(free[0]), n_rows=free.size)
    # m - mean = c × (W lever) has three linear unknowns.
    x, y, z = (weight * lever).T
    zero = np.zeros(x.size)
    columns = ([zero, -z, y], [z, zero, -x], [-y, x, zero])
    rows = np.stack([np.concatenate(column) for column in columns], axis=1)
    moment = (part.moment_Nmm - part.moment_Nmm.mean(axis=0)).T.ravel()
    centre, *_ = np.linalg.lstsq(rows, moment, rcond=None)
    own_std = float(np.std(moment - rows @ centre)) * float(np.sqrt(np.trace(np.linalg.pinv(rows.T @ rows))))
    # A weight that is off by a share puts the centre off by the same share.
    centre_std = float(np.hypot(own_std, np.linalg.norm(centre) * std / weight))
    tool = ToolLoad(weight_N=weight, centre_mm=centre, weight_std_N=std, centre_std_mm=centre_std)
    check(recording, "tool", tool)
    return tool


# ----------------------------------------------------------------------- drift and bias


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drift:
    """Change of the bias per second, in the sensor's frame; arrays (3,)."""

    force_N_per_s: FloatArray
    moment_Nmm_per_s: FloatArray
    force_std_N_per_s: FloatArray
    moment_std_Nmm_per_s: FloatArray


def find_drift(recording: Recording, before: IntArray, after: IntArray) -> Drift:
    """Least-squares slope of the wrench over time, from rows (n,) in free air before and after the press.

    The tool's weight is out, unless the tool is oriented alike in all these rows.
    """
    check(recording, "drift", after.size, recording.n_rows - 1)
    free = np.concatenate([before, after])
    time = recording.time_s[free] - recording.time_s[free].mean()
    power = float(time @ time)

    def slope(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        slope = time @ values / power
        residual = values - values.mean(axis=0) - time[:, None] * slope
        return slope, residual.std(axis=0) / np.sqrt(power)

    force, force_std = slope(recording.force_N[free])
    moment, moment_std = slope(recording.moment_Nmm[free])
    return Drift(
        force_N_per_s=force,
        moment_Nmm_per_s=moment,
        force_std_N_per_s=force_std,
        moment_std_Nmm_per_s=moment_std,
    )


def without_drift(recording: Recording, drift: Drift) -> Recording:
    """Wrench as if the bias had stayed what it was at the first instant."""
    elapsed = (recording.time_s - recording.time_s[0])[:, None]
    return recording.less(elapsed * drift.force_N_per_s, elapsed * drift.moment_Nmm_per_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bias:
    """Constant part of the wrench at the log's first instant, in the sensor's frame; arrays (3,)."""

    force_N: FloatArray
    moment_Nmm: FloatArray
    force_std_N: FloatArray
    moment_std_Nmm: FloatArray
    n_rows: int


def find_bias(recording: Recording, free: IntArray) -> Bias:
    """Mean wrench over rows in free air, once weight and drift are out."""

    def mean(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean = values.mean(axis=0)
        factors = np.array([correlation_factor(column) for column in (values - mean).T])
        return mean, factors * values.std(axis=0, ddof=1) / np.sqrt(values.shape[0])

    force, force_std = mean(recording.force_N[free])
    moment, moment_std = mean(recording.moment_Nmm[free])
    return Bias(
        force_N=force,
        moment_Nmm=moment,
        force_std_N=force_std,
        moment_std_Nmm=moment_std,
        n_rows=int(free.size),
    )
