"""Logs in the layouts of others are read as proposed: units, preambles, transforms, two files."""

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from palpate.api.files import Column, TextFormat
from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate_robot_log.reading.assembly import read_recording
from palpate_robot_log.reading.channel_map import ChannelMap, LogFiles
from palpate_robot_log.reading.formats import read_here
from palpate_robot_log.reading.inspection import inspect_log
from palpate_robot_log.reading.raw import Stream
from palpate_robot_log.reading.ros import PLACE, TURN, chains
from palpate_robot_log.recording import Recording

from . import log_writers as write
from .known_presses import named, press, robot, wrench


def _written(path: Path, columns: Mapping[str, FloatArray]) -> Path:
    names, rows = list(columns), np.column_stack(list(columns.values()))
    lines = [",".join(f"{value:.12g}" for value in row) for row in rows]
    path.write_text("\n".join([",".join(names), *lines]) + "\n")
    return path


def test_a_unit_that_is_not_known_is_named_and_never_guessed(tmp_path: Path) -> None:
    table = write.press()
    names = {name: f"F{name[1]} (counts)" for name in ("fx_N", "fy_N", "fz_N")}
    path = _written(tmp_path / "log.csv", {names.get(name, name): v for name, v in table.items()})
    found = inspect_log(path)
    assert any("the file gives 'counts'" in finding for finding in found.findings)
    assert "'counts', which is not known" in found.record["problem"]
    assert 'unit = "N"' not in found.study_text
    with pytest.raises(CurveError, match="'counts', which is not known; calibrate the columns"):
        read_recording(path, write.channel_map(force={"columns": [*names.values()], "unit": "N"}))
    force = {"columns": [*names.values()], "unit": "N"}
    trusted = write.channel_map(**_with_units(), force=force, header_units=False)
    assert read_recording(path, trusted).recording.n_rows == 240


def _with_units() -> dict[str, object]:
    units = {"position": "m", "moment": "N*m"}
    return {
        "time": {"column": "time_s", "unit": "s"},
        **{key: {**write.MAP[key], "unit": unit} for key, unit in units.items()},
    }


def test_a_time_in_minutes_and_a_force_in_pounds_are_read_as_such(tmp_path: Path) -> None:
    table = write.press()
    named = {**table, "Time (min)": table["time_s"] / 60.0}
    for axis in "xyz":
        named[f"F{axis} (lb)"] = table[f"f{axis}_N"] / 4.4482216152605
        named[f"T{axis} (ozf-in)"] = table[f"t{axis}_Nm"] / 7.061551814226e-3
    drop = {"time_s", *write.COLUMNS[8:]}
    path = _written(tmp_path / "log.csv", {k: v for k, v in named.items() if k not in drop})
    recording = read_as_proposed(path)
    np.testing.assert_allclose(recording.time_s, table["time_s"], atol=1e-9)
    np.testing.assert_allclose(recording.force_N[:, 2], table["fz_N"], rtol=1e-9)
    np.testing.assert_allclose(recording.moment_Nmm[:, 2], 1e3 * table["tz_Nm"], rtol=1e-9)


def read_as_proposed(path: Path) -> Recording:
    settings = tomllib.loads(inspect_log(path).study_text)["experiment"]["settings"]
    text = TextFormat.model_validate(settings.get("text", {}))
    return read_recording(path, ChannelMap.model_validate(settings["channels"]), text).recording


def test_a_line_of_units_a_preamble_and_cp1252_are_in_the_proposal(tmp_path: Path) -> None:
    table = write.press()
    named = {name.rpartition("_")[0] or name: values for name, values in table.items()}
    units = ["s", "m", "m", "m", "", "", "", "", "N", "N", "N", "Nm", "Nm", "Nm"]
    rows = [
        ";".join(repr(v).replace(".", ",") for v in row)
        for row in np.column_stack([*named.values()]).tolist()
    ]
    head = ["Prüfung: 3", ";".join(named), ";".join(f"[{unit}]" if unit else "-" for unit in units)]
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join([*head, *rows, "Ende der Messung"]).encode("cp1252"))
    recording = read_as_proposed(path)
    np.testing.assert_allclose(recording.moment_Nmm[:, 2], 1e3 * table["tz_Nm"], rtol=1e-12)
    assert inspect_log(path).record["layout"] == {
        "delimiter": ";",
        "decimal": ",",
        "encoding": "cp1252",
        "skip_lines": 1,
    }


