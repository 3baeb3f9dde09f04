"""A sphere pressed and twisted on a half-space: partial slip (Lubkin 1951), full slip and reversal (Masing).

With c the stick radius, a the contact radius, m = 1 − (c/a)² and D(c) = K(m) − E(m),
β G a²/(μF) = 3/(4π) D(c) and
T/(μFa) = 4/π {(c/a)³ D(c) + 3 ∫ t² D(t) dt from c/a to 1}.
"""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from palpate.mesh.specimens import half_space

FULL_SLIP = 3.0 * np.pi / 16.0

TABLE = np.array(
    [
        (0.99, 0.003759, 0.019751),
        (0.95, 0.018994, 0.093920),
        (0.90, 0.038514, 0.176345),
        (0.80, 0.079419, 0.310527),
        (0.70, 0.123436, 0.409738),
        (0.60, 0.171637, 0.480480),
        (0.50, 0.225712, 0.528576),
        (0.30, 0.365570, 0.576868),
        (0.10, 0.639718, 0.588620),
    ]
)
"""c/a, βGa²/(μF) and T/(μFa), tabulated apart from the closed form above."""

STICK = (0.95, 0.8, 0.6, 0.4, 0.25)
FRICTION, CONTACT = 0.3, 0.05

pytestmark = pytest.mark.slow


def _difference(c):
    return ellipk(1.0 - c**2) - ellipe(1.0 - c**2)


def twist(c):
    """βGa²/(μF) at which a circle of radius c a sticks."""
    return 3.0 / (4.0 * np.pi) * _difference(c)


def torque(c):
    """T/(μFa) there."""
    return 4.0 / np.pi * (c**3 * _difference(c) + 3.0 * quad(lambda t: t**2 * _difference(t), c, 1.0)[0])


def virgin(x):
    """T/(μFa) of a first twist to x = βGa²/(μF)."""
    return torque(brentq(lambda c: twist(c) - x, 1e-12, 1.0)) if x > 0.0 else 0.0


def test_the_closed_form_is_the_table():
    for c, x, y in TABLE:
        assert twist(c) == pytest.approx(x, abs=6e-7)
        assert torque(c) == pytest.approx(y, abs=6e-7)


def test_the_closed_form_ends_in_full_slip():
    assert virgin(3.0) == pytest.approx(FULL_SLIP, rel=1e-4)


@pytest.fixture(scope="module")
def loop(simulated, radius_mm):
    """βGa²/(μF), T/(μFa) and the share of sticking points along a loop of twist.

    By stages to one end, back to its opposite, forth, and on into full slip. The solution takes the
    force as given, so a is Hertz's radius of the force that the sphere feels. Shear modulus 1 MPa;
    ν near a half, where pressing and twisting do not mix.
    """
    depth = CONTACT**2 * radius_mm
    top = twist(STICK[-1])
    back = top - 2.0 * top * np.array([0.2, 0.5, 1.0])
    stages = np.array([*(twist(c) for c in STICK), *back, *(-back), 1.3])
    limb = half_space(
        "hex8",
        CONTACT * radius_mm,
        n_radius=6,
        n_core=4,
        fine=1.2,
        crowding=1.4,
        growth=1.8,
        extent=30.0,
    )
    beta = stages * FRICTION * 16.0 / 3.0 * CONTACT
    rows = simulated(limb, [(depth, 0.0), *((depth, b) for b in np.rad2deg(beta))], friction=FRICTION)
    force, moment = rows["force_N"][2:, 2], rows["moment_Nmm"][2:, 2]
    a = (3.0 * force * radius_mm / 16.0) ** (1.0 / 3.0)
    return beta * a**2 / (FRICTION * force), moment / (FRICTION * force * a), rows["sticking"][2:]


def test_partial_slip_is_lubkins(loop):
    """Measured +0.6, +1.3, +1.6, +1.1 and +0.1 % at the five c/a.

    No order: with 4 and 5 rings the greatest error is 5.1 and 2.7 %, yet relative to the torque of
    full slip all three meshes err by 0.8 to 1.0 % (root of mean square). Where in its cell the edge
    of the contact is matters as much as the cells' size.
    """
    x, y, _ = (column[: len(STICK)] for column in loop)
    np.testing.assert_allclose(y, [virgin(value) for value in x], rtol=0.03)


def test_stick_shrinks_inwards(loop):
    assert (np.diff(loop[2][: len(STICK)]) < 0.0).all()


def test_reversal_is_masings(loop):
    """T(β) = T_m − 2 T(half the way back) from one end of the loop, and its mirror from the other.

    Measured within 1.5 % of the torque at the ends.
    """
    x, y, _ = loop
    first = len(STICK)
    top = x[first - 1]
    back, forth = slice(first, first + 3), slice(first + 3, first + 6)
    expected = [virgin(top) - 2.0 * virgin(0.5 * (top - value)) for value in x[back]]
    mirrored = [2.0 * virgin(0.5 * (top + value)) - virgin(top) for value in x[forth]]
    np.testing.assert_allclose(y[back], expected, atol=0.03 * virgin(top))
    np.testing.assert_allclose(y[forth], mirrored, atol=0.03 * virgin(top))


def test_full_slip(loop):
    """Measured −0.08 %."""
    assert loop[1][-1] == pytest.approx(FULL_SLIP, rel=0.02)
    assert loop[2][-1] == 0.0
