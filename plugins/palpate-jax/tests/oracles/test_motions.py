"""Motions of the indenter against what mechanics asks of any of them."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.api import MeshError
from palpate.domain import Indentation, Job, Limb, Spot, Status
from palpate.domain.indenter import Sphere
from palpate.mesh.specimens import block
from palpate_indentation import Moves, MovesSettings, Punch, PunchSettings
from palpate_jax.path_simulation import equilibrium_states
from palpate_jax.schedule import motion, pose
from palpate_jax.solver import JaxSettings, JaxSolver
from palpate_materials.neo_hookean import NeoHookean
from palpate_prediction.summary import QUANTITIES, press_states, spread

THETA = np.array([0.02, 0.4])
SPHERE = Sphere(radius_mm=7.5)
BLOCK = block("hex8", n_across=8, n_down=3, width_mm=30.0, height_mm=10.0, grading=1.4)
LIMITS = {"depth_limit": "4 mm", "slide_limit": "3 mm", "tilt_limit": "20 deg", "twist_limit": "60 deg"}
FORWARD = {"slide": ["2 mm", "0 mm"]}


def solver(tolerance=1e-8, depth_steps=4):
    return JaxSolver(JaxSettings(depth_steps=depth_steps, rotation_step_deg=6.0, tolerance=tolerance))


def job_of(protocol, theta=THETA, slopes=False):
    return Job(
        spot="p1",
        set_id=0,
        materials={"soft_tissue": NeoHookean()},
        thetas={"soft_tissue": theta},
        protocol=protocol,
        slopes=slopes,
    )


def protocol_of(*moves, friction=0.4, indenter=SPHERE, **limits):
    made = Moves(MovesSettings(moves=moves, **limits)).waypoints()
    return Indentation.along(made, indenter=indenter, friction=friction)


def states_of(protocol, limb=BLOCK, slopes=False, theta=THETA, **settings):
    """Equilibrium states of a motion that can be finished."""
    jax, job = solver(**settings)._paths, job_of(protocol, theta, slopes)
    prepared = jax._prepared(limb, job.materials)
    modulus = jax._modulus(prepared, job.thetas)
    _, reached, stop = jax._walk(prepared, protocol, job, modulus, None)
    assert stop is None, stop.reason
    return equilibrium_states(reached)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_press_to_a_force_is_press_to_the_depth_that_it_reaches(friction):
    by_force = states_of(protocol_of({"force": "0.5 N"}, friction=friction, depth_limit="4 mm"))
    assert by_force.wrench[-1, 0] == pytest.approx(0.5, rel=1e-8)
    # The last waypoint makes the contact's penalty that of the limit.
    path = [*((depth, 0.0) for depth in by_force.pose[:, 0]), (4.0, 0.0)]
    press = Indentation(indenter=SPHERE, path=path, friction=friction)
    by_depth = states_of(press, depth_steps=2)
    n = len(by_force.pose)
    np.testing.assert_allclose(by_depth.pose[:n], by_force.pose, atol=1e-12)
    np.testing.assert_allclose(by_depth.wrench[:n, 0], by_force.wrench[:, 0], atol=1e-6 * 0.5)


@pytest.mark.slow
def test_a_force_is_held_while_the_indenter_turns_and_slides():
    held = {"force": "0.5 N"}
    moves = (held, {"twist": "12 deg", **held}, {"slide": ["1 mm", "0 mm"], **held}, {"twist": "0 deg"})
    states = states_of(protocol_of(*moves, **LIMITS), tolerance=1e-4)
    n_held = len(states.pose) - 2
    np.testing.assert_allclose(states.wrench[4:n_held, 0], 0.5, rtol=1e-6)
    assert np.ptp(states.pose[4:n_held, 0]) > 1e-3
    assert np.ptp(states.pose[n_held - 1 :, 0]) == 0.0, "what is not named stays where the force left it"


@pytest.mark.slow
def test_all_loads_are_met_together():
    moves = {"force": "0.5 N", "slide_force": ["0.03 N", "-0.02 N"], "tilt_moment": ["0.2 N*mm", "0.1 N*mm"]}
    states = states_of(protocol_of({"force": "0.3 N"}, moves, **LIMITS), tolerance=1e-4)
    np.testing.assert_allclose(states.wrench[-1, :5], [0.5, 0.03, -0.02, 0.2, 0.1], atol=1e-6)


@pytest.mark.slow
def test_slopes_go_through_loads():
    """Wrench and pose against central differences, where loads and places take turns."""
    held = {"force": "0.5 N"}
    moves = ({"depth": "1 mm"}, held, {"twist": "12 deg", **held}, {"tilt": ["4 deg", "0 deg"]})
    moves += ({"slide_force": ["0.03 N", "0 N"]}, {"depth": "1 mm"})
    protocol = protocol_of(*moves, **LIMITS)
    found = states_of(protocol, slopes=True)
    for k, name in enumerate(list(found.slopes)[:2]):
        step = 1e-4 * THETA[k] * np.eye(2)[k]
        ahead, behind = (states_of(protocol, theta=THETA + sign * step) for sign in (1, -1))
        for each, slopes in (("wrench", found.slopes), ("pose", found.pose_slopes)):
            change = (getattr(ahead, each) - getattr(behind, each)) / (2e-4 * THETA[k])
            scale = np.abs(change).max(axis=0).max()
            np.testing.assert_allclose(slopes[name], change, atol=1e-4 * scale)


def test_full_slip_under_a_slide_is_friction_times_force():
    """A flat punch over all of the skin, so that each pressure is along the normal."""
    wide = Punch(PunchSettings(radius="60 mm", edge="1 mm"))
    small = block("hex8", n_across=3, n_down=2, width_mm=8.0, height_mm=8.0)
    protocol = protocol_of({"depth": "0.2 mm"}, {"slide": ["1.5 mm", "2 mm"]}, friction=0.1, indenter=wide)
    states = states_of(protocol, small, tolerance=1e-10)
    force, *lateral = states.wrench[-1, :3]
    assert np.hypot(*lateral) == pytest.approx(0.1 * force, rel=1e-9)
    np.testing.assert_allclose(np.array(lateral) / np.hypot(*lateral), [0.6, 0.8], atol=0.02)


def test_a_slide_forth_and_its_mirror_image_are_mirror_images():
    press = {"depth": "2 mm"}
    forth, other = (
        states_of(protocol_of(press, {"slide": [f"{sign * 2} mm", "0 mm"]}, {"slide": ["0 mm", "0 mm"]}))
        for sign in (1, -1)
    )
    mirror = np.array([1, -1, 1, 1, -1, -1])  # of x; moments turn the other way
    np.testing.assert_allclose(other.pose, forth.pose * mirror, atol=1e-12)
    np.testing.assert_allclose(other.wrench, forth.wrench * mirror, atol=1e-6)
    assert forth.wrench[-1, 1] < 0.0, "friction holds the indenter back where it came from"


@pytest.mark.slow
def test_tilts_about_x_and_y_are_one_tilt_turned():
    def tilted(x, y):
        return states_of(protocol_of({"depth": "2 mm"}, {"tilt": [f"{x} deg", f"{y} deg"]})).wrench[-1]

    about_x, about_y, back = tilted(8, 0), tilted(0, 8), tilted(-8, 0)
    assert about_x[3] > 0.1, "a tilt moment does work along its tilt"
    np.testing.assert_allclose(about_y[[0, 4, 3]], [about_x[0], about_x[3], -about_x[4]], atol=1e-6)
    np.testing.assert_allclose(back[[0, 3]], [about_x[0], -about_x[3]], atol=1e-6)


@pytest.mark.slow
def test_a_motion_in_parts_is_the_whole():
    whole = states_of(protocol_of({"depth": "2 mm"}, {"slide": ["2 mm", "1 mm"], "twist": "12 deg"}))
    half = {"slide": ["1 mm", "0.5 mm"], "twist": "6 deg"}
    parts = states_of(
        protocol_of(
            {"depth": "1 mm"}, {"depth": "2 mm"}, half, {"slide": ["2 mm", "1 mm"], "twist": "12 deg"}
        )
    )
    np.testing.assert_allclose(parts.pose[-1], whole.pose[-1])
    np.testing.assert_allclose(parts.wrench[-1], whole.wrench[-1], atol=1e-6)


def test_the_frame_of_the_spot_turns_the_motion():
    """A slide along x of a spot whose x is the mesh's y is a slide along y; the block is symmetric."""
    spot = Spot(name="p1", normal=np.array([0.0, 0.0, 1.0]), along=np.array([0.0, 1.0, 0.0]))
    protocol = protocol_of({"depth": "2 mm"}, {"slide": ["2 mm", "0.5 mm"], "tilt": ["5 deg", "0 deg"]})
    here, there = states_of(protocol), states_of(protocol, Limb(spot=spot, mesh=BLOCK.mesh))
    np.testing.assert_allclose(there.wrench, here.wrench, atol=1e-6)


