"""A sphere pressed deep into an incompressible half-space (Lin et al. 2009): finite strain.

F = π a² B (λ^−2 − λ) with λ = 1 − 0.2 a/R, of contact radius a: the sphere's mean pressure is the
nominal stress of a bar at an estimated stretch. Its modulus is fitted to Hertz, E = 1.06 B. It is an
approximation: to first order it is (1 + 0.2 a/R) times the linear solution, which
itself has no such term, so an exact solver differs from it by a few per cent for a > 0.1 R.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from palpate.mesh.specimens import half_space

MODULUS = 3.0 / (27.0 * np.pi / 80.0)
"""B of a shear modulus of 1 MPa."""

SMALL = 0.05
"""√(R d)/R at which strains are so small that the material is linear."""

MESH = {"n_radius": 3, "n_core": 2, "growth": 1.8, "fine": 1.1}


def lin(a, radius):
    stretch = 1.0 - 0.2 * a / radius
    return np.pi * a**2 * MODULUS * (stretch**-2 - stretch)


def half_log(a, radius):
    return 0.5 * np.log((radius + a) / (radius - a))


def contact_radius(depth, radius):
    """Sneddon's, of a true sphere: a mesh's own is known to a cell, and force goes with its cube."""
    return brentq(lambda a: a * half_log(a, radius) - depth, 1e-9 * radius, 0.99 * radius)


def linear(a, radius):
    """Sneddon's force of a linear material at that contact radius."""
    return 4.0 * ((a**2 + radius**2) * half_log(a, radius) - a * radius)


def test_the_formula_is_hertzs_at_small_depth():
    assert lin(1e-5, 1.0) == pytest.approx(16.0 / 3.0 * 1e-15, rel=1e-5)
    assert pytest.approx(1.06, abs=1e-3) == 3.0 / MODULUS


def test_the_formula_departs_from_linear_theory_to_first_order():
    """The finite strain that it adds is 0.2 a/R, to be had at the smallest depth."""
    a = np.array([1e-3, 1e-2])
    np.testing.assert_allclose((lin(a, 1.0) / linear(a, 1.0) - 1.0) / a, 0.2, rtol=0.03)


@pytest.fixture(scope="module")
def over_hertz(simulated, radius_mm):
    """Force over Hertz's on a mesh of the size of the contact, relative to that of a small depth.

    Its cells stay the same in units of the contact radius, so what the mesh errs by (9 %) drops out:
    0.9960 and 0.9619 at the sizes below; 0.9961 and 0.9611 on cells of half the size, which err by 2.7 %,
    and 0.9964 and 0.9641 on quadratic tetrahedra, which err by 0.04 %.
    """

    def of(size):
        depth = size**2 * radius_mm
        limb = half_space("hex8", size * radius_mm, **MESH)
        force = simulated(limb, [(depth, 0.0)])["force_N"][-1, 2]
        return force / (16.0 / 3.0 * np.sqrt(radius_mm) * depth**1.5)

    small = of(SMALL)
    return lambda size: of(size) / small


@pytest.mark.slow
@pytest.mark.parametrize(("size", "within"), [(0.1, 0.025), (0.4, 0.05)])
def test_force_is_near_lins(over_hertz, radius_mm, size, within):
    """Measured −1.9 and −4.0 %, at depths of 0.01 and 0.16 radii.

    The solver's force is 0.4 and 3.8 % below Hertz's and the formula's 1.5 and 0.2 % above. With Hertz's
    contact radius √(R d) instead of Sneddon's the formula would be 2.1 and 9 % above Hertz.
    """
    depth = size**2 * radius_mm
    hertz = 16.0 / 3.0 * np.sqrt(radius_mm) * depth**1.5
    expected = lin(contact_radius(depth, radius_mm), radius_mm) / hertz
    assert over_hertz(size) == pytest.approx(expected, rel=within)
