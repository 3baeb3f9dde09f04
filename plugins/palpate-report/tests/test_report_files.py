"""Figures and tables for print: sizes of columns, embedded fonts, and any name is text."""

import re
import shutil
import subprocess
from dataclasses import replace
from xml.etree import ElementTree

import matplotlib as mpl
import numpy as np
import polars as pl
import pytest
from matplotlib.image import imread

from palpate.errors import StudyError
from palpate.fit.least_squares import LeastSquares
from palpate_report.data.table_files import latex, markdown, write_tables
from palpate_report.data.tables import make_tables, printed
from palpate_report.figures import drawings
from palpate_report.figures.style import LINES, MEASURED_COLOUR, MM, STYLE, save
from palpate_report.settings import BY_ITSELF, ReportSettings
from palpate_report.stage import ReportStage

SINGLE_MM, DOUBLE_MM = WIDTHS_MM = (BY_ITSELF.single_column, BY_ITSELF.double_column)


def test_every_figure_is_one_or_two_columns_wide(content):
    made = content()
    for draw in (
        drawings.nmse_distribution, drawings.generalised, lambda c: drawings.responses(c, "p1"),
        lambda c: drawings.parameter_space(c, "p1"),
    ):  # fmt: skip
        assert any(draw(made).get_figwidth() == pytest.approx(w * MM) for w in WIDTHS_MM)


def test_a_study_chooses_width_font_letters_and_scenarios(content, tmp_path):
    settings = ReportSettings.model_validate(
        {
            "single_column": "9 cm",
            "double_column": "183 mm",
            "font": "DejaVu Serif",
            "letters": "A",
            "scenarios": ["II"],
        }
    )
    made = replace(content(), settings=settings)
    drawings.write_figures(made, tmp_path)
    svg = ElementTree.parse(tmp_path / "response_p1.svg").getroot()
    assert float(svg.get("width").removesuffix("pt")) == pytest.approx(183 * 72 / 25.4, abs=0.01)
    texts = list(svg.iter("{http://www.w3.org/2000/svg}text"))
    shown = " ".join(text.text for text in texts)
    assert {"A", "B"} <= {text.text for text in texts}
    assert all("DejaVu Serif" in text.get("style") for text in texts)
    assert "scenario II," in shown
    assert "scenario III," not in shown
    assert b"DejaVuSerif" in (tmp_path / "response_p1.pdf").read_bytes()
    one = imread(tmp_path / "nmse_distribution.png").shape[1]
    assert one == pytest.approx(90 * 300 / 25.4, abs=1)


def test_a_scenario_that_the_study_does_not_have_is_refused(content):
    study = content().study
    with pytest.raises(StudyError, match=r"no scenario 'IV'; choose of I, II, III"):
        ReportStage(ReportSettings(scenarios=("I", "IV"))).check(study)


@pytest.fixture
def saved(content, tmp_path):
    """One figure in its three formats, by suffix."""
    with mpl.rc_context(dict(STYLE)):
        files = save(drawings.responses(content(), "p1"), tmp_path / "one")
    return {file.suffix: file for file in files}


def test_a_saved_figure_has_its_width_and_holds_its_fonts(saved):
    svg = ElementTree.parse(saved[".svg"]).getroot()
    assert float(svg.get("width").removesuffix("pt")) == pytest.approx(DOUBLE_MM * 72 / 25.4, abs=0.01)
    texts = list(svg.iter("{http://www.w3.org/2000/svg}text"))
    assert {"a", "b", "residual", "10"} <= {text.text for text in texts}, "letters stay text"
    assert all("Arial" in text.get("style") and "Helvetica" in text.get("style") for text in texts)
    assert imread(saved[".png"]).shape[1] == pytest.approx(DOUBLE_MM * 300 / 25.4, abs=1)
    pdf = saved[".pdf"].read_bytes()
    assert b"/FontFile2" in pdf
    assert b"/Type3" not in pdf


@pytest.mark.skipif(shutil.which("pdffonts") is None, reason="pdffonts of poppler-utils is not installed")
def test_an_independent_reader_finds_every_font_embedded(saved):
    reported = subprocess.run(["pdffonts", saved[".pdf"]], capture_output=True, text=True, check=True).stdout
    fonts = reported.splitlines()[2:]
    assert fonts
    for font in fonts:
        assert font.split()[-5] == "yes", font
        assert "Type 3" not in font


