"""Logs that are no complete press are refused, with file, row, time stamp and remedy."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import CurveError
from palpate_robot_log.checks import warnings_of
from palpate_robot_log.processing.chain import process
from palpate_robot_log.recording import Recording

from . import simulated_logs as logs

SWAPPED = {"xy": [1, 0, 2], "xz": [2, 1, 0], "yz": [0, 2, 1]}


def log() -> Recording:
    return logs.recording("p1")


def until(seconds: float) -> Recording:
    whole = log()
    return whole.part(slice(0, int(np.searchsorted(whole.time_s, seconds))))


def without_contact() -> Recording:
    whole, random = log(), np.random.default_rng(2)
    noise = random.normal(0.0, 0.04, whole.force_N.shape)
    return whole.changed(force_N=whole.force_N[:80].mean(axis=0) + noise)


def twice() -> Recording:
    whole = log()
    fields = ("position_mm", "quaternion", "force_N", "moment_Nmm", "rows")
    return Recording(
        source=whole.source,
        time_s=np.concatenate([whole.time_s, whole.time_s + 40.0]),
        **{name: np.concatenate([getattr(whole, name)] * 2) for name in fields},
    )


def drawn(n_rows: int, seed: int) -> Recording:
    """Keep some of the rows by chance."""
    whole, random = log(), np.random.default_rng(seed)
    return whole.part(np.sort(random.choice(whole.n_rows, n_rows, replace=False)))


def half_without_force() -> Recording:
    force = log().force_N.copy()
    force[: log().n_rows // 2, 2] = 0.0
    return log().changed(force_N=force)


def zeroed(seconds: float) -> Recording:
    """A log whose sensor is zeroed at an instant."""
    force, at = log().force_N.copy(), int(np.searchsorted(log().time_s, seconds))
    force[at:] -= force[at]
    return log().changed(force_N=force)


def in_the_other_frame(sign: float) -> Recording:
    """A log of the base frame that is read as of the sensor's, with a tool that lies on its side."""
    whole = log()
    side = Rotation.from_euler("x", 90.0, degrees=True)
    in_base = Rotation.from_quat(np.array(whole.quaternion)).apply(np.array(whole.force_N))
    quaternion = (Rotation.from_quat(np.array(whole.quaternion)) * side).as_quat()
    return whole.changed(force_N=sign * in_base, quaternion=quaternion)


