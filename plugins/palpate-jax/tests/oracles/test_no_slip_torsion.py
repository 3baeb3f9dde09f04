"""A disc or a sphere that does not slip, twisted on a half-space: T = 16/3 G a³ β (Reissner & Sagoci 1944).

The traction is infinite at the edge of the contact, so even cells converge slowly; cells that shrink
towards the edge do better. The torque depends neither on ν nor on how the contact came about.
"""

import numpy as np
import pytest

from palpate.mesh.specimens import half_space

EVEN = {
    4: {"n_radius": 4, "n_core": 4, "growth": 1.8},
    6: {"n_radius": 6, "n_core": 6, "growth": 1.5},
}
CROWDED = {"n_radius": 8, "n_core": 6, "crowding": 1.8, "growth": 1.8}

GRIP = 50.0
"""A coefficient of friction at which nothing slips."""

SMALL = 0.05
"""Contact radius over that of the sphere."""


@pytest.fixture(scope="module")
def glued_error(simulated, with_disc):
    """Relative error of the torque on a disc of radius 1 mm that is glued on."""

    def of(**mesh):
        limb = with_disc(half_space("hex8", 1.0, fine=1.2, extent=12.0, **mesh), "bonded", 1.0)
        torque = simulated(limb, [(0.0, 0.1)])["moment_Nmm"][-1, 2]
        return torque / (16.0 / 3.0 * np.deg2rad(0.1)) - 1.0

    return of


@pytest.mark.slow
def test_torque_of_a_glued_disc(glued_error):
    """Measured +1.35 %; the inscribed rim of 24 sides takes off 1.7 %, so the cells add about 3 %."""
    assert glued_error(**CROWDED) == pytest.approx(0.0, abs=0.02)


@pytest.mark.slow
def test_torque_of_a_glued_disc_approaches_it(glued_error, observed_order):
    """Measured +12.2 and +7.8 % on even cells: order 1.1, of a singularity that allows one."""
    errors = [glued_error(**mesh) for mesh in EVEN.values()]
    assert 0.8 < observed_order("torque of a glued disc", errors, list(EVEN)) < 2.0


def errors_of_grip(simulated, radius_mm, n):
    """Relative errors of the torque as the edge of the contact crosses a cell, of n in the radius.

    The sphere is pressed and twisted in turns. Nothing slips, so each twist adds what the contact of
    its moment resists. The radius of that is Hertz's of the force that the sphere feels: points of a
    cell across the edge touch one by one, so the sphere's own contact radius would count in cells.
    """
    scale, step = SMALL * radius_mm, 0.01
    limb = half_space("hex8", scale, n_radius=n, n_core=n, fine=1.3, growth=1.8, extent=30.0)
    path = []
    for k, share in enumerate((-0.5, -0.25, 0.0, 0.25)):
        depth = (1.0 + share / n) ** 2 * scale**2 / radius_mm
        path += [(depth, k * step), (depth, (k + 1) * step)]
    rows = simulated(limb, path, friction=GRIP)
    assert rows["sticking"][-1] == 1.0
    force, moment = (rows[name][-len(path) :, 2] for name in ("force_N", "moment_Nmm"))
    a = (3.0 * force[1::2] * radius_mm / 16.0) ** (1.0 / 3.0)
    return (moment[1::2] - moment[0::2]) / (16.0 / 3.0 * a**3 * np.deg2rad(step)) - 1.0


@pytest.mark.slow
def test_torque_of_a_sphere_that_grips(simulated, radius_mm, observed_order):
    """Friction that never slips: measured 16 and 9.4 % (root of mean square), order 1.3.

    Whole cells stick at the rim, so the error depends on the place of the edge in its cell: −2 to
    +22 % on the coarse mesh, −2 to +12 % on the fine one. Eight rings, beyond these tests, give 5.1 %,
    and six that shrink towards the edge (by 1.3) 3.4 %: none reaches 2 %.
    """
    errors = [np.sqrt(np.mean(errors_of_grip(simulated, radius_mm, n) ** 2)) for n in EVEN]
    assert observed_order("torque of a sphere that grips", errors, list(EVEN)) > 1.0
    assert errors[1] < 0.12
