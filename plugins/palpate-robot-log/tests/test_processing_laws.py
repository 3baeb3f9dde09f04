"""Frame, clock and zero of a log do not matter; each step undoes what it names."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from palpate.mesh.spot_frame import spot_axes
from palpate_robot_log.processing.chain import process, wrench_at_spot
from palpate_robot_log.processing.contact import place_of_contact
from palpate_robot_log.processing.corrections import (
    Drift,
    Lag,
    ToolLoad,
    find_bias,
    find_drift,
    fit_tool,
    shifted,
    without_drift,
    without_weight,
)
from palpate_robot_log.processing.curves import smoothed
from palpate_robot_log.processing.settings import Smoothing
from palpate_robot_log.recording import Recording, thinned, turn_and_tilt

from . import simulated_logs as logs

seeds = st.integers(0, 2**32 - 1)
UP = np.array([0.0, 0.0, 1.0])


def in_frame(recording: Recording, turn: Rotation, offset) -> Recording:
    """The same log in another base frame."""
    return recording.changed(
        position_mm=turn.apply(np.array(recording.position_mm)) + offset,
        quaternion=(turn * Rotation.from_quat(np.array(recording.quaternion))).as_quat(),
    )


def same_curves(one, other, share):
    for channel, curve in one.curves.items():
        again = other.curves[channel]
        assert again.abscissa == pytest.approx(curve.abscissa, abs=share * np.abs(curve.abscissa).max())
        assert again.ordinate == pytest.approx(curve.ordinate, abs=share * np.abs(curve.ordinate).max())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_the_base_frame_does_not_matter(seed):
    random = np.random.default_rng(seed)
    turn = Rotation.random(rng=random)
    moved = in_frame(logs.recording("p2"), turn, random.normal(0.0, 500.0, 3))
    gravity = {**logs.WEIGHT, "direction": turn.apply([0.0, 0.0, -1.0]).tolist()}
    same_curves(logs.processed("p2"), process(moved, logs.settings(gravity=gravity)), 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("offset", "seed"), [(-50.0, 3), (1234.5, 4)])
def test_clock_and_sensor_zero_do_not_matter(offset, seed):
    random, whole = np.random.default_rng(seed), logs.recording("p3")
    shifted_zero = whole.changed(
        time_s=whole.time_s + offset,
        force_N=whole.force_N + random.normal(0.0, 5.0, 3),
        moment_Nmm=whole.moment_Nmm + random.normal(0.0, 50.0, 3),
    )
    same_curves(logs.processed("p3"), process(shifted_zero, logs.settings()), 2e-3)


def test_signs_of_quaternions_do_not_matter():
    whole = logs.recording("p4")
    signs = np.random.default_rng(3).choice([-1.0, 1.0], whole.n_rows)
    flipped = whole.changed(quaternion=whole.quaternion * signs[:, None])
    same_curves(logs.processed("p4"), process(flipped, logs.settings()), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("lag_s", [-0.06, 0.04, 0.12])
def test_a_lag_between_wrench_and_pose_is_found_and_taken_out(lag_s):
    # The wrench comes late by as much as it is read too early.
    late = shifted(logs.recording("p1"), -lag_s)
    processed = process(late, logs.settings())
    assert processed.located.lag.significant
    assert processed.located.lag.seconds == pytest.approx(lag_s, abs=0.02)
    assert processed.located.lag.n_bends == 4
    same_curves(logs.processed("p1"), processed, 0.01)
    assert not process(late, logs.settings(alignment={"enabled": False})).located.lag.significant


@pytest.mark.parametrize(("n_bends", "is_lag"), [(1, False), (2, True)])
def test_a_single_bend_shows_no_lag(n_bends, is_lag):
    """One bend of a soft motion may be off by rows, and nothing checks it."""
    assert Lag(seconds=0.07, std_s=0.01, n_bends=n_bends).significant == is_lag


def poses(n_rows, seed):
    """A tool in free air in five orientations."""
    random = np.random.default_rng(seed)
    each = Rotation.random(5, rng=random).as_quat()
    return Recording(
        source="poses.csv",
        time_s=np.arange(n_rows) * 0.01,
        position_mm=np.zeros((n_rows, 3)),
        quaternion=each[np.arange(n_rows) * 5 // n_rows],
        force_N=random.normal(0.0, 0.04, (n_rows, 3)),
        moment_Nmm=random.normal(0.0, 0.25, (n_rows, 3)),
        rows=np.arange(n_rows),
    )


@given(seeds, st.floats(0.5, 20.0), st.lists(st.floats(-80.0, 80.0), min_size=3, max_size=3))
def test_weight_and_centre_are_fitted_from_poses_in_free_air(seed, weight, centre):
    down, bias = -UP, np.array([0.7, -0.4, 0.2])
    bare = poses(1000, seed)
    tool = ToolLoad(weight_N=weight, centre_mm=np.array(centre))
    loaded = without_weight(
        bare.changed(force_N=bare.force_N + bias, moment_Nmm=bare.moment_Nmm + 10.0 * bias),
        ToolLoad(weight_N=-weight, centre_mm=tool.centre_mm),
        down,
    )
    found = fit_tool(loaded, np.arange(1000), down)
    assert found.weight_N == pytest.approx(weight, abs=6.0 * found.weight_std_N)
    assert found.weight_std_N < 0.02
    assert found.centre_mm == pytest.approx(tool.centre_mm, abs=6.0 * found.centre_std_mm)
    clean = without_weight(loaded, found, down)
    assert clean.force_N.mean(axis=0) == pytest.approx(bias, abs=0.05)


def with_poses_before(spot, weight_N):
    """A log that starts with four orientations of the tool high above the spot, 4 s each."""
    whole, true, random = logs.recording(spot), logs.truth(spot), np.random.default_rng(9)
    n_rows, tilts = 3200, np.array([[0, 0, 0], [60, 0, 0], [0, -70, 0], [-50, 40, 0]])
    first = Rotation.from_quat(whole.quaternion[0].copy())
    turn = first * Rotation.from_euler("xyz", tilts[np.arange(n_rows) * 4 // n_rows], degrees=True)
    time_s = whole.time_s[0] - 16.0 + 0.005 * np.arange(n_rows)
    pull = weight_N * turn.apply(-UP, inverse=True)
    elapsed = time_s[:, None]
    force = true.force_bias_N + elapsed * true.force_drift_N_per_s + pull
    moment = true.moment_bias_Nmm + elapsed * true.moment_drift_Nmm_per_s + np.cross([0.0, 0.0, -30.0], pull)
    before = {
        "time_s": time_s,
        "position_mm": np.tile(whole.position_mm[0] + 60.0 * true.normal, (n_rows, 1)),
        "quaternion": turn.as_quat(),
        "force_N": force + random.normal(0.0, 0.04, (n_rows, 3)),
        "moment_Nmm": moment + random.normal(0.0, 0.25, (n_rows, 3)),
        "rows": np.arange(n_rows),
    }
    return Recording(
        source=whole.source,
        **{name: np.concatenate([values, getattr(whole, name)]) for name, values in before.items()},
    )


def test_a_log_with_poses_in_free_air_identifies_its_tool():
    whole = with_poses_before("p4", 0.8829)
    processed, true = process(whole, logs.settings(gravity={"method": "fit"})), logs.truth("p4")
    assert processed.cleaned.tool.weight_N == pytest.approx(0.8829, abs=0.01)
    assert processed.cleaned.tool.centre_mm == pytest.approx([0.0, 0.0, -30.0], abs=0.5)
    at_start = whole.time_s[0]
    assert processed.cleaned.bias.force_N == pytest.approx(
        true.force_bias_N + at_start * true.force_drift_N_per_s, abs=0.02
    )
    assert processed.cleaned.bias.moment_Nmm == pytest.approx(
        true.moment_bias_Nmm + at_start * true.moment_drift_Nmm_per_s, abs=0.2
    )
    same_curves(logs.processed("p4"), processed, 5e-3)


@given(seeds)
def test_drift_and_bias_are_found_to_their_standard_deviations(seed):
    random, bare = np.random.default_rng(seed), poses(2000, seed)
    rate = Drift(
        force_N_per_s=random.normal(0.0, 0.01, 3),
        moment_Nmm_per_s=random.normal(0.0, 0.1, 3),
        force_std_N_per_s=np.zeros(3),
        moment_std_Nmm_per_s=np.zeros(3),
    )
    zero = random.normal(0.0, 1.0, 3)
    elapsed = bare.time_s[:, None]
    dirty = bare.changed(
        force_N=bare.force_N + zero + elapsed * rate.force_N_per_s,
        moment_Nmm=bare.moment_Nmm + elapsed * rate.moment_Nmm_per_s,
    )
    before, after = np.arange(200), np.arange(1700, 2000)
    found = find_drift(dirty, before, after)
    assert np.all(np.abs(found.force_N_per_s - rate.force_N_per_s) < 6.0 * found.force_std_N_per_s)
    assert np.all(np.abs(found.moment_Nmm_per_s - rate.moment_Nmm_per_s) < 6.0 * found.moment_std_Nmm_per_s)
    still = without_drift(dirty, found)
    bias = find_bias(still, np.concatenate([before, after]))
    assert bias.force_N == pytest.approx(zero, abs=0.02)
    assert still.less(bias.force_N, bias.moment_Nmm).force_N.mean(axis=0) == pytest.approx(0.0, abs=0.02)


@given(seeds)
def test_a_moment_is_moved_by_lever_and_force_and_keeps_its_part_along_the_force(seed):
    random, bare = np.random.default_rng(seed), poses(20, seed)
    normal = Rotation.random(rng=random).apply(UP)
    tip, spot = random.normal(0.0, 30.0, 3), random.normal(0.0, 30.0, 3)
    there = wrench_at_spot(bare, spot, normal, tip)
    turn = Rotation.from_quat(np.array(bare.quaternion))
    force, moment = turn.apply(np.array(bare.force_N)), turn.apply(np.array(bare.moment_Nmm))
    sensor = bare.position_mm - turn.apply(tip)
    axes = spot_axes(normal).T
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[2] == pytest.approx(normal)
    assert there.force_N @ axes == pytest.approx(force)
    assert there.moment_Nmm @ axes == pytest.approx(moment + np.cross(sensor - spot, force))


@given(seeds, st.floats(10.0, 400.0))
def test_a_rotation_about_an_axis_is_read_for_any_signs_and_tilt(seed, reach):
    random = np.random.default_rng(seed)
    axis, first = Rotation.random(rng=random).apply(UP), Rotation.random(rng=random)
    across = np.cross(axis, [0.3, -0.5, 0.8])
    across /= np.linalg.norm(across)
    angle = reach * np.sin(np.linspace(0.0, 6.0, 400))
    tilted = Rotation.from_rotvec(np.radians(3.0) * across)
    quaternion = (tilted * Rotation.from_rotvec(np.radians(angle)[:, None] * axis) * first).as_quat()
    quaternion *= random.choice([-1.0, 1.0], 400)[:, None]
    turn, tilt = turn_and_tilt(quaternion, first.as_quat(), axis)
    assert turn - turn[0] == pytest.approx(angle, abs=1e-6)
    assert tilt == pytest.approx(3.0, abs=1e-6)


SHAPES = {
    "press": lambda t: 12.0 * ((1.0 - np.cos(np.pi * t)) / 2.0) ** 1.5,
    "branch": lambda t: 25.0 * (2.0 * t - 1.0) + 4.0 * np.exp(-8.0 * t),
    "peak": lambda t: 10.0 * np.exp(-0.5 * ((t - 0.6) / 0.08) ** 2),
    "line": lambda t: 3.0 - 7.0 * t,
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("noise_share", [0.0, 0.003, 0.02])
def test_smoothing_keeps_peaks(shape, noise_share):
    time = np.linspace(0.0, 1.0, 1200)
    true = SHAPES[shape](time)
    peak = np.abs(true).max()
    random = np.random.default_rng(7)
    found = [
        smoothed(time, true + random.normal(0.0, noise_share * peak, time.size), peak, Smoothing())
        for _ in range(1 if noise_share == 0.0 else 20)
    ]
    mean = np.mean([one.values for one in found], axis=0)
    spread = 4.0 * np.mean([one.std for one in found], axis=0) / np.sqrt(len(found))
    # Half a percent of the peak, beyond what the noise of the mean of twenty draws explains.
    assert np.all(np.abs(mean - true) < 0.005 * peak + spread)


@pytest.mark.slow
def test_the_standard_deviation_of_smoothed_values_is_that_of_repeats():
    time = np.linspace(0.0, 1.0, 1000)
    true = SHAPES["press"](time)
    random = np.random.default_rng(11)
    found = [smoothed(time, true + random.normal(0.0, 0.1, 1000), 12.0, Smoothing()) for _ in range(60)]
    spread = np.std([one.values for one in found], axis=0)
    reported = np.mean([one.std for one in found], axis=0)
    assert 0.6 < np.median(reported / spread) < 1.6
    assert np.mean([one.noise for one in found]) == pytest.approx(0.1, rel=0.1)


def test_thinning_averages_rows_and_loses_nothing_of_the_figures():
    thin, block = thinned(logs.recording("p1"), 2000)
    assert (block, thin.n_rows) == (4, 1825)
    few = process(logs.recording("p1"), logs.settings(thinning={"max_rows": 2000}))
    same_curves(logs.processed("p1"), few, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "steps",
    [
        {"smoothing": {"method": "savgol", "window": "0.4 s", "order": 2}},
        {"resampling": {"points": 31}},
        {"normal": {"method": "tool_axis"}},
        {"onset": {"method": "given", "time": "0.5 s"}},
        {"gravity": {"method": "off"}},
        {"relaxation": {"enabled": False}},
        {"spikes": {"enabled": False}},
    ],
)
def test_other_ways_to_do_a_step_agree(steps):
    usual, other = logs.processed("p1"), process(logs.recording("p1"), logs.settings(**steps))
    grid = np.linspace(0.3, 9.7, 30)
    one, two = (
        np.interp(grid, p.curves["force"].abscissa, p.curves["force"].ordinate) for p in (usual, other)
    )
    assert two == pytest.approx(one, abs=0.1)
    one, two = (p.curves["torque"].ordinate.max() for p in (usual, other))
    assert two == pytest.approx(one, abs=0.5)


@pytest.mark.parametrize(
    ("steps", "force_N", "torque_Nmm"),
    [({"drift": {"enabled": False}}, 0.0, 1.6), ({"tare": {"enabled": False}}, 0.4, 0.6)],
)
def test_a_step_that_is_switched_off_leaves_its_error_in(steps, force_N, torque_Nmm):
    usual, other = logs.processed("p1").curves, process(logs.recording("p1"), logs.settings(**steps)).curves
    assert other["force"].ordinate[-1] - usual["force"].ordinate[-1] == pytest.approx(force_N, abs=0.03)
    off = np.abs(other["torque"].ordinate - usual["torque"].ordinate).max()
    assert off == pytest.approx(torque_Nmm, abs=0.2)


def test_rows_of_the_log_are_kept_without_resampling():
    curve = process(logs.recording("p1"), logs.settings(resampling={"enabled": False})).curves["torque"]
    assert curve.abscissa.size > 4000
    assert len(curve.branches) == 3


def test_spikes_are_replaced_and_reported():
    whole = logs.recording("p1")
    spiky = whole.force_N.copy()
    spiky[[0, 50, 900, 3000]] += 200.0
    processed = process(whole.changed(force_N=spiky), logs.settings())
    same_curves(logs.processed("p1"), processed, 2e-3)
    found = {step["step"]: step["found"] for step in processed.record["steps"]}["spikes"]
    assert found == {"rows": [2, 52, 902, 3002], "count": 4}


def test_relaxation_in_a_dwell_is_measured():
    whole = logs.recording("p1")
    axis = Rotation.from_quat(np.array(whole.quaternion)).inv().apply(logs.truth("p1").normal)
    since = np.maximum(whole.time_s - 5.5, 0.0)
    falling = 2.0 * (1.0 - np.exp(-since / 0.3)) * (whole.time_s < 31.0)
    processed = process(whole.changed(force_N=whole.force_N - falling[:, None] * axis), logs.settings())
    dwell = processed.relaxations[0]
    assert (dwell.phase, dwell.channel) == ("dwell_1", "force")
    assert dwell.fall == pytest.approx(2.0 * (1.0 - np.exp(-1.0 / 0.3)), abs=0.06)
    assert dwell.time_constant_s == pytest.approx(0.3, rel=0.25)
    assert dwell.share == pytest.approx(dwell.fall / 12.8, rel=0.05)


def test_the_spread_of_the_drift_is_that_where_each_curve_ends():
    found, truth = logs.processed("p1"), logs.truth("p1")
    start, drift = found.phase("press").start.time_s, found.cleaned.drift
    turn = Rotation.from_quat(found.raw.quaternion[found.phase("twist_1").rows(found.raw.time_s)]).mean()
    normal = turn.inv().apply(truth.normal)
    last = [phase for phase in found.phases if phase.name.startswith("twist")][-1]
    force = np.linalg.norm(normal * drift.force_std_N_per_s) * (found.phase("press").stop.time_s - start)
    torque = np.linalg.norm(normal * drift.moment_std_Nmm_per_s) * (last.stop.time_s - start)
    spread = found.record["uncertainty"]["drift"]
    assert spread == {"force": pytest.approx(force, rel=0.1), "torque": pytest.approx(torque, rel=0.1)}
    assert last.stop.time_s < found.phases[-1].stop.time_s
    # No more than the curve itself is said to be off by there.
    assert spread["force"] < found.curves["force"].std[-1]
    without = process(logs.recording("p1"), logs.settings(drift={"enabled": False}))
    assert without.record["uncertainty"]["drift"] == {}


@pytest.mark.parametrize("seed", range(1, 12, 2))
def test_no_contact_pulls_the_tool(seed):
    """A force that rises late, as on fat over muscle, is no fall before a rise; its place has an error."""
    travel_mm = np.arange(-4.0, 8.5, 0.03)
    force_N = np.maximum(travel_mm, 0.0) ** 2.2
    noise_N = np.random.default_rng(seed).normal(0.0, 0.01 * force_N.max(), travel_mm.size)
    found = place_of_contact(travel_mm, force_N + noise_N, exponent=1.3)
    assert abs(found.at) < 0.5
    assert found.std < 1.0
