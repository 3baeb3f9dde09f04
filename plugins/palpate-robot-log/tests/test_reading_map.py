"""The channel map: units, signs, forms of orientation, frames and common time."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from palpate.api.files import Column
from palpate.errors import CurveError
from palpate_robot_log.reading.assembly import assemble
from palpate_robot_log.reading.formats import read_here
from palpate_robot_log.reading.raw import RawLog, Stream
from palpate_robot_log.recording import Recording

from . import log_writers as write


def log_of(table: write.Table, **units: str) -> RawLog:
    columns = {key: Column(name=key, values=v, unit=units.get(key, "")) for key, v in table.items()}
    stream = Stream.of(columns.values())
    return RawLog(source="log.npz", format="NumPy archive", row_word="row", streams=(stream,))


def recording(table: write.Table, **changes: Any) -> Recording:
    return assemble(log_of(table), write.channel_map(**changes)).recording


def renamed(table: write.Table, **names: str) -> write.Table:
    return {names.get(key, key): values for key, values in table.items()}


# ------------------------------------------------------------------------ units


def test_units_are_taken_from_the_names_or_the_map() -> None:
    table = write.press()
    expected = recording(table)
    bare = renamed(table, x_m="x", y_m="y", z_m="z")
    found = recording(bare, position={"columns": ["x", "y", "z"], "unit": "m"})
    np.testing.assert_array_equal(found.position_mm, expected.position_mm)
    milli = {**table, "fx_mN": 1e3 * table["fx_N"], "t_ms": 1e3 * table["time_s"]}
    found = recording(milli, time="t_ms", force={"columns": ["fx_mN", "fy_N", "fz_N"]})
    np.testing.assert_allclose(found.force_N, expected.force_N, rtol=1e-14)
    np.testing.assert_allclose(found.time_s, expected.time_s, rtol=1e-14)


def test_a_line_of_units_counts_as_names_do(tmp_path: Path) -> None:
    table = write.press()
    write.write_text(tmp_path / "log.csv", renamed(table, x_m="x", y_m="y", z_m="z"), ";", ",")
    names, *rows = (tmp_path / "log.csv").read_text().splitlines()
    (tmp_path / "log.csv").write_text("\n".join([names, "s;m;m;m;;;;-;N;N;N;Nm;Nm;Nm", *rows]) + "\n")
    channels = write.channel_map(position={"columns": ["x", "y", "z"]})
    found = assemble(read_here(tmp_path / "log.csv"), channels).recording
    np.testing.assert_array_equal(found.position_mm, recording(table).position_mm)
    assert found.rows[0] == 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"position": {"columns": ["qx", "qy", "qz"]}},
            "column 'qx' shows no unit, and the channel map gives",
        ),
        ({"position": {"columns": ["fx_N", "y_m", "z_m"]}}, "'N' is a unit of force where one of length"),
        (
            {"position": {"columns": ["x_m", "y_m", "z_m"], "unit": "mm"}},
            "is in m as the file shows, and in mm as the channel map gives",
        ),
        ({"force": {"columns": ["fx_N", "fy_N", "fz_N"], "unit": "bananas"}}, "'bananas' is not known"),
        ({"force": {"columns": ["fx_N", "fy_N", "fq_N"]}}, "no column 'fq_N'; did you mean 'f"),
        ({"force": {"columns": ["Fx", "fy_N", "fz_N"]}}, r"no column 'Fx'; did you mean 'fx_N'\?"),
        ({"force": {"columns": ["fx_N", "fy_N", "fz_N"], "stream": "/ft"}}, "no stream '/ft'"),
    ],
)
def test_a_map_that_does_not_fit_is_reported(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(CurveError, match=message):
        recording(write.press(), **changes)


def test_units_of_the_file_can_be_overruled() -> None:
    table = write.press()
    lying = {**table, **{name: 1e3 * table[name] for name in ("x_m", "y_m", "z_m")}}
    changes = {key: {**write.MAP[key], "unit": unit} for key, unit in (("force", "N"), ("moment", "N m"))}
    found = recording(
        lying,
        header_units=False,
        time={"column": "time_s", "unit": "s"},
        position={"columns": ["x_m", "y_m", "z_m"], "unit": "mm"},
        **changes,
    )
    np.testing.assert_allclose(found.position_mm, recording(table).position_mm, rtol=1e-14)


# ------------------------------------------------------------------------ signs


def test_a_minus_reverses_a_column_and_a_zero_is_no_axis() -> None:
    table = write.press()
    found = recording(table, force={"columns": ["-fy_N", "fx_N", "fz_N"]})
    np.testing.assert_array_equal(found.force_N[:, 0], -table["fy_N"])
    found = recording(table, force={"columns": ["0", "0", "fz_N"]})
    np.testing.assert_array_equal(found.force_N[:, :2], 0.0)
    np.testing.assert_array_equal(found.force_N[:, 2], table["fz_N"])


def test_a_reaction_is_turned_round() -> None:
    table = write.press()
    found, plain = recording(table, acts_on="tissue"), recording(table)
    np.testing.assert_array_equal(found.force_N, -plain.force_N)
    np.testing.assert_array_equal(found.moment_Nmm, -plain.moment_Nmm)


# ----------------------------------------------------------------------- frames


def _q(table: write.Table) -> Rotation:
    return Rotation.from_quat(np.column_stack([table[f"q{a}"] for a in "xyzw"]))


def test_a_wrench_in_the_base_is_brought_into_the_sensor() -> None:
    table = write.press()
    plain = recording(table)
    in_base = dict(table)
    for names, values in (
        (write.COLUMNS[8:11], plain.force_N),
        (write.COLUMNS[11:], 1e-3 * plain.moment_Nmm),
    ):
        in_base.update(zip(names, _q(table).apply(values.copy()).T.copy(), strict=True))
    found = recording(in_base, wrench_frame="base")
    np.testing.assert_allclose(found.force_N, plain.force_N, atol=1e-12)
    np.testing.assert_allclose(found.moment_Nmm, plain.moment_Nmm, atol=1e-9)


def test_the_sensor_may_be_rotated_in_the_tool_and_the_tip_offset() -> None:
    table = write.press()
    found = recording(table, sensor_turned=["10 deg", "20 deg", "30 deg"], tip=["1 mm", "0 mm", "120 mm"])
    mount = Rotation.from_euler("xyz", [10.0, 20.0, 30.0], degrees=True)
    overlap = np.einsum("ij,ij->i", found.quaternion, (_q(table) * mount).as_quat())
    np.testing.assert_allclose(np.abs(overlap), 1.0, atol=1e-12)
    tip = recording(table).position_mm + _q(table).apply([1.0, 0.0, 120.0])
    np.testing.assert_allclose(found.position_mm, tip, atol=1e-9)


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("form", ["euler", "axis_angle", "rotation_matrix", "inverse", "fixed"])
def test_orientation_in_every_form(form: str, unit: str) -> None:
    table = write.press()
    turn = _q(table)
    scale = np.degrees(1.0) if unit == "deg" else 1.0
    changes: dict[str, Any] = {"form": form, "unit": unit}
    match form:
        case "euler":
            values, changes["sequence"] = scale * turn.as_euler("ZYX"), "ZYX"
        case "axis_angle":
            values = scale * turn.as_rotvec()
        case "rotation_matrix":
            values, changes = turn.as_matrix().reshape(-1, 9), {"form": form}
        case "inverse":
            values, changes = 1.005 * turn.inv().as_quat(), {"inverse": True}
        case _:
            values, changes = np.empty((240, 0)), {"form": form, "value": [0.0, 0.6, 0.0, 0.8]}
            turn = Rotation.from_quat(np.tile([0.0, 0.6, 0.0, 0.8], (240, 1)))
    columns = [f"o{i}" for i in range(values.shape[1])]
    table |= dict(zip(columns, values.T.copy(), strict=True))
    found = recording(table, orientation={"columns": columns, **changes})
    overlap = np.einsum("ij,ij->i", found.quaternion, turn.as_quat())
    np.testing.assert_allclose(np.abs(overlap), 1.0, atol=1e-12)


def test_degrees_and_radians_are_not_mixed_up() -> None:
    table = write.press()
    small = {f"o{i}": 0.1 * np.ones(240) for i in range(3)}
    turned = {"form": "euler", "columns": ["o0", "o1", "o2"]}
    large = {key: 900.0 * values for key, values in small.items()}
    with pytest.raises(CurveError, match="they are likely degrees"):
        recording(table | large, orientation={**turned, "unit": "rad"})
    with pytest.raises(CurveError, match="so they may be radians"):
        recording(table | small, orientation={**turned, "unit": "deg"})
    plausible = {"small_angles": True}
    assert recording(table | small, orientation={**turned, "unit": "deg"}, plausible=plausible).n_rows == 240


def test_a_matrix_that_mirrors_or_is_no_turn_is_refused() -> None:
    table = write.press()
    columns = [f"o{i}" for i in range(9)]
    orientation = {"form": "rotation_matrix", "columns": columns}
    matrices = _q(table).as_matrix()
    for corrupt, message in (
        (matrices * [1.0, 1.0, -1.0], "the matrix mirrors"),
        (1.1 * matrices, "no rotation"),
    ):
        values = dict(zip(columns, corrupt.reshape(-1, 9).T.copy(), strict=True))
        with pytest.raises(CurveError, match=message):
            recording(table | values, orientation=orientation)


def test_a_map_is_checked_when_it_is_made() -> None:
    for wrong in (
        {"orientation": {"form": "euler", "columns": ["a", "b"]}},
        {"orientation": {"columns": []}},
        {"orientation": {"form": "euler", "columns": ["a", "b", "c"], "sequence": "xYz"}},
        {"force": {"columns": ["a", "b"]}},
        {"acts_on": "robot"},
        {"max_gap": 0.1},
        {"tip": ["1 mm"]},
        {"colour": "red"},
    ):
        with pytest.raises(ValidationError):
            write.channel_map(**wrong)
    with pytest.raises(CurveError, match=r"orientation\.value has length 2"):
        recording(write.press(), orientation={"form": "fixed", "value": [0.0, 0.0, 0.0, 2.0]})


# ----------------------------------------------------------------- common time


def _bag(wrench: write.Table, pose: write.Table) -> RawLog:
    def stream(name: str, table: write.Table, names: tuple[str, ...], targets: list[str]) -> Stream:
        columns = {"stamp": Column(name="stamp", values=table["time_s"], unit="s")}
        for source, target in zip(names, targets, strict=True):
            unit = {"N": "N", "Nm": "N m", "m": "m"}.get(source.rpartition("_")[2], "")
            columns[target] = Column(name=target, values=table[source], unit=unit)
        return Stream.of(columns.values(), name)

    channels = write.BAG_MAP
    pose_names = [*channels["position"]["columns"], *channels["orientation"]["columns"]]
    wrench_names = [*channels["force"]["columns"], *channels["moment"]["columns"]]
    streams = (
        stream("/wrench", wrench, write.COLUMNS[8:], wrench_names),
        stream("/pose", pose, write.COLUMNS[1:8], pose_names),
    )
    return RawLog(source="log.bag", format="ROS 1 bag", row_word="message", streams=streams)


def test_a_slower_pose_is_interpolated_to_the_times_of_the_wrench() -> None:
    whole = write.press()
    pose = {name: values[::7] for name, values in write.press().items()}
    reading = assemble(_bag(whole, pose), write.bag_map())
    found, expected = reading.recording, recording(whole)
    assert reading.record["interpolated"] == ["position", "orientation"]
    assert found.n_rows == 239, "the last time of the pose comes a row before that of the wrench"
    np.testing.assert_allclose(found.position_mm, expected.position_mm[:239], atol=0.2)
    overlap = np.einsum("ij,ij->i", found.quaternion, expected.quaternion[:239])
    assert np.degrees(2.0 * np.arccos(np.clip(np.abs(overlap), 0.0, 1.0))).max() < 0.1


def test_the_times_of_the_pose_may_be_kept_instead() -> None:
    pose = {name: values[::7] for name, values in write.press().items()}
    reading = assemble(_bag(write.press(), pose), write.bag_map(common_time="pose"))
    assert reading.record["interpolated"] == ["force", "moment"]
    np.testing.assert_array_equal(reading.recording.time_s, pose["time_s"])
    np.testing.assert_array_equal(reading.recording.force_N[:, 2], pose["fz_N"])


def test_clocks_that_differ_are_reported() -> None:
    pose = write.press()
    pose["time_s"] = pose["time_s"] + 100.0
    with pytest.raises(
        CurveError, match=r"hardly overlap in time \(force 0.000 to 1.195 s; position 100.000"
    ):
        assemble(_bag(write.press(), pose), write.bag_map())


def test_a_column_in_two_streams_needs_its_stream() -> None:
    log = _bag(write.press(), write.press())
    doubled = RawLog(
        source="log.bag",
        format="ROS 1 bag",
        row_word="message",
        streams=(*log.streams, replace(log.streams[0], name="/raw")),
    )
    with pytest.raises(CurveError, match=r"in several streams \(/wrench, /raw\)"):
        assemble(doubled, write.bag_map())
    for name in ("force", "moment"):
        chosen = {**write.BAG_MAP[name], "stream": "/raw"}
        other = {**write.BAG_MAP["moment" if name == "force" else "force"], "stream": "/wrench"}
        both = {name: chosen, ("moment" if name == "force" else "force"): other}
        assert assemble(doubled, write.bag_map(**both)).recording.n_rows == 240
