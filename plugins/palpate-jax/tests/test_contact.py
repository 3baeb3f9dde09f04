import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_indentation import (
    Box,
    BoxSettings,
    Capsule,
    CapsuleSettings,
    Cuff,
    CuffSettings,
    Punch,
    PunchSettings,
    Ring,
    RingSettings,
)
from palpate_jax import schedule as kinematics
from palpate_jax.contact import Contact, ContactLaw, ContactState, Memory

LAW = ContactLaw(Sphere(radius_mm=7.5), penalty=4.0, friction=0.5)
PRESSED = np.array([0.3, 0.0])


def pose(path):
    """The indenter at (depth_mm, rotation_deg)."""
    return kinematics.pose(np.array([path[0], 0.0, 0.0, 0.0, 0.0, path[1]]))


@pytest.fixture
def contact():
    return Contact(block("tet10", n_across=4, n_down=1, width_mm=8.0, height_mm=2.0).mesh)


@pytest.fixture
def at_rest(contact):
    return np.zeros_like(contact._rest)


def gap(contact, displacements, depth_mm):
    """Distance of every point to the sphere of LAW [mm], written out."""
    arms = contact.positions(displacements) - [0.0, 0.0, 7.5 - depth_mm]
    return np.linalg.norm(arms, axis=1) - 7.5


def untouched(contact):
    return contact.no_memory(pose(np.zeros(2)))


def touched(contact, displacements):
    """Memory of a press straight down."""
    return contact.remember(displacements, ContactState(pose(PRESSED), untouched(contact), LAW))


def test_faces_cover_the_upper_face(contact):
    assert sum(s.areas.sum() for s in contact.surfaces) == pytest.approx(64.0, rel=1e-12)


def test_force_is_the_pressure_over_the_cap(contact, at_rest):
    slippery = ContactLaw(LAW.shape, LAW.penalty, friction=0.0)
    answer = contact.answer(at_rest, ContactState(pose(PRESSED), untouched(contact), slippery))
    arms = contact.positions(at_rest) - [0.0, 0.0, 7.2]
    pressure = LAW.penalty * np.maximum(-gap(contact, at_rest, 0.3), 0.0)
    assert answer.penetration_mm == pytest.approx(pressure.max() / LAW.penalty)
    np.testing.assert_allclose(answer.force_N[:2], 0.0, atol=1e-12)
    expected = (contact.areas * pressure * -arms[:, 2] / np.linalg.norm(arms, axis=1)).sum()
    assert answer.force_N[2] == pytest.approx(expected, rel=1e-12)


WHERE = st.floats(-1.5, 1.5)


@settings(max_examples=25)
@given(WHERE, WHERE)
def test_the_arm_of_the_pressure_depends_little_on_where_its_edge_is_in_a_face(x, y):
    """∫ p r² dA decides the torque: within 3.2 % in 400 places, 17 % with three points in a face."""
    contact = Contact(block("tet10", n_across=4, n_down=1, width_mm=8.0, height_mm=2.0).mesh)

    def weighted(r):
        return np.maximum(7.5 - np.hypot(r, 7.2), 0.0) * r**2

    r = np.linspace(0.0, np.sqrt(7.5**2 - 7.2**2), 2001)
    places = contact.positions(np.zeros_like(contact._rest))[:, :2] - [x, y]
    found = contact.areas @ weighted(np.hypot(*places.T))
    assert found == pytest.approx(np.trapezoid(2.0 * np.pi * r * weighted(r), r), rel=0.05)


