"""A disc or a sphere that does not slip, twisted on a half-space: T = 16/3 G a³ β (Reissner & Sagoci 1944).

The traction is infinite at the edge of the contact, so even cells converge slowly; cells that shrink
towards the edge do better. The torque depends neither on ν nor on how the contact came about.
"""

import numpy as np
import pytest

from palpate.specimens import half_space

EVEN = {
    4: {"n_radius": 4, "n_core": 4, "growth": 1.5},
    6: {"n_radius": 6, "n_core": 6, "growth": 1.31},
}
CROWDED = {"n_radius": 8, "n_core": 6, "crowding": 1.8, "growth": 1.8}

GRIP = 50.0
"""A coefficient of friction at which nothing slips."""


@pytest.fixture(scope="module")
def glued_error(simulated, with_disc):
    """Relative error of the torque on a disc of radius 1 mm that is glued on."""

    def of(**mesh):
        limb = with_disc(half_space("hex8", 1.0, fine=1.25, extent=20.0, **mesh), "bonded", 1.0)
        torque = simulated(limb, [(0.0, 0.1)])["moment_Nmm"][-1, 2]
        return torque / (16.0 / 3.0 * np.deg2rad(0.1)) - 1.0

    return of


def test_torque_of_a_glued_disc(glued_error):
    """Measured +1.35 %; the inscribed rim of 24 sides takes off 1.7 %, so the cells add about 3 %."""
    assert glued_error(**CROWDED) == pytest.approx(0.0, abs=0.02)


def test_torque_of_a_glued_disc_approaches_it(glued_error, observed_order):
    """Measured +13.1 and +8.1 % on even cells: order 1.2, of a singularity that allows one."""
    errors = [glued_error(**mesh) for mesh in EVEN.values()]
    assert 0.8 < observed_order("torque of a glued disc", errors, list(EVEN)) < 2.0


def test_torque_of_a_sphere_that_grips(simulated, radius_mm, observed_order):
    """Friction that never slips. Measured +5.2 and +3.1 %: order 1.3 (+1.6 % at 8 cells, beyond these tests).

    The contact radius is Hertz's of the force that the sphere feels: points of a cell across the edge
    touch or not one by one, so the sphere's own contact radius would count in cells.
    """
    depth = 0.05**2 * radius_mm
    errors = []
    for n in EVEN:
        limb = half_space("hex8", 0.05 * radius_mm, n_radius=n, n_core=n, growth=1.5, extent=60.0)
        rows = simulated(limb, [(depth, 0.0), (depth, 0.01)], friction=GRIP)
        assert rows["sticking"][-1] == 1.0
        a = (3.0 * rows["force_N"][-1, 2] * radius_mm / 16.0) ** (1.0 / 3.0)
        errors.append(rows["moment_Nmm"][-1, 2] / (16.0 / 3.0 * a**3 * np.deg2rad(0.01)) - 1.0)
    assert errors[1] < 0.035
    assert 0.8 < observed_order("torque of a sphere that grips", errors, list(EVEN)) < 2.5
