"""The force of a sphere on a half-space without friction (Hertz; Sneddon for a true sphere).

F = E* [½ (a² + R²) ln((R + a)/(R − a)) − a R] at d = ½ a ln((R + a)/(R − a)).
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from palpate.specimens import half_space

CONTACT = 0.05
"""Hertz's contact radius over that of the sphere: strains so small that the material is linear."""

HEX8 = [(4, 4), (6, 6)]
"""Cells in the contact radius and across the core, coarse and fine."""


def sneddon(depth, radius):
    """Contact radius and force over E* of a rigid sphere."""
    half_log = lambda a: 0.5 * np.log((radius + a) / (radius - a))  # noqa: E731
    a = brentq(lambda a: a * half_log(a) - depth, 1e-9 * radius, 0.99 * radius)
    return a, (a**2 + radius**2) * half_log(a) - a * radius


def test_a_small_sneddon_is_hertz():
    a, force = sneddon(1e-4, 7.5)
    assert a == pytest.approx(np.sqrt(7.5e-4), rel=1e-4)
    assert force == pytest.approx(4.0 / 3.0 * np.sqrt(7.5) * 1e-6, rel=1e-4)


@pytest.fixture(scope="module")
def error(simulated, radius_mm):
    """Relative error of the force on a mesh."""
    a = CONTACT * radius_mm
    depth = a**2 / radius_mm
    _, expected = sneddon(depth, radius_mm)

    def of(kind, n_radius, n_core, nu):
        limb = half_space(kind, a, n_radius=n_radius, n_core=n_core, growth=2.0 if kind == "tet10" else 1.5)
        rows = simulated(limb, [(depth, 0.0)], nu=nu)
        assert rows["penetration_mm"][-1] < 0.01 * depth
        return rows["force_N"][-1, 2] * (1.0 - nu) / 2.0 / expected - 1.0

    return of


@pytest.mark.parametrize("nu", [0.3, 0.4975])
def test_force_is_sneddons_on_quadratic_tetrahedra(error, nu):
    """Measured +0.9 % (ν = 0.3) and +0.5 %; not yet a trend: two cells give +0.2 % and −0.3 %."""
    assert error("tet10", 3, 2, nu) == pytest.approx(0.0, abs=0.01)


def test_hexahedra_approach_sneddon(error):
    """Measured +4.5 % and +3.1 %: order 0.9."""
    coarse, fine = (error("hex8", *mesh, 0.3) for mesh in HEX8)
    order = np.log(coarse / fine) / np.log(HEX8[1][0] / HEX8[0][0])
    assert 0.0 < fine < 0.035
    assert order > 0.7
