"""The same press out of every format: the numbers are the same, and damage is reported."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.errors import CurveError
from palpate_robot_log.reading.assembly import assemble, columns_of, read_recording
from palpate_robot_log.reading.channel_map import ChannelMap
from palpate_robot_log.reading.formats import read_here, read_log
from palpate_robot_log.recording import Recording

from . import log_writers as write

Writer = Callable[[Path, write.Table], None]

pytest.importorskip("h5py")
pytest.importorskip("rosbags")


def _bag1(compression: str) -> Writer:
    return lambda path, table: write.write_bag1(path, table, compression=compression)


def _bag2(storage: str, compression: str) -> Writer:
    return lambda path, table: write.write_bag2(path, table, storage=storage, compression=compression)


def _prefixed(before: str) -> ChannelMap:
    plain: dict[str, Any] = {}
    for key, value in write.MAP.items():
        plain[key] = (
            before + value
            if isinstance(value, str)
            else {"columns": [before + name for name in value["columns"]]}
        )
    return ChannelMap.model_validate(plain)


FORMATS: dict[str, tuple[str, Writer, ChannelMap]] = {
    "csv": ("log.csv", write.write_text, write.channel_map()),
    "semicolons and decimal commas": (
        "log.txt",
        lambda path, table: write.write_text(path, table, ";", ","),
        write.channel_map(),
    ),
    "tabs after a preamble": (
        "log.tsv",
        lambda path, table: write.write_text(path, table, "\t", ".", "Robot log\nrate;200 Hz\n# run 3\n"),
        write.channel_map(),
    ),
    "parquet": ("log.parquet", write.write_parquet, write.channel_map()),
    "npz": ("log.npz", write.write_npz, write.channel_map()),
    "npy": ("log.npy", write.write_npy, _prefixed("array.")),
    "matlab 5": ("log.mat", write.write_matlab5, _prefixed("log.")),
    "matlab 5 uncompressed": (
        "log.mat",
        lambda path, table: write.write_matlab5(path, table, compressed=False),
        _prefixed("log."),
    ),
    "matlab 7.3": ("log.mat", write.write_matlab73, _prefixed("log.")),
    "hdf5": ("log.h5", write.write_hdf5, _prefixed("log.")),
    "ros 1": ("log.bag", _bag1(""), write.bag_map()),
    "ros 1 bz2": ("log.bag", _bag1("BZ2"), write.bag_map()),
    "ros 1 lz4": ("log.bag", _bag1("LZ4"), write.bag_map()),
    "ros 2 sqlite": ("log", _bag2("SQLITE3", ""), write.bag_map()),
    "ros 2 mcap": ("log", _bag2("MCAP", ""), write.bag_map()),
    "ros 2 mcap in zstd": ("log", _bag2("MCAP", "STORAGE"), write.bag_map()),
    "ros 2 messages in zstd": ("log", _bag2("SQLITE3", "MESSAGE"), write.bag_map()),
}


def recording_of(path: Path, channels: ChannelMap) -> Recording:
    return assemble(read_here(path, columns=columns_of(channels)), channels).recording


def assert_is_press(recording: Recording, table: write.Table) -> None:
    np.testing.assert_allclose(recording.time_s - recording.time_s[0], table["time_s"], atol=2e-9)
    for index, axis in enumerate("xyz"):
        np.testing.assert_allclose(recording.position_mm[:, index], 1e3 * table[f"{axis}_m"], rtol=1e-13)
        np.testing.assert_allclose(recording.force_N[:, index], table[f"f{axis}_N"], rtol=1e-13)
        np.testing.assert_allclose(recording.moment_Nmm[:, index], 1e3 * table[f"t{axis}_Nm"], rtol=1e-13)
    q = np.column_stack([table[f"q{axis}"] for axis in "xyzw"])
    np.testing.assert_allclose(recording.quaternion, q, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "writer", "channels"), FORMATS.values(), ids=FORMATS.keys())
def test_every_format_gives_the_same_recording(
    tmp_path: Path, name: str, writer: Writer, channels: ChannelMap
) -> None:
    table = write.press()
    writer(tmp_path / name, table)
    assert_is_press(recording_of(tmp_path / name, channels), table)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["csv", "parquet", "matlab 5", "matlab 7.3", "ros 1 lz4", "ros 2 mcap"])
def test_a_subprocess_gives_the_same(tmp_path: Path, kind: str) -> None:
    name, writer, channels = FORMATS[kind]
    table = write.press()
    writer(tmp_path / name, table)
    reading = read_recording(tmp_path / name, channels)
    assert_is_press(reading.recording, table)
    assert reading.record["n_rows"] == 240
    assert reading.recording.source == str(tmp_path / name)


def test_a_bag_whose_files_are_compressed_is_unpacked_out_of_sight(tmp_path: Path) -> None:
    table = write.press()
    write.write_bag2(tmp_path / "log", table, storage="SQLITE3", compression="FILE")
    before = sorted(tmp_path.rglob("*"))
    assert_is_press(read_recording(tmp_path / "log", write.bag_map()).recording, table)
    assert sorted(tmp_path.rglob("*")) == before


def test_rows_are_lines_of_text_and_messages_of_a_bag(tmp_path: Path) -> None:
    table = write.press()
    write.write_text(tmp_path / "log.csv", table, head="# comment\n\n")
    rows = recording_of(tmp_path / "log.csv", write.channel_map()).rows
    np.testing.assert_array_equal(rows[[0, 1, -1]], [4, 5, 243])
    write.write_bag1(tmp_path / "log.bag", table)
    rows = recording_of(tmp_path / "log.bag", write.bag_map()).rows
    np.testing.assert_array_equal(rows[:3], [0, 2, 4])


def test_a_wrong_file_ending_changes_nothing(tmp_path: Path) -> None:
    table = write.press()
    write.write_parquet(tmp_path / "log.csv", table)
    assert_is_press(recording_of(tmp_path / "log.csv", write.channel_map()), table)


def test_matrices_of_matlab_have_columns_by_number(tmp_path: Path) -> None:
    from scipy.io import savemat

    table = write.press()
    wrench = np.column_stack([table[name] for name in write.COLUMNS[8:]])
    pose = np.column_stack([table[name] for name in write.COLUMNS[1:8]])
    savemat(tmp_path / "log.mat", {"t_s": table["time_s"], "wrench": wrench, "pose": pose.T, "who": "me"})
    channels = write.channel_map(
        time="t_s",
        position={"columns": [f"pose(:,{i})" for i in (1, 2, 3)], "unit": "m"},
        orientation={"columns": [f"pose(:,{i})" for i in (4, 5, 6, 7)]},
        force={"columns": [f"wrench(:,{i})" for i in (1, 2, 3)], "unit": "N"},
        moment={"columns": [f"wrench(:,{i})" for i in (4, 5, 6)], "unit": "N*m"},
    )
    assert_is_press(recording_of(tmp_path / "log.mat", channels), table)


def test_arrays_of_two_lengths_are_two_streams(tmp_path: Path) -> None:
    wrench, pose = write.press(), write.press(121, 100.0)
    arrays = {f"w_{name}": wrench[name] for name in ("time_s", *write.COLUMNS[8:])}
    arrays |= {f"p_{name}": pose[name] for name in write.COLUMNS[:8]}
    np.savez(tmp_path / "log.npz", **arrays)  # type: ignore[arg-type]
    log = read_here(tmp_path / "log.npz")
    assert [(stream.name, stream.rows.size) for stream in log.streams] == [
        ("240 rows", 240),
        ("121 rows", 121),
    ]
    channels = write.channel_map(
        time="w_time_s",
        position={"columns": [f"p_{a}_m" for a in "xyz"], "time": "p_time_s"},
        orientation={"columns": [f"p_q{a}" for a in "xyzw"], "time": "p_time_s"},
        force={"columns": [f"w_f{a}_N" for a in "xyz"]},
        moment={"columns": [f"w_t{a}_Nm" for a in "xyz"]},
    )
    reading = assemble(log, channels)
    assert reading.record["interpolated"] == ["position", "orientation"]
    np.testing.assert_allclose(reading.recording.position_mm[:, 2], 1e3 * wrench["z_m"], atol=0.06)


def test_lists_and_time_stamps_in_parquet(tmp_path: Path) -> None:
    import polars as pl

    table = write.press()
    start = np.datetime64("2030-01-01T12:00:00", "ns")
    stamps = start + (table["time_s"] * 1e9).round().astype("timedelta64[ns]")
    force = np.column_stack([table[f"f{a}_N"] for a in "xyz"])
    frame = pl.DataFrame({**table, "stamp": stamps, "force_N": force.tolist(), "who": ["me"] * 240})
    frame.write_parquet(tmp_path / "log.parquet")
    channels = write.channel_map(
        time="stamp", force={"columns": [f"force_N[{i}]" for i in range(3)], "unit": "N"}
    )
    assert_is_press(recording_of(tmp_path / "log.parquet", channels), table)
    notes = read_here(tmp_path / "log.parquet").notes
    assert notes == ("columns passed over: who (String)",)


@pytest.mark.parametrize("start", ["2030-01-31T23:59:50", "2030-01-31 23:59:50", "23:59:50"])
def test_dates_and_times_of_day_in_text_are_seconds(tmp_path: Path, start: str) -> None:
    table = {name: values[:199] for name, values in write.press().items()}
    path = tmp_path / "log.csv"
    write.write_text(path, table)
    head, *rows = path.read_text().splitlines()
    stamps = [f"{start}.{round(1e3 * time_s):03d}" for time_s in table["time_s"]]
    rows = [f"{stamp},{row.partition(',')[2]}" for stamp, row in zip(stamps, rows, strict=True)]
    path.write_text("\n".join([head, *rows]))
    found = recording_of(path, write.channel_map(time={"column": "time_s", "unit": "s"}))
    # A date is kept to a quarter of a microsecond.
    np.testing.assert_allclose(found.time_s, table["time_s"], atol=3e-7)


def test_transforms_are_distinguished_by_their_frames(tmp_path: Path) -> None:
    path = write.write_transforms(tmp_path / "log", {"/tf": [("base", "tool"), ("base", "camera")]})
    log = read_here(path)
    assert [stream.name for stream in log.streams] == ["/tf base>tool", "/tf base>camera"]
    camera = log.stream("/tf base>camera").columns
    np.testing.assert_array_equal(camera["transform.translation.y"].values, 2.0)
    np.testing.assert_array_equal(camera["transform.translation.x"].values, np.arange(30.0))
    np.testing.assert_allclose(camera["stamp"].values, 5.0 + 1e-3 * np.arange(30), atol=1e-9)


# ---------------------------------------------------------------------- damage


@pytest.mark.parametrize(
    "kind", ["parquet", "npz", "npy", "matlab 5", "matlab 5 uncompressed", "matlab 7.3", "ros 1", "ros 1 lz4"]
)
@pytest.mark.parametrize("share", [0.98, 0.6, 0.1])
def test_a_file_that_is_cut_off_is_an_error(tmp_path: Path, kind: str, share: float) -> None:
    name, writer, _ = FORMATS[kind]
    path = tmp_path / name
    writer(path, write.press())
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(CurveError, match="damaged"):
        read_here(path)


@pytest.mark.parametrize(("storage", "ending"), [("SQLITE3", "db3"), ("MCAP", "mcap")])
@pytest.mark.parametrize("share", [0.98, 0.5, 0.01])
def test_a_ros_2_bag_that_is_cut_off_is_an_error(
    tmp_path: Path, storage: str, ending: str, share: float
) -> None:
    write.write_bag2(tmp_path / "log", write.press(), storage=storage)
    (path,) = (tmp_path / "log").glob(f"*.{ending}")
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    for given in (tmp_path / "log", path):
        with pytest.raises(CurveError, match="damaged or cut off"):
            read_here(given)


def test_a_bag_that_was_not_closed_is_an_error(tmp_path: Path) -> None:
    write.write_bag2(tmp_path / "log", write.press(60))
    (tmp_path / "log" / "log.db3-wal").write_bytes(b"rows that never reached the file")
    with pytest.raises(CurveError, match="the recording was not closed"):
        read_here(tmp_path / "log")


def test_a_topic_of_another_type_is_named(tmp_path: Path) -> None:
    write.write_bag1(tmp_path / "log.bag", write.press(60))
    with pytest.raises(CurveError, match=r"no topic /ft .*topics there: /wrench \(geometry_msgs"):
        read_here(tmp_path / "log.bag", streams=("/ft",))


BINARY = {
    "gzip": (b"\x1f\x8b\x08", "compressed by gzip; unpack it first"),
    "pickle": (b"\x80\x05\x95", "is a pickle, which could run code"),
    "spreadsheet": (b"\xd0\xcf\x11\xe0", "save the table as CSV"),
    "zip of something": (b"PK\x03\x04" + bytes(40), "damaged, cut off"),
}


@pytest.mark.parametrize(("content", "message"), BINARY.values(), ids=BINARY.keys())
def test_other_kinds_of_files_are_named(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "log.dat").write_bytes(content)
    with pytest.raises(CurveError, match=message):
        read_here(tmp_path / "log.dat")


def test_text_under_a_binary_ending_is_reported(tmp_path: Path) -> None:
    (tmp_path / "log.mat").write_text("time_s,x\n0,1\n")
    with pytest.raises(CurveError, match=r"the \.mat file is damaged"):
        read_here(tmp_path / "log.mat")


def test_what_is_not_there_is_reported(tmp_path: Path) -> None:
    with pytest.raises(CurveError, match=r"gone\.csv: cannot be read \(No such file"):
        read_log(tmp_path / "gone.csv")
    with pytest.raises(CurveError, match="a folder without metadata"):
        read_log(tmp_path)


@pytest.mark.parametrize("holds", ["numbers", "a structure", "a cell", "nothing"])
def test_a_cell_array_of_anything_hides_no_numbers(tmp_path: Path, holds: str) -> None:
    import h5py

    path = tmp_path / "log.mat"
    write.write_matlab73(path, write.press(30))
    whole = [[*stream.columns] for stream in read_here(path).streams]
    with h5py.File(path, "r+") as file:
        number = file.create_dataset("#refs#/a", data=np.array([[1.5]]))
        file["#refs#/b/x"] = np.array([[1.5]])
        inner = file.create_dataset("#refs#/c", data=np.array([[number.ref]], dtype=h5py.ref_dtype))
        refs = {"numbers": number.ref, "a structure": file["#refs#/b"].ref, "a cell": inner.ref}
        cell = np.array([[refs.get(holds, h5py.Reference())]], dtype=h5py.ref_dtype)
        file.create_dataset("settings", data=cell).attrs["MATLAB_class"] = np.bytes_("cell")
    assert [[*stream.columns] for stream in read_here(path).streams] == whole


@pytest.mark.parametrize(("module", "kind"), [("h5py", "matlab"), ("rosbags", "ros")])
def test_a_package_that_is_missing_is_named_with_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, kind: str
) -> None:
    import sys

    write.write_matlab73(tmp_path / "matlab.mat", write.press(30))
    write.write_bag1(tmp_path / "ros.bag", write.press(30))
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(CurveError, match=rf"pip install 'palpate-robot-log\[{kind}\]'"):
        read_here(next(tmp_path.glob(f"{kind}.*")))
