"""LabVIEW's TDMS, written by npTDMS: every channel comes back, and what cannot be read is named."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from palpate.errors import CurveError
from palpate_robot_log.reading.assembly import assemble, columns_of
from palpate_robot_log.reading.channel_map import ChannelMap
from palpate_robot_log.reading.formats import read_here

from . import log_writers as write

try:
    import nptdms
except ImportError:
    nptdms = None

needs_nptdms = pytest.mark.skipif(nptdms is None, reason="npTDMS is not installed: the extra 'tdms'")
numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)


def write_tdms(path: Path, groups: dict[str, dict[str, Any]], **properties: Any) -> None:
    with nptdms.TdmsWriter(path) as writer:
        for group, channels in groups.items():
            objects = [
                nptdms.ChannelObject(group, name, values, properties=properties)
                for name, values in channels.items()
            ]
            writer.write_segment(objects)


@needs_nptdms
def test_a_press_comes_back_as_from_other_formats(tmp_path: Path) -> None:
    table = write.press()
    write_tdms(tmp_path / "log.tdms", {"press": table})
    channels = ChannelMap.model_validate(dict(write.MAP))
    recording = assemble(read_here(tmp_path / "log.tdms", columns=columns_of(channels)), channels).recording
    np.testing.assert_allclose(recording.time_s - recording.time_s[0], table["time_s"], atol=2e-9)
    np.testing.assert_array_equal(recording.force_N[:, 2], table["fz_N"])
    np.testing.assert_allclose(recording.position_mm[:, 0], 1e3 * table["x_m"], rtol=1e-13)


@needs_nptdms
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.dictionaries(
        st.text("abcxyz '/_", min_size=1, max_size=6),
        st.lists(numbers, min_size=2, max_size=5),
        min_size=1,
        max_size=4,
    )
)
def test_every_channel_of_numbers_is_read_to_the_bit(tmp_path: Path, table: dict[str, list[float]]) -> None:
    path = tmp_path / "any.tdms"
    write_tdms(path, {"group": {name: np.array(values) for name, values in table.items()}})
    log = read_here(path)
    assert len(log.streams) == len({len(values) for values in table.values()})
    found = {
        name: column.values.tolist() for stream in log.streams for name, column in stream.columns.items()
    }
    assert found == table


@needs_nptdms
def test_waveforms_have_a_time_and_units(tmp_path: Path) -> None:
    path = tmp_path / "log.tdms"
    groups = {"load": {"Fz": np.arange(5.0)}, "probe": {"z": np.arange(3.0), "label": ["a", "b", "c"]}}
    write_tdms(path, groups, wf_increment=0.25, wf_start_offset=1.0, unit_string="N")
    log = read_here(path)
    assert [stream.name for stream in log.streams] == ["load", "probe"]
    load = log.stream("load").columns
    assert (load["Fz"].unit, load["time"].unit) == ("N", "s")
    np.testing.assert_array_equal(load["time"].values, [1.0, 1.25, 1.5, 1.75, 2.0])
    assert log.notes == ("channels without numbers: probe.label",)


@needs_nptdms
def test_time_stamps_are_seconds_since_the_first(tmp_path: Path) -> None:
    stamps = np.array(["2018-06-01T10:00:00.5", "2018-06-01T10:00:02"], dtype="datetime64[us]")
    write_tdms(tmp_path / "log.tdms", {"load": {"when": stamps, "Fz": np.arange(2.0)}})
    columns = read_here(tmp_path / "log.tdms").streams[0].columns
    np.testing.assert_allclose(columns["when"].values, [0.0, 1.5], atol=1e-6)
    assert columns["when"].unit == "s"


@needs_nptdms
@given(st.floats(0.0, 100.0), st.integers(0, 10**6))
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_streams_of_one_file_have_one_clock(tmp_path: Path, lag: float, later_us: int) -> None:
    """Of time stamps and of waveforms that start at a time, whichever comes first."""
    path, start = tmp_path / "log.tdms", np.datetime64("2018-06-01T10:00:00", "us")
    later = start + np.timedelta64(later_us, "us")
    waveform = {"wf_increment": 0.5, "wf_start_time": start, "wf_start_offset": lag}
    with nptdms.TdmsWriter(path) as writer:
        stamps = later + np.array([0, 1_500_000], dtype="timedelta64[us]")
        writer.write_segment(
            [
                nptdms.ChannelObject("probe", "when", stamps),
                nptdms.ChannelObject("load", "Fz", np.arange(3.0), properties=waveform),
                nptdms.ChannelObject(
                    "late", "Fz", np.arange(3.0), properties=waveform | {"wf_start_time": later}
                ),
                nptdms.ChannelObject("unset", "Fz", np.arange(3.0), properties={"wf_increment": 0.5}),
            ]
        )
    log, after = read_here(path), 1e-6 * later_us
    for stream, column, seconds in (
        ("probe", "when", [after, after + 1.5]),
        ("load", "time", [lag, lag + 0.5, lag + 1.0]),
        ("late", "time", [lag + after, lag + after + 0.5, lag + after + 1.0]),
        ("unset", "time", [0.0, 0.5, 1.0]),
    ):
        np.testing.assert_allclose(log.stream(stream).columns[column].values, seconds, atol=2e-6)


@needs_nptdms
@pytest.mark.parametrize(
    ("changed", "names"),
    [
        ({"wf_increment": 0.25}, ["load, 3 rows, every 0.5 s", "load, 3 rows, every 0.25 s"]),
        (
            {"wf_start_offset": 2.0},
            ["load, 3 rows, every 0.5 s, from 0.0 s", "load, 3 rows, every 0.5 s, from 2.0 s"],
        ),
    ],
)
def test_streams_of_one_length_have_names_of_their_own(
    tmp_path: Path, changed: dict[str, float], names: list[str]
) -> None:
    path, waveform = tmp_path / "log.tdms", {"wf_increment": 0.5, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("load", name, np.arange(3.0), properties=given)
                for name, given in (("Fz", waveform), ("z", waveform | changed))
            ]
        )
    assert [stream.name for stream in read_here(path).streams] == names


@needs_nptdms
@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, share: float) -> None:
    path = tmp_path / "log.tdms"
    write_tdms(path, {"press": write.press(20)})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(CurveError, match=r"log\.tdms: (the TDMS file is (damaged or )?cut off|no channels)"):
        read_here(path)


def test_an_index_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.tdms_index").write_bytes(b"TDSh" + bytes(60))
    with pytest.raises(CurveError, match=r"give the \.tdms file itself"):
        read_here(tmp_path / "log.tdms_index")


def test_without_nptdms_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "log.tdms").write_bytes(b"TDSm" + bytes(60))
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(CurveError, match=r"pip install 'palpate-robot-log\[tdms\]'"):
        read_here(tmp_path / "log.tdms")