def test_a_transform_as_a_list_in_a_cell_is_understood(tmp_path: Path) -> None:
    table = write.press()
    q = np.column_stack([table[f"q{axis}"] for axis in "xyzw"])
    pose = np.tile(np.eye(4), (240, 1, 1))
    pose[:, :3, :3] = Rotation.from_quat(q).as_matrix()
    pose[:, :3, 3] = np.column_stack([table[f"{axis}_m"] for axis in "xyz"])
    wrench = np.column_stack([table[name] for name in write.COLUMNS[8:]])
    lines = [
        f"{t!r};{pose[i].T.ravel().tolist()};{wrench[i].tolist()}"
        for i, t in enumerate(table["time_s"].tolist())
    ]
    path = tmp_path / "franka.csv"
    path.write_text("\n".join(["time;O_T_EE;K_F_ext_hat_K", *lines]) + "\n")
    recording = read_as_proposed(path)
    np.testing.assert_allclose(recording.position_mm, 1e3 * pose[:, :3, 3], rtol=1e-12)
    np.testing.assert_allclose(recording.force_N, wrench[:, :3], rtol=1e-12)


@pytest.mark.parametrize(("ahead_s", "clocks"), [(0.0, "common"), (1e5, "own")])
def test_two_files_that_count_since_1970_have_one_clock_where_they_overlap(
    tmp_path: Path, ahead_s: float, clocks: str
) -> None:
    table = write.press()
    stamps = (1.9e9 + table["time_s"]) * 1e9
    parts = {"pose": table, "wrench": table}
    for part, names in (("pose", write.COLUMNS[1:8]), ("wrench", write.COLUMNS[8:])):
        ahead = ahead_s * 1e9 * (part == "wrench")
        lines = [
            ",".join([f"{stamp + ahead:.0f}", *(f"{parts[part][name][i]:.9g}" for name in names)])
            for i, stamp in enumerate(stamps)
        ]
        (tmp_path / f"p1_{part}.csv").write_text("\n".join([",".join(["%time", *names]), *lines]) + "\n")
    found = inspect_log(tmp_path / "p1_pose.csv", tmp_path / "p1_wrench.csv")
    assert found.record["channels"]["clocks"] == clocks
    assert found.record["channels"]["time"]["column"] == "%time"


def test_two_files_of_which_one_counts_its_rows_ask_for_its_rate(tmp_path: Path) -> None:
    table = write.press()
    pose = {name: table[name] for name in write.COLUMNS[:8]}
    wrench = {"frame": np.arange(240.0)} | {name: table[name] for name in write.COLUMNS[8:]}
    write.write_text(tmp_path / "p1_pose.csv", pose)
    write.write_text(tmp_path / "p1_wrench.csv", wrench)
    found = inspect_log(tmp_path / "p1_pose.csv", tmp_path / "p1_wrench.csv")
    rate = 'time = { column = "frame", rate = "… Hz" }'
    assert found.record["problem"] == f"not found: the time of wrench; give {rate} next to its columns"
    known = "".join(
        line.replace(" }", f", {rate.replace('…', '200')} }}")
        if line.startswith(("force", "moment"))
        else line
        for line in found.study_text.splitlines(keepends=True)
    )
    settings = tomllib.loads(known)["experiment"]["settings"]
    files, channels = (
        kind.model_validate(settings[key]) for key, kind in (("files", LogFiles), ("channels", ChannelMap))
    )
    assert read_recording(tmp_path / "p1_pose.csv", channels, files=files).recording.n_rows > 100
    assert found.record["channels"]["clocks"] == "own"


