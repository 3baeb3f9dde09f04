"""Every output shows the reported rows of one table: the answer of the run."""

import html
import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import Spot
from palpate.fit.least_squares import LeastSquares
from palpate.run.directory import RunDirectory
from palpate.stages import pipeline
from palpate.stages.saved_run import SavedRun
from palpate.stages.stage import read_run
from palpate.study.display_units import unit_factors
from palpate.study.reading import StudySpot
from palpate_prediction.cards.programs import PROGRAMS, cards_of
from palpate_report.answer.card import cut_ends
from palpate_report.comparison import comparison_tables, write_comparison
from palpate_report.data.display_units import in_display_units
from palpate_report.data.marks import with_minus, with_unit
from palpate_report.from_run import report_data, write_report
from palpate_report.stage import summary_of

from .every_row import disagreeing_rows, table_of
from .fits import at_end_of_range, refused

pytestmark = pytest.mark.usefixtures("undrawn")

STIFFNESS = "soft_tissue.stiffness"


@pytest.fixture
def run_of(make_study, plugins, tissue, tmp_path):
    """Run the study with such changes, and read the run back.

    Its spots are the first of the usual ones, or have these own values and curves that err by 0.4 %, and by a
    wave.
    """

    def measured_at(name, own, wave):
        path, rng = tmp_path / f"{name}.csv", np.random.default_rng(int(name[1:]))
        lines = []
        for channel, curve in tissue.answer(*own).curves.items():
            size, n = np.abs(curve.ordinate).max(), curve.ordinate.size
            wrong = curve.ordinate * (1.0 + wave * np.sin(np.linspace(0.0, 9.0, n)))
            wrong += 0.004 * size * rng.normal(size=n) * (curve.abscissa != 0.0)
            lines += [
                f"{channel},{x!r},{y!r}" for x, y in zip(curve.abscissa.tolist(), wrong.tolist(), strict=True)
            ]
        path.write_text("\n".join(lines))
        return StudySpot(spot=Spot(name=name), measured={None: (path,)}, mesh=None)

    def run(*, spots=2, own=(), wave=0.0, **changes):
        study = make_study(**({"n_sets": 40} | changes))
        found = [measured_at(f"p{i + 1}", values, wave) for i, values in enumerate(own)]
        study = replace(study, spots=tuple(found) or study.spots[:spots])
        pipeline.run_study(study, tmp_path / "run", plugins)
        return read_run(study, RunDirectory(tmp_path / "run"), plugins)

    return run


def shown(row):
    """Numbers and verdict of a row, as far as outputs have them."""
    ends = (row["lower"], row["upper"]) if row["level"] else (None, None)
    return (row["value"], *ends, row["verdict"])


def disagreements(data, report, folder):
    """Outputs in which a reported row is other than in the answer, with the row."""
    rows = data.answer.filter("reported").to_dicts()
    is_refused = bool(report.conclusion.failure)
    summary = summary_of(data.study, report)
    of_json = {} if is_refused else {r["parameter"]: r for r in summary.values["intervals"]}
    of_table = {}
    if "intervals" in report.tables:
        of_fit = report.tables["intervals"].filter(fit=data.together, scenario=data.study.generalise_by)
        of_table = {r["parameter"]: r for r in of_fit.to_dicts()}
    compared = {r["parameter"]: r for r in comparison_tables({"one": data})["parameters"].to_dicts()}
    terminal, page = summary.labelled["Parameters"], html.unescape((folder / "index.html").read_text())
    methods = (folder / "methods.md").read_text(encoding="utf-8")
    headlines = {each.parameter: each for each in (*data.estimates, *data.moduli)}
    for row in rows:
        brief = data.brief_name(row["parameter"]) if row["kind"] == "parameter" else row["parameter"]
        one, text = shown(row), str(headlines[brief])
        if shown(compared[brief] | {"level": row["level"]}) != one:
            yield "comparison", brief
        if (text in terminal) == is_refused:
            yield "terminal", brief
        if row["kind"] == "parameter" and (with_minus(text) in methods) == is_refused:
            yield "methods", brief
        quantity = with_minus(with_unit(headlines[brief].text, row["unit"]))
        if (quantity in page) == is_refused:
            yield "page", brief
        if row["kind"] == "parameter" and not is_refused and shown(of_json[brief]) != one:
            yield "JSON", brief
        if of_table and row["kind"] == "parameter":
            own = of_table.get(brief) or of_table[row["parameter"]]
            if shown(own | {"level": row["level"]}) != one:
                yield "tables", brief