FAULTS: dict[str, tuple[Callable[[], Recording], str]] = {
    "reaction": (
        lambda: log().changed(force_N=-log().force_N),
        r"row 34\d \(t = 1.7\d\d s\).*set acts_on = \"tissue\" in the",
    ),
    "force x z": (
        lambda: log().changed(force_N=log().force_N[:, SWAPPED["xz"]]),
        r"90 degrees off the normal.*force goes along -x and the normal along -z",
    ),
    "force y z": (lambda: log().changed(force_N=log().force_N[:, SWAPPED["yz"]]), "axes are swapped"),
    "left-handed": (
        lambda: log().changed(moment_Nmm=log().moment_Nmm * [1.0, 1.0, -1.0]),
        r"row 130\d \(t = 6.50\d s\).*out of phase.*left-handed",
    ),
    "moment x z": (
        lambda: log().changed(moment_Nmm=log().moment_Nmm[:, SWAPPED["xz"]]),
        "axes of the moment are swapped",
    ),
    "moment y z": (
        lambda: log().changed(moment_Nmm=log().moment_Nmm[:, SWAPPED["yz"]]),
        "axes of the moment are swapped",
    ),
    "base to tool": (lambda: log().changed(quaternion=log().quaternion * [-1, -1, -1, 1]), "quaternion"),
    "w first": (lambda: log().changed(quaternion=log().quaternion[:, [3, 0, 1, 2]]), "order.*quaternion"),
    "orientation stuck": (
        lambda: log().changed(quaternion=np.tile(log().quaternion[0], (log().n_rows, 1))),
        "torque goes up and down.*orientation is stuck",
    ),
    "position x y": (
        lambda: log().changed(position_mm=log().position_mm[:, SWAPPED["xy"]]),
        "off the normal of the path",
    ),
    "position x z": (
        lambda: log().changed(position_mm=log().position_mm[:, SWAPPED["xz"]]),
        r"row 130\d .*twists about an axis 24 degrees off the normal.*order of the position's columns",
    ),
    "position in m": (lambda: log().changed(position_mm=log().position_mm / 1e3), "unit of the position"),
    "position in um": (lambda: log().changed(position_mm=log().position_mm * 1e3), "unit of the position"),
    "no contact": (without_contact, "a press without contact: the force changes by 0.[12]"),
    "two presses": (twice, r"2 presses in one log \(1.\d+ to 34.\d+ s, 41.\d+ to 74.\d+ s\)"),
    "starts in contact": (lambda: log().part(slice(500, None)), "must not start in contact"),
    "no free air": (lambda: log().part(slice(100, None)), r"\(t = 0.500 s\): 0 rows in free air before"),
    "gap": (
        lambda: log().part(np.r_[0:700, 760 : log().n_rows]),
        r"row 701 \(t = 3.495 s\): a gap of 0.305 s while the tool presses",
    ),
    "zeroed in contact": (
        lambda: zeroed(16.0),
        r"row 320\d \(t = 16\.0\d\d s\): the force jumps by 12\.\d N while the tip rests, and is 12\.\d N "
        "off when the tool is back at its height: the sensor was zeroed in contact",
    ),
    "zeroed while pressing": (
        lambda: zeroed(3.0),
        r"the force jumps by .* N while the tip moves, and is .* N off when the tool is back at its height",
    ),
    "zeroed and not back": (
        lambda: zeroed(16.0).part(slice(0, 5000)),
        r"the force jumps by 12\.\d N while the tip rests: the sensor was zeroed in contact",
    ),
    "other frame": (lambda: in_the_other_frame(1.0), r'set wrench_frame = "base" in the channel map'),
    "other frame and body": (
        lambda: in_the_other_frame(-1.0),
        r'set acts_on = "tissue" and wrench_frame = "base" in the channel map',
    ),
    "no moment": (
        lambda: log().changed(moment_Nmm=0.05 * np.sin(np.arange(log().n_rows))[:, None] * np.ones(3)),
        r'no moment answers the twist .* write "0" for the three columns',
    ),
    "spikes": (
        lambda: log().changed(force_N=log().force_N + 50.0 * (np.arange(log().n_rows) % 50 == 0)[:, None]),
        "146 of 7300 rows have a spike",
    ),
    "thinned": (lambda: drawn(60, 0), r"too few rows where the tool starts or stops .* 2\.53 Hz"),
    "half without force": (half_without_force, "too few rows where .* check that the force is logged"),
    "ends before contact": (lambda: until(0.6), "a press without contact"),
    "ends pressing": (lambda: until(3.0), r"row 601 \(t = 2.995 s\): the log stops half-way.*presses deeper"),
    "ends at depth": (lambda: until(6.0), r"row 1201 .*0 rows in free air after the press"),
    "ends twisting": (lambda: until(14.0), r"row 2801 \(t = 13.995 s\).*half-way.*twists at 3.75 degrees/s"),
    "ends retracting": (lambda: until(33.0), r"row 6601 .*half-way.*travels at -2.99 mm/s"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_log_is_named(name):
    build, message = FAULTS[name]
    with pytest.raises(CurveError, match=message) as caught:
        process(build(), logs.settings())
    assert str(caught.value).startswith("robot_p1.csv: ")


@pytest.mark.parametrize("jump_N", [1.0, -2.0, 4.0])
@pytest.mark.parametrize("seconds", [3.0, 4.85, 5.0, 16.0, 33.0])
def test_a_zero_that_shifts_for_good_is_no_drift(seconds, jump_N):
    """While the tool goes in, at its deepest point, in the rests, and on the way back."""
    jumps = (log().time_s > seconds)[:, None] * np.array([0.0, 0.0, jump_N])
    with pytest.raises(CurveError, match=r"is .* off when .*: the sensor was zeroed in contact"):
        process(log().changed(force_N=log().force_N + jumps), logs.settings())


@pytest.mark.parametrize("seconds", [2.0, 7.0, 12.45, 26.0, 30.4, 32.0])
def test_a_log_that_stops_in_motion_is_refused_without_drift_too(seconds):
    with pytest.raises(CurveError, match="half-way"):
        process(until(seconds), logs.settings(drift={"enabled": False}))


def test_a_log_without_retract_needs_no_drift_correction():
    processed = process(until(30.9), logs.settings(drift={"enabled": False}))
    assert "torque" in processed.curves
    assert [phase.name for phase in processed.phases][-1] == "dwell_2"
    assert processed.cleaned.drift is None


SETTINGS = {
    "heavier than what it shows": (
        {"gravity": {"method": "known", "weight": "90 N"}},
        "heavier than plausible",
    ),
    "heavier than any": ({"gravity": {"method": "known", "weight": "900 N"}}, "900 N is not plausible"),
    "longer than any": (
        {"gravity": {"method": "known", "weight": "0.88 N", "centre": ["0 mm", "0 mm", "3 m"]}},
        "3000 mm from the sensor is not plausible",
    ),
    "one orientation": ({"gravity": {"method": "fit"}}, "orientation hardly changes.*give gravity.weight"),
    "later than the log": ({"window": {"start": "100 s"}}, "holds 0 rows of a log from 0.000 to 36.495 s"),
    "a clock apart": ({"alignment": {"lag": "1 s"}}, "wrench comes 1.000 s after the pose"),
    "another normal": ({"normal": {"method": "given", "vector": [0, 0, 1]}}, "38 degrees off the normal"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
def test_settings_that_do_not_fit_the_log_are_named(name):
    steps, message = SETTINGS[name]
    with pytest.raises(CurveError, match=message):
        process(log(), logs.settings(**steps))


@pytest.mark.parametrize(
    "steps",
    [
        {"gravity": {"method": "known"}},
        {"gravity": {"method": "off", "weight": "1 N"}},
        {"gravity": {"method": "fit", "direction": [0, 0, 0]}},
        {"normal": {"method": "given"}},
        {"onset": {"method": "law", "time": "1 s"}},
        {"window": {"start": "2 s", "stop": "1 s"}},
        {"smoothing": {"window": "-1 s"}},
    ],
)
def test_settings_that_contradict_themselves_are_refused(steps):
    with pytest.raises(ValueError, match="validation error"):
        logs.settings(**steps)


@pytest.mark.parametrize("drift_N", [3.0, 14.0, -14.0])
def test_a_large_drift_is_taken_out_and_named(drift_N, tmp_path):
    whole = log()
    ramp = np.linspace(0.0, drift_N, whole.n_rows)[:, None] * np.array([0.0, 0.0, 1.0])
    usual, drifted = (
        process(whole, logs.settings()),
        process(whole.changed(force_N=whole.force_N + ramp), logs.settings()),
    )
    span = np.ptp(usual.curves["force"].ordinate)
    off = np.abs(drifted.curves["force"].ordinate - usual.curves["force"].ordinate).max()
    assert off < 0.02 * span
    (warning,) = warnings_of(drifted.raw, drifted)
    named_N = float(re.search(r"drifts by ([\d.]+) N over the log", warning)[1])
    assert named_N == pytest.approx(abs(drift_N), rel=0.05)
    assert warnings_of(usual.raw, usual) == []


def test_a_recording_is_read_only():
    with pytest.raises(ValueError, match="read-only"):
        log().force_N[0] = 0.0
