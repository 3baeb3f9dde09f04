"""Nothing that a run refuses is printed bare: every file of its report, its cards, and a comparison."""

import base64
import csv
import io
import json
import math
import re
from dataclasses import replace

import polars as pl
import pytest

from palpate.answer.words import MARKS, explained, mark_of, verdict_of
from palpate.api.fit import Adequacy
from palpate.fit.fitted import fitted
from palpate.fit.least_squares import LeastSquares
from palpate_prediction.cards.programs import PROGRAMS, cards_of
from palpate_report.answer.headline import Verdicts, with_verdicts
from palpate_report.answer.model_verdict import NO_PARAMETERS, model_verdict
from palpate_report.answer.paper_tables import paper_tables
from palpate_report.answer.result import make_conclusion
from palpate_report.comparison import write_comparison
from palpate_report.data.marks import with_minus
from palpate_report.data.tables import make_tables
from palpate_report.figures import drawings
from palpate_report.from_run import write_report
from palpate_report.page.html import render
from palpate_report.stage import summary_of

from .fits import at_end_of_range, refused as as_refused, with_tables

pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def refused(content):
    return as_refused(content(search=LeastSquares()))


@pytest.fixture
def drawn(monkeypatch):
    """A picture without the cost of drawing it."""

    def save(runs, folder):
        folder.mkdir(parents=True)
        (folder / "curves.svg").write_text("<svg/>")
        return (folder / "curves.svg",)

    monkeypatch.setattr("palpate_report.figures.drawings.write_comparison_figures", save)


def values_of(data):
    """Every value of a parameter or modulus, with the ends of its interval."""
    swept = replace(data, fit=type(data.fit)())
    for best in (*data.bests, *swept.bests):
        for value in best.values:
            yield from (each for each in (value.value, value.lower, value.upper) if each is not None)
        yield from (modulus.value for modulus in best.moduli)


def has_a_value(text, values):
    numbers = [float(each) for each in re.findall(r"[-+]?\d+\.\d+(?:e[-+]?\d+)?", text)]
    return any(math.isclose(n, v, rel_tol=6e-4) for n in numbers for v in values)


def bare(folder, values):
    """Files, and rows of CSV files, with a value of a parameter and without mark or warning."""
    for path in sorted(folder.rglob("*.*")):
        if path.suffix == ".csv":
            for row in csv.DictReader(io.StringIO(path.read_text())):
                named = {"parameter", "verdict"} & row.keys() or re.search("tissue", " ".join(row))
                for other in ("sd", "share", "difference", "r2", "probability"):  # no value
                    row.pop(other, None)
                if named and has_a_value(" ".join(row.values()), values) and "refused" not in row.values():
                    yield path.name, row
        elif path.suffix in (".tex", ".md", ".html"):
            text = path.read_text()
            if has_a_value(text, values) and NO_PARAMETERS not in text:
                yield path.name, ""


def test_no_output_of_a_refused_run_has_a_bare_value(refused, drawn, tmp_path):
    assert model_verdict(refused).failure.startswith(NO_PARAMETERS)
    values = list(values_of(refused))
    report = write_report(refused, tmp_path / "report")
    laws = {"laws": pl.DataFrame({"law": ["spongy"], "fit": ["refused"]})}  # of a comparison of laws
    made = write_comparison({"one": refused, "two": refused}, tmp_path / "comparison", first=laws)
    found = list(bare(tmp_path, values))
    assert found == [], sorted({name for name, _ in found})
    # The search for bare values finds them where they are.
    plain = write_report_without_verdicts(refused, tmp_path / "plain")
    assert {name for name, _ in bare(plain, values)} > {"table1_fit.csv", "intervals.csv", "fit.csv"}
    assert all(row["verdict"] == "refused" for row in made["tables"]["parameters"].to_dicts())
    assert any(NO_PARAMETERS in note for note in made["notes"])
    assert NO_PARAMETERS in (tmp_path / "comparison" / "index.html").read_text()
    tex = (tmp_path / "report" / "tables" / "paper_table1.tex").read_text()
    assert tex.startswith(f"% WARNING: Spongy: {NO_PARAMETERS}")
    rows = [line for line in tex.splitlines() if re.match(r"p1 &|& I", line)]
    assert rows
    for row in rows:  # each value but R²
        assert all(cell.endswith(r"$^{\dagger}$") for cell in row.removesuffix(r" \\").split(" & ")[2:-1])
    assert set(report.tables["table1_fit"]["verdict"]) == {"refused"}


