"""Laws of every indentation, on a block small enough to solve in a second."""

import re
from dataclasses import replace
from importlib.resources import as_file, files

import numpy as np
import pytest

from palpate.domain import Channel, Indentation, Job, Limb, Spot, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_indentation.mesh_source import MeshioSource
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Yeoh

YEOH = np.array([0.0141, -0.0011, 1.05e-4, 0.4])
PATH = [(0.0, 0.0), (2.0, 0.0), (2.0, -15.0), (2.0, 15.0), (2.0, 0.0)]
TIGHT = JaxSettings(depth_steps=4, rotation_step_deg=5.0, tolerance=1e-9)


@pytest.fixture(scope="module")
def limb():
    return block("hex8", n_across=8, n_down=3, width_mm=24.0, height_mm=10.0, grading=1.4)


@pytest.fixture(scope="module")
def solver():
    return JaxSolver(TIGHT)


def make_job(theta=YEOH, path=PATH, friction=0.6, material=None):
    return Job(
        spot="block",
        set_id=0,
        materials={"soft_tissue": material or Yeoh()},
        thetas={"soft_tissue": np.asarray(theta, dtype=float)},
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=np.array(path), friction=friction),
    )


@pytest.fixture(scope="module")
def reference(solver, limb):
    simulation = solver.simulate(make_job(), limb)
    assert simulation.status is Status.OK, simulation.message
    return simulation


def curve(simulation, channel):
    return simulation.response[channel].ordinate


@pytest.mark.slow
def test_contact_radius_and_sticking_are_channels_over_their_path(solver, limb):
    labels = {"abscissa_label": "", "ordinate_label": ""}
    radius = Channel(name="radius", abscissa="depth_mm", ordinate="contact_radius_mm", **labels)
    sticking = Channel(name="sticking", abscissa="rotation_deg", ordinate="sticking_1", **labels)
    found = solver.simulate(replace(make_job(path=PATH[:3]), channels=(radius, sticking)), limb)
    radii, shares = (found.response[name].ordinate for name in ("radius", "sticking"))
    assert radii[0] == 0.0
    assert radii[-1] == pytest.approx(np.sqrt(7.5 * 2.0), rel=0.25)  # Hertz; cells are larger than 1 mm
    assert shares[0] > shares[-1] >= 0.0  # the twist makes points slide


@pytest.mark.slow
def test_force_grows_and_torque_follows_the_twist(reference):
    assert (np.diff(curve(reference, "force")) > 0.0).all()
    torque = reference.response["torque"]
    assert torque.ordinate[np.argmin(torque.abscissa)] == torque.ordinate.min() < 0.0
    assert torque.ordinate[np.argmax(torque.abscissa)] == torque.ordinate.max() > 0.0
    assert len(torque.branches) == 3


def test_friction_leaves_a_loop_in_the_torque(reference):
    torque = reference.response["torque"]
    zeros = torque.ordinate[torque.abscissa == 0.0]
    assert abs(zeros[0]) < 1e-3 * np.ptp(torque.ordinate)
    assert zeros[1] > 0.02 * torque.ordinate.max()


def test_without_friction_there_is_no_torque(solver, limb):
    simulation = solver.simulate(make_job(friction=0.0), limb)
    assert simulation.status is Status.OK
    assert np.abs(curve(simulation, "torque")).max() < 1e-9 * curve(simulation, "force").max() * 7.5


def test_moduli_scale_force_and_torque_exactly(solver, limb, reference):
    scaled = solver.simulate(make_job(3.0 * YEOH), limb)
    for channel in ("force", "torque"):
        expected = 3.0 * curve(reference, channel)
        np.testing.assert_allclose(curve(scaled, channel), expected, atol=1e-7 * np.abs(expected).max())


