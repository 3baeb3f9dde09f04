"""The frame of a spot is right-handed with z outward; the signs of force and torque hang on z alone."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from palpate.domain import Limb, Spot
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import SpotWrench, in_spot_frame, spot_axes

normals = st.one_of(
    st.sampled_from([(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]),
    st.integers(0, 10**6).map(lambda seed: tuple(Rotation.random(rng=seed).apply([0.0, 0.0, 1.0]))),
)


@given(normals)
def test_axes_are_right_handed_about_the_normal(normal):
    axes = spot_axes(np.array(normal))
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_array_equal(axes[:, 2], normal)


def test_x_is_along_a_given_direction():
    axes = spot_axes(np.array([0.0, 0.6, 0.8]), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(axes[:, 0], [0.0, 0.8, -0.6], atol=1e-15)


def test_a_normal_along_z_leaves_the_mesh_as_it_is():
    limb = block("tet10", n_across=2, n_down=1)
    np.testing.assert_array_equal(in_spot_frame(limb).points_mm, limb.mesh.points_mm)


@given(normals)
def test_the_spot_becomes_the_origin_and_its_normal_z(normal):
    spot = Spot(name="p", position_mm=[1.0, 2.0, 3.0], normal=normal)
    mesh = block("hex8", n_across=2, n_down=1).mesh
    points = in_spot_frame(Limb(spot=spot, mesh=mesh)).points_mm
    np.testing.assert_allclose(points[:, 2], (mesh.points_mm - spot.position_mm) @ spot.normal, atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(points, axis=1), np.linalg.norm(mesh.points_mm - spot.position_mm, axis=1), atol=1e-12
    )


@given(normals, st.floats(-180.0, 180.0))
def test_force_and_torque_do_not_depend_on_the_axes_in_the_plane(normal, degrees):
    """An indenter that presses along −z and twists by the right hand feels both with positive sign."""
    about = Rotation.from_rotvec(degrees * np.array(normal), degrees=True)
    axes = spot_axes(np.array(normal), about.apply(spot_axes(np.array(normal))[:, 0]))
    on_tissue = -2.0 * np.array(normal) + 0.3 * axes[:, 0], 5.0 * np.array(normal) - 0.7 * axes[:, 1]
    force, moment = (np.atleast_2d(-v @ axes) for v in on_tissue)
    wrench = SpotWrench(force_N=force, moment_Nmm=moment)
    assert wrench.pressing[0] == pytest.approx(2.0)
    assert wrench.twisting[0] == pytest.approx(5.0)


@given(normals, st.integers(0, 2**31 - 1))
def test_a_wrench_does_the_work_of_its_tractions(normal, seed):
    """Power of any traction at any point of a moving body = wrench on the tissue · rate of the pose."""
    random = np.random.default_rng(seed)
    tip, arm, pull, velocity, spin = random.standard_normal((5, 1, 3))
    power = float((pull * (velocity + np.cross(spin, arm - tip))).sum())
    wrench = SpotWrench(force_N=-pull, moment_Nmm=-np.cross(arm, pull)).on_tissue(-tip)
    rate = np.concatenate([-velocity[:, 2:], velocity[:, :2], spin], axis=1)
    assert float((wrench * rate).sum()) == pytest.approx(power)
    np.testing.assert_allclose(wrench[0, 0], -pull[0, 2])
