"""A log that is wrong is named with row, time stamp, column and remedy; never read as if it were right."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.api.files import Column
from palpate.errors import CurveError
from palpate_robot_log.reading.assembly import Reading, assemble, columns_of
from palpate_robot_log.reading.formats import read_here
from palpate_robot_log.reading.raw import RawLog, Stream

from . import log_writers as write

Damage = Callable[[write.Table], None]


def log_of(table: write.Table, name: str = "log.csv") -> RawLog:
    n_rows = table["time_s"].size
    columns = {key: Column(name=key, values=values) for key, values in table.items()}
    stream = Stream.of(columns.values(), rows=np.arange(2, n_rows + 2))
    return RawLog(source=name, format="delimited text", row_word="line", streams=(stream,))


def reading(table: write.Table, **changes: Any) -> Reading:
    return assemble(log_of(table), write.channel_map(**changes))


def _set(name: str, rows: slice, value: float | None) -> Damage:
    def damage(table: write.Table) -> None:
        table[name][rows] = table[name][rows.start] if value is None else value

    return damage


def _times(factor: float, *names: str) -> Damage:
    def damage(table: write.Table) -> None:
        for name in names:
            table[name] = factor * table[name]

    return damage


def _drop(rows: slice) -> Damage:
    def damage(table: write.Table) -> None:
        for name in table:
            table[name] = np.delete(table[name], rows)

    return damage


def _stick(table: write.Table) -> None:
    for name in write.COLUMNS[8:]:
        table[name][100:170] = table[name][100]


def _clip(table: write.Table) -> None:
    table["fz_N"] = np.maximum(table["fz_N"], -6.0)


def _freeze(table: write.Table) -> None:
    for name in write.COLUMNS[1:4]:
        table[name][100:170] = table[name][100]


X, F, T = ("x_m", "y_m", "z_m"), ("fx_N", "fy_N", "fz_N"), ("tx_Nm", "ty_Nm", "tz_Nm")
BAD: dict[str, tuple[Damage, str]] = {
    "time repeats": (
        _set("time_s", slice(40, 42), None),
        r"line 43 \(t = 0.2000 s\), .*the time of the row before once more \(1 such rows.*keep_first",
    ),
    "time goes back": (
        _set("time_s", slice(40, 41), 0.1),
        r"line 42 \(t = 0.1000 s\), .*time goes back, to 0.1000 s from 0.1950 s \(1 times",
    ),
    "gap": (
        _drop(slice(50, 80)),
        r"line 51 \(t = 0.2450 s\), .*no rows for 0.1550 s from here to line 52 \(t = 0.4000 s\).*max_gap",
    ),
    "milliseconds": (_times(1e3, "time_s"), "rows are 5 s apart with time in s.*correct the unit of time"),
    "no number": (
        _set("fy_N", slice(7, 9), np.nan),
        r"line 9 \(t = 0.0350 s\), column 'fy_N': no value \(NaN or empty\), as in 2 rows.*skip",
    ),
    "infinite": (_set("qx", slice(3, 4), np.inf), "line 5 .*column 'qx': no value"),
    "no time": (_set("time_s", slice(3, 4), np.nan), "line 5 .*column 'time_s': no value"),
    "millimetres": (_times(1e3, *X), "the tip moves 1.2.* mm in all with columns in m.*1000 times smaller"),
    "nanometres": (_times(1e-6, *X), "the tip moves 1.2.*e-05 mm in all"),
    "far away": (
        lambda table: table.update(x_m=table["x_m"] + 1e3),
        r"line \d+ .*the tip is 1e\+06 mm from the base",
    ),
    "millinewtons": (_times(1e3, *F), "it varies by 9.* N with columns in N.*1000 times smaller"),
    "kilonewtons": (_times(1e-3, *F), "it varies by 0.00.* N .*1000 times larger"),
    "newton millimetres": (_times(1e3, *T), "is a lever of 3.* mm, plausible is 0.02 to 1500"),
    "tiny moments": (_times(1e-4, *T), "is a lever of 0.000.* mm"),
    "dead axis": (_set("ty_Nm", slice(0, 240), 0.001), "column .ty_Nm.: 1 in every row: the axis is dead"),
    "stuck": (
        _stick,
        r"line 102 \(t = 0.5000 s\), force: the same to the last digit .* for 0.345 s, until line 171",
    ),
    "one axis stuck": (
        _set("ty_Nm", slice(100, 170), None),
        r"line 102 \(t = 0.5000 s\), moment, column 'ty_Nm': .* for 0.345 s, until line 171 .*axis is stuck",
    ),
    "saturated": (_clip, r"column 'fz_N': -6 in \d+ rows on end, until line .*and never beyond: .*saturated"),
    "frozen pose": (
        _freeze,
        r"line 102 .*the pose does not change for 0.345 s and then jumps by 4.* mm at line 172",
    ),
    "pose that jumps": (
        lambda table: table["x_m"].__setitem__(slice(120, None), table["x_m"][120:] + 0.04),
        r"line 122 .*the tip jumps by 40 mm within one step.*log the press again",
    ),
    "tool at rest": (
        lambda table: table.update({n: np.random.default_rng(0).normal(0.4, 1e-6, 240) for n in X}),
        r"as by noise: the tool rests in all rows; log a press",
    ),
    "no unit quaternion": (
        _set("qw", slice(20, 30), 0.9),
        r"line 22 .*the quaternion has length 1\.\d+ and not 1, as in 10 rows",
    ),
    "zero quaternion": (
        lambda table: table.update({f"q{a}": np.r_[0.0, table[f"q{a}"][1:]] for a in "xyzw"}),
        "line 2 .*the quaternion has length 0.0000",
    ),
    "too short": (_drop(slice(10, 240)), "10 rows with values where a press needs at least 20"),
}


@pytest.mark.parametrize(("damage", "message"), BAD.values(), ids=BAD.keys())
def test_what_is_wrong_is_named(damage: Damage, message: str) -> None:
    table = write.press()
    assert reading(table).recording.n_rows == 240
    damage(table)
    with pytest.raises(CurveError, match=message) as caught:
        reading(table)
    assert str(caught.value).startswith("log.csv: ")
    assert "; " in str(caught.value) or ": " in str(caught.value), "a remedy follows"


# -------------------------------------------------- what is right, though it looks wrong


def test_a_coarse_sensor_is_neither_stuck_nor_saturated() -> None:
    table = write.press()
    for name in write.COLUMNS[8:11]:
        table[name] = np.round(table[name] / 0.1) * 0.1
    assert reading(table).recording.n_rows == 240


@pytest.mark.parametrize("n_rows", [2, 5])
def test_a_wrench_that_is_repeated_is_read_when_it_is_new(n_rows: int) -> None:
    table = write.press()
    whole = reading(table).recording
    for name in write.COLUMNS[8:]:
        table[name] = np.repeat(table[name][::n_rows], n_rows)
    found = reading(table).recording
    np.testing.assert_array_equal(found.rows, whole.rows[::n_rows])
    np.testing.assert_allclose(found.force_N, whole.force_N[::n_rows])
    np.testing.assert_allclose(found.position_mm, whole.position_mm[::n_rows])


def test_a_robot_at_rest_may_repeat_its_pose() -> None:
    table = write.press()
    for name in write.COLUMNS[1:8]:
        table[name][170:] = table[name][170]
    assert reading(table).recording.n_rows == 240


# ------------------------------------------------------------- settings that allow it


def test_rows_without_a_value_can_be_interpolated() -> None:
    table = write.press()
    whole = reading(table).recording
    table["z_m"][50:53] = np.nan
    table["fx_N"][100] = np.nan
    found = reading(table, missing="skip")
    assert found.recording.n_rows == 239
    assert set(found.record["interpolated"]) == {"position", "orientation", "moment"}  # type: ignore[arg-type]
    np.testing.assert_allclose(found.recording.position_mm[50:53], whole.position_mm[50:53], atol=0.02)
    np.testing.assert_array_equal(found.recording.rows[[99, 100]], [101, 103])


def test_repeated_rows_can_be_left_out() -> None:
    table = write.press()
    table["time_s"][40] = table["time_s"][39]
    found = reading(table, repeated_time="keep_first").recording
    assert found.n_rows == 239
    assert 42 not in found.rows


def test_bounds_can_be_widened() -> None:
    table = write.press()
    _drop(slice(50, 80))(table)
    assert reading(table, max_gap="0.2 s").recording.n_rows == 210
    table = write.press()
    _stick(table)
    assert reading(table, stuck="1 s").recording.n_rows == 240


def test_the_sensors_range_is_respected() -> None:
    table = write.press()
    with pytest.raises(
        CurveError, match=r"column 'fz_N': -9.* reaches the sensor's range of 9 \(force_limit"
    ):
        reading(table, force_limit="9 N")
    with pytest.raises(CurveError, match=r"reaches the sensor's range of 10 \(moment_limit"):
        reading(table, moment_limit="0.01 N*m")
    assert reading(table, force_limit="50 N").recording.n_rows == 240


# ------------------------------------------------------------------- text by line


TEXT = "time_s,x_m\n" + "".join(f"{i},0.{i}\n" for i in range(30))
LINES = {
    "cut in a row": (TEXT + "30", "line 32 has 1 cells where there are 2 columns; the file may be cut off"),
    "text in a cell": (TEXT.replace("\n7,0.7", "\n7,ERR"), "line 9, column 'x_m': 'ERR' is not a number"),
    "infinity": (TEXT.replace("\n7,0.7", "\n7,-inf"), "line 9, column 'x_m': -inf is not a finite"),
    "overflow": (TEXT.replace("\n7,0.7", "\n7,1e999"), "line 9, column 'x_m': 1e999 is too large"),
    "long row": (TEXT.replace("\n7,0.7", "\n7,0.7,1"), "line 9 has 3 cells"),
    "open quote": (TEXT.replace("\n7,0.7", '\n7,"0.7'), "line 9: .*close the quotation marks"),
    "other mark": (TEXT.replace("\n7,0.7", '\n7,"0,7"'), "'0,7' is not a number with decimal mark '.'"),
    "no names": (TEXT.split("\n", 1)[1], "line 1 holds numbers where column names belong"),
    "names only": ("time_s,x_m\n", "a line of names and no data"),
    "name twice": (TEXT.replace("x_m", "time_s"), "names column 'time_s' more than once"),
    "empty": ("", "the file is empty"),
    "missing": (TEXT.replace("x_m", "xm"), "no column 'x_m'; did you mean 'xm'"),
    "zero bytes": (TEXT + "\0", "is zero, so this is no text"),
}


@pytest.mark.parametrize(("text", "message"), LINES.values(), ids=LINES.keys())
def test_bad_text_is_reported_by_line_and_column(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(CurveError, match=message) as caught:
        read_here(path, columns=("time_s", "x_m"))
    assert str(caught.value).startswith(f"{path}: ")


def test_a_point_that_groups_thousands_is_not_a_decimal_mark(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(TEXT.replace(",", ";").replace(".", ",").replace("\n7;0,7", "\n7;1.500"))
    with pytest.raises(CurveError, match=r"line 9, column 'x_m': '1.500' has marks between its thousands"):
        read_here(path, columns=("time_s", "x_m"))


def test_a_last_line_without_an_end_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(TEXT[:-1])
    assert "may have been cut short" in read_here(path).notes[0]


def test_unused_columns_may_hold_anything(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(TEXT.replace("x_m", "x_m,state").replace("\n7,0.7", "\n7,0.7,go").replace("0.8", "0.8,"))
    lines = [line if line.count(",") == 2 else line + ",1" for line in path.read_text().splitlines()]
    path.write_text("\n".join(lines) + "\n")
    (stream,) = read_here(path, columns=("time_s", "x_m")).streams
    assert list(stream.columns) == ["time_s", "x_m"]
    (everything,) = read_here(path).streams
    assert everything.columns["state"].note.startswith("1 cells are no numbers, the first in line 9: ")


def test_the_columns_of_a_map_are_each_read_once() -> None:
    assert sorted(columns_of(write.channel_map())) == sorted(write.COLUMNS)


def test_a_time_is_no_counter_and_a_counter_has_a_rate() -> None:
    table = write.press()
    with pytest.raises(CurveError, match="'time_s' counts no rows; leave its rate out"):
        reading(table, time={"column": "time_s", "rate": "200 Hz"})
    table["frame"] = np.arange(240.0)
    with pytest.raises(CurveError, match=r"'frame' counts rows; give the rate .*: time = \{ column"):
        reading(table, time="frame")


def test_a_counter_may_have_empty_cells_and_a_unit() -> None:
    table = {**write.press(), "frame [counts]": np.arange(240.0)}
    by_rows = {"column": "frame [counts]", "rate": "200 Hz"}
    assert reading(table, time=by_rows).recording.time_s[-1] == pytest.approx(239 / 200)
    table["frame [counts]"][20] = np.nan
    with pytest.raises(CurveError, match=r"line 22 .*column 'frame \[counts\]': no value"):
        reading(table, time=by_rows)


def test_a_column_is_one_axis_alone() -> None:
    with pytest.raises(ValueError, match="'fx_N' is named twice; give x, y and z their own columns"):
        reading(write.press(), force={"columns": ["fx_N", "-fx_N", "fz_N"]})
