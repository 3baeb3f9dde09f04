"""States of the skin: what they add up to, and what bounds them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.domain import Indentation, Job, Limb, Spot, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import spot_axes
from palpate_jax.model import Model
from palpate_jax.skin import strain_ranges
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean

FRICTION = 0.4
PATH = np.array([(0, 0), (2.5, 0), (2.5, -12)])
SMALL = {"n_across": 8, "n_down": 3, "width_mm": 24.0, "height_mm": 10.0, "grading": 1.4}
TURN = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0]
TURN = TURN * np.linalg.det(TURN)
SHIFT = np.array([4.0, 9.0, -2.0])


def simulated(kind, surface=True, tilt_deg=(0.0, 0.0)):
    """A press and twist on a block elsewhere in space, so that the spot's frame is not the mesh's."""
    limb = block(kind, **(SMALL if kind == "hex8" else SMALL | {"n_across": 5, "n_down": 2}))
    mesh = replace(limb.mesh, points_mm=limb.mesh.points_mm @ TURN.T + SHIFT)
    limb = Limb(spot=Spot(name="p1", position_mm=SHIFT, normal=TURN[:, 2]), mesh=mesh)
    job = Job(
        spot="p1",
        set_id=0,
        materials={"soft_tissue": NeoHookean()},
        thetas={"soft_tissue": np.array([0.02, 0.4])},
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=PATH, friction=FRICTION, tilt_deg=tilt_deg),
        surface=surface,
    )
    found = JaxSolver(JaxSettings(depth_steps=3, rotation_step_deg=12.0)).simulate(job, limb)
    assert found.status is Status.OK, found.message
    return limb, found


@pytest.fixture(scope="module", params=["hex8", "tet10", "tet4"])
def pressed(request):
    return simulated(request.param)


def test_nothing_is_kept_that_nobody_asked_for():
    assert simulated("tet4", surface=False)[1].surface is None


@pytest.mark.slow
def test_tractions_add_up_to_the_force_and_the_moment(pressed):
    limb, simulation = pressed
    states = simulation.surface
    axes = spot_axes(limb.spot.normal)
    force, moment = (each @ axes for each in states.resultants(SHIFT))
    wanted = np.array(simulation.diagnostics["force_N"])
    np.testing.assert_allclose(-force, wanted, atol=1e-6 * np.abs(wanted).max())
    wanted = np.array(simulation.diagnostics["moment_Nmm"])
    bends = "tet10" in limb.mesh.cells
    np.testing.assert_allclose(moment, wanted, atol=(0.05 if bends else 1e-5) * np.abs(wanted).max())
    assert moment[-1, 2] == pytest.approx(wanted[-1, 2], rel=0.05 if bends else 1e-4)


@pytest.mark.slow
def test_shear_obeys_coulomb_and_pressure_presses(pressed):
    states = pressed[1].surface
    size = np.linalg.norm(states.shears_MPa, axis=2)
    assert (states.pressures_MPa >= 0.0).all()
    assert size.max() > 0.0
    assert (size <= FRICTION * states.pressures_MPa * (1.0 + 1e-5)).all()
    normal = states.tractions_MPa - states.shears_MPa
    assert (np.linalg.norm(normal, axis=2) <= states.pressures_MPa * (1.0 + 1e-5)).all()


@pytest.mark.slow
def test_only_what_touches_is_loaded(pressed):
    states = pressed[1].surface
    assert ((states.touching > 0.0) == (states.pressures_MPa > 0.0)).all()
    assert (states.touching <= 1.0 + 1e-6).all()
    area = (states.areas_mm2 * states.touching).sum(axis=1)
    assert (np.diff(area[:3]) > 0.0).all()
    assert area.max() < np.pi * 7.5**2


@pytest.mark.slow
def test_the_surface_is_closed_to_the_outside_and_moves_with_the_tool(pressed):
    limb, simulation = pressed
    states = simulation.surface
    corners = states.points_mm[states.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals @ limb.spot.normal > 0.0).all()
    assert 0.5 * np.linalg.norm(normals, axis=1).sum() == pytest.approx(24.0**2, rel=1e-5)
    np.testing.assert_allclose(states.depth_mm[-1], 2.5)
    np.testing.assert_allclose(states.rotation_deg[-1], -12.0)
    tool = (states.points_mm + states.displacements_mm[-1] - states.positions_mm[-1]) @ states.rotations[-1]
    distance = Sphere(radius_mm=7.5).distance(tool)
    assert abs(distance[np.argmax(states.pressures_MPa[-1])]) < 0.3
    np.testing.assert_allclose(states.positions_mm[-1], SHIFT - 2.5 * limb.spot.normal, atol=1e-5)


def test_a_tilted_tool_is_where_its_axis_is():
    limb, simulation = simulated("tet4", tilt_deg=(10.0, 0.0))
    moved = simulation.surface.positions_mm[-1] - SHIFT
    along = -moved / np.linalg.norm(moved)
    assert np.degrees(np.arccos(along @ limb.spot.normal)) == pytest.approx(10.0, abs=1e-3)


@pytest.mark.parametrize("kind", ["hex8", "tet4"])
def test_strains_of_a_constant_deformation_are_its_own(kind):
    F = np.array([[1.2, 0.3, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]])
    limb = block(kind, **SMALL)
    model = Model(limb, {"soft_tissue": NeoHookean()}, True)
    state = SimpleNamespace(displacements=model.points @ (F - np.eye(3)).T)
    found = strain_ranges(limb, model, [state, state])["soft_tissue"]
    stretches, J = np.linalg.svd(F, compute_uv=False), np.linalg.det(F)
    for name, wanted in (("stretch_min", stretches.min()), ("stretch_max", stretches.max()), ("J_min", J),
                         ("J_max", J), ("i1_max", (stretches**2).sum() / J ** (2 / 3))):  # fmt: skip
        np.testing.assert_allclose(found[name], [wanted, wanted], rtol=1e-10)


@pytest.mark.slow
def test_strains_come_with_the_skin(pressed):
    found = pressed[1].diagnostics["strain"]["soft_tissue"]
    assert 0.3 < min(found["stretch_min"]) < 1.0 < max(found["stretch_max"]) < 3.0
    assert np.all(np.diff(found["i1_max"][:3]) > 0.0)
    assert len(found["where_mm"][-1]) == 3
