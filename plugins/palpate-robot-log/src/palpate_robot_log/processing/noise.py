"""Noise of a signal, from the signal itself."""

import numpy as np

from palpate.api import FloatArray

_MAD_TO_STD = 1.4826


def noise_std(values: FloatArray) -> float:
    """Standard deviation of white noise on a smooth signal (n,).

    From the median of second differences, whose variance is six times that of the noise;
    spikes and a few kinks leave the median where it is.
    """
    bends = np.diff(values, 2)
    if bends.size == 0:
        return 0.0
    return float(_MAD_TO_STD * np.median(np.abs(bends)) / np.sqrt(6.0))


def correlation_factor(residual: FloatArray) -> float:
    """Inflation of a mean's standard deviation by neighbours that err alike, at least 1.

    For noise whose correlation falls geometrically, √((1 + ρ)/(1 - ρ)) with the lag-one
    correlation ρ.
    """
    power = float(residual @ residual)
    if residual.size < 8 or power == 0.0:
        return 1.0
    rho = min(float(residual[1:] @ residual[:-1]) / power, 0.95)
    return float(np.sqrt((1.0 + rho) / (1.0 - rho))) if rho > 0.0 else 1.0
