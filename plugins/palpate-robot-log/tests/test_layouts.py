"""Tables as other labs and machines write them are read at the first try, or asked about."""

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.api.files import TextFormat, TextTable, factor_to_base
from palpate.errors import CurveError
from palpate_indentation import CsvLoader, CsvSettings
from palpate_robot_log.reading.formats import read_here

from . import log_writers as write

LAYOUTS = Path(__file__).parent / "data" / "layouts"
DEPTH_MM = 0.2 * np.arange(41)
FORCE_N = 0.4 * DEPTH_MM**1.5

FILES: Mapping[str, tuple[str, str, Mapping[str, object]]] = {
    "latin1_degree.csv": ("Weg (mm)", "Kraft (N)", {"delimiter": ";", "encoding": "cp1252"}),
    "percent_comments.txt": (
        "Depth (mm)",
        "Force (N)",
        {"comment": "%", "names": ["Depth (mm)", "Force (N)"]},
    ),
    "semicolon_comments.txt": ("depth [mm]", "force [N]", {"comment": ";"}),
    "preamble_padded.csv": ("Depth (mm)", "Force (N)", {"delimiter": ";", "skip_lines": 5}),
    "preamble_unpadded.csv": ("Displacement (mm)", "Force (N)", {"skip_lines": 3}),
    "quoted_decimal_comma.csv": ("Displacement (mm)", "Force (N)", {"delimiter": ",", "decimal": ","}),
    "several_blocks.txt": ("Position (z), mm", "Fz, gf", {"skip_lines": 5, "block": 1}),
    "trailing_delimiter.csv": ("Displacement (mm)", "Force (N)", {}),
    "trailing_tab.txt": ("Depth (mm)", "Force (N)", {"delimiter": "tab"}),
    "units_line.csv": ("Displacement", "Force", {}),
    "units_line_eu.csv": ("Depth", "Force", {"decimal": ","}),
    "units_line_with_stress.csv": ("Extension", "Load", {}),
    "cycles.csv": ("Depth (mm)", "Force (N)", {"skip_lines": 1, "block": 1}),
    "dashes.txt": ("Depth", "Force", {"delimiter": "blanks"}),
    "excel_dates.csv": ("Displacement (mm)", "Force (N)", {"skip_lines": 1}),
    "footer.csv": ("Displacement (mm)", "Force (N)", {"delimiter": ";"}),
    "instron_bluehill.csv": ("Extension", "Load", {"skip_lines": 6}),
    "instron_universal.csv": ("Displacement (mm)", "Force (kN)", {}),
    "labview.lvm": ("Depth (mm)", "Force (N)", {"delimiter": "tab", "skip_lines": 21}),
    "mach1.txt": ("Position (z), mm", "Fz, gf", {"delimiter": "tab", "skip_lines": 12}),
    "mts.txt": ("Axial Displacement", "Axial Force", {"delimiter": "tab", "skip_lines": 5}),
    "shimadzu.csv": ("Stroke", "Force", {"skip_lines": 1}),
    "slashes.dat": ("Depth/mm", "Force/N", {"comment": "//", "names": ["Depth/mm", "Force/N"]}),
    "tabs_comma.txt": ("Weg in mm", "Kraft in N", {"decimal": ","}),
    "taxt.csv": ("Distance", "Force", {}),
    "taxt_title.tab": ("Distance", "Force", {"skip_lines": 1}),
    "units_unknown.csv": ("Crosshead", "Load", {}),
    "zwick.txt": ("Standardweg", "Standardkraft", {"encoding": "cp1252", "decimal": ",", "skip_lines": 4}),
    "zwick_utf16.tsv": ("Standard travel", "Standard force", {"encoding": "utf-16", "skip_lines": 1}),
}
"""Columns of depth and force, and the settings that reading without a setting gives."""


