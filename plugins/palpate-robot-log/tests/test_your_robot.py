"""Logs in the format of each maker: the table that `inspect` proposes reads them to the same curves."""

import tomllib
from collections.abc import Callable
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
from .simulated_logs import columns

Table = dict[str, FloatArray]
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


def named(names: str, *values: FloatArray) -> Table:
    return dict(zip(names.split(), np.column_stack(values).T, strict=True))


def kuka() -> Table:
    time, x, pose, f, m = log()
    angles = pose.as_euler("ZYX", degrees=True)
    return {"IPOC": 1e3 * time} | named("X Y Z A B C", 1e3 * x, angles) | named("Fx Fy Fz Tx Ty Tz", f, m)


def robot_sensor_interface() -> Table:
    """KUKA's names, among vectors of other quantities."""
    time, x, pose, f, m = log()
    rng = np.random.default_rng(5)
    others = [named(f"{what}_x {what}_y {what}_z", rng.normal(size=x.shape)) for what in ("vel", "acc")]
    rest = named("RIst.X RIst.Y RIst.Z RIst.A RIst.B RIst.C", 1e3 * x, pose.as_euler("ZYX", degrees=True))
    return (
        {"t": time} | others[0] | others[1] | rest | named("FTC.Fx FTC.Fy FTC.Fz FTC.Mx FTC.My FTC.Mz", f, m)
    )


def sunrise() -> Table:
    """KUKA's angles in radians, under a word that is a place elsewhere."""
    time, x, pose, f, m = log()
    names = " ".join(f"$POS_ACT.{letter}" for letter in "XYZABC")
    return {"time": time} | named(names, 1e3 * x, pose.as_euler("ZYX")) | named("Fx Fy Fz Tx Ty Tz", f, m)