def write_report_without_verdicts(data, folder):
    from palpate_report.data.table_files import write_tables

    write_tables(make_tables(data), folder)
    return folder


class Read:
    """A run that is read back."""

    def __init__(self, data):
        self.study, self.measured, self.data = data.study, data.measured, data

    def fitted(self):
        return fitted(self.study, self.data.selection, self.data.generalisation, self.data.fit)

    def fit(self):
        return self.data.fit

    def strains(self):
        return {}


def test_every_card_of_a_refused_run_warns(refused, plugins, monkeypatch):
    monkeypatch.setattr("palpate_prediction.cards.programs.report_data", lambda run: run.data)
    (card,) = cards_of(Read(refused))
    assert set(card.verdicts.values()) == {"refused"}
    found = json.loads(PROGRAMS["json"](card))
    assert found["verdict"].startswith(f"WARNING: {NO_PARAMETERS}")
    assert {each["origin"] for each in found["parameters"].values()} == {"fitted"}


def sound(data):
    """The same fit, whose model describes its curves."""
    words = pl.Series(["well", "poorly", "not", "unclear"] * data.fit.intervals.height)
    known = data.fit.intervals.with_columns(identifiability=words.head(data.fit.intervals.height))
    fine = data.fit.adequacy.with_columns(verdict=pl.lit("describes"), message=pl.lit(""))
    return at_end_of_range(with_tables(data, intervals=known, adequacy=fine), "soft_tissue.grip")


def test_marks_are_those_of_the_verdict_and_are_explained_once(refused):
    data = sound(refused)
    tables = with_verdicts(data, make_tables(data))
    intervals = tables["intervals"]
    for row in intervals.iter_rows(named=True):
        at_end = row["parameter"].startswith("soft_tissue.grip")
        assert row["verdict"] == verdict_of(row["identifiability"], at_bound=at_end)
    combinations = data.table("parameter_combinations").with_columns(identifiability=pl.lit("not"))
    (shown,) = with_verdicts(data, {"parameter_combinations": combinations}).values()
    assert set(shown["identifiability"]) == {"not identified"}
    assert "not" not in set(intervals["identifiability"])
    tex = paper_tables({"spongy": data})["paper_table1"]
    assert "WARNING" not in tex
    assert tex.count(r"$^{\dagger}$ poorly or not identified") == 1
    assert tex.count(r"$^{\ddagger}$ at an end of the range") == 1
    assert r"$\mu_{0}$" in tex
    assert "$R^2$" in tex
    best = Verdicts(data).found["p1", "I", True]
    assert f"{best.moduli[0].value:.3f}" in tex


def test_a_set_outside_of_the_interval_has_not_its_word(content):
    """The sweep's interval is of the optimum between its sets."""
    data = content(assessed=False)
    known = data.table("identifiability").with_columns(identifiability=pl.lit("well"))
    data = with_tables(data, identifiability=known)
    (row, *_) = data.selection.iter_rows(named=True)
    spot, scenario, name = row["spot"], row["scenario"], "soft_tissue.stiffness"
    above = with_tables(
        data, identifiability=known.with_columns(lower=2.0 * row[name], upper=3.0 * row[name])
    )
    around = with_tables(
        data, identifiability=known.with_columns(lower=0.9 * row[name], upper=1.1 * row[name])
    )
    for each, word in ((around, "well"), (above, "unclear")):
        assert Verdicts(each).at(spot, scenario, name, is_fit=False) == word
        (at,) = (best for best in each.bests if (best.spot, best.scenario) == (spot, scenario))
        assert at.values[0].identifiability == word


