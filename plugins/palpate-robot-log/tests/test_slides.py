"""A slide after the press gives the lateral force over its shift, along its own line."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.errors import CurveError
from palpate_robot_log.processing.chain import process
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.recording import Recording

SETTINGS = ProcessingSettings.model_validate({"slide": {"enabled": True}})
WAYPOINTS = np.array(
    [  # time [s], depth [mm], shift [mm]
        *((0.0, -4.0, 0.0), (1.0, -4.0, 0.0), (5.0, 6.0, 0.0), (6.0, 6.0, 0.0), (9.0, 6.0, 5.0)),
        *((12.0, 6.0, -3.0), (13.0, 6.0, -3.0), (17.0, -4.0, -3.0), (18.0, -4.0, -3.0)),
    ]
)
STIFFNESS_N, FRICTION = 2.0, 0.4


def slid(angle_deg=25.0, tilt_deg=20.0, bend_mm=0.0, noise_N=0.005, seed=1):
    """A log of a slide along a line of the skin, and the shift and lateral force that made it."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, 18.0, 0.01)
    depth, shift = (np.interp(time, WAYPOINTS[:, 0], WAYPOINTS[:, k]) for k in (1, 2))
    pressing = 0.9 * np.maximum(depth, 0.0) ** 1.5
    lateral, anchor = np.zeros(time.size), 0.0
    for k in range(time.size):  # sticks on a spring, slides at the limit
        trial, limit = STIFFNESS_N * (shift[k] - anchor), FRICTION * pressing[k]
        lateral[k] = np.clip(trial, -limit, limit)
        anchor = shift[k] - lateral[k] / STIFFNESS_N
    frame = Rotation.from_euler("xz", [tilt_deg, angle_deg], degrees=True)
    zeros = np.zeros(time.size)
    bend = bend_mm * np.sin(np.pi * shift / 5.0)
    position = frame.apply(np.column_stack([shift, bend, -depth])) + np.array([400.0, -200.0, 300.0])
    force = np.column_stack([-lateral, zeros, pressing]) + noise_N * random.standard_normal((time.size, 3))
    moment = 0.2 * random.standard_normal((time.size, 3))
    recording = Recording(
        source="slid.csv",
        time_s=time,
        position_mm=position,
        quaternion=np.tile(frame.as_quat(), (time.size, 1)),
        force_N=force + np.array([0.3, -0.2, 0.5]),
        moment_Nmm=moment,
        rows=np.arange(time.size),
    )
    return recording, shift, lateral


@pytest.mark.slow
@pytest.mark.parametrize("angle_deg", [0.0, 100.0, -130.0])
def test_the_lateral_force_is_that_along_the_first_stroke(angle_deg):
    recording, shift, lateral = slid(angle_deg)
    processed = process(recording, SETTINGS)
    curve = processed.curves["lateral_force"]
    assert list(processed.curves) == ["force", "lateral_force"]
    assert [phase.name for phase in processed.phases if "slide" in phase.name] == ["slide_1", "slide_2"]
    assert [curve.abscissa[stop - 1] for _, stop in curve.branches] == pytest.approx(
        [5.0, -3.0], abs=0.03
    )  # a row is 0.027 mm
    for start, stop in curve.branches:
        middle = slice(start + 3, stop - 3)  # smoothing rounds what is sharp at a turn
        sense = 1.0 if start == 0 else -1.0
        rows = (np.gradient(shift) * sense > 0.0) & (recording.time_s > 5.5) & (recording.time_s < 12.5)
        expected = np.interp(sense * curve.abscissa[middle], sense * shift[rows], lateral[rows])
        off = np.abs(curve.ordinate[middle] - expected)
        assert np.median(off) < 0.01
        assert off.max() < 0.15 * np.abs(lateral).max()
    record = processed.record["uncertainty"]["drift"]
    assert record["lateral_force"] > record["force"] > 0.0


def test_without_the_switch_the_path_gives_no_normal():
    with pytest.raises(CurveError, match=r"give slide\.enabled"):
        process(slid()[0], ProcessingSettings())


@pytest.mark.parametrize(
    ("bend_mm", "factor", "reason"),
    [(2.0, 1.0, "leaves its line by"), (0.0, 0.05, "a slide is at least 0.5 mm")],
)
def test_what_is_no_slide_along_a_line_is_refused(bend_mm, factor, reason, monkeypatch):
    short = WAYPOINTS * [1.0, 1.0, factor]
    monkeypatch.setitem(slid.__globals__, "WAYPOINTS", short)
    with pytest.raises(CurveError, match=reason):
        process(slid(bend_mm=bend_mm)[0], SETTINGS)
