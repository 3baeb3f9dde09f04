"""Runs side by side: their parameters, and criteria where they describe the same curves."""

import html
import re
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Indentation, Response
from palpate.domain.indenter import Sphere
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation
from palpate.run.result import FitResult
from palpate_report.comparison import (
    TOO_FEW,
    _independent,
    _notes,
    comparison_tables,
    named,
    other_rates,
    press_durations_s,
    same_curves,
    write_comparison,
)
from palpate_report.figures import drawings


@pytest.fixture
def fitted(content):
    """A run with a fit, of noisy curves."""
    made = content(search=LeastSquares(), n_sets=20)
    noise = np.random.default_rng(1)
    measured = {
        spot: Response(
            curves={
                name: replace(c, ordinate=c.ordinate + noise.normal(0.0, np.ptp(c.ordinate), c.ordinate.size))
                for name, c in response.curves.items()
            }
        )
        for spot, response in made.measured.items()
    }
    return replace(made, measured=measured)


@pytest.fixture
def swept(content):
    """A run of few sets without a fit."""
    return content(n_sets=12)


def without_fit(data):
    return replace(data, fit=FitResult())


def other_limb(data):
    curves = {name: replace(c, ordinate=2.0 * c.ordinate) for name, c in data.measured["p1"].curves.items()}
    return replace(data, measured={**data.measured, "p1": Response(curves=curves)})


def test_runs_have_the_values_and_intervals_of_their_joint_fit(fitted):
    table = comparison_tables({"fit": fitted, "sweep": without_fit(fitted)})["parameters"]
    joint = fitted.fit.intervals.filter(fit="all spots", scenario="I", parameter="soft_tissue.grip")
    row = table.filter(run="fit", parameter="grip").row(0, named=True)
    assert (row["value"], row["lower"], row["upper"]) == joint.select("value", "lower", "upper").row(0)
    row = table.filter(run="sweep", parameter="grip").row(0, named=True)
    assert (row["value"], row["lower"]) == (fitted.generalisation["soft_tissue.grip"][0], None)


def test_a_figure_has_the_parameters_of_runs_side_by_side(fitted):
    runs = {"fit": fitted, "sweep": without_fit(fitted)}
    table = comparison_tables(runs)["parameters"]
    figure = drawings.draw_parameters(runs)
    panels = {axis.get_xlabel(): axis for axis in figure.axes}
    assert len(panels) == table.n_unique("parameter")
    axis = next(axis for label, axis in panels.items() if label.startswith("grip"))
    assert [label.get_text() for label in axis.get_yticklabels()][:2] in (["fit", "sweep"], ["", ""])
    row = table.filter(run="fit", parameter="grip").row(0, named=True)
    interval, value, other = (line.get_xdata() for line in axis.lines)
    assert list(interval) == [row["lower"], row["upper"]]
    assert list(value) == [row["value"]]
    assert list(other) == [fitted.generalisation["soft_tissue.grip"][0]]


def test_criteria_prefer_the_better_fit_and_share_the_weight_between_equals(fitted):
    runs = {"sweep": without_fit(fitted), "fit": fitted}
    table = comparison_tables(runs)["criteria"]
    assert table["run"].to_list() == ["fit", "sweep"]
    assert table["difference"][0] == 0.0 < table["difference"][1]
    assert table["weight"].sum() == pytest.approx(1.0)
    equals = comparison_tables({"one": fitted, "two": fitted})["criteria"]
    assert equals["weight"].to_list() == [0.5, 0.5]
    assert set(equals["meaning"]) == {"as good as the best"}


def test_few_independent_points_decide_nothing(fitted, monkeypatch):
    runs = {"sweep": without_fit(fitted), "fit": fitted}
    enough = comparison_tables(runs)["criteria"]
    assert TOO_FEW not in set(enough["meaning"])
    monkeypatch.setattr("palpate_report.comparison.FEWEST_POINTS", 1e6)
    tables = comparison_tables(runs)
    assert set(tables["criteria"]["meaning"]) == {TOO_FEW}
    assert tables["criteria"]["weight"].null_count() == 2
    assert any("decide nothing here" in note for note in _notes(tables, runs, laws=False))


def test_criteria_that_disagree_are_reported(fitted):
    runs = {"sweep": without_fit(fitted), "fit": fitted}
    tables = comparison_tables(runs)
    assert not any("AICc and BIC disagree" in note for note in _notes(tables, runs, laws=False))
    other = tables["criteria"].with_columns(bic=-pl.col("bic"), difference_bic=pl.lit(0.0))
    notes = list(_notes(tables | {"criteria": other}, runs, laws=False))
    assert "AICc and BIC disagree: fit by AICc, sweep by BIC. Read neither as a choice." in notes