@pytest.mark.parametrize(
    ("file", "depth", "force", "settings"), [(k, *v) for k, v in FILES.items()], ids=FILES
)
def test_a_layout_is_read_at_the_first_try(
    file: str, depth: str, force: str, settings: Mapping[str, object]
) -> None:
    table = TextTable(LAYOUTS / file)
    _, columns = table.read()
    for name, kind, expected in ((depth, "length", DEPTH_MM), (force, "force", FORCE_N)):
        values = columns[name].values * factor_to_base(columns[name].shown_unit, kind, name)
        np.testing.assert_allclose(values[:41], expected, atol=6e-3)
        assert values.size == 41
    found = table.settings()
    assert settings.items() <= found.items()
    again = TextTable(LAYOUTS / file, TextFormat.model_validate(found)).read([depth, force])[1]
    np.testing.assert_array_equal(again[force].values, columns[force].values)


@pytest.mark.parametrize(("file", "depth", "force"), [(k, *v[:2]) for k, v in FILES.items()], ids=FILES)
def test_the_loader_csv_reads_it_in_the_channels_units(file: str, depth: str, force: str) -> None:
    table = TextTable(LAYOUTS / file)
    channels = {"force": {"abscissa": depth, "ordinate": force}}
    curve = CsvLoader(CsvSettings.model_validate({**table.settings(), "channels": channels})).load(
        LAYOUTS / file, "force"
    )["force"]
    assert curve.abscissa[[0, -1]] == pytest.approx([0.0, 8.0], abs=1e-3)
    assert curve.ordinate[[0, -1]] == pytest.approx([0.0, 9.05], abs=6e-3)


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("Time,1,2\n", ["Time", "1", "2"]),
        (",x,y\n", ["column 1", "x", "y"]),
        ("#t,x,y\n", ["t", "x", "y"]),
        ("# run 3\n# t, x, y\n", ["t", "x", "y"]),
        ("%time,x,y\n", ["%time", "x", "y"]),
        ("12\nt,x,y\n", ["t", "x", "y"]),
        ("force,force,force\nx,y,z\n", ["x", "y", "z"]),
        ("sep=,\nt,x,y\n", ["t", "x", "y"]),
    ],
)
def test_lines_of_names_are_told_from_rows(head: str, names: list[str], tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(head + "".join(f"{0.1 * i:.1f},{i * i},{i}\n" for i in range(30)))
    table = TextTable(path)
    lines, columns = table.read()
    assert [*columns] == names
    assert (lines[0], lines.size) == (head.count("\n") + 1, 30)


@pytest.mark.parametrize("head", ["", "0,1,2\n", "# made by me on a day in May\n", "Operator: none\n"])
def test_a_row_of_numbers_never_becomes_the_names(head: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(head + "".join(f"{0.1 * i:.1f},{i * i},{i}\n" for i in range(30)))
    table = TextTable(path)
    assert (table.names, table.read()[0].size) == (("column 1", "column 2", "column 3"), 30 + ("0,1" in head))
    assert "the file names no columns: write them under names" in table.notes()
    with pytest.raises(CurveError, match="holds numbers where column names belong"):
        table.read(["column 1"])


def test_names_in_a_comment_cost_no_row() -> None:
    table = TextTable(LAYOUTS / "names_in_comment.txt")
    lines, columns = table.read()
    assert (lines[0], lines.size, [*columns]) == (2, 41, ["depth_mm", "force_N"])
    assert table.settings()["names"] == ["phase", "depth_mm", "force_N"]


def test_another_table_of_a_file_is_chosen_by_its_number() -> None:
    table = TextTable(LAYOUTS / "cycles.csv", TextFormat(block=2))
    lines, columns = table.read(["Force (N)"])
    assert (lines[0], lines[-1]) == (46, 86)
    np.testing.assert_allclose(columns["Force (N)"].values, 0.9 * FORCE_N, atol=1e-4)
    assert TextTable(LAYOUTS / "several_blocks.txt", TextFormat(block=2)).read()[0].size == 21


def test_several_tables_are_a_question_where_columns_are_wanted() -> None:
    with pytest.raises(
        CurveError, match=r"holds 2 tables: lines 3 to 43, 46 to 86; choose one with block = 1"
    ):
        TextTable(LAYOUTS / "cycles.csv").read(["Force (N)"])
    with pytest.raises(CurveError, match="block = 3 where the file holds 2 tables"):
        TextTable(LAYOUTS / "cycles.csv", TextFormat(block=3))
    assert "holds 2 tables" in "".join(TextTable(LAYOUTS / "cycles.csv").notes())


def test_lines_after_the_table_are_noted_and_a_row_that_is_cut_is_not_among_them(tmp_path: Path) -> None:
    assert "lines passed over after the table: 44 to 45" in TextTable(LAYOUTS / "footer.csv").notes()
    text = (LAYOUTS / "footer.csv").read_text()
    (tmp_path / "cut.csv").write_text(text[: text.index("Maximum")] + "8.2\n")
    with pytest.raises(CurveError, match="line 44 has 1 cells where there are 2 columns"):
        TextTable(tmp_path / "cut.csv").read(["Force (N)"])


def test_a_word_inside_the_table_is_a_damaged_row(tmp_path: Path) -> None:
    text = (LAYOUTS / "footer.csv").read_text()
    for line in (2, 3, 20):
        lines = text.splitlines()
        lines[line - 1] = "ERR;" + lines[line - 1].split(";")[1]
        (tmp_path / "bad.csv").write_text("\n".join(lines))
        with pytest.raises(CurveError, match=rf"line {line}, column 'Displacement \(mm\)': 'ERR'"):
            TextTable(tmp_path / "bad.csv").read(["Displacement (mm)"])


@pytest.mark.parametrize("file", ["lists_in_cells.csv", "arrays_in_cells.csv"])
def test_lists_in_cells_are_columns_by_number(file: str, tmp_path: Path) -> None:
    table = TextTable(LAYOUTS / file)
    time, pose, wrench = table.layout.names
    _, columns = table.read()
    assert [*columns] == [time, *(f"{pose}[{i}]" for i in range(7)), *(f"{wrench}[{i}]" for i in range(6))]
    np.testing.assert_allclose(columns[f"{pose}[0]"].values, 0.4, atol=1e-4)
    assert columns[f"{wrench}[2]"].values.min() < -12.0
    text = (LAYOUTS / file).read_text().splitlines()
    text[9] = text[8].split("[")[0].rstrip('"') + '"[1, 2]","[1, 2]"'
    (tmp_path / "short.csv").write_text("\n".join(text))
    with pytest.raises(
        CurveError, match=r"line 10, column '.*\[3\]': '\[1, 2\]' is no list of numbers as in"
    ):
        TextTable(tmp_path / "short.csv").read([f"{pose}[3]"])


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("3/14/2030 2:05:00.120 PM", "3/14/2030 2:05:01.620 PM"),
        ("14.03.2030 14:05:00,120", "14.03.2030 14:05:01,620"),
        ("2030/03/14 14:05:00.120", "2030/03/14 14:05:01.620"),
        ("2030-03-14T23:59:59.000Z", "2030-03-15T00:00:00.500Z"),
    ],
)
def test_dates_of_other_makers_are_seconds(tmp_path: Path, first: str, second: str) -> None:
    path = tmp_path / "dates.csv"
    path.write_text(f"when;x\n{first};1\n{second};2\n")
    assert TextTable(path).read()[1]["when"].values == pytest.approx([0.0, 1.5], abs=1e-9)


