"""Curves of force over depth and torque over rotation, branch by branch, and relaxation in the dwells.

Smoothing keeps peaks: Savitzky-Golay within one branch. Its window is the longest whose own bias stays
small: smoothing the smoothed values once more may move none of them by more than ``BIAS_SHARE`` of the
peak, beyond what their noise explains. A branch ends where the motion turns, so no window spans a kink.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from palpate.api import Curve, FloatArray, Relaxation
from palpate_robot_log.processing.settings import ProcessingSettings, Smoothing
from palpate_robot_log.recording import block_means, correlation_factor, noise_std

BIAS_SHARE = 0.001  # share of the peak that smoothing may move a value by
_GROWTH = 1.5


class Signal(NamedTuple):
    """Abscissa and ordinate of a channel in every row of the log (n,), and the rows of its branches."""

    abscissa: FloatArray
    ordinate: FloatArray
    branches: Sequence[slice]


def curve_of(
    channel: str,
    time_s: FloatArray,
    signal: Signal,
    zero_std: FloatArray,
    settings: ProcessingSettings,
    shift_std: float | None = None,
) -> tuple[Curve, list["Smoothed"]]:
    """Curve of successive branches, which share their turning points, and how each was smoothed.

    Parameters
    ----------
    time_s : (n,) array
        Of the log.
    signal : Signal
        At least one branch.
    zero_std : (n,) array
        Standard deviation of the ordinate's zero, added in squares.
    shift_std : float, optional
        Standard deviation of the abscissa's zero, of a curve that rises from there: what is before
        it is left out, and what a shift would do to the ordinate is added in squares.
    """
    resampling = settings.resampling
    whole = slice(signal.branches[0].start, signal.branches[-1].stop)
    peak, span = float(np.abs(signal.ordinate[whole]).max()), float(np.ptp(signal.abscissa[whole]))
    parts, smoothings = [], []
    for rows in signal.branches:
        time = time_s[rows]
        # Relative to its span, depth or rotation may change by a tenth of the share of force and torque.
        level = smoothed(time, signal.abscissa[rows], 0.1 * span, settings.smoothing).values
        ordinate = smoothed(time, signal.ordinate[rows], peak, settings.smoothing)
        # Noise in a slow start would make the path turn where the tool did not.
        sense = 1.0 if level[-1] >= level[0] else -1.0
        level = sense * np.minimum(np.maximum.accumulate(sense * level), sense * level[-1])
        part = np.stack([level, ordinate.values, np.hypot(ordinate.std, zero_std[rows]), time])
        if shift_std is not None:
            part = part[:, level >= 0.0]
        if resampling.enabled:
            grid = np.linspace(part[0, 0], part[0, -1], resampling.points)
            others = (np.interp(sense * grid, sense * part[0], values) for values in part[1:])
            part = np.stack([grid, *others])
        if shift_std is not None:
            part[2] = np.hypot(part[2], shift_std * _steepness(part[0], part[1]))
        parts.append(part)
        smoothings.append(ordinate)
    kept = [parts[0], *(part[:, 1:] for part in parts[1:])]
    for before, after in pairwise(parts):
        std = max(before[2, -1], after[2, 0])
        before[:, -1] = (before[:, -1] + after[:, 0]) / 2.0
        before[2, -1] = std
    abscissa, values, stds, times = np.concatenate(kept, axis=1)
    return Curve(channel=channel, abscissa=abscissa, ordinate=values, std=stds, time_s=times), smoothings


def _steepness(abscissa: FloatArray, ordinate: FloatArray) -> FloatArray:
    """Magnitude (n,) of the slope of a curve whose abscissa rises, without its noise's slope."""
    grid = np.linspace(abscissa[0], abscissa[-1], min(31, abscissa.size))
    rising = np.concatenate([[True], np.diff(abscissa) > 0.0])
    slope = np.gradient(np.interp(grid, abscissa[rising], ordinate[rising]), grid)
    return np.interp(abscissa, grid, np.abs(slope))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smoothed:
    """A branch after smoothing; arrays (n,) at the times that were given.

    ``std`` belongs to the smoothed values, ``noise`` to the given ones; ``bias`` is the
    largest change that smoothing once more would make, and ``window_s`` the window's length.
    """

    values: FloatArray
    std: FloatArray
    noise: float
    bias: float
    window_s: float