@pytest.mark.parametrize(
    ("word", "at_bound", "mark"),
    [("well", False, ""), ("roughly", False, ""), ("poorly", False, "†"), ("not", False, "†"),
     ("unclear", True, "†‡"), ("well", True, "‡"), ("", False, "")],
)  # fmt: skip
def test_a_mark_says_what_may_be_read(word, at_bound, mark):
    assert mark_of(verdict_of(word, at_bound=at_bound)) == mark
    assert mark_of(verdict_of(word, model=Adequacy.FAILS)) == "†"
    assert [each in explained([mark]) for each in MARKS] == [each in mark for each in MARKS]


def test_every_figure_of_a_refused_run_is_stamped(refused, content):
    for data, is_refused in ((refused, True), (content(assessed=False, search=LeastSquares()), False)):
        made = drawings.stamped(data)
        drawn = {name: draw(made) for name, is_there, draw in drawings._drawings(made) if is_there}
        assert {"intervals", "parameter_space_p1", "response_p1", "generalised"} <= drawn.keys()
        assert ("stress_strain" in drawn) != is_refused
        for name, figure in drawn.items():
            stamp = figure.get_suptitle()
            assert (NO_PARAMETERS in stamp) == is_refused, name
            assert data.notice in stamp, name


def test_a_comparison_names_the_refused_run_on_its_figure(refused, content):
    runs = {"one": refused, "two": content(assessed=False, search=LeastSquares())}
    figure = drawings._curves({name: drawings.stamped(data) for name, data in runs.items()})
    (line,) = (line for line in figure.get_suptitle().splitlines() if NO_PARAMETERS in line)
    assert line.startswith("one: ")


def test_the_first_screen_of_a_refused_run_shows_curves_and_no_interval(refused, content):
    pictures = {name: f"<svg>{name}</svg>".encode() for name in ("intervals", "stress_strain", "generalised")}
    for data, shown in ((refused, {"generalised"}), (content(search=LeastSquares(), assessed=False), None)):
        tables = make_tables(data)
        page = render(data, tables, make_conclusion(data, tables), [], pictures)
        first = page[: page.index('id="section-')]
        embedded = {n for n, svg in pictures.items() if base64.b64encode(svg).decode() in first}
        assert embedded == (shown or {"intervals", "stress_strain"})


def test_every_output_of_an_approximation_has_its_sentence_and_its_words(
    refused, drawn, plugins, monkeypatch, tmp_path
):
    """Page, terminal, JSON, tables, LaTeX, comparison and card have one verdict."""
    data = sound(refused)
    rows = data.fit.adequacy.with_columns(
        verdict=pl.when(check="discrepancy").then(pl.lit("approximates")).otherwise(pl.lit("describes"))
    )
    data = with_tables(data, adequacy=rows)
    model = model_verdict(data)
    assert model.verdict is Adequacy.APPROXIMATES
    assert re.match(r"Effective parameters: Spongy describes these curves to within [\d.]+ %", model.sentence)
    report = write_report(data, tmp_path / "report")
    summary = summary_of(data.study, report)
    assert summary.values["model"] == {"verdict": "approximates", "sentence": model.sentence}
    assert report.conclusion.headline.startswith(model.sentence)
    words = {each.name: each.verdict for each in report.conclusion.estimates}
    assert all("effective" in word.split(", ") for word in words.values())
    own = report.tables["intervals"].filter(fit="all spots", scenario=data.generalising.name)
    assert dict(own.select("parameter", "verdict").rows()) == words
    shown = with_minus(model.sentence)
    assert shown in (tmp_path / "report" / "index.html").read_text()
    assert r"$^{" in (tex := (tmp_path / "report" / "tables" / "paper_table1.tex").read_text())
    assert f"% WARNING: Spongy: {model.sentence}" in tex
    made = write_comparison({"one": data, "two": data}, tmp_path / "comparison")
    assert f"one: {model.sentence}" in made["notes"]
    monkeypatch.setattr("palpate_prediction.cards.programs.report_data", lambda run: run.data)
    (card,) = cards_of(Read(data))
    assert card.verdict.startswith(model.sentence.replace("°", "?"))
    assert {words[f"soft_tissue.{name}"] for name in card.verdicts} == set(card.verdicts.values())
