"""Closed forms that a solver's answers are held against: a half-space, and a small homogeneous strain."""

import numpy as np

from palpate import mechanics
from palpate.domain import FloatArray
from palpate.domain.material import Material

RADIUS_MM = 7.5
"""Of the sphere on the half-space."""

DEPTH_MM = 0.0025 * RADIUS_MM
"""So little that strains are small: the contact has a twentieth of the sphere's radius."""

ROTATION_DEG = 0.25
HALF_SPACE_PATH = np.array([(0.0, 0.0), (DEPTH_MM, 0.0), (DEPTH_MM, ROTATION_DEG)])
HALF_SPACE_FRICTION = 2.0
"""Enough for hardly any slip at that rotation."""

SMALL_STRAIN = 1e-3


def half_space_peaks(material: Material, theta: FloatArray) -> dict[str, float]:
    """Force [N] and torque [N·mm] at the end of ``HALF_SPACE_PATH``, by channel.

    Hertz: F = 4/3 E/(1 − ν²) √R d^1.5. Reissner and Sagoci: T = 16/3 μ a³ φ with a² = R d, for a disc
    that sticks.

    Parameters
    ----------
    theta : (n_parameters,) array
        Textbook values.
    """
    mu, kappa = mechanics.initial_moduli(material, theta)
    young, poisson = _young_and_poisson(mu, kappa)
    contact_mm = np.sqrt(RADIUS_MM * DEPTH_MM)
    return {
        "force": 4 / 3 * young / (1 - poisson**2) * np.sqrt(RADIUS_MM) * DEPTH_MM**1.5,
        "torque": 16 / 3 * mu * contact_mm**3 * np.radians(ROTATION_DEG),
    }


def small_strain_modulus(channel: str, material: Material, theta: FloatArray) -> float | None:
    """Slope at rest [MPa] of the nominal stress of a homogeneous test; None for a channel of another name."""
    mu, kappa = mechanics.initial_moduli(material, theta)
    young, poisson = _young_and_poisson(mu, kappa)
    return {
        "uniaxial": young,
        "equibiaxial": young / (1 - poisson),
        "pure_shear": young / (1 - poisson**2),
        "simple_shear": mu,
        "confined_compression": kappa + 4 / 3 * mu,
    }.get(channel)


def _young_and_poisson(mu: float, kappa: float) -> tuple[float, float]:
    return 9 * kappa * mu / (3 * kappa + mu), (3 * kappa - 2 * mu) / (6 * kappa + 2 * mu)
