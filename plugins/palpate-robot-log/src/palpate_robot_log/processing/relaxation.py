"""Relaxation: how far force and torque fall while the tool rests."""

import numpy as np

from palpate.api import FloatArray, Relaxation
from palpate_robot_log.processing.noise import correlation_factor
from palpate_robot_log.processing.thinning import block_means

_ROWS = 1000
_FEWEST = 12


def relaxation(
    phase: str, channel: str, time_s: FloatArray, values: FloatArray, drift_std_per_s: float = 0.0
) -> Relaxation | None:
    """Fall of a signal (n,) over a dwell; None where it has too few rows.

    The dwell is described by v(t) = v∞ + A e^(-t/τ); where its fall is not significant or the dwell is
    too short for τ, by a line. The standard deviation contains that of the drift.
    """
    if values.size < _FEWEST:
        return None
    block = -(-values.size // _ROWS)
    time, value = block_means(time_s - time_s[0], block), block_means(values, block)
    length = float(time[-1])
    constants = length * np.geomspace(0.03, 3.0, 25)
    fits = [_fit(time, value, 1.0 - np.exp(-time / tau)) for tau in constants]
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
    return fall(_fit(time, value, time / length), 1.0, None)


def _fit(time: FloatArray, value: FloatArray, shape: FloatArray) -> tuple[float, float, float, float]:
    """Start value, amplitude, its standard deviation and squared residual of value = start + a shape."""
    design = np.stack([np.ones_like(time), shape], axis=1)
    coefficients, *_ = np.linalg.lstsq(design, value, rcond=None)
    residual = value - design @ coefficients
    squares = float(residual @ residual)
    variance = squares / max(time.size - 2, 1) * correlation_factor(residual) ** 2
    spread = np.linalg.pinv(design.T @ design)[1, 1]
    return float(coefficients[0]), float(coefficients[1]), float(np.sqrt(variance * spread)), squares
