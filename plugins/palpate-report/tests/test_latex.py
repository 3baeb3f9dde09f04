"""Tables for LaTeX: the paper's own shape, compiled without a box that is too wide."""

import re
import shutil
import subprocess
from dataclasses import replace

import polars as pl
import pytest
from hypothesis import given, strategies as st

from palpate.fit.least_squares import LeastSquares
from palpate.run.result import FitResult
from palpate_report.answer.paper_tables import materials_of, paper_tables
from palpate_report.data.table_files import PREAMBLE, latex, power_of_ten, symbol
from palpate_report.data.tables import make_tables

HOSTILE = r"[50 % of a_b & {c} $x$ #1 ~^ \end{table} | `d` <e> κ ±" + "\n next"


@pytest.fixture
def compiled(tmp_path):
    """Warnings of a two-column document of these tables, and its PDF."""
    if shutil.which("pdflatex") is None:
        pytest.skip("pdflatex (texlive-latex-base, texlive-latex-recommended) is not installed")

    def run(*tables):
        text = "\n".join(
            [r"\documentclass[twocolumn]{article}", PREAMBLE, r"\begin{document}", *tables, r"\end{document}"]
        )
        (tmp_path / "a.tex").write_text(text, encoding="utf-8")
        command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "a.tex"]
        done = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, errors="replace", check=False
        )
        assert done.returncode == 0, done.stdout[-2000:]
        return re.findall(r"Overfull.*|LaTeX Warning: (?:Float|Command).*", done.stdout), tmp_path / "a.pdf"

    return run


def cells(text):
    """Texts of the cells of each row of a table."""
    rows = [line.removesuffix(r"\\").split("&") for line in text.splitlines() if line.endswith(r"\\")]
    return [[cell.strip() for cell in row] for row in rows]


def number_of(cell):
    """The number of a cell without its mark."""
    return float(re.match(r"\$([-\d.]+)\$", cell)[1])


def test_the_papers_tables_have_spots_by_scenarios_with_intervals(content):
    made = content(search=LeastSquares())
    tables = paper_tables({"spongy": made})
    best = {(r["spot"], r["scenario"]): r for r in made.fit.ends.iter_rows(named=True)}
    n_curves = sum(len(response.curves) for response in made.measured.values())
    law = made.study.space.regions[0].material.summary
    assert f"{law[0].upper()}{law[1:]}; {n_curves} curves." in tables["paper_table1_wide"]
    title, groups, heads, *rows = cells(tables["paper_table1_wide"])
    assert "spongy" in title[0]
    assert [re.search(r"\{(I+)\}$", cell)[1] for cell in groups[1:]] == ["I", "II", "III"]
    assert heads[0] == "Spot"
    assert len(heads) == 1 + 4 * 3  # both parameters, the shear modulus and R²
    assert [row[0] for row in rows[::2]] == ["p1", "p2", "all spots"]
    for row, brackets in zip(rows[::2], rows[1::2], strict=True):
        for value, between, head in zip(row[1:], brackets[1:], heads[1:], strict=True):
            if head == "$R^2$":
                assert between == ""
                continue
            lower, upper = (float(end) for end in re.findall(r"\$([-\d.]+)\$", between))
            assert lower <= number_of(value) <= upper, head
    value = best["p1", "II"]["soft_tissue.stiffness"]
    assert number_of(rows[0][5]) == pytest.approx(value, rel=0.01)
    narrow = cells(tables["paper_table1"])
    assert [row[1] for row in narrow[2::2]] == ["I", "II", "III"] * 3
    assert sorted(rows[0][1:]) == sorted(cell for row in narrow[2:8:2] for cell in row[2:])


def test_a_scenario_that_one_run_lacks_is_empty_there(content):
    made = content(search=LeastSquares())
    less = replace(made, study=replace(made.study, scenarios=made.study.scenarios[:1]))
    rows = cells(paper_tables({"all": made, "less": less})["paper_table1"])
    lacking = [row[1] for row in rows if len(row) > 2 and set(row[2:]) == {"--"}]
    assert lacking == ["II", "III"] * 3  # of both spots, and of all


def test_table_2_has_the_least_of_each_scenario_in_bold(content):
    made = content()
    _, heads, *rows = cells(paper_tables({"spongy": made})["paper_table2"])
    assert heads == ["Spot", "I", "II", "III"]
    for j, scenario in enumerate(heads[1:], start=1):
        fopt = made.selection.filter(scenario=scenario)["fopt"]
        assert [rows[i][j].startswith(r"\boldmath") for i in range(2)] == (fopt == fopt.min()).to_list()


def test_every_table_fits_its_column(content, compiled):
    made = content(search=LeastSquares())
    one = replace(made, fit=FitResult())
    tables = paper_tables({materials_of(made): made, "stiff_sponge, only swept": one})
    texts = [latex(name, table) for name, table in make_tables(made).items()]
    warnings, _ = compiled(*tables.values(), *texts)
    assert not warnings


def test_any_name_is_text(compiled):
    table = pl.DataFrame({"a_name": [HOSTILE, "[x]"], "x": [float("inf"), 1.5e-7], "y": [None, None]})
    warnings, _ = compiled(latex("one", table))
    assert not warnings


def test_a_table_without_a_result_is_not_written(content):
    made = content()
    assert paper_tables({"none": replace(made, selection=made.selection[:0])}) == {}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("c1", "$c_{1}$"),
        ("kappa", r"$\kappa$"),
        ("skin.c12", "skin.$c_{12}$"),
        ("a_b", r"a\_b"),
        ("_1", r"$\__{1}$"),
    ],
)
def test_a_parameter_is_a_symbol_where_its_name_is_one(name, text):
    assert symbol(name) == text


@given(st.floats(min_value=1e-12, max_value=1e12))
def test_numbers_are_printed_without_exponents_in_powers_of_a_thousand(largest):
    power = power_of_ten(largest)
    assert power % 3 == 0
    assert 0.00999 <= largest / 10.0**power < 1.001e4
