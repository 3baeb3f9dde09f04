"""Robots' logs give the truth of their press at the first try, under the names of their makers."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate_robot_log import RobotLogLoader
from palpate_robot_log.reading.inspection import inspect_log
from palpate_robot_log.robot_log import RobotLogSettings

from . import log_writers as write
from .known_presses import DEPTH_MM, FORCE_N, TORQUE_NMM, Press, Table, named, press, robot, wrench
from .layouts_of_makers import rows

pytestmark = pytest.mark.usefixtures("in_this_process")


def in_base(made: Press) -> FloatArray:
    return np.column_stack([made.pose.apply(made.force_N), made.pose.apply(made.moment_Nm)])


def numbered(name: str, values: FloatArray) -> Table:
    return {name.format(k): column for k, column in enumerate(values.T)}


def universal_robots(made: Press) -> Table:
    pose = [np.column_stack([1e-3 * x, made.pose.as_rotvec()]) for x in (made.tip_mm, made.commanded_mm)]
    return (
        {"timestamp": 71.5 + made.time_s}
        | numbered("target_TCP_pose_{}", pose[1])
        | numbered("actual_TCP_pose_{}", pose[0])
        | numbered("actual_TCP_force_{}", in_base(made))
    )


def franka(made: Press) -> Table:
    transforms = []
    for tip in (made.tip_mm, made.commanded_mm):
        transform = np.tile(np.eye(4), (tip.shape[0], 1, 1))
        transform[:, :3, :3], transform[:, :3, 3] = made.pose.as_matrix(), 1e-3 * tip
        transforms.append(transform.transpose(0, 2, 1).reshape(-1, 16))
    return (
        {"time": made.time_s}
        | numbered("O_T_EE_d_{}", transforms[1])
        | numbered("O_T_EE_{}", transforms[0])
        | numbered("O_F_ext_hat_K_{}", in_base(made))
    )


def kuka_rsi(made: Press) -> Table:
    angles = made.pose.as_euler("ZYX", degrees=True)
    poses = [
        named(f"X_{word} Y_{word} Z_{word} A_{word} B_{word} C_{word}", tip, angles)
        for word, tip in (("RSol", made.commanded_mm), ("RIst", made.tip_mm))
    ]
    return {"IPOC": 1e3 * made.time_s + 12.1e8} | poses[0] | poses[1] | wrench(made)


def iiwa(made: Press) -> Table:
    angles = made.pose.as_euler("ZYX")
    return (
        {"time [s]": made.time_s}
        | named("commandedX commandedY commandedZ", made.commanded_mm)
        | named("measuredX measuredY measuredZ measuredA measuredB measuredC", made.tip_mm, angles)
        | named("Fx[N] Fy[N] Fz[N] Tx[Nm] Ty[Nm] Tz[Nm]", made.force_N, made.moment_Nm)
    )


def abb(made: Press) -> Table:
    quaternion = made.pose.as_quat()[:, [3, 0, 1, 2]]
    return {"t_ms": 1e3 * made.time_s} | named("X Y Z q1 q2 q3 q4", made.tip_mm, quaternion) | wrench(made)


def xarm(made: Press) -> Table:
    angles = made.pose.as_euler("xyz", degrees=True)
    ft = "ext_force_x ext_force_y ext_force_z ext_torque_x ext_torque_y ext_torque_z"
    return (
        {"time_s": made.time_s}
        | named("target_x target_y target_z target_roll target_pitch target_yaw", made.commanded_mm, angles)
        | named("x y z roll pitch yaw", made.tip_mm, angles)
        | wrench(made, ft)
    )


def optotrak(made: Press) -> Table:
    quaternion = made.pose.as_quat()[:, [3, 0, 1, 2]]
    return (
        {"Frame": np.arange(1.0, made.time_s.size + 1), "Time": made.time_s}
        | named("Q0 Qx Qy Qz Tx Ty Tz", quaternion, made.tip_mm)
        | wrench(made)
    )


def vicon(made: Press) -> Table:
    return (
        {"Frame": np.arange(made.time_s.size * 1.0), "Sub Frame": 0.0 * made.time_s, "Time (s)": made.time_s}
        | named("TX_mm TY_mm TZ_mm", made.tip_mm)
        | named("RX_rad RY_rad RZ_rad", made.pose.as_rotvec())
        | named("Fx_N Fy_N Fz_N Mx_Nmm My_Nmm Mz_Nmm", made.force_N, 1e3 * made.moment_Nm)
    )


def camera(made: Press) -> Table:
    return (
        {"time_s": made.time_s}
        | named("cmd_px cmd_py cmd_pz", 1e-3 * made.commanded_mm)
        | named("cam_px_rel cam_py_rel cam_pz_rel", made.tip_mm)
        | named("ox oy oz ow", made.pose.as_quat())
        | wrench(made, "fx_N fy_N fz_N tx_Nm ty_Nm tz_Nm")
    )


def suffixes(made: Press) -> Table:
    return (
        {"time_s": made.time_s}
        | named("x_des y_des z_des", made.commanded_mm)
        | named("desired_x desired_y desired_z", made.commanded_mm)
        | named("x_meas y_meas z_meas", made.tip_mm)
        | named("qx qy qz qw", made.pose.as_quat())
        | wrench(made, "force_x_N force_y_N force_z_N torque_x_Nm torque_y_Nm torque_z_Nm")
    )


def load_cell(made: Press) -> Table:
    names = "x_mm y_mm z_mm qx qy qz qw"
    return (
        {"time_s": made.time_s}
        | named(names, made.tip_mm, made.pose.as_quat())
        | {"Load (N)": made.force_N[:, 2]}
    )


def forces_alone(made: Press) -> Table:
    names = "x_mm y_mm z_mm qx qy qz qw Fx Fy Fz"
    return {"time": made.time_s} | named(names, made.tip_mm, made.pose.as_quat(), made.force_N)


def sunrise(made: Press) -> Table:
    """KUKA's angles in radians, under a word that is a place elsewhere."""
    names = " ".join(f"$POS_ACT.{letter}" for letter in "XYZABC")
    return {"time": made.time_s} | named(names, made.tip_mm, made.pose.as_euler("ZYX")) | wrench(made)


