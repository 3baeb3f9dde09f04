"""Coordinates in which curves are nearly linear: a power of each modulus whose interval is wide.

A curve is in proportion to the modulus of a body of one material, but nearly linear in the logarithm of the
modulus of a soft layer between others, and in the reciprocal of a bulk modulus: their compliances add. The
power is found by one more simulation (transformations of Box and Cox, J. R. Stat. Soc. B 26, 1964).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray
from palpate.api.fit import Box
from palpate_certainty.laplace import Laplace


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CurveCoordinates:
    """Coordinates from 0 to 1 over each range, and the place where curves have their slopes.

    Parameters
    ----------
    box : Box
    powers : (n_parameters,) array
        1 for a value itself, 0 for its logarithm.
    origin : (n_parameters,) array
        Where slopes are from, as shares of the ranges.
    """

    box: Box
    powers: FloatArray
    origin: FloatArray

    def shares(self, coordinates: FloatArray) -> FloatArray:
        """Shares of the ranges at coordinates (..., n_parameters) from 0 to 1."""
        shares, (bent, ratio, power) = np.array(coordinates), self._bent
        shares[..., bent] = (_inverse(shares[..., bent] * _power(ratio, power), power) - 1.0) / (ratio - 1.0)
        return shares

    def coordinates(self, shares: FloatArray) -> FloatArray:
        """Coordinates of shares (..., n_parameters) of the ranges."""
        found, (bent, ratio, power) = np.array(shares), self._bent
        found[..., bent] = _power(1.0 + found[..., bent] * (ratio - 1.0), power) / _power(ratio, power)
        return found

    def rates(self, shares: FloatArray) -> FloatArray:
        """Derivatives (..., n_parameters) of shares of the ranges in their coordinates."""
        rates, (bent, ratio, power) = np.ones_like(shares), self._bent
        values = 1.0 + shares[..., bent] * (ratio - 1.0)
        rates[..., bent] = _power(ratio, power) * values ** (1.0 - power) / (ratio - 1.0)
        return rates

    def density(self, found: Laplace) -> Laplace:
        """Density of the coordinates from a density of shares that is linear around the origin."""
        rates = self.rates(self.origin)
        centre = self.coordinates(self.origin) + (found.centre - self.origin) / rates
        return found.mapped(np.diag(1.0 / rates), centre)

    @property
    def _bent(self) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Mask (n_parameters,) of moduli in another power, and the ratios of their ranges and powers."""
        bent = self.powers != 1.0
        return bent, self.box.upper[bent] / self.box.lower[bent], self.powers[bent]


def power_of(factor: float, change: float) -> float:
    """Power of a modulus in which a curve is linear: 1 where stiffnesses add, -1 where compliances do.

    Parameters
    ----------
    factor : float
        A modulus whose curve is known, over the one that slopes are from.
    change : float
        Relative change of the modulus that would change the curve as much if it were linear.
    """

    def error(power: float) -> float:
        return float(_power(np.array([factor]), np.array([power]))[0]) - change

    if error(-1.0) >= 0.0:
        return -1.0
    return 1.0 if error(1.0) <= 0.0 else float(scipy.optimize.brentq(error, -1.0, 1.0))


def _power(ratio: FloatArray, power: FloatArray) -> FloatArray:
    """(x^p - 1) / p, and log x where p is 0."""
    log = np.log(ratio)
    return np.divide(np.expm1(power * log), power, out=log.copy(), where=np.abs(power * log) > 1e-9)


def _inverse(at: FloatArray, power: FloatArray) -> FloatArray:
    """(1 + p x)^(1 / p), and exp x where p is 0."""
    inside = power * at
    return np.exp(np.divide(np.log1p(inside), power, out=at.copy(), where=np.abs(inside) > 1e-9))
