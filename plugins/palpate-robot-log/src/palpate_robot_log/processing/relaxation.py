"""Relaxation: how far force and torque fall while the tool rests."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.noise import correlation_factor
from palpate_robot_log.processing.thinning import block_means

SIGNIFICANT = 3.0
"""Standard deviations that a fall must exceed to have a time constant."""

_ROWS = 1000
_FEWEST = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Change over one dwell.

    ``fall`` is positive where the magnitude falls, in the unit of the channel; ``share`` is it
    over the value at the start; ``time_constant_s`` is that of one exponential, None where the
    fall is not significant or the dwell is too short.
    """

    phase: str
    channel: str
    start_value: float
    fall: float
    fall_std: float
    share: float
    time_constant_s: float | None


def relaxation(phase: str, channel: str, time_s: FloatArray, values: FloatArray) -> Relaxation | None:
    """Fall of a signal (n,) over a dwell; None where it has too few rows.

    The dwell is described by v(t) = v∞ + A e^(-t/τ); where its fall is not significant, by a line.
    """
    if values.size < _FEWEST:
        return None
    block = -(-values.size // _ROWS)
    time, value = block_means(time_s - time_s[0], block), block_means(values, block)
    length = float(time[-1])
    constants = length * np.geomspace(0.03, 3.0, 25)
    fits = [_fit(time, value, 1.0 - np.exp(-time / tau)) for tau in constants]
    best = int(np.argmin([fit[3] for fit in fits]))
    line = _fit(time, value, time / length)
    start, change, std, _ = fits[best]
    at_end = 1.0 - float(np.exp(-length / constants[best]))
    is_significant = abs(change) > SIGNIFICANT * std and 0 < best < constants.size - 1
    if not is_significant:
        start, change, std, _ = line
        at_end = 1.0
    sign = 1.0 if start >= 0.0 else -1.0
    return Relaxation(
        phase=phase,
        channel=channel,
        start_value=start,
        fall=-sign * change * at_end,
        fall_std=std * at_end,
        share=float(-change * at_end / start) if start else 0.0,
        time_constant_s=float(constants[best]) if is_significant else None,
    )


def _fit(time: FloatArray, value: FloatArray, shape: FloatArray) -> tuple[float, float, float, float]:
    """Start value, amplitude, its standard deviation and squared residual of value = start + a shape."""
    design = np.stack([np.ones_like(time), shape], axis=1)
    coefficients, *_ = np.linalg.lstsq(design, value, rcond=None)
    residual = value - design @ coefficients
    squares = float(residual @ residual)
    variance = squares / max(time.size - 2, 1) * correlation_factor(residual) ** 2
    spread = np.linalg.pinv(design.T @ design)[1, 1]
    return float(coefficients[0]), float(coefficients[1]), float(np.sqrt(variance * spread)), squares
