"""Channels observe equilibrium states: columns by name, over the moving part of the path, with slopes."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain.channels import EQUILIBRIUM_CHANNELS, FORCE, LATERAL_FORCE, TILT_MOMENT
from palpate.domain.curves import Channel
from palpate.domain.equilibrium_states import POSE, STATE_COLUMNS, WRENCH, EquilibriumStates
from palpate.errors import CurveError

SEEDS = st.integers(0, 2**31 - 1)

RATIO = Channel(
    name="grip",
    abscissa="slide_mm",
    ordinate="grip_1",
    abscissa_label="lateral shift (mm)",
    ordinate_label="lateral over normal force",
    degree=0,
    needs=("lateral_force_N", "force_N"),
    observe=lambda columns: columns["lateral_force_N"] / columns["force_N"],
)


def slid(seed, n=6, angle=0.3):
    """Press, then slide along one direction; slopes are random."""
    random = np.random.default_rng(seed)
    pose, wrench = np.zeros((n, 6)), random.standard_normal((n, 6))
    pose[1:, 0] = 2.0
    pose[2:, 1:3] = np.arange(1, n - 1)[:, None] * [np.cos(angle), np.sin(angle)]
    wrench[:, 0] += 10.0
    return EquilibriumStates(pose=pose, wrench=wrench, slopes={"a.b": random.standard_normal((n, 6))})


def test_each_channel_has_the_part_of_the_path_that_moves():
    pose, wrench = np.zeros((5, 6)), np.zeros((5, 6))
    pose[:, 0], pose[:, 5] = [0.0, 1.0, 2.0, 2.0, 2.0], [0.0, 0.0, 0.0, -5.0, 5.0]
    wrench[:, 0], wrench[:, 5] = np.arange(5.0), np.arange(5.0) - 2.0
    response = EquilibriumStates(pose=pose, wrench=wrench).observed(EQUILIBRIUM_CHANNELS)
    assert list(response) == ["force", "torque"]
    np.testing.assert_array_equal(response["force"].ordinate, [0.0, 1.0, 2.0])
    np.testing.assert_array_equal(response["torque"].abscissa, [0.0, -5.0, 5.0])
    assert (
        not EquilibriumStates(pose=np.zeros((1, 6)), wrench=np.zeros((1, 6)))
        .observed(EQUILIBRIUM_CHANNELS)
        .curves
    )


@given(SEEDS, st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_a_slide_and_a_tilt_depend_on_no_axes(seed, angle, turn):
    cos, sin = np.cos(turn), np.sin(turn)
    turned, axes = np.eye(6), np.array([[cos, sin], [-sin, cos]])
    turned[1:3, 1:3] = turned[3:5, 3:5] = axes
    states = slid(seed, angle=angle)
    pose = states.pose + np.roll(states.pose, 2, axis=1) * [0, 0, 0, 1, 1, 0]
    here, there = (
        EquilibriumStates(pose=pose @ each, wrench=states.wrench @ each).observed(
            [LATERAL_FORCE, TILT_MOMENT]
        )
        for each in (np.eye(6), turned)
    )
    for name in ("lateral_force", "tilt_moment"):
        np.testing.assert_allclose(there[name].abscissa, here[name].abscissa, atol=1e-12)
        np.testing.assert_allclose(there[name].ordinate, here[name].ordinate, atol=1e-12)
        assert here[name].abscissa[1] > 0.0


@given(SEEDS, st.floats(-3.1, 3.1), st.floats(1e-12, 1e-6))
def test_a_slide_after_a_press_that_floats_has_its_own_direction(seed, angle, remainder):
    """Under ``slide_force = [0, 0]`` the shifts of the press are remainders of Newton's method."""
    states, random = slid(seed, angle=angle), np.random.default_rng(seed)
    pose = states.pose + np.roll(states.pose, 2, axis=1) * [0, 0, 0, 1, 1, 0]
    floating = pose.copy()
    floating[1, 1:5] = remainder * random.standard_normal(4)
    exact, found = (
        EquilibriumStates(pose=each, wrench=states.wrench, slopes=states.slopes).columns
        for each in (pose, floating)
    )
    for name in ("slide_mm", "tilt_deg", "lateral_force_N", "tilt_moment_Nmm"):
        np.testing.assert_allclose(found[name], exact[name], atol=10.0 * remainder)