def test_a_name_that_occurs_twice_is_an_error_only_where_it_is_wanted(tmp_path: Path) -> None:
    path = tmp_path / "twice.csv"
    path.write_text("t,x,i,i\n0,1,2,3\n1,2,3,4\n")
    table = TextTable(path)
    assert [*table.read(["t", "x"])[1]] == ["t", "x"]
    assert [*table.read()[1]] == ["t", "x"]
    assert "name occurs twice: i" in table.notes()[0]
    with pytest.raises(CurveError, match="line 1 names column 'i' more than once"):
        table.read(["i"])


@given(
    delimiter=st.sampled_from([",", ";", "\t", "|"]),
    n_before=st.integers(0, 4),
    is_padded=st.booleans(),
    has_units=st.booleans(),
    n_after=st.integers(0, 3),
    is_trailing=st.booleans(),
    ending=st.sampled_from(["\n", "\r\n"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
)
def test_what_is_around_a_table_changes_nothing(
    tmp_path_factory: pytest.TempPathFactory,
    delimiter: str,
    n_before: int,
    is_padded: bool,
    has_units: bool,
    n_after: int,
    is_trailing: bool,
    ending: str,
    encoding: str,
) -> None:
    path = tmp_path_factory.mktemp("around") / "t.csv"
    tail = delimiter if is_trailing else ""
    before = [f"Größe {i}{delimiter}{i + 1}" + delimiter * is_padded for i in range(n_before)]
    names, units = (["Time", "Depth", "Force"], ["(s)", "(mm)", "(lb)"])
    head = [delimiter.join(names) + tail, *([delimiter.join(units) + tail] if has_units else [])]
    rows = [f"{0.1 * i:.1f}{delimiter}{0.2 * i:.4f}{delimiter}{i * i}{tail}" for i in range(12)]
    after = ["", *(f"Mean {i}{delimiter}{i}" for i in range(n_after))] if n_after else []
    path.write_bytes((ending.join([*before, *head, *rows, *after]) + ending).encode(encoding))
    table = TextTable(path)
    lines, columns = table.read()
    assert lines[0] == n_before + len(head) + 1
    assert [(name, column.unit) for name, column in columns.items()] == [
        (name, unit.strip("()") if has_units else "") for name, unit in zip(names, units, strict=True)
    ]
    np.testing.assert_array_equal(columns["Force"].values, np.arange(12) ** 2)


@pytest.mark.parametrize(
    ("names", "encoding"),
    [
        (("時間", "ストローク", "試験力"), "shift_jis"),
        (("时间", "位移", "试验力"), "gb18030"),
        (("Zeit", "Prüfweg", "Größe in °"), "cp1252"),
        (("temps", "déplacement", "effort mesuré"), "cp1252"),
        (("t", "“depth”", "F ± 1 µN"), "cp1252"),
    ],
)
def test_the_encoding_of_names_is_found(tmp_path: Path, names: tuple[str, ...], encoding: str) -> None:
    path = tmp_path / "t.csv"
    text = ",".join(names) + "\n" + "".join(f"{i},{2 * i},{i * i}\n" for i in range(9))
    path.write_bytes(text.encode(encoding))
    table = TextTable(path)
    assert (table.encoding, table.names) == (encoding, names)


# ----------------------------------------------------------------------- files that are no text


def _archive(path: Path, *members: str) -> None:
    with zipfile.ZipFile(path, "w") as book:
        for member in members:
            book.writestr(member, "<x/>")


@pytest.mark.parametrize(
    ("members", "message"),
    [
        (("[Content_Types].xml", "xl/workbook.xml"), "is a spreadsheet of Excel; save the table as CSV"),
        (("mimetype", "content.xml"), "is a spreadsheet of OpenDocument; save the table as CSV"),
        (
            ("header.properties", "segments/0/channels/height.dat"),
            "is a force curve of JPK; export it as text",
        ),
    ],
)
def test_archives_of_other_programs_are_named(tmp_path: Path, members: tuple[str, ...], message: str) -> None:
    path = tmp_path / "book.zip"
    _archive(path, *members)
    with pytest.raises(CurveError, match=message):
        read_here(path)
    with pytest.raises(CurveError, match=message):
        CsvLoader().load(path)


def test_a_binary_wave_of_igor_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.ibw").write_bytes(b"\x05\x00" + bytes(400))
    with pytest.raises(CurveError, match="a binary wave of Igor Pro; save it as delimited text"):
        read_here(tmp_path / "a.ibw")


@pytest.mark.parametrize(
    ("writer", "kind"), [(write.write_matlab5, "MATLAB"), (write.write_parquet, "Parquet")]
)
def test_the_loader_csv_says_what_a_file_of_columns_is(tmp_path: Path, writer, kind: str) -> None:
    writer(tmp_path / "a.dat", write.press(30))
    with pytest.raises(CurveError, match=f"is an? {kind} file, and this loader reads text alone; see"):
        CsvLoader().load(tmp_path / "a.dat")


# ------------------------------------------------------------------------------------ commands


def test_a_study_of_a_bag_names_the_file_in_its_folder(call, tmp_path):
    pytest.importorskip("rosbags")
    write.write_bag2(tmp_path / "bag", write.press())
    (tmp_path / "p1.vtu").write_text("")
    assert call("init", "arm", "--measured", "bag", "--mesh", "p1.vtu", plugin=None).code == 0
    assert 'measured = "../bag/bag.db3"' in (tmp_path / "arm" / "study.toml").read_text()
    (tmp_path / "bag" / "more.db3").write_bytes(b"")
    assert (
        "a folder of several files"
        in call("init", "a", "--measured", "bag", "--mesh", "p1.vtu", plugin=None).err
    )


@pytest.mark.slow
@pytest.mark.parametrize("file", [file for file in FILES if "stress" not in file and "universal" not in file])
def test_init_writes_a_study_that_reads_the_file(file, call, tmp_path):
    """The study is the proposed one, but for the protocol: this press has no twist and is 8 mm deep."""
    (tmp_path / "p1.vtu").write_text("")
    assert call("init", "arm", "--measured", LAYOUTS / file, "--mesh", "p1.vtu", plugin=None).code == 0
    study = tmp_path / "arm" / "study.toml"
    text = re.sub(r'(?m)^depth = "10 mm"$', 'depth = "8 mm"', study.read_text())
    text = re.sub(r"(?m)^twist = .*$", "", text)
    text = re.sub(r"(?m)^scenarios = .*$", 'scenarios = ["III"]', text)
    study.write_text(re.sub(r"(?m)^generalise_by = .*$", 'generalise_by = "III"', text))
    done = call("experiment", "arm", "--json", plugin=None)
    assert done.code == 0, done.err
    (row,) = done.json
    assert (row["channel"], row["n_points"]) == ("force", 41)
    assert row["largest"] == pytest.approx(9.051, abs=2e-3)


# -------------------------------------------------------------------------------------- robots


def test_a_label_of_labview_without_a_number_is_a_line_like_others(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("X0\nX_Dimension\nDepth (mm),Force (N)\n0,0\n1,1\n2,2\n")
    assert TextTable(tmp_path / "t.csv").read()[1]["Force (N)"].values.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("begin", [0.0, 12.0])
def test_a_table_that_begins_elsewhere_is_no_page_of_the_one_before(tmp_path: Path, begin: float) -> None:
    rows = [f"{x:.1f},{x * x:.2f}" for x in range(10)]
    again = [f"{begin + x:.1f},{x * x:.2f}" for x in range(10)]
    (tmp_path / "t.csv").write_text(
        "\n".join(["Depth (mm),Force (N)", *rows, "Depth (mm),Force (N)", *again])
    )
    assert len(TextTable(tmp_path / "t.csv").blocks) == 2


@pytest.mark.parametrize(
    ("line", "depth", "unit"),
    [
        ("Y_Unit_Label\tmm\tNewtons", "Depth", "mm"),
        ("Y_Unit_Label\tVolts\tNewtons", "Depth", "Volts"),
        ("Y_Unit_Label\tVolts\tNewtons", "Depth (mm)", "mm"),
        ("Units\tmm\tN", "Depth", "mm"),
    ],
)
def test_a_line_of_units_above_the_names_counts_where_a_name_has_none(
    line: str, depth: str, unit: str, tmp_path: Path
) -> None:
    path = tmp_path / "log.lvm"
    rows = [
        f"{0.1 * k:.1f}\t{d:.6g}\t{f:.6g}" for k, (d, f) in enumerate(zip(DEPTH_MM, FORCE_N, strict=True))
    ]
    head = ["LabVIEW Measurement", "Channels\t2", line, f"X_Value\t{depth}\tForce"]
    path.write_text("\n".join([*head, *rows]) + "\n")
    _, columns = TextTable(path).read()
    assert [column.shown_unit for column in columns.values()][1] == unit
    assert factor_to_base(columns["Force"].shown_unit, "force", "") == 1.0
    assert columns["X_Value"].shown_unit == ""