def test_full_slip_turns_with_friction_times_pressure_times_radius(contact, at_rest):
    slippery = ContactLaw(LAW.shape, LAW.penalty, 0.002)
    memory = untouched(contact)
    for rotation in (0.0, 2.0, 4.0):
        load = ContactState(pose(np.array([0.3, rotation])), memory, slippery)
        answer = contact.answer(at_rest, load)
        memory = contact.remember(at_rest, load)
    pressure = LAW.penalty * np.maximum(-gap(contact, at_rest, 0.3), 0.0)
    radius = np.linalg.norm(contact.positions(at_rest)[:, :2], axis=1)
    assert answer.sticking == 0.0
    expected = 0.002 * (contact.areas * pressure * radius).sum()
    assert answer.moment_Nmm[2] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("shape", [Sphere(radius_mm=7.5), Punch(PunchSettings(radius="3 mm", edge="1.5 mm"))])
@pytest.mark.parametrize("anchored", [True, False])
@pytest.mark.parametrize("coupled", [True, False])
def test_stiffness_is_the_derivative_of_the_force(contact, shape, anchored, coupled):
    rng = np.random.default_rng(0)
    u, d = 0.02 * rng.standard_normal((2, *contact._rest.shape))
    here = pose(np.array([0.3, 4.0]))
    # Coupled, some points slide; otherwise everything sticks, and there is nothing to leave out.
    law = ContactLaw(shape, LAW.penalty, 0.5 if coupled else 1e6)
    shift = [0.05, 0.0, 0.0] if anchored else [0.05, 0.02, -0.6]
    memory = Memory(
        here.into(contact.positions(u)) + shift, np.full(len(contact.areas), anchored, dtype=bool)
    )
    load, h = ContactState(here, memory, law), 1e-7
    slope = -(contact.force(u + h * d, load) - contact.force(u - h * d, load)) / (2 * h)
    product = np.zeros_like(u)
    stiffness = contact.stiffness(u, load, coupled=coupled)
    for skin, (faces, k) in zip(contact.surfaces, stiffness, strict=True):
        nodes = skin.nodes[faces]
        local = np.einsum("fij,fj->fi", k, d[nodes].reshape(len(nodes), -1))
        np.add.at(product, nodes, local.reshape(*nodes.shape, 3))
    assert np.abs(slope).max() > 0.01
    np.testing.assert_allclose(product, slope, atol=2e-6 * np.abs(product).max())


def test_a_point_is_anchored_where_its_way_met_the_surface(contact, at_rest):
    """A straight way through the surface, in one step or in two, pulls the same."""
    sticky = ContactLaw(LAW.shape, LAW.penalty, 1e6)
    lateral = np.full_like(at_rest, (0.2, 0.0, 0.0))
    once = contact.answer(lateral, ContactState(pose(PRESSED), untouched(contact), sticky))
    memory = contact.remember(0.5 * lateral, ContactState(pose(0.5 * PRESSED), untouched(contact), sticky))
    twice = contact.answer(lateral, ContactState(pose(PRESSED), memory, sticky))
    assert once.force_N[0] > 0.1 * once.force_N[2]
    assert twice.force_N[0] == pytest.approx(once.force_N[0], rel=0.02)


def test_a_press_straight_down_anchors_what_it_touches(contact, at_rest):
    memory = touched(contact, at_rest)
    assert memory.anchored.any()
    assert not memory.anchored.all()
    turned = pose(np.array([0.3, 0.01]))
    assert contact.answer(at_rest, ContactState(turned, memory, LAW)).moment_Nmm[2] > 0.0


def test_slip_moves_the_anchor_to_the_cone_and_a_reversal_sticks(contact, at_rest):
    turned, back = (pose(np.array([0.3, a])) for a in (20.0, 19.99))
    memory = touched(contact, at_rest)
    sliding = contact.answer(at_rest, ContactState(turned, memory, LAW))
    moved = contact.remember(at_rest, ContactState(turned, memory, LAW))
    assert sliding.sticking < 0.2
    after = contact.answer(at_rest, ContactState(turned, moved, LAW))
    assert after.moment_Nmm[2] == pytest.approx(sliding.moment_Nmm[2], rel=1e-9)
    assert contact.answer(at_rest, ContactState(back, moved, LAW)).sticking > sliding.sticking + 0.5