@given(SEEDS, st.sampled_from([FORCE, LATERAL_FORCE, RATIO]))
def test_slopes_are_those_of_the_ordinate(seed, channel):
    states, step = slid(seed), 1e-6
    slope = states.slopes["a.b"]
    ahead, behind = (
        EquilibriumStates(pose=states.pose, wrench=states.wrench + sign * step * slope).observed([channel])
        for sign in (1.0, -1.0)
    )
    expected = (ahead[channel.name].ordinate - behind[channel.name].ordinate) / (2.0 * step)
    found = states.observed([channel])[channel.name].slopes["a.b"]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_columns_of_a_solver_can_be_observed_and_have_no_slopes():
    states = slid(1)
    others = {"contact_radius_mm": np.arange(6.0)}
    more = EquilibriumStates(pose=states.pose, wrench=states.wrench, slopes=states.slopes, others=others)
    radius = Channel(
        name="radius", abscissa="depth_mm", ordinate="contact_radius_mm", abscissa_label="", ordinate_label=""
    )
    assert not states.observed([radius]).curves
    curve = more.observed([radius])["radius"]
    np.testing.assert_array_equal(curve.ordinate, [0.0, 1.0])
    assert not curve.slopes
    assert set(more.cut(slice(3)).columns) == set(more.columns)


def test_columns_have_names_with_units_and_one_place_each():
    states = slid(2)
    timed = EquilibriumStates(pose=states.pose, wrench=states.wrench, time_s=np.arange(6.0))
    assert set(timed.columns) == set(STATE_COLUMNS)
    for name, values in zip((*POSE, *WRENCH), np.hstack([states.pose, states.wrench]).T, strict=True):
        np.testing.assert_array_equal(timed.columns[name], values)
    for curve in timed.observed(EQUILIBRIUM_CHANNELS).curves.values():
        assert len(curve.time_s) == len(curve.abscissa)
    assert not any(curve.time_s for curve in states.observed(EQUILIBRIUM_CHANNELS).curves.values())


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"wrench": np.zeros((3, 6))}, "wrench of shape"),
        ({"time_s": np.zeros(2)}, "time_s of shape"),
        ({"slopes": {"a.b": np.zeros((4, 5))}}, r"slopes in 'a\.b' of shape"),
        ({"others": {"x_mm": np.zeros(3)}}, "'x_mm' of shape"),
        ({"others": {"force_N": np.zeros(4)}}, "rename it"),
    ],
)
def test_states_that_do_not_match_are_refused(given, words):
    with pytest.raises(CurveError, match=words):
        EquilibriumStates(**{"pose": np.zeros((4, 6)), "wrench": np.zeros((4, 6))} | given)


def test_what_is_no_function_cannot_observe():
    with pytest.raises(CurveError, match="`observe` is of class partial"):
        replace(RATIO, observe=partial(RATIO.observe))


def test_needs_and_observe_belong_together():
    with pytest.raises(CurveError, match="belong together"):
        Channel(
            name="x",
            abscissa="depth_mm",
            ordinate="y",
            abscissa_label="",
            ordinate_label="",
            needs=("force_N",),
        )


@pytest.mark.parametrize("returns", [False, True])
def test_slopes_are_at_a_fixed_abscissa_where_loads_are_prescribed(returns):
    """F = k d^1.5 by force: at a depth the force grows by F per relative change of k, over time d falls."""
    share = np.linspace(0.0, 1.0, 41)
    force = 4.0 * (np.concatenate([share, share[-2::-1]]) if returns else share)
    pose, wrench, moved = np.zeros((3, force.size, 6))
    wrench[:, 0], pose[:, 0] = force, (force / 2.0) ** (2.0 / 3.0)
    moved[:, 0] = -pose[:, 0] / 3.0  # per unit of k = 2
    slopes = {"a.k": np.zeros_like(pose)}
    times = np.arange(force.size, dtype=float)
    states = EquilibriumStates(
        pose=pose, wrench=wrench, time_s=times, slopes=slopes, pose_slopes={"a.k": moved}
    )
    depth = Channel(
        name="depth", abscissa="time_s", ordinate="depth_mm", abscissa_label="t", ordinate_label="d", degree=0
    )
    curves = states.observed([FORCE, depth])
    np.testing.assert_allclose(curves["depth"].slopes["a.k"], moved[:, 0])
    found, inner = curves["force"].slopes["a.k"], np.abs(share[-1] - force / 4.0) > 1e-9
    inner[0] = False
    np.testing.assert_allclose(found[inner], force[inner] / 2.0, atol=2e-3)
    np.testing.assert_allclose(found, force / 2.0, atol=0.05)
    assert states.cut(slice(3, 9)).pose_slopes["a.k"].shape == (6, 6)