def test_a_chain_of_transforms_is_the_pose_of_its_last_frame(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    log = write.write_transforms(
        tmp_path / "log", {"/tf": [("base", "arm"), ("arm", "tool")], "/tf_static": [("tool", "sensor")]}
    )
    found = read_here(log)
    names = ["/tf base>sensor", "/tf base>tool", "/tf base>arm", "/tf arm>tool"]
    assert [stream.name for stream in found.streams] == names
    notes = "\n".join(found.notes)
    assert "/tf_static tool>sensor: one message, so no motion" in notes
    assert "/tf base>sensor: composed of a chain of transforms" in notes
    # Each transform of a message moves by its number along x and by its place in the message along y.
    chosen = read_here(log, streams=("/tf base>sensor",)).stream("/tf base>sensor")
    place = np.column_stack([chosen.column(f"transform.translation.{axis}").values for axis in "xyz"])
    np.testing.assert_allclose(place[:, 0], 2.0 * np.arange(30.0))
    np.testing.assert_allclose(place[:, 1], 1.0 + 2.0 + 1.0)


@given(seed=st.integers(0, 2**32 - 1), n_moving=st.integers(1, 3))
def test_chains_of_transforms_multiply(seed: int, n_moving: int) -> None:
    """Transforms of several rates: at common times the pose is their product, in this order."""
    rng = np.random.default_rng(seed)
    frames = [(f"frame_{k}", f"frame_{k + 1}") for k in range(4)]
    edges, places, turns = {}, [], []
    for k, pair in enumerate(frames):
        n_rows = 7 if k < n_moving else 1
        place, turn = rng.normal(size=(n_rows, 3)), Rotation.random(n_rows, rng=seed + k)
        columns = [Column(name="received", values=0.1 * np.arange(n_rows), unit="s")]
        columns += [Column(name=name, values=v) for name, v in zip(PLACE, place.T, strict=True)]
        columns += [Column(name=name, values=v) for name, v in zip(TURN, turn.as_quat().T, strict=True)]
        edges[pair] = Stream.of(columns, f"/tf {pair[0]}>{pair[1]}")
        places.append(place)
        turns.append(turn)
    longest = next(chains(edges))
    assert longest.name == "/tf frame_0>frame_4"
    for row in range(7):
        point = np.zeros(3)
        for place, turn in reversed([*zip(places, turns, strict=True)]):
            at = min(row, len(place) - 1)
            point = place[at] + turn[at].apply(point)
        np.testing.assert_allclose(longest.frame.select(PLACE).to_numpy()[row], point, atol=1e-12)


@pytest.mark.parametrize("name", ["rz_deg", "angle_deg", "Rotation"])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_one_angle_is_the_turn_about_the_line_of_the_press(name: str, sense: float, tmp_path: Path) -> None:
    made = press(twist=True)
    turn = sense * np.degrees((made.pose[0].inv() * made.pose).as_rotvec()[:, 2])
    columns = {"time_s": made.time_s} | named("x_mm y_mm z_mm", made.tip_mm) | {name: turn}
    path = _written(tmp_path / "log.csv", columns | wrench(made, "fx_N fy_N fz_N tx_Nm ty_Nm tz_Nm"))
    found = inspect_log(path)
    assert found.record["problem"] == ""
    (curves,) = [line for line in found.findings if line.startswith("its curves")]
    assert "over -22.5 to 22.5 degrees" in curves
    assert re.search(r"torque -2\d\.?\d* to 2\d\.?\d* N·mm", curves)
    assert any(f"check {name} is taken for the turn of the tool" in line for line in found.findings)


@pytest.mark.parametrize("case", ["constant", "tilted", "of a knee", "two angles"])
def test_an_angle_that_may_not_be_the_tool_s_turn_is_asked_about(case: str, tmp_path: Path) -> None:
    made = press(twist=case != "constant", tilt_deg=12.0 if case == "tilted" else 0.0)
    turn = np.degrees((made.pose[0].inv() * made.pose).as_rotvec()[:, 2])
    turn = 10.0 * np.sin(made.time_s) if case == "of a knee" else turn
    columns = {"time_s": made.time_s} | named("x_mm y_mm z_mm", made.tip_mm) | {"rz_deg": turn}
    columns |= {"tilt_deg": 0.0 * turn} if case == "two angles" else {}
    columns |= wrench(made, "fx_N fy_N fz_N tx_Nm ty_Nm tz_Nm")
    found = inspect_log(_written(tmp_path / "log.csv", columns))
    assert found.record["problem"].startswith("not found: orientation; name their columns")


def test_an_angle_next_to_a_force_alone_leaves_the_tool_as_it_is(tmp_path: Path) -> None:
    made = press()
    columns = {"time_s": made.time_s} | named("x_mm y_mm z_mm", made.tip_mm)
    columns |= named("fx_N fy_N fz_N", made.force_N) | {"knee_angle_deg": 10.0 * np.sin(made.time_s)}
    found = inspect_log(_written(tmp_path / "log.csv", columns))
    assert found.record["channels"]["orientation"]["form"] == "fixed"
    assert any("its curves: force" in line for line in found.findings)


def test_a_time_in_whole_steps_is_a_time(tmp_path: Path) -> None:
    made = press()
    columns = {"t": np.arange(made.time_s.size, dtype=float)} | robot(made)
    assert inspect_log(_written(tmp_path / "log.csv", columns)).record["channels"]["time"]["column"] == "t"


def test_a_count_next_to_a_time_is_no_time(tmp_path: Path) -> None:
    made = press()
    counts = {"F/T Sequence": 7.0 * np.arange(made.time_s.size), "Time": made.time_s}
    path = _written(tmp_path / "log.csv", counts | robot(made))
    assert inspect_log(path).record["channels"]["time"] == {"column": "Time", "unit": "s"}


def test_commas_between_thousands_leave_semicolons_between_cells(tmp_path: Path) -> None:
    time, force = np.arange(0.0, 2000.0, 10.0), np.linspace(0.0, 9000.0, 200)
    rows = [f"{t:,.0f};{f:,.1f};{f / 2.0:,.1f}" for t, f in zip(time, force, strict=True)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time (ms);force (mN);depth (µm)", *rows]) + "\n")
    (curves,) = [line for line in inspect_log(path).findings if line.startswith("these tables read")]
    assert curves.endswith("force 0 to 9 N over 0 to 4.5 mm in 200 rows")
