"""Curves in text files: what is written is read, and every mistake is reported by file, line and column."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import ValidationError

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate_indentation import CsvLoader, CsvSettings

finite = st.floats(-1e140, 1e140)
curves = st.lists(st.tuples(finite, finite), min_size=2, max_size=30).filter(
    lambda rows: len({x for x, _ in rows}) > 1
)
dialects = st.sampled_from([(",", "."), (";", "."), ("\t", "."), (";", ","), ("\t", ",")])

GOOD = "depth_mm,angle_deg,force_N,torque_Nmm\n0,0,0,0\n5,0,2,0\n10,0,7,0.5\n10,-9,6,-3\n10,9,6,3\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "p1.csv"


def loader(**settings: object) -> CsvLoader:
    return CsvLoader(CsvSettings.model_validate(settings))


def moving(rows: list[tuple[float, float]]) -> FloatArray:
    """Rows without the rest at both ends, but with the points where it is left and reached."""
    while rows[0][0] == rows[1][0]:
        rows = rows[1:]
    while rows[-1][0] == rows[-2][0]:
        rows = rows[:-1]
    return np.array(rows).T


# ------------------------------------------------------------------------ laws


@given(rows=curves, dialect=dialects, crlf=st.booleans(), bom=st.booleans())
def test_what_is_written_is_read_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[float, float]],
    dialect: tuple[str, str],
    crlf: bool,
    bom: bool,
) -> None:
    delimiter, decimal = dialect
    lines = [delimiter.join(["x", "y"])]
    lines += [delimiter.join(repr(v).replace(".", decimal) for v in row) for row in rows]
    path = tmp_path_factory.mktemp("curves") / "c.csv"
    text = ("\r\n" if crlf else "\n").join(lines)
    path.write_bytes(text.encode("utf-8-sig" if bom else "utf-8"))
    curve = loader(decimal=decimal).load(path, "stretching")["stretching"]
    x, y = moving(rows)
    np.testing.assert_array_equal(curve.abscissa, x)
    np.testing.assert_array_equal(curve.ordinate, y)


@given(
    scale=st.sampled_from([-1e3, -1.0, 1e-3, 0.5, 60.0]),
    offset=st.sampled_from([-2.0, 0.0, 1.0]),
    rows=curves,
)
def test_scale_and_offset_are_linear(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]], scale: float, offset: float
) -> None:
    points = [(float(i), y) for i, (_, y) in enumerate(rows)]
    path = tmp_path_factory.mktemp("curves") / "c.csv"
    path.write_text("x,y\n" + "".join(f"{x!r},{y!r}\n" for x, y in points))
    column = {"name": "y", "scale": scale, "offset": offset}
    curve = loader(channels={"c": {"abscissa": "x", "ordinate": column}}).load(path)["c"]
    np.testing.assert_array_equal(curve.ordinate, scale * np.array([y for _, y in points]) + offset)


# -------------------------------------------------------------------- examples


def test_each_channel_keeps_the_rows_in_which_it_is_driven(file: Path) -> None:
    file.write_text(GOOD)
    response = loader().load(file)
    np.testing.assert_array_equal(response["force"].abscissa, [0, 5, 10])
    np.testing.assert_array_equal(response["force"].ordinate, [0, 2, 7])
    np.testing.assert_array_equal(response["torque"].abscissa, [0, -9, 9])
    np.testing.assert_array_equal(response["torque"].ordinate, [0.5, -3, 3])


def test_a_file_of_one_channel_needs_that_channels_columns_only(file: Path) -> None:
    file.write_text("force_N,depth_mm\n0,0\n2,5\n")
    response = loader().load(file, "force")
    assert list(response) == ["force"]
    np.testing.assert_array_equal(response["force"].ordinate, [0, 2])


def test_homogeneous_tests_have_stretch_and_stress(file: Path) -> None:
    file.write_text("stress_MPa,stretch\n0,1\n0.3,2\n")
    np.testing.assert_array_equal(loader().load(file, "uniaxial")["uniaxial"].abscissa, [1, 2])


def test_a_stress_in_another_unit_is_not_taken_for_mpa(file: Path) -> None:
    file.write_text("stretch,stress_kPa\n1,0\n2,300\n")
    with pytest.raises(CurveError, match="no column 'stress_MPa'; did you mean 'stress_kPa'"):
        loader().load(file, "uniaxial")


def test_a_preamble_comments_blank_lines_and_other_units(file: Path) -> None:
    file.write_text(
        "Machine: press\nSpeed; 10\n"
        "Strain;Note;Stress (kPa)\n0;start;0\n\n# a pause\n-0,25;;-20\n-0,5;end;-90\n"
    )
    chosen = {
        "skip_lines": 2,
        "decimal": ",",
        "channels": {
            "uniaxial": {
                "abscissa": {"name": "Strain", "offset": 1},
                "ordinate": {"name": "Stress (kPa)", "scale": 1e-3},
            }
        },
    }
    curve = loader(**chosen).load(file, "uniaxial")["uniaxial"]
    np.testing.assert_array_equal(curve.abscissa, [1.0, 0.75, 0.5])
    np.testing.assert_allclose(curve.ordinate, [0.0, -0.02, -0.09], rtol=1e-15)


def test_a_stray_carriage_return_is_a_blank(file: Path) -> None:
    file.write_bytes(b"stretch,stress_MPa\n1.00\r,0.0\n1.25\r,0.1\n")
    np.testing.assert_array_equal(loader().load(file, "uniaxial")["uniaxial"].abscissa, [1.0, 1.25])


def test_a_byte_order_mark_is_no_part_of_a_name(file: Path) -> None:
    file.write_text(GOOD, encoding="utf-8-sig")
    assert loader().load(file)["force"].abscissa.size == 3


def test_quoted_names_may_hold_the_delimiter(file: Path) -> None:
    file.write_text('"depth, driven",force\n0,0\n1,2\n')
    assert loader().load(file, "pull")["pull"].ordinate[-1] == 2.0


# ------------------------------------------------------------------- bad files

BAD = {
    "nan": (
        GOOD.replace("5,0,2,0", "5,0,nan,0"),
        "line 3, column 'force_N': no number, the cell is",
    ),
    "infinity": (GOOD.replace("10,9,", "10,-inf,"), "line 6, column 'angle_deg': -inf is not a finite"),
    "overflow": (GOOD.replace("5,0,2", "5,0,1e999"), "line 3, column 'force_N': 1e999 is too large"),
    "square too large": (
        GOOD.replace("5,0,2", "5,0,1e308"),
        "line 3, column 'force_N': too large once scaled",
    ),
    "other unit": (GOOD.replace("force_N", "Force"), "no column 'force_N'; did you mean 'Force'"),
    "text": (GOOD.replace("5,0,2,0", "5,0,two,0"), "line 3, column 'force_N': 'two' is not a number"),
    "unit in a cell": (GOOD.replace("5,0,2", "5 mm,0,2"), "line 3, column 'depth_mm': '5 mm' is not a"),
    "underscore": (GOOD.replace("10,0,7", "1_0,0,7"), "line 4, column 'depth_mm': '1_0' is not a number"),
    "empty cell": (
        GOOD.replace("5,0,2,0", "5,0,,0"),
        "line 3, column 'force_N': no number, the cell is",
    ),
    "missing column": (
        GOOD.replace("angle_deg", "angel_deg"),
        "no column 'angle_deg'; did you mean 'angel_deg'",
    ),
    "column twice": (GOOD.replace("torque_Nmm", "force_N"), "line 1 names column 'force_N' more than once"),
    "ragged": (GOOD.replace("5,0,2,0", "5,0,2"), "line 3 has 3 cells where there are 4 columns"),
    "long row": (GOOD.replace("5,0,2,0", "5,0,2,0,1"), "line 3 has 5 cells where there are 4 columns"),
    "empty": ("", "the file is empty"),
    "blank": (" \n\n", "the file is empty"),
    "comments only": ("# nothing\n", "no names and no rows"),
    "header only": (GOOD.splitlines()[0] + "\n", "a line of names and no data"),
    "one row": ("".join(GOOD.splitlines(keepends=True)[:2]), "only 1 row of data"),
    "no header": (GOOD.split("\n", 1)[1], "line 1 holds numbers where column names belong"),
    "never moves": (GOOD.replace("-9", "0").replace("9,", "0,"), "column 'angle_deg': the abscissa never"),
    "open quote": (GOOD.replace("5,0", '"5,0'), "line 3: unexpected end of data; close the quotation marks"),
    "decimal comma": (
        GOOD.replace(",", ";").replace("0.5", "0,5").replace("10;9;6", "10;9;6.5"),
        "line 4, column 'torque_Nmm': '0,5' is not a number with decimal mark '.'",
    ),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_a_bad_file_is_reported_by_line_and_column(file: Path, text: str, message: str) -> None:
    file.write_text(text)
    with pytest.raises(CurveError) as caught:
        loader().load(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert message in str(caught.value)
    assert "; " in str(caught.value), "a remedy follows"


GERMAN = "x;y\n0,5;0,1\n1,5;0,2\n2,5;0,3\n"


@pytest.mark.parametrize(
    ("text", "settings", "message"),
    [
        (GERMAN, {"decimal": "."}, "numbers written with ','; set decimal = \",\" in the"),
        (GERMAN, {"delimiter": ",", "decimal": "."}, 'set decimal = "," and delimiter = ";" in the'),
    ],
)
def test_a_file_with_other_marks_is_named(file: Path, text: str, settings: dict, message: str) -> None:
    file.write_text(text)
    columns = {"pull": {"abscissa": "x", "ordinate": "y"}}
    with pytest.raises(CurveError) as caught:
        loader(channels=columns, **settings).load(file, "pull")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"\xff\xfe" + GOOD.encode(), "is not utf-16 text; leave encoding out"),
        (b"depth_mm,force_N\n1,2\n\0\0", "byte 21 is zero, so this is no text"),
    ],
    ids=["cut utf-16", "binary"],
)
def test_bytes_that_are_no_text_are_refused(file: Path, raw: bytes, message: str) -> None:
    file.write_bytes(raw)
    with pytest.raises(CurveError, match=message):
        loader().load(file)


def test_a_point_that_groups_thousands_is_not_a_decimal_mark(file: Path) -> None:
    file.write_text("x;y\n0;0\n1.500;2\n")
    with pytest.raises(CurveError, match=r"line 3, column 'x': '1.500' has marks between its thousands"):
        loader(decimal=",").load(file, "pull")


@pytest.mark.parametrize(
    "text", ["root:$6$hash:19000\nbin:*:18000\n", "secret,other\nkey,word\n", "a,a\nb,c\n"]
)
def test_the_words_of_a_file_that_is_no_table_are_not_repeated(file: Path, text: str) -> None:
    file.write_text(text)
    with pytest.raises(CurveError, match="no cell holds a number, so this is no table of numbers") as caught:
        CsvLoader().load(file)
    assert not any(word in str(caught.value).removeprefix(str(file)) for word in ("hash", "secret"))


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(CurveError, match=r"gone\.csv: cannot be read \(No such file"):
        loader().load(tmp_path / "gone.csv")
    with pytest.raises(CurveError, match=r"cannot be read \(Is a directory"):
        loader().load(tmp_path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252", "latin-1"])
def test_the_encoding_is_found(file: Path, encoding: str) -> None:
    file.write_text(GOOD.replace("\n0,0", "\n# Prüfung bei 20 °C\n0,0"), encoding=encoding)
    assert loader().load(file)["force"].abscissa.size == 3


def test_an_encoding_that_is_given_is_kept_to(file: Path) -> None:
    file.write_text(GOOD.replace("force", "förce"), encoding="cp1252")
    with pytest.raises(CurveError, match="byte 20 is not utf-8 text; leave encoding out"):
        loader(encoding="utf-8").load(file)


@pytest.mark.parametrize(
    ("text", "abscissa", "ordinate", "largest"),
    [
        ("Depth,Load\nmm,kN\n0,0\n1,2\n", "Depth", "Load", (1.0, 2000.0)),
        ("Depth [m],Load [lb]\n0,0\n1,2\n", "Depth [m]", "Load [lb]", (1000.0, 8.896443230521)),
        ("Depth,Load\n(cm),(kg)\n0,0\n1,2\n", "Depth", {"name": "Load", "scale": -9.80665}, (10.0, -19.6133)),
        # A scale to another kind is the study's own: from an extension to a strain, say.
        ("Depth (s),Load (N)\n0,0\n1,2\n", {"name": "Depth (s)", "scale": 3.0}, "Load (N)", (3.0, 2.0)),
    ],
)
def test_units_of_the_file_give_the_scale(
    file: Path, text: str, abscissa: object, ordinate: object, largest: tuple[float, float]
) -> None:
    file.write_text(text)
    channels = {"force": {"abscissa": abscissa, "ordinate": ordinate}}
    curve = loader(channels=channels).load(file, "force")["force"]
    assert (curve.abscissa[-1], curve.ordinate[-1]) == pytest.approx(largest, rel=1e-12)


@pytest.mark.parametrize(
    ("names", "ordinate", "message"),
    [
        (
            "Depth (mm),Load (counts)",
            "Load (counts)",
            "the file gives the unit 'counts', which is not known; give scale",
        ),
        ("Depth (mm),Load (mm)", "Load (mm)", "'mm' is a unit of length where one of force is needed"),
        (
            "Depth (mm),Load (lb)",
            {"name": "Load (lb)", "scale": 9.80665},
            "scale = 9.80665 where the file gives the unit 'lb', whose factor is 4.448221615",
        ),
    ],
)
def test_a_unit_that_is_unknown_or_differs_is_a_question(
    file: Path, names: str, ordinate: object, message: str
) -> None:
    file.write_text(f"{names}\n0,0\n1,2\n")
    channels = {"force": {"abscissa": "Depth (mm)", "ordinate": ordinate}}
    with pytest.raises(CurveError) as caught:
        loader(channels=channels).load(file, "force")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("channel", "names", "ends"),
    [
        ("force_over_time", "Time (min),Load (kgf)", (60.0, 9.80665)),
        ("lateral_force", "Shift (cm),Load (kN)", (10.0, 1000.0)),
        ("tilt_moment", "Tilt (rad),Moment (Nm)", (180.0 / np.pi, 1000.0)),
    ],
)
def test_every_known_channel_has_kinds_of_units(
    file: Path, channel: str, names: str, ends: tuple[float, float]
) -> None:
    file.write_text(f"{names}\n0,0\n1,1\n")
    curve = loader().load(file, channel)[channel]
    assert (curve.abscissa[-1], curve.ordinate[-1]) == pytest.approx(ends)
    file.write_text("x (V),y (V)\n0,0\n1,1\n")
    with pytest.raises(CurveError, match="'V' is a unit of another kind where one of"):
        loader().load(file, channel)


def test_names_encoding_and_other_separators_can_be_set(file: Path) -> None:
    file.write_text("0 0\n1  2\n", encoding="utf-16")
    chosen = {"names": ["x", "y"], "encoding": "utf-16", "delimiter": "blanks"}
    np.testing.assert_array_equal(loader(**chosen).load(file, "pull")["pull"].ordinate, [0, 2])
    with pytest.raises(CurveError, match="remove the setting names"):
        loader(**chosen).save(file, loader(**chosen).load(file, "pull"), "pull")


def test_a_channel_without_known_columns_needs_exactly_two(file: Path) -> None:
    file.write_text(GOOD)
    with pytest.raises(CurveError, match=r"4 columns .* for channel 'pull'.*channels\.pull"):
        loader().load(file, "pull")


def test_skipping_past_the_end_names_the_setting_to_lower(file: Path) -> None:
    file.write_text(GOOD)
    with pytest.raises(CurveError, match="no names and no rows after line 99; lower skip_lines"):
        loader(skip_lines=99).load(file)


def test_a_scale_that_overflows_is_reported_by_line(file: Path) -> None:
    file.write_text("x,y\n0,1\n1,1e300\n")
    channels = {"c": {"abscissa": "x", "ordinate": {"name": "y", "scale": 1e300}}}
    with pytest.raises(CurveError, match="line 2, column 'y': too large once scaled"):
        loader(channels=channels).load(file)


@pytest.mark.parametrize(
    "wrong",
    [
        {"channels": {}},
        {"channels": {"c": {"abscissa": "x"}}},
        {"channels": {"c": {"abscissa": "x", "ordinate": {"name": "y", "scale": 0.0}}}},
        {"channels": {"c": {"abscissa": "", "ordinate": "y"}}},
        {"delimiter": "/"},
        {"decimal": "·"},
        {"skip_lines": -1},
        {"separator": ","},
    ],
)
def test_wrong_settings_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        loader(**wrong)