def sensor_interface(made: Press) -> Table:
    """KUKA's names, among vectors of other quantities."""
    rng, others = np.random.default_rng(5), {"t": made.time_s}
    for what in ("vel", "acc"):
        others |= named(f"{what}_x {what}_y {what}_z", rng.normal(size=made.tip_mm.shape))
    names = " ".join(f"RIst.{letter}" for letter in "XYZABC")
    pose = named(names, made.tip_mm, made.pose.as_euler("ZYX", degrees=True))
    return others | pose | wrench(made, "FTC.Fx FTC.Fy FTC.Fz FTC.Mx FTC.My FTC.Mz")


def ros_stamps(made: Press) -> Table:
    """Time in whole seconds and nanoseconds."""
    stamp_ns = (1_700_000_000 * 10**9 + np.round(1e9 * made.time_s)).astype(np.int64)
    stamp = {"/ft/header/stamp/sec": stamp_ns // 10**9, "/ft/header/stamp/nanosec": stamp_ns % 10**9}
    place = " ".join(f"field.pose.position.{a}" for a in "xyz")
    turn = " ".join(f"field.pose.orientation.{a}" for a in "xyzw")
    names = " ".join(f"field.wrench.{part}.{a}" for part in ("force", "torque") for a in "xyz")
    return stamp | named(f"{place} {turn}", 1e-3 * made.tip_mm, made.pose.as_quat()) | wrench(made, names)


def unset_stamps(made: Press) -> Table:
    """Stamps that nobody has set, next to a time."""
    return dict.fromkeys(("header.stamp.sec", "header.stamp.nanosec"), 0.0 * made.time_s) | abb(made)


def doosan(made: Press, names: str = "x y z a b c") -> Table:
    pose = named(names, made.tip_mm, made.pose.as_euler("ZYZ", degrees=True))
    return {"time": made.time_s} | pose | named("fx fy fz tx ty tz", -made.force_N, -made.moment_Nm)


def doosan_posx(made: Press) -> Table:
    return doosan(made, " ".join(f"posx[{k}]" for k in range(6)))


def degrees_about_fixed_axes(made: Press) -> Table:
    angles = made.pose.as_euler("xyz", degrees=True)
    pose = named("x_mm y_mm z_mm rx_deg ry_deg rz_deg", made.tip_mm, angles)
    return {"time": made.time_s} | pose | wrench(made, "Fx_(N) Fy_(N) Fz_(N) Tx_(Nm) Ty_(Nm) Tz_(Nm)")


def plotjuggler(made: Press) -> Table:
    """Topics of two rates in one table: rows of one have no values of the other."""
    names = " ".join(f"/ft/wrench/{part}/{a}" for part in ("force", "torque") for a in "xyz")
    place = " ".join(f"/pose/pose/position/{a}" for a in "xyz")
    turn = " ".join(f"/pose/pose/orientation/{a}" for a in "xyzw")
    pose = named(f"{place} {turn}", 1e-3 * made.tip_mm, made.pose.as_quat())
    table = {"__time": np.sort(np.concatenate([made.time_s, made.time_s + 0.002]))}
    for shift, part in enumerate((wrench(made, names), pose)):
        for name, values in part.items():
            table[name] = np.full(table["__time"].size, np.nan)
            table[name][shift::2] = values
    return table


ROBOTS = (
    *(universal_robots, franka, kuka_rsi, iiwa, abb, xarm, optotrak, vicon, camera, suffixes, sunrise),
    *(sensor_interface, ros_stamps, unset_stamps, doosan, doosan_posx, degrees_about_fixed_axes),
    *(plotjuggler, load_cell, forces_alone),
)


@pytest.mark.filterwarnings("ignore:Gimbal lock")
@pytest.mark.parametrize("twist", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("layout", ROBOTS, ids=lambda layout: layout.__name__)
def test_a_robot_gives_the_truth_of_its_press(
    layout: Callable[[Press], Table], twist: bool, tmp_path: Path
) -> None:
    write.write_text(tmp_path / "log.csv", layout(press(twist=twist)))
    found = inspect_log(tmp_path / "log.csv")
    assert found.record["problem"] == ""
    settings = tomllib.loads(found.study_text)["experiment"]["settings"]
    response = RobotLogLoader(RobotLogSettings.model_validate(settings)).load(tmp_path / "log.csv")
    force = response.curves["force"]
    assert force.ordinate[-1] == pytest.approx(FORCE_N, rel=0.01)
    assert force.abscissa[-1] == pytest.approx(DEPTH_MM, abs=0.08)  # 10.5 mm were commanded
    has_moment = layout not in (load_cell, forces_alone)
    assert ("torque" in response.curves) == (twist and has_moment)
    if twist and has_moment:
        assert np.abs(response.curves["torque"].ordinate).max() == pytest.approx(TORQUE_NMM, rel=0.03)
    if twist and not has_moment:
        (warning,) = response.record["warnings"]
        assert "no moment, so the twist gives no torque" in warning
        with pytest.raises(CurveError, match="no moment"):
            RobotLogLoader(RobotLogSettings.model_validate(settings)).load(tmp_path / "log.csv", "torque")


def test_a_pose_of_a_probe_is_read(tmp_path: Path) -> None:
    made = press()
    table = {"time_s": made.time_s} | robot(made)
    renamed = {f"probe_{name}" if name[1:] == "_mm" else name: column for name, column in table.items()}
    write.write_text(tmp_path / "log.csv", renamed)
    found = inspect_log(tmp_path / "log.csv")
    assert found.record["problem"] == ""
    assert "probe_x_mm" in found.study_text


def test_specimens_with_letters_are_no_hexadecimal_counts(tmp_path: Path) -> None:
    rows = (f"AB{10 + k},{0.2 * k:.1f},{0.1 * k**1.5:.4f}" for k in range(40))
    (tmp_path / "curve.csv").write_text("\n".join(["specimen,Depth (mm),Force (N)", *rows]))
    assert not any("hexadecimal" in text for text in inspect_log(tmp_path / "curve.csv").findings)


@pytest.mark.parametrize("unit", ["_mm", ""])
def test_a_pose_that_is_commanded_alone_is_named(unit: str, tmp_path: Path) -> None:
    made = press()
    table = {"time_s": made.time_s} | robot(made)
    commanded = {
        f"cmd_{name[0]}{unit}" if name[1:] == "_mm" else name: column for name, column in table.items()
    }
    write.write_text(tmp_path / "log.csv", commanded)
    found = inspect_log(tmp_path / "log.csv")
    assert any("position: these columns are commanded, not measured" in text for text in found.findings)
    assert "# check position: these columns are commanded" in found.study_text


def test_names_of_makers_and_languages_are_known(tmp_path: Path) -> None:
    """Stamps of KUKA's Sunrise, angles of a ship, numbered quaternions with a word behind the number."""
    made = press(twist=True)
    loads = "Fx (N),Fy (N),Fz (N),Mx (Nm),My (Nm),Mz (Nm)"
    q, stamp = made.pose.as_quat()[:, [3, 0, 1, 2]], [made.time_s // 1.0, np.round(made.time_s % 1.0 * 1e9)]
    turns = made.pose.as_euler("xyz", degrees=True)
    for names, columns in (
        ("ZeitSek,ZeitNsek,x_mm,y_mm,z_mm,q0,q1,q2,q3", [*stamp, made.tip_mm, q]),
        ("t_s,x_mm,y_mm,z_mm,roulis,tangage,lacet", [made.time_s, made.tip_mm, turns]),
        ("t_s,PosX TCP,PosY TCP,PosZ TCP,Q0 TCP,Q1 TCP,Q2 TCP,Q3 TCP", [made.time_s, made.tip_mm, q]),
    ):
        path = tmp_path / "t.csv"
        lines = rows(*columns, made.force_N, made.moment_Nm, form="{:.12g}")
        path.write_text("\n".join([f"{names},{loads}", *lines]))
        found = inspect_log(path)
        assert not found.record["problem"]
        settings = tomllib.loads(found.study_text)["experiment"]["settings"]
        torque = RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path)["torque"]
        assert torque.ordinate.max() == pytest.approx(TORQUE_NMM, abs=0.5)
        assert torque.abscissa.max() == pytest.approx(22.5, abs=0.1)


def asked(path: Path, table: Table) -> str:
    write.write_text(path, table)
    return str(inspect_log(path).record["problem"])


def test_numbers_that_fit_two_units_are_asked_about(tmp_path: Path) -> None:
    """A lever of 200 mm, or 0.2 mm; a press of 13 mm, or 1.3 mm."""
    made = press(twist=True)
    turn, forces = named("qx qy qz qw", made.pose.as_quat()), named("fx fy fz", made.force_N)
    for size_mm, size_Nm, question in (
        (1.0, 100.0, "mx, my, mz span 5.09 and show no unit: N cm, N m or N·mm? write unit next to moment"),
        (0.1, 1.0, "x, y, z span 1.3 and show no unit: cm, mm or m? write unit next to position"),
    ):
        place, moments = (
            named("x y z", size_mm * made.tip_mm),
            named("mx my mz", size_Nm * made.moment_Nm),
        )
        assert asked(tmp_path / "t.csv", {"t": made.time_s} | place | turn | forces | moments) == question


@pytest.mark.parametrize(("yields_mm", "is_asked"), [(0.4, True), (0.0, False)])
def test_two_measured_positions_that_differ_are_asked_about(
    tmp_path: Path, yields_mm: float, is_asked: bool
) -> None:
    made = press(twist=True)
    off = yields_mm / FORCE_N * made.force_N
    poses = named("camera_x camera_y camera_z", 1e-3 * (made.tip_mm - off)) | named(
        "robot_x robot_y robot_z", 1e-3 * made.tip_mm
    )
    turn = named("qx qy qz qw", made.pose.as_quat())
    table = {"t": made.time_s} | poses | turn | wrench(made)
    question = "camera_x, camera_y, camera_z or robot_x, robot_y, robot_z? both show the tool, and differ"
    assert (question in asked(tmp_path / "t.csv", table)) == is_asked
    table |= {name: 0.1 * 1e3 * values for name, values in poses.items()}
    problem = asked(tmp_path / "t.csv", table)
    assert (question in problem) == is_asked
    assert "and show no unit: cm, mm or m?" in problem


@pytest.mark.parametrize("name", ["Rotation (deg)", "Rotation"])
def test_a_turn_of_a_machine_that_wraps_is_one_turn(name: str, tmp_path: Path) -> None:
    made = press(twist=True)
    turn = np.degrees(np.unwrap(made.pose.as_euler("ZYX")[:, 0]))
    table = {
        "Time (s)": made.time_s,
        "Crosshead (mm)": 203.0 - made.tip_mm[:, 2],
        "Load (N)": -made.force_N[:, 2],
        name: np.mod(turn - turn[0] + 5.0, 360.0),
        "Torque (N·mm)": 1e3 * made.moment_Nm[:, 2],
    }
    path = tmp_path / "t.csv"
    write.write_text(path, table)
    settings = tomllib.loads(inspect_log(path).study_text)["experiment"]["settings"]
    torque = RobotLogLoader(RobotLogSettings.model_validate(settings)).load(path)["torque"]
    assert torque.abscissa.max() == pytest.approx(22.5, abs=0.1)
    assert torque.ordinate.max() == pytest.approx(TORQUE_NMM, abs=0.5)
    curve = {one: table[one][100:400] for one in (name, "Torque (N·mm)")}
    assert f"{name} jumps by a full turn: unwrap it" in asked(path, curve)


def test_a_fast_turn_without_a_unit_keeps_its_sense(tmp_path: Path) -> None:
    t = np.arange(0.0, 40.0, 0.1)
    depth = np.interp(t, [0.0, 2.0, 12.0, 22.0, 32.0, 40.0], [0.0, 0.0, 10.0, 10.0, 0.0, 0.0])
    turn = np.interp(t, [0.0, 13.0, 21.0, 40.0], [0.0, 0.0, 320.0, 320.0])
    table = {
        "Time (s)": t,
        "Displacement (mm)": depth,
        "Force (N)": 0.02 * np.clip(depth - 3.0, 0.0, None) ** 1.5,
        "Rotation": turn,
        "Torque (N mm)": 60.0 * np.sin(np.radians(turn) / 3.6),
    }
    moments = []
    for name in ("Rotation", "Rotation (deg)"):
        columns = {name if key == "Rotation" else key: values for key, values in table.items()}
        write.write_text(tmp_path / "t.csv", columns)
        text = inspect_log(tmp_path / "t.csv").record["study_toml"]
        moments.append([line for line in text.splitlines() if "Torque" in line])
    assert moments[0] == moments[1]
    assert moments[0]


def test_a_time_with_marks_between_its_thousands_is_named(tmp_path: Path) -> None:
    made = press(twist=True)
    body = rows(made.tip_mm, made.pose.as_quat(), made.force_N, made.moment_Nm, form="{:.12g}")
    names = "Time (ms),x_mm,y_mm,z_mm,qx,qy,qz,qw,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm"
    lines = [f'"{1e3 * t:,.0f}",{row}' for t, row in zip(made.time_s, body, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join([names, *lines]))
    problem = inspect_log(tmp_path / "t.csv").record["problem"]
    assert "'1,000' has marks between its thousands; export the file without them" in problem
