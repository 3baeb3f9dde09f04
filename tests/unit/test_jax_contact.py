import numpy as np
import pytest

from palpate.specimens import block
from palpate_jax.contact import Contact, Law, Memory
from palpate_jax.march import pose

LAW = Law(radius_mm=7.5, penalty=4.0, friction=0.5)


@pytest.fixture
def contact():
    return Contact(block("tet10", n_across=4, n_down=1, width_mm=8.0, height_mm=2.0).mesh)


def test_faces_cover_the_upper_face(contact):
    assert sum(s.areas.sum() for s in contact.skins) == pytest.approx(64.0, rel=1e-12)


def test_force_is_the_pressure_over_the_cap(contact):
    u = np.zeros_like(contact._points)
    answer = contact.answer(u, pose(7.5, np.array([0.3, 0.0])), contact.no_memory(), LAW)
    arms = contact._positions(u) - [0.0, 0.0, 7.2]
    distance = np.linalg.norm(arms, axis=1)
    pressure = LAW.penalty * np.maximum(7.5 - distance, 0.0)
    assert answer.penetration_mm == pytest.approx(pressure.max() / LAW.penalty)
    np.testing.assert_allclose(answer.force_N[:2], 0.0, atol=1e-12)
    expected = (contact._areas * pressure * -arms[:, 2] / distance).sum()
    assert answer.force_N[2] == pytest.approx(expected, rel=1e-12)


def test_full_slip_turns_with_friction_times_pressure_times_radius(contact):
    u = np.zeros_like(contact._points)
    slippery = Law(LAW.radius_mm, LAW.penalty, 0.002)
    memory = contact.remember(u, pose(7.5, np.array([0.3, 0.0])), contact.no_memory(), slippery)
    answer = contact.answer(u, pose(7.5, np.array([0.3, 1.0])), memory, slippery)
    positions = contact._positions(u)
    pressure = LAW.penalty * np.maximum(7.5 - np.linalg.norm(positions - [0.0, 0.0, 7.2], axis=1), 0.0)
    radius = np.linalg.norm(positions[:, :2], axis=1)
    assert answer.sticking == 0.0
    expected = 0.002 * (contact._areas * pressure * radius).sum()
    assert answer.moment_Nmm[2] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("coupled", [True, False])
def test_stiffness_is_the_derivative_of_the_force(contact, coupled):
    rng = np.random.default_rng(0)
    u, d = 0.02 * rng.standard_normal((2, *contact._points.shape))
    here = pose(7.5, np.array([0.3, 4.0]))
    memory = Memory(
        contact._positions(u) @ here.rotation + [0.05, 0.0, -7.2], np.ones(len(contact._areas), bool)
    )
    h = 1e-7

    def slope(law):
        return -(
            contact.force(u + h * d, here, memory, law) - contact.force(u - h * d, here, memory, law)
        ) / (2 * h)

    law = LAW if coupled else Law(LAW.radius_mm, LAW.penalty, 1e6)  # everything sticks: nothing to leave out
    product = np.zeros_like(u)
    for skin, k in zip(contact.skins, contact.stiffness(u, here, memory, law, coupled=coupled), strict=True):
        local = np.einsum("fij,fj->fi", k, d[skin.nodes].reshape(len(skin.nodes), -1))
        np.add.at(product, skin.nodes, local.reshape(*skin.nodes.shape, 3))
    np.testing.assert_allclose(product, slope(law), atol=2e-6 * np.abs(product).max())


def test_first_touch_has_no_traction_and_sticks_afterwards(contact):
    u = np.zeros_like(contact._points)
    before = pose(7.5, np.array([0.3, 0.0]))
    memory = contact.remember(u, before, contact.no_memory(), LAW)
    assert memory.anchored.any()
    assert not memory.anchored.all()
    turned = pose(7.5, np.array([0.3, 0.01]))
    answer = contact.answer(u, turned, memory, LAW)
    assert answer.sticking > 0.85  # the rim presses too lightly to hold
    assert answer.moment_Nmm[2] > 0.0
    assert contact.answer(u, turned, contact.no_memory(), LAW).moment_Nmm[2] == pytest.approx(0.0, abs=1e-12)


def test_slip_moves_the_anchor_to_the_cone_and_a_reversal_sticks(contact):
    u = np.zeros_like(contact._points)
    at = [pose(7.5, np.array([0.3, a])) for a in (0.0, 20.0, 19.99)]
    memory = contact.remember(u, at[0], contact.no_memory(), LAW)
    sliding = contact.answer(u, at[1], memory, LAW)
    moved = contact.remember(u, at[1], memory, LAW)
    assert sliding.sticking < 0.2
    after = contact.answer(u, at[1], moved, LAW)
    assert after.moment_Nmm[2] == pytest.approx(sliding.moment_Nmm[2], rel=1e-9)
    assert contact.answer(u, at[2], moved, LAW).sticking > sliding.sticking + 0.5


def test_leaving_contact_forgets_the_anchor(contact):
    u = np.zeros_like(contact._points)
    pressed = contact.remember(u, pose(7.5, np.array([0.3, 0.0])), contact.no_memory(), LAW)
    lifted = contact.remember(u, pose(7.5, np.array([-1.0, 0.0])), pressed, LAW)
    assert not lifted.anchored.any()