@pytest.mark.slow
def test_separation_and_return_forget_the_friction():
    press, away = {"depth": "2 mm"}, {"depth": "-1 mm"}
    once = states_of(protocol_of(press))
    again = states_of(
        protocol_of(press, {"slide": ["1 mm", "0 mm"]}, away, {"slide": ["0 mm", "0 mm"]}, press)
    )
    off = again.pose[:, 0] <= 0.0
    assert not again.wrench[off].any()
    assert again.wrench[-1, 0] == pytest.approx(once.wrench[-1, 0], rel=0.02)


@pytest.mark.parametrize(
    ("moves", "message"),
    [
        (
            [{"force": "5 N"}],
            "force of 5 N is not reached up to the farthest depth allowed, 4 mm: the largest",
        ),
        ([{"depth": "2 mm"}, {"torque": "9 N*mm"}], r"torque of 9 N·mm is not .* rotation allowed, 60 deg"),
    ],
)
def test_a_load_that_is_never_reached_is_reported_with_the_largest(moves, message):
    found = solver(tolerance=1e-4).simulate(job_of(protocol_of(*moves, **LIMITS)), BLOCK)
    assert found.status is Status.DIVERGED
    assert re.search(message, found.message), found.message
    assert found.response.curves


@pytest.mark.parametrize(
    ("moves", "message"),
    [
        (
            [{"depth": "2 mm"}, {"slide": ["12 mm", "0 mm"]}],
            "the contact surface ends .* press and move less far",
        ),
        ([{"depth": "2 mm"}, {"slide": ["8 mm", "0 mm"], "tilt": ["25 deg", "0 deg"]}], "surface ends"),
    ],
)
def test_a_motion_that_leaves_the_mesh_is_refused(moves, message):
    job = job_of(protocol_of(*moves))
    with pytest.raises(MeshError, match=message):
        solver().check(job, BLOCK)


