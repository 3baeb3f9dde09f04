"""The axis of press and twist in the frame of a spot."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from palpate.domain import Indentation, Job, Limb, Mesh, Spot
from palpate.domain.indenter import Sphere
from palpate.errors import StudyError
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import in_spot_frame, indentation_of, spot_axes

PROTOCOL = Indentation(indenter=Sphere(radius_mm=5.0), path=[(0, 0), (3, 0)], friction=1.0)
LIMB = Limb(
    spot=Spot(name="p1", normal=np.array([1.0, 2.0, 2.0])),
    mesh=Mesh(
        points_mm=np.eye(4, 3),
        cells={"tet4": np.arange(4)[None]},
        cell_regions={"tet4": np.zeros(1, dtype=int)},
        regions=("tissue",),
        node_sets={"contact": np.arange(0)},
    ),
)


def pressed(tilt_deg):
    protocol = replace(PROTOCOL, tilt_deg=tilt_deg)
    job = Job(spot="p1", set_id=0, materials={}, thetas={}, protocol=protocol)
    return indentation_of(job, LIMB, "a solver")[1]


def test_a_tilt_rotates_the_axis_about_an_axis_of_the_spot():
    x, y, z = spot_axes(LIMB.spot.normal).T
    angle = np.radians(20.0)
    np.testing.assert_allclose(
        pressed((20.0, 0.0)).spot.normal, np.cos(angle) * z - np.sin(angle) * y, atol=1e-12
    )
    np.testing.assert_allclose(
        pressed((0.0, 20.0)).spot.normal, np.cos(angle) * z + np.sin(angle) * x, atol=1e-12
    )
    assert pressed((3.0, 4.0)).spot.normal @ z == pytest.approx(np.cos(np.radians(5.0)))


@given(
    normal=arrays(float, 3, elements=st.floats(-1.0, 1.0)).filter(lambda n: np.linalg.norm(n) > 0.1),
    tilt_deg=st.tuples(*2 * [st.floats(-15.0, 15.0)]),
)
def test_a_tilt_turns_no_tool_about_its_axis(normal, tilt_deg):
    limb = replace(LIMB, spot=Spot(name="p1", normal=normal))
    job = Job(spot="p1", set_id=0, materials={}, thetas={}, protocol=replace(PROTOCOL, tilt_deg=tilt_deg))
    spot = indentation_of(job, limb, "a solver")[1].spot
    rotation = spot_axes(spot.normal, spot.along) @ spot_axes(limb.spot.normal).T
    vector = Rotation.from_matrix(rotation).as_rotvec(degrees=True)
    np.testing.assert_allclose(vector @ limb.spot.normal, 0.0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(vector), np.hypot(*tilt_deg), atol=1e-5)


def test_tilts_are_the_same_by_their_values():
    assert [replace(PROTOCOL, tilt_deg=t).tilt_deg for t in ([0, 0], np.zeros(2))] == [(0.0, 0.0)] * 2
    with pytest.raises(StudyError, match="two angles"):
        replace(PROTOCOL, tilt_deg=(1.0, 0.0, 0.0))


def test_without_a_tilt_the_limb_is_as_it_was():
    assert pressed((0.0, 0.0)) is LIMB


class Plate(Sphere):
    """A flat square, 10 mm wide."""

    def distance(self, points):
        out = np.abs(points[..., :2]) - 5.0
        return np.maximum(out.max(axis=-1), -points[..., 2])


@pytest.mark.parametrize(("degrees", "lift"), [(0.0, 0.0), (3.0, 5.0 * np.sin(np.radians(3.0)))])
def test_a_tilted_flat_tool_first_touches_at_depth_0(degrees, lift):
    limb = block("hex8", n_across=20, n_down=2, width_mm=40.0)
    press = replace(PROTOCOL, indenter=Plate(radius_mm=5.0), tilt_deg=(degrees, 0.0))
    job = Job(spot="p1", set_id=0, materials={}, thetas={}, protocol=press)
    moved = indentation_of(job, limb, "a solver")[1]
    gaps = press.indenter.distance(in_spot_frame(moved).points_mm[limb.mesh.node_sets["contact"]])
    assert gaps.min() == pytest.approx(0.0, abs=1e-6)
    back = moved.spot.position_mm - limb.spot.position_mm
    # Nodes are 2 mm apart, so the one that is touched first is up to 2 mm from the edge.
    assert 0.8 * lift - 1e-9 <= back @ moved.spot.normal <= lift + 1e-9
    np.testing.assert_allclose(np.cross(back, moved.spot.normal), 0.0, atol=1e-12)


def test_an_indenter_does_not_press_along_the_skin():
    with pytest.raises(StudyError, match="below 30°"):
        replace(PROTOCOL, tilt_deg=(60.0, 60.0))