ALIKE = ((0.4, 20.0),) * 4
DIFFERENT = ((0.4, 20.0), (0.5, 25.0), (0.3, 22.0), (0.45, 18.0))
CASES = {
    "two spots": {"search": LeastSquares()},
    "one spot": {"search": LeastSquares(), "spots": 1},
    "in kPa": {"search": LeastSquares(), "units": {STIFFNESS: "kPa"}},
    "a sweep": {},
    "a sweep at one spot": {"spots": 1},
    "four spots that share": {"search": LeastSquares(), "n_sets": 0, "own": ALIKE},
    "four spots that differ": {"search": LeastSquares(), "n_sets": 0, "own": DIFFERENT},
    "approximated": {"search": LeastSquares(), "n_sets": 0, "own": ALIKE[:1], "wave": 0.15},
    "refused": {"search": LeastSquares(), "n_sets": 0, "own": ALIKE[:1], "wave": 0.9},
    "cut at its range": {"search": LeastSquares(), "n_sets": 0, "own": ((0.995, 20.0),)},
}
MODELS = {"approximated": "approximates", "refused": "does not describe"}
DIFFER = ("two spots", "in kPa", "four spots that differ")


@pytest.mark.parametrize("case", CASES)
def test_outputs_agree_with_the_answer_of_the_run(run_of, tmp_path, case):
    run = run_of(**CASES[case])
    data = in_display_units(report_data(run))
    stored = run.table("answer", "answer")
    assert stored["reported"].any()
    sources = stored.filter("reported").select("spot", "scenario", "source").unique()
    assert sources.height == 1
    assert run.directory.records.is_current("answer")
    assert set(stored.filter("reported")["model"]) == {MODELS.get(case, "describes")}
    assert data.spots_differ("I") == (case in DIFFER)
    assert bool(cut_ends(data, data.estimates)) == (case == "cut at its range")

    # The table of the run is that of the page, in the units of the materials.
    factors = unit_factors(run.study)
    per = [factors.get(name.partition("@")[0], 1.0) for name in stored["parameter"]]
    is_parameter = pl.col("kind") == "parameter"
    values = (stored["value"] * pl.Series(per)).to_list()
    kept = [k for k, is_one in enumerate(stored.select(is_parameter).to_series()) if is_one]
    assert [values[k] for k in kept] == pytest.approx(data.answer.filter(is_parameter)["value"].to_list())
    words = ["spot", "scenario", "source", "parameter", "verdict", "marks", "reported"]
    assert stored.select(words).equals(data.answer.select(words))

    report = write_report(report_data(run), tmp_path / "page")
    assert list(disagreements(data, report, tmp_path / "page")) == []
    assert disagreeing_rows(data, tmp_path / "page") == []

    # Cards and notebooks have the values that are reported.
    found = {r["parameter"]: r for r in stored.filter("reported", is_parameter).to_dicts()}
    saved = SavedRun(run=run)
    assert saved.headline.values == {name: row["value"] for name, row in found.items()}
    in_words = pl.col("identifiability").replace("not", "not identified")
    assert saved.answer.equals(stored.filter("reported").with_columns(in_words))
    (card,) = cards_of(run)
    of_card = json.loads(PROGRAMS["json"](card))["parameters"]
    for name, row in found.items():
        brief = name.partition(".")[2]
        assert of_card[brief]["value"] == pytest.approx(row["value"])
        assert card.verdicts[brief] == row["verdict"]
        ends = (row["lower"], row["upper"]) if row["level"] else None
        assert card.intervals.get(brief) == (pytest.approx(ends) if ends else None)


@pytest.mark.parametrize("change", [refused, lambda data: at_end_of_range(data, STIFFNESS)])
def test_outputs_agree_on_values_that_are_no_results(content, tmp_path, change):
    data = change(content(search=LeastSquares()))
    report = write_report(data, tmp_path / "page")
    assert list(disagreements(data, report, tmp_path / "page")) == []
    own = data.answer.filter("reported", kind="parameter")
    assert set(own["marks"]) <= {"†", "‡", "†‡", ""}
    assert any(own["marks"])


def test_a_comparison_has_the_answer_of_each_run(content, tmp_path):
    made = content(search=LeastSquares())
    runs = {"one": made, "refused": refused(made), "a sweep": content()}
    write_comparison(runs, tmp_path)
    rows = table_of(tmp_path / "tables" / "parameters.csv")
    for name, data in runs.items():
        own = data.answer.filter("reported")
        found = [
            shown(row | {"level": row["lower"], "verdict": row["verdict"] or ""})
            for row in rows
            if row["run"] == name
        ]
        assert found == [shown(row) for row in own.to_dicts()], name


def test_a_disagreement_is_found(content, tmp_path):
    data = content(search=LeastSquares(), assessed=False)
    other = replace(data, fit=replace(data.fit, table=data.fit.table.with_columns(pl.col(STIFFNESS) * 1.5)))
    report = write_report(other, tmp_path / "page")
    found = {output for output, _ in disagreements(data, report, tmp_path / "page")}
    assert found == {"JSON", "terminal", "page", "methods"}
    places = {output for output, _ in disagreeing_rows(data, tmp_path / "page")}
    assert places == {"table 1", "LaTeX", "marks in LaTeX", "page"}