@given(st.lists(st.floats(-20.0, 20.0), min_size=12, max_size=12))
def test_motion_is_the_rate_of_the_pose(numbers):
    at, way, step = np.array(numbers[:6]), np.array(numbers[6:]), 1e-6
    ahead, here, behind = (pose(at + sign * step * way) for sign in (1, 0, -1))
    move = motion(at, way)
    spin = (ahead.rotation - behind.rotation) / (2.0 * step) @ here.rotation.T
    np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], move.spin, atol=1e-7)
    np.testing.assert_allclose((ahead.tip - behind.tip) / (2.0 * step), move.tip, atol=1e-7)
    np.testing.assert_allclose(here.rotation @ here.rotation.T, np.eye(3), atol=1e-12)


def test_a_loop_without_friction_takes_no_work():
    """So the loads are those that do work along the components of the pose."""
    moves = ({"depth": "2 mm"}, {"slide": ["3 mm", "0 mm"], "tilt": ["0 deg", "8 deg"]}, {"depth": "0 mm"})
    off_centre = Limb(spot=Spot(name="p1", position_mm=np.array([2.0, 1.0, 0.0])), mesh=BLOCK.mesh)
    states = states_of(
        protocol_of(*moves, {"tilt": ["0 deg", "0 deg"]}, friction=0.0), off_centre, depth_steps=12
    )
    moved = np.diff(states.pose, axis=0) * [1, 1, 1, *np.radians([1, 1, 1])]
    work = (0.5 * (states.wrench[1:] + states.wrench[:-1]) * moved).sum(axis=1)
    assert np.abs(work).sum() > 0.5
    assert abs(work.sum()) < 0.01 * np.abs(work).sum()


def test_a_motion_that_never_touches_is_refused():
    lifted = protocol_of({"depth": "-3 mm"}, {"slide": ["2 mm", "0 mm"]}, {"depth": "1 mm"})
    hole = Limb(spot=BLOCK.spot, mesh=replace(BLOCK.mesh, points_mm=BLOCK.mesh.points_mm - [0, 0, 2.0]))
    solver().check(job_of(lifted), BLOCK)
    with pytest.raises(MeshError, match=r"off the surface|never touches"):
        solver().check(job_of(lifted), hole)


def test_a_force_is_reached_where_the_first_step_goes_beyond_it():
    """Few points of a coarse mesh touch, and Newton's method from there leaves the skin again."""
    coarse = block("hex8", n_across=6, n_down=3, width_mm=40.0, height_mm=20.0, grading=1.3)
    protocol = protocol_of({"force": "0.4 N"}, depth_limit="6 mm", friction=0.5)
    states = states_of(protocol, coarse, theta=np.array([0.0675, 0.45]), tolerance=1e-4)
    np.testing.assert_allclose(states.wrench[1:, 0], 0.4 * (np.arange(1, 5) / 4) ** 1.5, rtol=1e-5)


@pytest.mark.slow
def test_a_force_is_reached_from_far_off_the_skin():
    small = block("hex8", n_across=4, n_down=2, width_mm=24.0, height_mm=10.0)
    held = {"force": "0.01 N"}
    lifted, direct = (
        states_of(protocol_of(*moves, held, depth_limit="0.5 mm", friction=0.0), small)
        for moves in ([{"depth": "-5 mm"}], [])
    )
    np.testing.assert_allclose(lifted.pose[-1], direct.pose[-1], atol=1e-6)


@pytest.mark.slow
def test_a_stiffer_tissue_under_a_force_has_what_a_softer_one_has_under_less():
    """The linear bands of a prediction by force take this from the states of one press."""
    protocol = protocol_of({"force": "0.5 N"}, friction=0.4, depth_limit="4 mm")
    jax = JaxSolver(JaxSettings(depth_steps=6))
    found = []
    for modulus in (0.02, 0.022):
        job = replace(job_of(protocol, np.array([modulus, 0.4])), surface=True)
        found.append(press_states(jax.simulate(job, BLOCK), None))
    softer, stiffer = found
    for quantity in (each for each in QUANTITIES if each.at_force):
        (expected,) = spread(softer, quantity, np.array([1.1]), by_force=True)
        found = stiffer.value(quantity.attribute)
        assert found == pytest.approx(expected, rel=0.006), quantity.name
    assert stiffer.value("depth_mm") < 0.96 * softer.value("depth_mm")
    assert stiffer.value("p95_MPa") > 1.06 * softer.value("p95_MPa")
