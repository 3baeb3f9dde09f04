"""The rigid tools keep the contract of indenters, and are the shapes that they are called after."""

import numpy as np
import pytest

from palpate.api import MeshError, Sphere
from palpate.testing import IndenterContract
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

BOX = {"length": "45 mm", "width": "15 mm", "height": "10 mm", "edge": "2 mm"}
CUFF = {"radius": "40 mm", "angle": "120 deg", "width": "20 mm", "edge": "2 mm"}
CAPSULE = {"radius": "5 mm", "length": "20 mm"}


class TestPunch(IndenterContract):
    @pytest.fixture
    def indenter(self):
        return Punch(PunchSettings(radius="5 mm", edge="1 mm"))


class TestCapsule(IndenterContract):
    @pytest.fixture
    def indenter(self):
        return Capsule(CapsuleSettings(**CAPSULE, turn="30 deg"))


class TestBox(IndenterContract):
    @pytest.fixture
    def indenter(self):
        return Box(BoxSettings(**BOX, turn="-20 deg"))


class TestRing(IndenterContract):
    @pytest.fixture
    def indenter(self):
        return Ring(RingSettings(radius="12 mm", edge="3 mm"))


class TestCuff(IndenterContract):
    @pytest.fixture
    def indenter(self):
        return Cuff(CuffSettings(**CUFF))


@pytest.mark.parametrize(
    ("tool", "x", "distance"),
    [
        (Punch(PunchSettings(radius="5 mm", edge="1 mm")), (3.0, 0.0, -2.0), 2.0),
        (Punch(PunchSettings(radius="5 mm", edge="1 mm")), (0.0, 8.0, 4.0), 3.0),
        (Capsule(CapsuleSettings(**CAPSULE)), (10.0, 0.0, -1.0), 1.0),
        (Capsule(CapsuleSettings(**CAPSULE, turn="90 deg")), (0.0, 18.0, 5.0), 3.0),
        (Box(BoxSettings(**BOX)), (22.5 + 3.0, 0.0, 5.0), 3.0),
        (Box(BoxSettings(**BOX)), (20.5 + 3.0, 5.5 + 4.0, 5.0), 3.0),
        (Ring(RingSettings(radius="12 mm", edge="3 mm")), (0.0, 12.0, -1.0), 1.0),
        (Cuff(CuffSettings(**CUFF)), (0.0, 0.0, -40.0 + 15.0), 25.0),
        (Cuff(CuffSettings(**CUFF)), (39.0 * np.sin(1.0), 5.0, 39.0 * np.cos(1.0) - 40.0), 1.0),
    ],
)
def test_a_distance_is_that_of_the_shape(tool, x, distance):
    assert tool.distance(np.array([x]))[0] == pytest.approx(distance, abs=1e-12)


def test_the_end_of_a_cuff_is_round():
    tool, angle = Cuff(CuffSettings(**CUFF)), np.deg2rad(60.0)
    end = np.array([42.0 * np.sin(angle), 0.0, 42.0 * np.cos(angle) - 40.0])
    past = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    assert tool.distance((end + 5.0 * past)[None])[0] == pytest.approx(3.0, abs=1e-12)


def test_the_section_of_a_punch_is_its_face():
    punch = Punch(PunchSettings(radius="5 mm", edge="1 mm"))
    assert punch.contact_radius_mm(2.0) == pytest.approx(5.0, rel=0.02)
    assert punch.reach_mm(2.0) == pytest.approx(5.0, rel=0.02)


def test_bounds_hold_a_turned_cuff():
    turned = Cuff(CuffSettings(radius="40 mm", angle="120 deg", width="60 mm", edge="3 mm", turn="35 deg"))
    points, _ = turned.surface()
    assert (turned.distance(turned.bounds_mm[1] * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])) > 0.0).all()
    assert np.abs(turned.distance(points)).max() < 3.0


def test_a_radius_does_not_shrink_to_nothing():
    with pytest.raises(MeshError, match=r"smaller radius in \[budget\]"):
        Capsule(CapsuleSettings(radius="1 mm", length="10 mm")).grown(-2.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Punch(PunchSettings(radius="3 mm", edge="4 mm")), "rounded by 4 mm, where less than 3 mm"),
        (lambda: Box(BoxSettings(**BOX | {"edge": "6 mm"})), "at most 5 mm fit"),
        (lambda: Ring(RingSettings(radius="3 mm", edge="3 mm")), "less than 3 mm fit"),
        (lambda: Cuff(CuffSettings(**CUFF | {"edge": "11 mm"})), "at most 10 mm fit"),
    ],
)
def test_a_rounding_that_does_not_fit_is_refused(build, message):
    with pytest.raises(MeshError, match=message):
        build()


def test_a_capsule_without_length_is_a_sphere():
    from palpate.api import Sphere

    points = np.random.default_rng(0).uniform(-9.0, 9.0, (50, 3))
    capsule = Capsule(CapsuleSettings(radius="7.5 mm", length="0 mm"))
    for got, known in zip(capsule.normals(points), Sphere(radius_mm=7.5).normals(points), strict=True):
        np.testing.assert_allclose(got, known, atol=1e-12)


@pytest.mark.parametrize(("turn", "is_long"), [(0.0, 0), (90.0, 1)])
def test_a_plate_reaches_further_along_its_length(turn, is_long):
    plate = Box(BoxSettings(length="45 mm", width="15 mm", height="10 mm", edge="2 mm", turn=f"{turn} deg"))
    reach = plate.reaches_mm(4.0, np.eye(2))
    assert reach[is_long] == pytest.approx(22.5, rel=0.02)
    assert reach[1 - is_long] == pytest.approx(7.5, rel=0.05)
    assert (reach <= plate.reach_mm(4.0)).all()


def test_a_cuff_reaches_half_its_chord_across_and_half_its_width_along():
    cuff = Cuff(CuffSettings(radius="35 mm", angle="120 deg", width="30 mm", edge="3 mm"))
    chord = 35.0 * np.sin(np.deg2rad(60.0))
    np.testing.assert_allclose(cuff.reaches_mm(5.0, np.eye(2)), [chord, 15.0])


def test_a_sphere_reaches_as_far_to_every_side():
    angles = np.linspace(0.0, 6.0, 7)
    reach = Sphere(radius_mm=7.5).reaches_mm(5.0, np.column_stack([np.cos(angles), np.sin(angles)]))
    np.testing.assert_allclose(reach, Sphere(radius_mm=7.5).reach_mm(5.0))
