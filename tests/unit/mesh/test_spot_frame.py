"""The axis of press and twist in the frame of a spot."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Limb, Mesh, Spot
from palpate.errors import StudyError
from palpate.indenters import Sphere
from palpate.mesh.spot_frame import indentation_of, spot_axes

PROTOCOL = Indentation(indenter=Sphere(radius_mm=5.0), path=[(0, 0), (3, 0)], friction=1.0)
LIMB = Limb(
    spot=Spot(name="p1", normal=np.array([1.0, 2.0, 2.0])),
    mesh=Mesh(
        points_mm=np.eye(4, 3),
        cells={"tet4": np.arange(4)[None]},
        cell_regions={"tet4": np.zeros(1, dtype=int)},
        regions=("tissue",),
        node_sets={},
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


def test_without_a_tilt_the_limb_is_as_it_was():
    assert pressed((0.0, 0.0)) is LIMB


def test_an_indenter_does_not_press_along_the_skin():
    with pytest.raises(StudyError, match="below 30°"):
        replace(PROTOCOL, tilt_deg=(60.0, 60.0))