def test_a_rotated_limb_responds_the_same(solver, limb, reference):
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]) @ np.array(
        [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    )
    shift = np.array([100.0, -20.0, 5.0])
    mesh = replace(limb.mesh, points_mm=limb.mesh.points_mm @ turn.T + shift)
    moved = Limb(spot=Spot(name="block", position_mm=shift, normal=turn[:, 2]), mesh=mesh)
    simulation = solver.simulate(make_job(), moved)
    for channel in ("force", "torque"):
        expected = curve(reference, channel)
        np.testing.assert_allclose(curve(simulation, channel), expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
def test_cold_sets_have_the_same_bits_after_any_others(limb):
    softer, path = 0.7 * YEOH * (1.0, 0.9, 1.0, 1.0), PATH[:3]
    jobs = {"a": make_job(YEOH, path), "b": make_job(softer, path), "c": make_job(2.0 * YEOH, path)}
    orders = ("abc", "cba", "b")
    found = {
        (name, order): simulation
        for order in orders
        for name, simulation in zip(
            order, JaxSolver(TIGHT).simulate_many([jobs[name] for name in order], limb), strict=True
        )
    }
    for name, order in found:
        for channel in ("force", "torque"):
            expected = curve(found[name, "abc"], channel)
            np.testing.assert_array_equal(curve(found[name, order], channel), expected)


def test_a_hold_changes_nothing(solver, limb):
    held = [*PATH[:3], PATH[2], PATH[2]]
    simulation = solver.simulate(make_job(path=held), limb)
    rows = simulation.diagnostics
    for name in ("force_N", "moment_Nmm"):
        values = np.array(rows[name])[-3:, 2]
        np.testing.assert_allclose(values, values[0], rtol=1e-6)


@pytest.mark.slow
def test_half_the_steps_give_the_same(limb, reference):
    finer = JaxSolver(JaxSettings(depth_steps=8, rotation_step_deg=2.5, tolerance=1e-7))
    simulation = finer.simulate(make_job(), limb)
    for channel, bound in (("force", 0.005), ("torque", 0.01)):
        ends = [stop - 1 for _, stop in simulation.response[channel].branches]
        expected = [stop - 1 for _, stop in reference.response[channel].branches]
        np.testing.assert_allclose(
            curve(simulation, channel)[ends],
            curve(reference, channel)[expected],
            atol=bound * np.abs(curve(reference, channel)).max(),
        )


def test_the_sphere_leaves_and_returns(solver, limb, reference):
    path = [(0.0, 0.0), (2.0, 0.0), (2.0, -15.0), (0.0, -15.0), (2.0, -15.0)]
    simulation = solver.simulate(make_job(path=path), limb)
    assert simulation.status is Status.OK, simulation.message
    force = np.array(simulation.diagnostics["force_N"])[:, 2]
    depth = np.array(simulation.diagnostics["depth_mm"])
    assert force[depth == 0.0] == pytest.approx(0.0, abs=1e-9)
    assert force[-1] == pytest.approx(curve(reference, "force")[-1], rel=1e-6)
    assert simulation.diagnostics["moment_Nmm"][-1][2] == pytest.approx(0.0, abs=1e-2)


def test_a_moved_spot_is_another_limb(limb):
    job = make_job(path=PATH[:2])
    moved = Limb(spot=Spot(name="block", position_mm=np.array([4.0, 0.0, 0.0])), mesh=limb.mesh)
    used = JaxSolver(TIGHT)
    used.simulate(job, limb)
    again, fresh = used.simulate(job, moved), JaxSolver(TIGHT).simulate(job, moved)
    np.testing.assert_array_equal(curve(again, "force"), curve(fresh, "force"))


def test_parameters_without_a_rest_are_a_status(solver, limb):
    (simulation,) = solver.simulate_many([make_job([-0.01, 0.0, 1e-4, 0.4])], limb)
    assert simulation.status is Status.DIVERGED
    assert "c1" in simulation.message


def test_hexahedra_and_tetrahedra_agree(solver):
    job, size = make_job(path=PATH[:2]), {"width_mm": 24.0, "height_mm": 10.0, "grading": 1.4}
    hexes = solver.simulate(job, block("hex8", n_across=12, n_down=5, **size))
    tets = solver.simulate(job, block("tet10", n_across=6, n_down=2, **size))
    assert curve(tets, "force")[-1] == pytest.approx(curve(hexes, "force")[-1], rel=0.03)


def test_penetration_is_a_small_share_of_the_depth(reference):
    assert 0.0 < max(reference.diagnostics["penetration_mm"]) < 0.01 * 2.0


@pytest.mark.slow
def test_an_unstable_material_diverges_with_its_partial_curve(solver):
    limb = block("hex8", n_across=4, n_down=2, width_mm=24.0, height_mm=10.0)
    collapsing = [0.0141, -0.006, 1e-6, 0.4]
    simulation = solver.simulate(make_job(collapsing, path=[(0.0, 0.0), (6.0, 0.0)]), limb)
    assert simulation.status is Status.DIVERGED
    assert re.search(r"beyond depth .* the material of region 'soft_tissue' is unstable", simulation.message)
    assert 0.0 < simulation.response["force"].abscissa[-1] < 6.0


def test_a_path_that_takes_too_many_iterations_is_given_up():
    """A law that collapses halves its steps; the limit of iterations ends the path, and says so."""
    limb = block("hex8", n_across=4, n_down=2, width_mm=24.0, height_mm=10.0)
    path = [(0.0, 0.0), (6.0, 0.0)]
    job, sound = make_job([0.0141, -0.006, 1e-6, 0.4], path=path), make_job(path=path)
    usual = JaxSolver(JaxSettings()).simulate(sound, limb).diagnostics
    n_states = len(usual["depth_mm"])
    assert usual["n_iterations"] < 0.4 * JaxSettings().step_iterations * n_states, (
        "a usual path is far from it"
    )
    for each in (2, 5):
        given_up = JaxSolver(JaxSettings(step_iterations=each)).simulate(job, limb)
        assert given_up.status is Status.DIVERGED
        assert given_up.diagnostics["n_iterations"] == each * n_states
        assert given_up.message.startswith(
            f"given up after {each * n_states} Newton iterations, {each} for each load step "
            "(setting step_iterations), beyond depth"
        )
        assert given_up.message.endswith("a stability filter drops such sets")
        assert 0.0 < given_up.response["force"].abscissa[-1] < 6.0


@pytest.mark.slow
def test_tissue_that_loses_contact_slides_on():
    """Stable materials whose contact finds no balance near the last one reach the end of the path.

    The rim of a hole in the contact surface, at the spot itself, is where it lets go in large steps. With
    which of the materials it does so depends on the rounding of the machine.
    """
    meshes = files("palpate_forearm") / "studies" / "forearm-demo" / "meshes"
    with as_file(meshes / "p3.vtu") as path:
        forearm = MeshioSource().load(path, Spot(name="p3"))
    sets = forearm.mesh.node_sets
    at_the_spot = np.linalg.norm(forearm.mesh.points_mm, axis=1).argmin()
    holed = {**sets, "contact": sets["contact"][sets["contact"] != at_the_spot]}
    forearm = replace(forearm, mesh=replace(forearm.mesh, node_sets=holed))
    solver = JaxSolver(JaxSettings(depth_steps=2, rotation_step_deg=22.5))
    n_held = 0
    for c1 in np.linspace(0.021, 0.023, 9):
        job = make_job(
            [c1, -0.00136, 5.19e-5, 0.8], path=[(0.0, 0.0), (10.0, 0.0), (10.0, -22.5)], friction=1.0
        )
        simulation = solver.simulate(job, forearm)
        assert simulation.status is Status.OK, simulation.message
        n_held += simulation.diagnostics["n_held"]
    assert n_held > 0


def test_coupled_material_runs(solver, limb):
    simulation = solver.simulate(make_job([0.08, 0.45], path=PATH[:3], material=NeoHookean()), limb)
    assert simulation.status is Status.OK


def test_bonded_nodes_move_with_the_indenter(solver, limb):
    """Glued on, the tissue answers a twist elastically: no loop, and the same both ways."""
    x = limb.mesh.points_mm
    disc = np.flatnonzero((x[:, 2] == 0.0) & (np.hypot(x[:, 0], x[:, 1]) < 4.0))
    glued = replace(limb, mesh=replace(limb.mesh, node_sets={**limb.mesh.node_sets, "bonded": disc}))
    simulation = solver.simulate(make_job(), glued)
    assert simulation.status is Status.OK, simulation.message
    rotation = np.array(simulation.diagnostics["rotation_deg"])
    moment = np.array(simulation.diagnostics["moment_Nmm"])[:, 2]
    ends = moment[np.abs(rotation) == 15.0]
    assert ends[0] == pytest.approx(-ends[1], rel=1e-6)
    assert ends[0] < 0.0
    np.testing.assert_allclose(moment[rotation == 0.0], 0.0, atol=1e-7 * ends[1])
