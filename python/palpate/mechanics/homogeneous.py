"""Homogeneous deformations that keep the volume, and the nominal stress of an energy along them."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from palpate.domain import FloatArray
from palpate.domain.material import IsotropicMaterial
from palpate.errors import MaterialError

_STEP = 1e-5


def _along(power: float, *, twice: bool = False) -> Callable[[FloatArray], FloatArray]:
    return lambda t: np.stack([t, t if twice else t ** (-1.0 - power), t**power], axis=-1)


def _sheared(amount: FloatArray) -> FloatArray:
    long = np.hypot(1.0, amount / 2.0) + amount / 2.0
    return np.stack([long, 1.0 / long, np.ones_like(long)], axis=-1)


MODES: Mapping[str, Callable[[FloatArray], FloatArray]] = MappingProxyType(
    {
        "uniaxial": _along(-0.5),
        "equibiaxial": _along(-2.0, twice=True),
        "pure_shear": _along(-1.0),
        "simple_shear": _sheared,
        "confined_compression": lambda t: np.stack([t, np.ones_like(t), np.ones_like(t)], axis=-1),
    }
)
"""Principal stretches (n, 3) of what a test prescribes (n,), stretch or amount of shear, by its channel."""


def nominal_stress(
    material: IsotropicMaterial, theta: FloatArray, mode: str, amount: FloatArray
) -> FloatArray:
    """Nominal stress along a mode, the slope of the energy by central differences.

    Parameters
    ----------
    theta : (n_parameters,) array
        Textbook values.
    mode : str
        One of :data:`MODES`; all but ``confined_compression`` keep the volume, as if incompressible.
    amount : (n,) array
        Stretches, or amounts of shear.

    Returns
    -------
    (n,) array
        Stress [MPa], of one direction where two are stretched.

    Raises
    ------
    MaterialError
        There is no such mode.
    """
    if mode not in MODES:
        raise MaterialError(f"mode '{mode}' is unknown; name one of {', '.join(MODES)}")
    above, below = (np.asarray(material.energy(MODES[mode](amount + h), theta)) for h in (_STEP, -_STEP))
    return (above - below) / (2.0 * _STEP) * (0.5 if mode == "equibiaxial" else 1.0)