def ros_stamps() -> Table:
    """Time in whole seconds and nanoseconds."""
    time, table = log()[0], ros_text()
    stamp_ns = (1_700_000_000 * 10**9 + np.round(1e9 * time)).astype(np.int64)
    stamp = {"/ft/header/stamp/sec": stamp_ns // 10**9, "/ft/header/stamp/nanosec": stamp_ns % 10**9}
    return stamp | {name: values for name, values in table.items() if "." in name and "header" not in name}


def unset_stamps() -> Table:
    """Stamps that nobody has set, next to a time."""
    none = np.zeros(log()[0].size)
    return {"header.stamp.sec": none, "header.stamp.nanosec": none} | abb()


def franka() -> Table:
    time, x, pose, f, m = log()
    transform = np.tile(np.eye(4), (time.size, 1, 1))
    transform[:, :3, :3], transform[:, :3, 3] = pose.as_matrix(), x
    by_columns = transform.transpose(0, 2, 1).reshape(-1, 16)
    wrench = np.column_stack([pose.apply(f), pose.apply(m)])
    return (
        {"time": time}
        | {f"O_T_EE[{k}]": column for k, column in enumerate(by_columns.T)}
        | {f"O_T_EE_d[{k}]": column for k, column in enumerate(by_columns.T)}
        | {f"O_F_ext_hat_K[{k}]": column for k, column in enumerate(wrench.T)}
        | {f"q[{k}]": np.sin(time + k) for k in range(7)}
    )


def universal_robots() -> Table:
    time, x, pose, f, m = log()
    table = {"timestamp": 4321.5 + time}
    table |= {f"actual_TCP_pose_{k}": v for k, v in enumerate(np.column_stack([x, pose.as_rotvec()]).T)}
    wrench = np.column_stack([pose.apply(f), pose.apply(m)])
    table |= {f"target_TCP_pose_{k}": v for k, v in enumerate(np.column_stack([x, pose.as_rotvec()]).T)}
    return table | {f"actual_TCP_force_{k}": v for k, v in enumerate(wrench.T)}


def abb() -> Table:
    time, x, pose, f, m = log()
    quaternion = pose.as_quat()[:, [3, 0, 1, 2]]
    return {"Time": time} | named("X Y Z q1 q2 q3 q4", 1e3 * x, quaternion) | named("Fx Fy Fz Mx My Mz", f, m)


def fanuc() -> Table:
    time, x, pose, f, m = log()
    angles = pose.as_euler("xyz", degrees=True)
    return {"t_ms": 1e3 * time} | named("X Y Z W P R", 1e3 * x, angles) | named("Fx Fy Fz Mx My Mz", f, m)


def doosan() -> Table:
    time, x, pose, f, m = log()
    angles = pose.as_euler("ZYZ", degrees=True)
    return {"time": time} | named("x y z a b c", 1e3 * x, angles) | named("fx fy fz tx ty tz", -f, -m)


def doosan_posx() -> Table:
    table = doosan()
    return {f"posx[{'xyzabc'.index(name)}]" if name in "xyzabc" else name: v for name, v in table.items()}


def degrees_about_fixed_axes() -> Table:
    time, x, pose, f, m = log()
    angles = pose.as_euler("xyz", degrees=True)
    return (
        {"time": time}
        | named("x_mm y_mm z_mm", 1e3 * x)
        | named("rx_deg ry_deg rz_deg", angles)
        | named("Fx_(N) Fy_(N) Fz_(N) Tx_(Nm) Ty_(Nm) Tz_(Nm)", f, m)
    )


def ros_text() -> Table:
    time, x, pose, f, m = log()
    header = {"%time": np.round(1.7e9 + time, 6) * 1e9, "field.header.seq": np.arange(time.size)}
    return (
        header
        | named(" ".join(f"field.pose.position.{a}" for a in "xyz"), x)
        | named(" ".join(f"field.pose.orientation.{a}" for a in "xyzw"), pose.as_quat())
        | named(" ".join(f"field.wrench.force.{a}" for a in "xyz"), f)
        | named(" ".join(f"field.wrench.torque.{a}" for a in "xyz"), m)
    )


def plotjuggler() -> Table:
    """Topics of two rates in one table: rows of one have no values of the other."""
    time, x, pose, f, m = log()
    poses = named(" ".join(f"/pose/pose/position/{a}" for a in "xyz"), x)
    poses |= named(" ".join(f"/pose/pose/orientation/{a}" for a in "xyzw"), pose.as_quat())
    wrench = named(" ".join(f"/ft/wrench/force/{a}" for a in "xyz"), f)
    wrench |= named(" ".join(f"/ft/wrench/torque/{a}" for a in "xyz"), m)
    both = np.sort(np.concatenate([time, time + 0.002]))
    table = {"__time": both}
    for shift, part in ((0, wrench), (1, poses)):
        for name, values in part.items():
            table[name] = np.full(both.size, np.nan)
            table[name][shift::2] = values if shift == 0 else values + 0.0
    return table


MAKERS = (
    sunrise,
    ros_stamps,
    unset_stamps,
    universal_robots,
    fanuc,
    doosan,
    doosan_posx,
    degrees_about_fixed_axes,
    ros_text,
    plotjuggler,
)


def curves_of(path: Path, study_text: str) -> Any:
    settings = tomllib.loads(study_text)["experiment"]["settings"]
    return RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path).curves


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("reference") / "log.csv"
    write.write_text(path, {name: values[::STEP] for name, values in columns("p1").items()})
    return curves_of(path, inspect_log(path).study_text)


@pytest.mark.parametrize(
    "maker",
    [
        kuka,
        robot_sensor_interface,
        franka,
        abb,
        *(pytest.param(maker, marks=pytest.mark.slow) for maker in MAKERS),
    ],
    ids=lambda maker: maker.__name__,
)
def test_the_proposed_table_reads_the_log_as_it_is(
    maker: Callable[[], Table], reference: Any, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    delimiter, decimal = (";", ",") if maker is kuka else (",", ".")
    write.write_text(path, maker(), delimiter, decimal)
    found = inspect_log(path)
    assert found.record["problem"] == ""
    curves = curves_of(path, found.study_text)
    assert set(curves) == {"force", "torque"}
    for channel, curve in curves.items():
        expected = reference[channel]
        span = np.ptp(expected.ordinate)
        assert abs(np.ptp(curve.ordinate) - span) < 0.01 * span, channel
        assert abs(curve.ordinate[-1] - expected.ordinate[-1]) < 0.02 * span, channel
        assert abs(curve.abscissa.max() - expected.abscissa.max()) < 0.02 * np.ptp(expected.abscissa)


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
