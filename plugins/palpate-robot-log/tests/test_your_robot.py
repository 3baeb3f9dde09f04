"""The simulated log of a robot as a chain of transforms and in two files: read to the same curves."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate_robot_log import RobotLogLoader
from palpate_robot_log.reading.assembly import clock_offset_s
from palpate_robot_log.reading.channel_map import LogFiles
from palpate_robot_log.reading.inspection import inspect_log
from palpate_robot_log.reading.raw import RawLog, Series
from palpate_robot_log.robot_log import RobotLogSettings

from . import log_writers as write
from .known_presses import named
from .simulated_logs import columns

STEP = 4
"""Every fourth row: 50 Hz are enough for a press of 36 s."""


def log() -> tuple[FloatArray, FloatArray, Rotation, FloatArray, FloatArray]:
    """Time [s], position [m], pose, force [N] and moment [N·m] of the simulated log of spot p1."""
    column = {name: values[::STEP] for name, values in columns("p1").items()}
    stacked = [
        np.stack([column[name] for name in names.split()], axis=1)
        for names in ("x_m y_m z_m", "qx qy qz qw", "fx_N fy_N fz_N", "tx_Nm ty_Nm tz_Nm")
    ]
    return column["time_s"], stacked[0], Rotation.from_quat(stacked[1]), stacked[2], stacked[3]


def curves_of(path: Path, study_text: str) -> Any:
    settings = tomllib.loads(study_text)["experiment"]["settings"]
    return RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path).curves


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("reference") / "log.csv"
    write.write_text(path, {name: values[::STEP] for name, values in columns("p1").items()})
    return curves_of(path, inspect_log(path).study_text)


def test_the_pose_of_the_tool_is_a_chain_of_transforms(reference: Any, tmp_path: Path) -> None:
    """An arm that moves, a flange on it, and a tool on the flange: their product is the pose of the log."""
    pytest.importorskip("rosbags")
    time, place, pose, force, moment = log()
    still = (np.tile([0.0, 0.0, 0.05], (time.size, 1)), Rotation.from_euler("xyz", [90, 0, 30], degrees=True))
    swing = Rotation.from_rotvec(np.outer(0.3 * np.sin(time / 7.0), [0.0, 0.0, 1.0]))
    arm = (0.1 * np.column_stack([np.cos(time / 9.0), np.sin(time / 9.0), np.zeros(time.size)]), swing)
    turn = swing.inv() * pose * still[1].inv()
    flange = (swing.inv().apply(place - arm[0]) - turn.apply(still[0]), turn)
    frames = {("base", "arm"): arm, ("arm", "flange"): flange, ("flange", "tool0"): still}
    path = write.write_chain(tmp_path / "bag", time, frames, np.column_stack([force, moment]))
    found = inspect_log(path)
    assert found.record["channels"]["position"]["stream"] == "/tf base>tool0"
    for channel, curve in curves_of(path, found.study_text).items():
        span = np.ptp(reference[channel].ordinate)
        assert abs(np.ptp(curve.ordinate) - span) < 0.01 * span, channel


# --------------------------------------------------------------------------- two files


def two_files(folder: Path, offset_s: float = -1234.5, drift: float = 1e-4) -> tuple[Path, Path]:
    """Pose at 50 Hz, wrench at 200 Hz by a clock that is ahead by ``offset_s`` and fast by ``drift``."""
    _, x, pose, _, _ = log()
    column = columns("p1")
    pose_file, wrench_file = folder / "arm_p1-robot.csv", folder / "arm_p1-ati.txt"
    time = {"t": column["time_s"][::STEP]}
    write.write_text(pose_file, time | named("X Y Z q1 q2 q3 q4", 1e3 * x, pose.as_quat()[:, [3, 0, 1, 2]]))
    clock_ms = 1e3 * (offset_s + (1.0 + drift) * column["time_s"])
    wrench = [column[name] for name in ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")]
    write.write_text(wrench_file, {"Zeit": clock_ms} | named("Fx Fy Fz Tx Ty Tz", *wrench), ";", ",")
    return pose_file, wrench_file


@pytest.mark.slow
def test_pose_and_wrench_in_two_files_with_their_own_clocks(reference: Any, tmp_path: Path) -> None:
    pose, wrench = two_files(tmp_path)
    found = inspect_log(pose, wrench)
    assert found.record["problem"] == ""
    table = tomllib.loads(found.study_text)["experiment"]["settings"]
    assert table["files"] == {"pose": "{}-robot.csv", "wrench": "{}-ati.txt"}
    assert table["channels"]["force"]["time"] == {"column": "Zeit", "unit": "ms"}
    curves = curves_of(pose, found.study_text)
    for channel, expected in reference.items():
        curve, span = curves[channel], np.ptp(expected.ordinate)
        assert abs(np.ptp(curve.ordinate) - span) < 0.01 * span, channel
        assert abs(np.ptp(curve.abscissa) - np.ptp(expected.abscissa)) < 0.01 * np.ptp(expected.abscissa)


@pytest.mark.slow
@pytest.mark.parametrize("spot", ["p2", "p3", "p4"])
@pytest.mark.parametrize("offset_s", [-4.0, 0.0, 1.7e9])
def test_the_shift_of_the_clocks_is_found_to_hundredths_of_a_second(spot: str, offset_s: float) -> None:
    column, rng = columns(spot), np.random.default_rng(3)
    position = np.stack([column[name] for name in ("x_m", "y_m", "z_m")], axis=1)
    force = np.stack([column[name] for name in ("fx_N", "fy_N", "fz_N")], axis=1)

    def series(what: str, time_s: FloatArray, values: FloatArray) -> Series:
        rows = np.arange(time_s.size)
        empty = RawLog(source="log", format="", row_word="row", streams=())
        names, units = ("x", "y", "z"), ("s", "")
        return Series(
            log=empty, what=what, names=names, stream="", time_s=time_s, values=values, rows=rows, units=units
        )

    cut = int(rng.integers(0, 60))  # the sensor's file begins some time after the robot's
    pose = series("position", column["time_s"], position)
    wrench = series("force", offset_s + column["time_s"][cut:], force[cut:])
    # 0.007 to 0.031 s measured: what is left of it, the bends of the twist correct.
    assert clock_offset_s(pose, wrench) == pytest.approx(offset_s, abs=0.04)
    noise = series("force", column["time_s"], rng.standard_normal(force.shape))
    with pytest.raises(CurveError, match="at no shift of the clocks the push follows the press"):
        clock_offset_s(pose, noise)


@pytest.mark.parametrize(
    ("pose", "wrench", "names"),
    [
        ("p1_pose.csv", "p1_ft.csv", ("{}_pose.csv", "{}_ft.csv")),
        ("pose_p1.csv", "ft_p1.txt", ("pose_{}.csv", "ft_{}.txt")),
        ("pose.csv", "ft.csv", ("pose.csv", "ft.csv")),
    ],
)
def test_names_of_two_files_leave_open_what_they_have_alike(
    pose: str, wrench: str, names: tuple[str, str]
) -> None:
    files = LogFiles.of(Path(pose), Path(wrench))
    assert (files.pose, files.wrench) == names
    assert files.wrench_of(Path("logs") / pose) == Path("logs") / wrench
    with pytest.raises(CurveError, match=r"the name does not fit files\.pose"):
        files.wrench_of(Path("other.dat"))


@pytest.mark.slow
def test_an_unknown_name_of_a_file_of_the_wrench_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match="once at most"):
        LogFiles(pose="{}_{}.csv", wrench="{}_ft.csv")
    pose, wrench = two_files(tmp_path)
    text = inspect_log(pose, wrench).study_text
    wrench.unlink()
    with pytest.raises(CurveError, match=r"arm_p1-ati\.txt: cannot be read"):
        curves_of(pose, text)