def smoothed(time_s: FloatArray, values: FloatArray, peak: float, choice: Smoothing) -> Smoothed:
    """One branch after smoothing; very few rows are left as they are.

    ``peak`` is the largest magnitude of the whole curve.
    """
    order = choice.order
    if choice.method == "none" or values.size < order + 4:
        noise = noise_std(values)
        return Smoothed(values=values, std=np.full(values.shape, noise), noise=noise, bias=0.0, window_s=0.0)
    # rows of a branch that are smoothed; more are averaged in blocks first
    block = -(-time_s.size // 3000)
    coarse, means = block_means(time_s, block), block_means(values, block)
    even = np.linspace(coarse[0], coarse[-1], coarse.size)
    step = float(even[1] - even[0])
    y = np.interp(even, coarse, means)
    if choice.window is None:
        window = _longest_window(y, BIAS_SHARE * peak, order)
    else:
        window = _odd(choice.window / step, order, y.size)
    smooth = savgol_filter(y, window, order, mode="interp")
    residual = y - smooth
    gain = _gain(window, order)
    noise = float(np.std(residual)) * float(np.sqrt(y.size / max(y.size - y.size * gain, 1.0)))
    # Values vary more where the window meets the branch's end.
    gains = np.full(y.size, gain)
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, window), order + 1))
    edge, half = np.sum(basis**2, axis=1), window // 2
    gains[:half], gains[y.size - half :] = edge[:half], edge[window - half :]
    std = noise * correlation_factor(residual) * np.sqrt(gains)
    bias = float(np.abs(savgol_filter(smooth, window, order, mode="interp") - smooth).max())
    return Smoothed(
        values=np.interp(time_s, even, smooth),
        std=np.interp(time_s, even, std),
        noise=noise * float(np.sqrt(block)),
        bias=bias,
        window_s=window * step,
    )


def _longest_window(y: FloatArray, allowed: float, order: int) -> int:
    """Longest odd window whose bias is small."""
    noise, shortest = noise_std(y), float(order + 4)
    n_lengths = max(int(np.log(max(y.size / 2.0 / shortest, 1.0)) / np.log(_GROWTH)) + 1, 1)
    for length in shortest * _GROWTH ** np.arange(n_lengths)[::-1]:
        window = _odd(float(length), order, y.size)
        once = savgol_filter(y, window, order, mode="interp")
        moved = np.abs(savgol_filter(once, window, order, mode="interp") - once).max()
        if moved <= allowed + noise * np.sqrt(_gain(window, order)):
            return window
    return _odd(shortest, order, y.size)


def _odd(window: float, order: int, n_rows: int) -> int:
    """Nearest odd length above the order that the rows allow."""
    least, most = 2 * (order // 2) + 3, n_rows - (n_rows % 2 == 0)
    return min(max(2 * int(window // 2) + 1, least), most)


def _gain(window: int, order: int) -> float:
    """Variance of a value in the middle of white noise of variance 1: Σ h²."""
    return float(np.sum(savgol_coeffs(window, order) ** 2))


def relaxation(
    phase: str, channel: str, time_s: FloatArray, values: FloatArray, drift_std_per_s: float = 0.0
) -> Relaxation | None:
    """Fall of a signal (n,) over a dwell; None where it has too few rows.

    The dwell is described by v(t) = v∞ + A e^(-t/τ); where its fall is not significant or the dwell is
    too short for τ, by a line. The standard deviation includes the drift's.
    """
    if values.size < 12:
        return None
    block = -(-values.size // 1000)
    time, value = block_means(time_s - time_s[0], block), block_means(values, block)
    length = float(time[-1])
    constants = length * np.geomspace(0.03, 3.0, 25)
    fits = [_decay(time, value, 1.0 - np.exp(-time / tau)) for tau in constants]
    best = int(np.argmin([fit[3] for fit in fits]))
    drift_std = drift_std_per_s * length

    def fall(fit: tuple[float, float, float, float], at_end: float, tau: float | None) -> Relaxation:
        start, change, std, _ = fit
        return Relaxation(
            phase=phase,
            channel=channel,
            duration_s=length,
            start_value=start,
            fall=float(-np.copysign(1.0, start) * change * at_end),
            fall_std=float(np.hypot(std * at_end, drift_std)),
            time_constant_s=tau,
        )

    tau = float(constants[best])
    curved = fall(fits[best], 1.0 - float(np.exp(-length / tau)), tau)
    if curved.is_significant and 0 < best < constants.size - 1:
        return curved
    return fall(_decay(time, value, time / length), 1.0, None)


def _decay(time: FloatArray, value: FloatArray, shape: FloatArray) -> tuple[float, float, float, float]:
    """Start value, amplitude, its standard deviation and squared residual of value = start + a shape."""
    design = np.stack([np.ones_like(time), shape], axis=1)
    coefficients, *_ = np.linalg.lstsq(design, value, rcond=None)
    residual = value - design @ coefficients
    squares = float(residual @ residual)
    variance = squares / max(time.size - 2, 1) * correlation_factor(residual) ** 2
    spread = np.linalg.pinv(design.T @ design)[1, 1]
    return float(coefficients[0]), float(coefficients[1]), float(np.sqrt(variance * spread)), squares