def test_colours_are_distinguished_by_every_colour_vision():
    """Distances in CIELAB after Machado et al.'s matrices of complete dichromacy (2009)."""
    sights = {
        "full": np.eye(3),
        "protan": [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        "deutan": [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
        "tritan": [
            [1.255528, -0.076749, -0.178779],
            [-0.078411, 0.930809, 0.147602],
            [0.004733, 0.691367, 0.303900],
        ],
    }  # fmt: skip
    colours = [MEASURED_COLOUR, *(colour for colour, _ in LINES[:3])]
    rgb = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in colours])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    for name, sight in sights.items():
        seen = np.clip(linear @ np.array(sight).T, 0, 1) @ xyz.T / [0.9505, 1.0, 1.089]
        f = np.where(seen > 0.008856, np.cbrt(seen), 7.787 * seen + 16 / 116)
        lab = np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], axis=1)
        apart = np.linalg.norm(lab[:, None] - lab[None], axis=2)[np.triu_indices(len(lab), 1)]
        assert apart.min() > 10.0, name
    assert len({dash for _, dash in LINES}) == len(LINES)


# ---------------------------------------------------------------------- tables

HOSTILE = r"50 % of a_b & {c} $x$ #1 ~^ \end{table} | `d` <e>" + "\n next"


def test_each_table_is_written_as_csv_latex_and_markdown(content, tmp_path):
    tables = make_tables(content(search=LeastSquares()))
    files = write_tables(tables, tmp_path)
    assert {f.suffix for f in files} == {".csv", ".tex", ".md"}
    assert len(files) == 3 * len(tables)
    for name, table in tables.items():
        n_rows = len(printed(name, table))
        text = (tmp_path / f"{name}.md").read_text()
        assert text.count("\n| ") == n_rows + 2
        lines = (tmp_path / f"{name}.tex").read_text().splitlines()
        assert sum(line.endswith(r"\\") for line in lines) == n_rows + 1
        assert len({len(re.findall(r"(?<!\\)&", line)) for line in lines if line.endswith(r"\\")}) == 1


def test_what_a_name_holds_is_text_in_latex_and_markdown():
    table = pl.DataFrame({"a_name": [HOSTILE], "x": [1.5e-7]})
    tex = latex("one", table)
    row = next(line for line in tex.splitlines() if "next" in line)
    assert row.count("&") - row.count(r"\&") == 1
    assert r"\end{table} |" not in row
    assert r"\textbackslash{}end\{table\}" in row
    assert r"50 \% of a\_b \& \{c\} \$x\$ \#1" in row
    assert r"$1.5\times10^{-7}$" in row
    assert r"a\_name & x \\" in tex
    md = markdown("one", table)
    assert md.count("\n") == 5
    assert r"\| \`d\` \<e\>" in md


def test_numbers_are_short_where_they_are_read_and_whole_where_they_are_used(tmp_path):
    table = pl.DataFrame(
        {"x": [0.123456789], "n": [12], "none": [None], "inf": [float("inf")], "yes": [True]}
    )
    write_tables({"t": table}, tmp_path)
    assert "0.123456789,12,," in (tmp_path / "t.csv").read_text()
    assert "| 0.1235 | 12 | – | inf | yes |" in (tmp_path / "t.md").read_text()
    assert r"$0.1235$ & $12$ & -- & $\infty$ & yes \\" in (tmp_path / "t.tex").read_text()


def test_text_in_csv_is_no_formula_and_numbers_stay_numbers(tmp_path):
    table = pl.DataFrame(
        {"=1+1": ["=cmd|' /C calc'!A0", "+1", "@x", "-2 steps", "\tx", "p-1"], "x": [-1.5] * 6}
    )
    write_tables({"t": table}, tmp_path)
    back = pl.read_csv(tmp_path / "t.csv")
    assert back.columns == ["'=1+1", "x"]
    assert [text[:2] for text in back["'=1+1"]] == ["'=", "'+", "'@", "'-", "'\t", "p-"]
    assert back["x"].to_list() == [-1.5] * 6
