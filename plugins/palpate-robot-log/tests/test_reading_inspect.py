"""Inspection: what is in a log, and a map that reads it without a change."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.api.files import Column, TextFormat
from palpate.plugins.optional import Inspection
from palpate_indentation import CsvLoader, CsvSettings
from palpate_robot_log.reading import inspection
from palpate_robot_log.reading.assembly import Reading, read_recording
from palpate_robot_log.reading.channel_map import ChannelMap
from palpate_robot_log.reading.inspection import inspect_log
from palpate_robot_log.reading.names import words_of
from palpate_robot_log.reading.quantities import QUANTITIES
from palpate_robot_log.reading.raw import RawLog, Stream
from palpate_robot_log.reading.robots import proposal_of, propose

from . import log_writers as write


def proposed(table: dict[str, Any], **units: str) -> dict[str, Any]:
    columns = {key: Column(name=key, values=v, unit=units.get(key, "")) for key, v in table.items()}
    stream = Stream.of(columns.values())
    log = RawLog(source="log", format="text", row_word="line", streams=(stream,))
    proposal = proposal_of(log, propose(log))
    written = tomllib.loads(proposal.text("log"))["experiment"]
    assert written["loader"] == "robot_log"
    assert written["settings"] == proposal.settings
    return dict(proposal.settings["channels"])


def read_as_proposed(path: Path, found: Inspection) -> int:
    settings = tomllib.loads(found.study_text)["experiment"]["settings"]
    channels = ChannelMap.model_validate(settings["channels"])
    text = TextFormat.model_validate(settings.get("text", {}))
    return read_recording(path, channels, text).recording.n_rows


@pytest.mark.slow
def test_a_table_with_units_is_understood_whole(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    write.write_text(path, write.press(), ";", ",", head="made by hand\n")
    found = inspect_log(path)
    assert found.record["problem"] == ""
    side = {"acts_on": "tool", "wrench_frame": "sensor"}
    assert found.record["channels"] == dict(write.MAP) | side
    assert found.record["layout"] == {"delimiter": ";", "decimal": ",", "skip_lines": 1}
    (stream,) = found.record["streams"]
    assert stream["time"]["rate_hz"] == pytest.approx(200.0)
    assert stream["time"]["gaps"] == []
    z = next(column for column in stream["columns"] if column["name"] == "z_m")
    assert (z["unit"], z["taken_for"], z["n_missing"]) == ("m", "position", 0)
    assert z["largest"] == pytest.approx(0.304)
    assert read_as_proposed(path, found) == 240
    assert any("this map reads the file: 240 rows at 200 Hz" in finding for finding in found.findings)


def test_a_log_of_one_reading_is_assembled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    maps, assembled = [], inspection.assemble

    def counted(log: RawLog, channels: ChannelMap) -> Reading:
        maps.append(channels)
        return assembled(log, channels)

    monkeypatch.setattr(inspection, "assemble", counted)
    write.write_text(tmp_path / "log.csv", write.press())
    assert inspect_log(tmp_path / "log.csv").record["problem"] == ""
    assert len(maps) == 1


@pytest.mark.slow
def test_a_bag_is_understood_whole(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    pose = {name: values[::4] for name, values in write.press().items()}
    write.write_bag2(tmp_path / "log", write.press(), pose)
    found = inspect_log(tmp_path / "log")
    rates = {stream["name"]: stream["time"]["rate_hz"] for stream in found.record["streams"]}
    assert rates == {"/wrench": pytest.approx(200.0), "/tool/pose": pytest.approx(50.0)}
    assert found.record["channels"]["force"]["stream"] == "/wrench"
    assert found.record["channels"]["orientation"]["stream"] == "/tool/pose"
    assert read_as_proposed(tmp_path / "log", found) == 237


def test_gaps_and_repeats_are_listed_with_rows_and_time_stamps(tmp_path: Path) -> None:
    table = {name: np.delete(values, slice(50, 80)) for name, values in write.press().items()}
    table["time_s"][20] = table["time_s"][19]
    write.write_text(tmp_path / "log.csv", table)
    found = inspect_log(tmp_path / "log.csv")
    time = found.record["streams"][0]["time"]
    assert time["gaps"] == [{"row": 51, "time_s": 0.245, "seconds": pytest.approx(0.155)}]
    assert (time["n_repeated"], time["n_backwards"]) == (1, 0)
    text = "\n".join(found.findings)
    assert "no rows for 0.155 s after line 51 (t = 0.2450 s)" in text
    assert "1 rows repeat the time" in text
    assert "with these tables: " in text
    assert "the time of the row before once more" in found.record["problem"]


def test_missing_channels_are_reported_and_left_to_be_named(tmp_path: Path) -> None:
    table = write.press()
    kept = {name: table[name] for name in write.COLUMNS[:8]}
    write.write_text(tmp_path / "log.csv", kept)
    found = inspect_log(tmp_path / "log.csv")
    assert found.record["problem"] == "not found: force, moment; name their columns"
    assert '# force = { columns = ["…", "…", "…"] }' in found.study_text
    assert set(tomllib.loads(found.study_text)["experiment"]["settings"]["channels"]) == {
        "time",
        "position",
        "orientation",
        "acts_on",
        "wrench_frame",
    }


def test_the_file_of_a_place_alone_asks_for_what_a_log_has_besides(tmp_path: Path) -> None:
    table = write.press()
    write.write_text(tmp_path / "log.csv", {name: table[name] for name in write.COLUMNS[:4]})
    problem = inspect_log(tmp_path / "log.csv").record["problem"]
    assert problem == "not found: orientation, force, moment; name their columns"


# ------------------------------------------------------------------ names and guesses


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("actual_TCP_force_0", ("actual", "tcp", "force", "0")),
        ("wrench.torque.z", ("wrench", "torque", "z")),
        ("Fx [N]", ("fx",)),
        ("wrench(:,4)", ("wrench", "4")),
        ("quatW", ("quat", "w")),
        ("time_s", ("time",)),
    ],
)
def test_names_are_taken_apart(name: str, words: tuple[str, ...]) -> None:
    assert words_of(name) == words


def test_names_of_many_makers_are_understood() -> None:
    table = write.press()
    f, t, x, q = (
        [table[name] for name in write.COLUMNS[part]]
        for part in (slice(8, 11), slice(11, 14), slice(1, 4), slice(4, 8))
    )

    def named(pattern: str, values: list[Any], keys: str = "xyzw") -> dict[str, Any]:
        return {pattern.format(key): value for key, value in zip(keys, values, strict=False)}

    makers = {
        "universal robots": named("actual_TCP_pose_{}", [*x, *[0.3 * v for v in q[:3]]], "012345")
        | named("target_TCP_pose_{}", [*x, *q[:3]], "012345")
        | named("actual_TCP_force_{}", [*f, *t], "012345")
        | {"timestamp": table["time_s"]},
        "words": named("position.{}", x)
        | named("orientation.{}", q)
        | named("force.{}", f)
        | named("torque.{}", t)
        | {"t": 1e3 * table["time_s"]},
        "german": named("Pos_{}", x)
        | named("quat{}", q, "XYZW")
        | named("Kraft {}", f)
        | named("Drehmoment {}", t)
        | {"Zeit": table["time_s"]},
    }
    for maker, columns in makers.items():
        found = proposed(columns)
        assert {*found} - {"acts_on", "wrench_frame"} == {"time", *QUANTITIES}, maker
        assert found["position"]["unit"] == "m", maker
        assert found["force"]["unit"] == "N", maker
        assert found["moment"]["unit"] == "N m", maker
        assert "target" not in str(found), maker
    assert proposed(makers["words"])["time"] == {"column": "t", "unit": "ms"}
    assert proposed(makers["universal robots"])["orientation"]["form"] == "axis_angle"


def test_millimetres_and_newton_millimetres_are_distinguished_by_size() -> None:
    table = write.press()
    columns = {name.rpartition("_")[0] or name: values for name, values in table.items()}
    for name in "xyz":
        columns[name] = 1e3 * columns[name]
        columns[f"t{name}"] = 1e3 * columns[f"t{name}"]
    found = proposed(columns)
    assert found["position"]["unit"] == "mm"
    assert found["moment"]["unit"] == "N·mm"


def test_a_matrix_of_turns_is_known_by_its_numbers() -> None:
    from scipy.spatial.transform import Rotation

    matrices = Rotation.random(50, rng=np.random.default_rng(1)).as_matrix().reshape(-1, 9)
    found = proposed({"t": np.arange(50.0), **{f"m_{i}": matrices[:, i] for i in range(9)}})
    assert found["orientation"]["form"] == "rotation_matrix"
    assert "orientation" not in proposed({"t": np.arange(50.0), **{f"m_{i}": np.ones(50) for i in range(9)}})


def test_nothing_is_proposed_out_of_nothing() -> None:
    assert proposed({"a": np.zeros(9), "b": np.ones(9)}).keys() == {"acts_on", "wrench_frame"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("header", "settings"),
    [
        (
            "depth_mm,angle_deg,force_N,torque_Nmm",
            {
                "channels": {
                    "force": {"abscissa": "depth_mm", "ordinate": "force_N"},
                    "torque": {"abscissa": "angle_deg", "ordinate": "torque_Nmm"},
                }
            },
        ),
        ("depth_mm,force_N", {"channels": {"force": {"abscissa": "depth_mm", "ordinate": "force_N"}}}),
        (
            "Depth [m];Load (kN);Twist [rad];Torque_N_m",
            {
                "channels": {
                    "force": {
                        "abscissa": {"name": "Depth [m]", "scale": 1000.0},
                        "ordinate": {"name": "Load (kN)", "scale": 1000.0},
                    },
                    "torque": {
                        "abscissa": {"name": "Twist [rad]", "scale": 57.2957795131},
                        "ordinate": {"name": "Torque_N_m", "scale": 1000.0},
                    },
                }
            },
        ),
    ],
)
def test_curves_that_are_processed_already_are_for_the_loader_csv(
    tmp_path: Path, header: str, settings: dict[str, Any]
) -> None:
    path, cell = tmp_path / "curves.csv", ";" if ";" in header else ","
    width = header.count(cell) + 1
    path.write_text("\n".join([header, *(cell.join([str(k * k / 1000)] * width) for k in range(30))]) + "\n")
    found = inspect_log(path)
    assert any("processed curves and no log" in finding for finding in found.findings)
    table = tomllib.loads(found.study_text)["experiment"]
    assert (table["loader"], table.get("settings", {})) == ("csv", settings)
    curves = CsvLoader(CsvSettings.model_validate(settings)).load(path)
    assert list(curves) == list(settings["channels"])


def test_a_log_with_a_column_of_depth_stays_a_log(tmp_path: Path) -> None:
    table = write.press(30)
    write.write_text(tmp_path / "log.csv", table | {"depth_mm": np.linspace(0.0, 5.0, 30)})
    assert 'loader = "robot_log"' in inspect_log(tmp_path / "log.csv").study_text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("header", "settings"),
    [
        (
            "stretch,stress_MPa",
            {"channels": {"uniaxial": {"abscissa": "stretch", "ordinate": "stress_MPa"}}},
        ),
        (
            "strain,stress_kPa",
            {
                "channels": {
                    "uniaxial": {
                        "abscissa": {"name": "strain", "offset": 1.0},
                        "ordinate": {"name": "stress_kPa", "scale": 0.001},
                    }
                }
            },
        ),
    ],
)
def test_a_homogeneous_test_is_for_the_loader_csv(
    tmp_path: Path, header: str, settings: dict[str, Any]
) -> None:
    path, at_rest = tmp_path / "pull.csv", int(header.startswith("stretch"))
    path.write_text(header + "\n" + "".join(f"{at_rest + k / 10},{k}\n" for k in range(30)))
    found = inspect_log(path)
    assert 'measured = { uniaxial = "pull.csv" }' in found.study_text
    table = tomllib.loads(found.study_text)["experiment"]
    assert (table["loader"], table.get("settings", {})) == ("csv", settings)
    assert list(CsvLoader(CsvSettings.model_validate(settings)).load(path, "uniaxial")) == ["uniaxial"]
    path.write_text("stretch,stress\n" + "".join(f"{1 + k / 10},{k}\n" for k in range(30)))
    found = inspect_log(path)
    assert "experiment" not in tomllib.loads(found.study_text)
    assert "stress shows no unit of stress: give scale" in found.record["problem"]


def test_a_robots_log_is_understood_by_the_loader_that_ships(call, tmp_path):
    write.write_text(tmp_path / "log.csv", write.press())
    found = call("experiment", "inspect", "log.csv", "--json", plugin=None).json
    assert found["channels"] == dict(write.MAP) | {"acts_on": "tool", "wrench_frame": "sensor"}
    assert found["problem"] == ""
    assert 'loader = "robot_log"' in found["study_toml"]