def test_leaving_contact_drops_the_anchor(contact, at_rest):
    away = ContactState(pose(np.array([-1.0, 0.0])), touched(contact, at_rest), LAW)
    lifted = contact.remember(at_rest, away)
    assert not lifted.anchored.any()
    np.testing.assert_allclose(lifted.anchors, contact.positions(at_rest) - [0.0, 0.0, 1.0])


@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("way", [(1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 30), (0.4, 0.5, -0.2, 9, 20, -20)])
def test_the_drag_is_the_change_of_the_force_with_the_indenters_motion(contact, way, tilted):
    u = 0.02 * np.random.default_rng(1).standard_normal(contact._rest.shape)
    at, way, h = np.array([0.3, 0.1, 0.0, 0.0, 0.0, 4.0]), np.array(way, dtype=float), 1e-6
    at[3:5] = (8.0, -5.0) if tilted else 0.0
    memory = touched(contact, u)
    ends = [contact.force(u, ContactState(kinematics.pose(at + s * h * way), memory, LAW)) for s in (1, -1)]
    drag = contact.drag(u, ContactState(kinematics.pose(at), memory, LAW), kinematics.motion(at, way))
    np.testing.assert_allclose(drag, (ends[0] - ends[1]) / (2 * h), atol=1e-5 * np.abs(drag).max())


def test_a_node_that_slides_along_the_indenter_keeps_its_depth(contact, at_rest):
    load = ContactState(pose(PRESSED), touched(contact, at_rest), LAW)
    lateral = np.full_like(at_rest, (0.4, 0.0, 0.0))
    along = contact.along(at_rest, lateral, load)
    shape, rest = LAW.shape, load.pose.into(contact._rest[contact._nodes])
    flat = shape.distance(rest) + 0.4 * shape.normals(rest)[0][:, 0]
    reached = shape.distance(load.pose.into((contact._rest + along)[contact._nodes]))
    near = np.abs(shape.distance(rest)) < 0.5
    np.testing.assert_allclose(reached[near], flat[near], atol=1e-3)
    assert np.abs(along - lateral).max() > 5e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape",
    [
        Sphere(radius_mm=7.5),
        Punch(PunchSettings(radius="3 mm", edge="1 mm")),
        Capsule(CapsuleSettings(radius="3 mm", length="4 mm")),
        Box(BoxSettings(length="5 mm", width="3 mm", height="4 mm", edge="1 mm")),
        Ring(RingSettings(radius="2 mm", edge="1 mm")),
        Cuff(CuffSettings(radius="20 mm", angle="30 deg", width="4 mm", edge="1 mm")),
    ],
    ids=lambda shape: shape.name,
)
def test_a_tool_that_slides_is_pulled_with_friction_times_its_normal_force(contact, at_rest, shape):
    """F_t = μ F_n: the skin below every tool has moved far to one side, all of it slides."""
    friction = 0.3
    law, place = ContactLaw(shape, 4.0, friction), pose(np.array([0.1, 0.0]))
    memory = Memory(
        place.into(contact.positions(at_rest)) - [5.0, 0.0, 0.0], np.ones(len(contact.areas), bool)
    )
    points = contact.touched(at_rest, ContactState(place, memory, law)).points
    touching = points.depth > 0.0
    assert touching.sum() > 4
    assert points.sliding[touching].all()
    pull = np.linalg.norm(points.friction[touching], axis=1)
    np.testing.assert_allclose(pull, friction * points.pressure[touching], rtol=1e-12)
    # Nowhere has friction a part along the normal, and on a flat face all of it is along the motion.
    normals = shape.normals(points.positions[touching])[0]
    np.testing.assert_allclose((points.friction[touching] * normals).sum(axis=1), 0.0, atol=1e-12)
    flat = normals[:, 2] < -1.0 + 1e-12
    np.testing.assert_allclose(points.friction[touching][flat][:, 1:], 0.0, atol=1e-12)