def test_a_parameter_that_changes_no_curve_costs_something(fitted):
    class OneMore(StandardParametrisation):
        def parameters(self, space, spots):
            return (*space.parameters, *space.parameters[:1])

    idle = replace(fitted, study=replace(fitted.study, parametrisation=OneMore()))
    table = comparison_tables({"more": idle, "less": fitted})["criteria"]
    assert table["run"].to_list() == ["less", "more"]
    assert table["bic"][1] > table["bic"][0]


def test_limbs_have_no_criteria(swept):
    limbs = {"one": swept, "two": other_limb(swept)}
    assert not same_curves(limbs)
    assert set(comparison_tables(limbs)) == {"parameters", "errors"}


def timed(data, press_s):
    """A run whose motion has times, and presses in this one."""
    path = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 0.0)])
    times = None if press_s is None else np.array([0.0, press_s, press_s + 1.0])
    motion = Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=0.5, time_s=times)
    spots = tuple(replace(spot, protocol=motion) for spot in data.study.spots)
    return replace(data, study=replace(data.study, spots=spots))


class AllRelax(StandardParametrisation):
    times_s = MappingProxyType({"relaxed.1s": 1.0})


def test_moduli_of_other_rates_are_not_compared(swept):
    slow, fast, unknown = timed(swept, 8.0), timed(swept, 1.0), timed(swept, None)
    runs = {"slow": slow, "fast": fast, "unknown": unknown}
    table = comparison_tables(runs)["parameters"]
    words = {
        (row["run"], row["parameter"]): "other rate" in row["verdict"] for row in table.iter_rows(named=True)
    }
    assert words["slow", "stiffness"]
    assert words["fast", "stiffness"]
    assert not words["unknown", "stiffness"]
    (sentence,) = (n for n in _notes(comparison_tables(runs), runs, laws=False) if "not comparable:" in n)
    assert "slow pressed in 8 s; fast pressed in 1 s. A model without time finds apparent" in sentence
    assert other_rates({"slow": slow, "less": timed(swept, 4.0), "unknown": unknown}) == (frozenset(), "")


def test_runs_of_the_same_two_rates_are_compared(swept, monkeypatch):
    durations = iter(([1.0, 10.0], [1.0, 10.0], [1.0, 10.0], [10.0, 10.0]))
    monkeypatch.setattr("palpate_report.comparison.press_durations_s", lambda _: next(durations))
    runs = {"a": swept, "b": swept}
    assert other_rates(runs) == (frozenset(), "")
    assert other_rates(runs)[0] == {"a", "b"}


def test_moduli_at_once_are_not_compared_with_apparent_ones(swept):
    study = replace(swept.study, parametrisation=AllRelax())
    at_once, apparent = replace(swept, study=study), timed(swept, 5.0)
    names, sentence = other_rates({"a": at_once, "b": apparent})
    assert names == {"a", "b"}
    assert "b pressed in 5 s; a relaxes, with moduli at once." in sentence
    assert other_rates({"a": at_once, "c": at_once}) == other_rates({"a": at_once, "d": swept})


def test_a_log_has_the_times_of_its_press(swept):
    response = swept.measured["p1"]
    force = response.curves["force"]
    curve = replace(force, time_s=np.linspace(3.0, 7.0, force.abscissa.size))
    logged = replace(swept, measured={**swept.measured, "p1": Response(curves={"force": curve})})
    assert press_durations_s(swept) == []
    assert press_durations_s(logged) == [pytest.approx(4.0)]


@given(st.integers(3, 40), st.integers(1, 30))
def test_a_point_that_is_repeated_counts_about_once(n, times):
    once = [np.random.default_rng(n).normal(size=20 * n)]
    again = [np.repeat(once[0], times)]
    assert _independent(again) <= _independent(once) * 1.2


def test_a_run_is_named_by_its_material_or_by_its_folder(swept):
    assert list(named({Path("runs/a"): swept})) == ["Spongy"]
    assert list(named({Path("runs/a"): swept, Path("runs/b"): swept})) == ["a", "b"]
    assert list(named({Path("x/a"): swept, Path("y/a"): swept})) == ["x/a", "y/a"]


@pytest.mark.slow
def test_the_page_holds_the_tables_and_the_figure_and_asks_no_network(swept, tmp_path):
    made = write_comparison({"<b>one": swept, "two": other_limb(swept)}, tmp_path)
    page = (tmp_path / "index.html").read_text()
    policy = re.search('Policy" content="([^"]*)"', page)[1]
    assert "&lt;b&gt;one" in page
    assert "<b>one" not in page
    assert html.unescape(policy).startswith("default-src 'none'")
    assert "AICc and BIC are left out: the runs were fitted to different curves or channels." in page
    assert ": simulated data, not a measurement.</p>" in page
    # One column for each run.
    heads = re.findall('<th scope="col"[^>]*>([^<]*)</th>', page[: page.index("Errors of each run")])
    assert heads == ["parameter", "&lt;b&gt;one", "two"]
    assert all(path.is_file() for path in made["files"])
    assert (tmp_path / "tables" / "paper_table1.tex").read_text().count("multicolumn{6}") == 2
