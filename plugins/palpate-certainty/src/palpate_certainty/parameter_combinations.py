"""Directions in which a fit is known, and in which it is not, as products of powers of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from palpate.api import FloatArray
from palpate.api.fit import LEVEL

LEAST_POWER = 0.15
"""Power of a parameter, over the largest one, below which it is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterCombination:
    """A combination of parameters that is known independently of the others.

    Parameters
    ----------
    text : str
        Such as ``c1 · m1^0.3``.
    relative_width : float
        Length of its 95 % interval, over its value.
    """

    text: str
    relative_width: float


def parameter_combinations(
    names: Sequence[str], values: FloatArray, rates: FloatArray, covariance: FloatArray
) -> list[ParameterCombination]:
    """Principal directions of a covariance, the best known first.

    Parameters
    ----------
    names : sequence of str
    values, rates : (n_parameters,) array
        Values, and their derivatives in the coordinates.
    covariance : (n_parameters, n_parameters) array
        In coordinates of the unit box.
    """
    # Relative changes; a value of zero has none, and is seen over its range.
    per_coordinate = rates / np.where(values == 0.0, rates, values)
    relative = covariance * np.outer(per_coordinate, per_coordinate)
    found = []
    for vector in np.linalg.eigh(covariance)[1].T:
        powers = vector / per_coordinate
        powers = powers / powers[np.argmax(np.abs(powers))]
        powers = np.where(np.abs(powers) < LEAST_POWER, 0.0, np.round(powers, 1))
        sd = float(np.sqrt(powers @ relative @ powers))
        width = 2.0 * float(norm.ppf(0.5 + LEVEL / 2.0)) * sd
        found.append(ParameterCombination(text=_product(names, powers), relative_width=width))
    return found


def _product(names: Sequence[str], powers: FloatArray) -> str:
    factors = [
        name if power == 1.0 else f"{name}^{power:g}"
        for name, power in zip(names, powers.tolist(), strict=True)
        if power
    ]
    return " · ".join(factors)
