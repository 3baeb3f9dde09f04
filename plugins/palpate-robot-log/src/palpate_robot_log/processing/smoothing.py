"""Smoothing that keeps peaks: Savitzky-Golay or a smoothing spline, within one branch.

The Savitzky-Golay window is the longest whose own bias stays small: smoothing the smoothed
values once more may move none of them by more than ``BIAS_SHARE`` of the peak, beyond what
their noise explains. A branch ends where the motion turns, so no window spans a kink.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import make_smoothing_spline
from scipy.linalg import solveh_banded
from scipy.signal import savgol_coeffs, savgol_filter

from palpate.api import FloatArray
from palpate_robot_log.processing.noise import correlation_factor, noise_std
from palpate_robot_log.processing.thinning import block_means

BIAS_SHARE = 0.001
"""Share of the peak that smoothing may move a value by."""

_MAX_ROWS = 3000
"""Rows of a branch that are smoothed; more are averaged in blocks first."""

_PARTS = 20
_STIFFNESSES = 24
_GROWTH = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Smoothed:
    """A branch after smoothing; arrays (n,) at the times that were given.

    ``std`` is that of the smoothed values, ``noise`` that of the given ones, ``bias`` the
    largest change that smoothing once more would make (of a spline: the largest mean residual
    of a twentieth), and ``window_s`` the window's length (of a spline: the
    length over which it bends).
    """

    values: FloatArray
    std: FloatArray
    noise: float
    bias: float
    window_s: float


def smoothed(
    time_s: FloatArray,
    values: FloatArray,
    *,
    method: Literal["savgol", "spline", "none"],
    peak: float,
    window_s: float | None = None,
    order: int = 3,
) -> Smoothed:
    """Smooth one branch.

    Parameters
    ----------
    time_s, values : (n,) array
    method : {"savgol", "spline", "none"}
    peak : float
        Largest magnitude of the whole curve, in the unit of ``values``.
    window_s : float, optional
        Length of the Savitzky-Golay window; chosen by its bias when left out.
    order : int
        Degree of the Savitzky-Golay polynomial.
    """
    if method == "none" or values.size < order + 4:
        noise = noise_std(values)
        return Smoothed(values=values, std=np.full(values.shape, noise), noise=noise, bias=0.0, window_s=0.0)
    if method == "spline":
        return _spline(time_s, values)
    return _savgol(time_s, values, BIAS_SHARE * peak, window_s, order)


def _savgol(
    time: FloatArray, values: FloatArray, allowed: float, window_s: float | None, order: int
) -> Smoothed:
    block = -(-time.size // _MAX_ROWS)
    coarse, means = block_means(time, block), block_means(values, block)
    even = np.linspace(coarse[0], coarse[-1], coarse.size)
    step = float(even[1] - even[0])
    y = np.interp(even, coarse, means)
    window = _longest(y, allowed, order) if window_s is None else _odd(window_s / step, order, y.size)
    smooth = savgol_filter(y, window, order, mode="interp")
    residual = y - smooth
    noise = float(np.std(residual)) * float(
        np.sqrt(y.size / max(y.size - y.size * _gain(window, order), 1.0))
    )
    std = noise * correlation_factor(residual) * np.sqrt(_gains(y.size, window, order))
    bias = float(np.abs(savgol_filter(smooth, window, order, mode="interp") - smooth).max())
    return Smoothed(
        values=np.interp(time, even, smooth),
        std=np.interp(time, even, std),
        noise=noise * float(np.sqrt(block)),
        bias=bias,
        window_s=window * step,
    )


def _longest(y: FloatArray, allowed: float, order: int) -> int:
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


def _gains(n_rows: int, window: int, order: int) -> FloatArray:
    """Variance of each smoothed value (n_rows,); larger where the window meets the branch's end."""
    gains = np.full(n_rows, _gain(window, order))
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, window), order + 1))
    edge = np.sum(basis**2, axis=1)
    half = window // 2
    gains[:half], gains[n_rows - half :] = edge[:half], edge[window - half :]
    return gains


def _spline(time: FloatArray, values: FloatArray) -> Smoothed:
    """Cubic smoothing spline whose stiffness has the least generalised cross-validation score."""
    block = -(-time.size // _MAX_ROWS)
    x, y = block_means(time, block), block_means(values, block)
    step = float(np.ptp(x)) / (x.size - 1)
    rows = (x - x[0]) / step
    length, gain, trace = _stiffness(y)
    fit = make_smoothing_spline(rows, y, lam=length**4)
    residual = y - fit(rows)
    noise = float(np.sqrt(residual @ residual / (x.size - trace)))
    spread = noise * correlation_factor(residual) * float(np.sqrt(gain))
    return Smoothed(
        values=fit((time - x[0]) / step),
        std=np.full(values.shape, spread),
        noise=noise * float(np.sqrt(block)),
        bias=max(abs(float(part.mean())) for part in np.array_split(residual, _PARTS)),
        window_s=length * step,
    )


def _stiffness(y: FloatArray) -> tuple[float, float, float]:
    """Length in rows over which the spline bends, the noise variance that it leaves, and its trace.

    Sought with the spline's discrete likeness, (1 + λ D'D) z = y with second differences D and
    λ = length⁴, which is solved in a fraction of the spline's time. Trace and variance come from a
    probe of random signs.
    """
    n = y.size
    probe = np.random.default_rng(0).choice([-1.0, 1.0], n)
    bands = np.zeros((3, n))
    bands[2] = np.r_[1.0, 5.0, np.full(n - 4, 6.0), 5.0, 1.0]
    bands[1, 1:] = np.r_[-2.0, np.full(n - 3, -4.0), -2.0]
    bands[0, 2:] = 1.0
    unit = np.array([[0.0], [0.0], [1.0]])
    scores = []
    for length in np.geomspace(1.5, n / 4.0, _STIFFNESSES):
        smooth, answer = solveh_banded(unit + length**4 * bands, np.stack([y, probe], axis=1)).T
        trace = float(answer @ probe)
        squares = float(np.sum((y - smooth) ** 2))
        scores.append((squares / (n - trace) ** 2, float(length), float(np.mean(answer**2)), trace))
    _, length, gain, trace = min(scores)
    return length, gain, trace
