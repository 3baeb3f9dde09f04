"""The first screen: the card, and the figures next to it."""

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from palpate.domain import ParameterSpace, Relaxation
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.catalogue import Plugins
from palpate.plugins.sections import Choice, Fold, Lines, Table, Word, rounded, shown
from palpate.study.reading import read_study
from palpate_report.answer.card import answer, apart_from_joint, title_of
from palpate_report.answer.failed_checks import apparent
from palpate_report.answer.law import typeset
from palpate_report.answer.next_step import CAUSES, COLOURS
from palpate_report.answer.result import Report, make_conclusion
from palpate_report.answer.warnings import report_warnings
from palpate_report.data.tables import make_tables, printed
from palpate_report.figures.drawings import interval_plot
from palpate_report.figures.panels import budget_bars, colour_of
from palpate_report.page.html import laid_out, render
from palpate_report.sections.fits import Values
from palpate_report.stage import summary_of

from .fits import at_end_of_range, refused, with_tables

TRUTH = {"soft_tissue.stiffness": 0.45, "soft_tissue.grip": 22.0}


@pytest.fixture
def fitted(content):
    return content(search=LeastSquares(), truth=TRUTH)


def passed(data):
    """The same fit, its model taken to describe the data."""
    fine = data.fit.adequacy.with_columns(verdict=pl.lit("describes"), message=pl.lit(""))
    known = data.fit.intervals.with_columns(identifiability=pl.lit("well"))
    return with_tables(data, adequacy=fine, intervals=known, between_spots=pl.DataFrame())


def test_spots_that_differ_have_a_standard_deviation_with_the_digits_of_its_interval(fitted):
    (spots,) = (text for name, text in card(fitted).facts if name == "Spots")
    rows = fitted.leading_rows(fitted.table("between_spots"))
    assert rows["parameter"].to_list() == list(TRUTH)
    for row in rows.to_dicts():
        assert rounded(row["sd"], row["lower"], row["upper"]) in spots
    assert "they differ, standard deviation between spots (95 % interval): stiffness = " in spots
    own = fitted.fit.intervals.filter(pl.col("fit").is_in(["p1", "p2"]), parameter=rows["parameter"][0])
    assert f", spots {min(own['value']):.3g} to {max(own['value']):.3g} MPa; " in spots
    assert make_conclusion(fitted, {}).lines(fitted.study)["Spots"] in spots


def test_spots_that_differ_much_are_no_refusal(fitted):
    """R² of the mean tells nothing of a model that fits each spot by values of its own."""
    fine = passed(fitted)
    assert make_conclusion(fine, {}).lead.startswith("One material for all 2 spots, ")
    fine = with_tables(fine, reported=fine.fit.reported.clear(), between_spots=fitted.table("between_spots"))

    def with_no_fit(where):
        table = fine.fit.table.with_columns(r2_force=pl.when(where).then(-3.0).otherwise("r2_force"))
        return replace(fine, fit=replace(fine.fit, table=table))

    far = with_no_fit(pl.col("fit") != pl.col("spot"))
    found = make_conclusion(far, {})
    assert not found.failure
    assert found.lead.startswith("Mean of 2 spots that differ, fitted to force + torque (scenario I): ")
    least = min(row["r2_force"] for row in fine.fit.of_each_spot.filter(scenario="I").to_dicts())
    assert f"each spot by its own fit, R² force at least {shown(least)}" in found.lead
    assert "no-fit" not in {warning.code for warning in report_warnings(far, {})}
    assert card(far).title.startswith("Spongy, the mean of 2 spots that differ: initial shear modulus ")
    # One spot that no values fit is a refusal.
    bad = with_no_fit(pl.col("fit") == "p1")
    assert "does not fit force at p1 (R² -3)" in make_conclusion(bad, {}).failure


def card(data):
    conclusion = make_conclusion(data, make_tables(data))
    return answer(data, conclusion)


def test_the_table_of_values_has_the_interval_of_each_modulus(fitted):
    data = passed(fitted)
    report = Report(tables={}, files=(), conclusion=make_conclusion(data, {}), pictures={})
    choice = next(block for block in Values().blocks(data, report) if isinstance(block, Choice))
    cells = {row[0]: row[1].values for row in choice.options[0].blocks[0].rows if isinstance(row[1], Lines)}
    for modulus in report.conclusion.moduli:
        assert cells[modulus.label][:2] == [modulus.text, modulus.interval]


def test_the_chart_shows_every_value_with_its_interval(fitted, content):
    for data, found in ((passed(fitted), "fit"), (content(), "set")):
        bests = [best for best in data.bests if best.found.startswith(found)]
        for k, axis in enumerate(interval_plot(data).axes):
            values = [best.values[k] for best in bests]
            drawn = [line.get_xdata() for line in axis.lines if line.get_label() != "true value"]
            assert [x[0] for x in drawn if len(x) == 1] == [value.value for value in values]
            ends = [[value.lower, value.upper] for value in values if value.lower is not None]
            assert [list(x) for x in drawn if len(x) == 2] == ends
            assert len(axis.patches) == (found == "fit")  # the joint fit is shaded


def test_no_interval_of_the_sweep_is_drawn_among_those_of_95_percent(fitted):
    data = passed(fitted)
    rows = data.fit.intervals.filter(pl.col("fit") != "p2")
    mixed = with_tables(data, intervals=rows)
    others = [value for best in mixed.bests for value in best.values if not value.level]
    assert any(value.lower is not None for value in others)
    n_drawn = sum(len(line.get_xdata()) == 2 for axis in interval_plot(mixed).axes for line in axis.lines)
    assert n_drawn == rows.height + len(mixed.searched)  # and the true values


def test_the_card_has_intervals_moduli_and_causes_of_the_fit_that_leads(fitted):
    data = passed(fitted)
    found = card(data)
    rows = data.fit.intervals.filter(fit="all spots", scenario="I").rows(named=True)
    assert found.is_sure
    assert [line.label for line in found.lines] == [
        "stiffness (MPa)", "grip (MPa)", "initial shear modulus (MPa)", "Young's modulus (MPa)",
    ]  # fmt: skip
    for line, row in zip(found.lines, rows, strict=False):
        assert (line.lower, line.value, line.upper) == (row["lower"], row["value"], row["upper"])
    # Energy θ0 Σ(λ − 1)²: the stiffness alone moves the shear modulus, and is as large.
    stiffness, modulus = found.lines[0], found.lines[2]
    assert (modulus.lower, modulus.upper) == pytest.approx((stiffness.lower, stiffness.upper))
    for _, causes in budget_bars(data):
        shares = [share for _, share in causes]
        assert shares == sorted(shares, reverse=True)
        assert 95.0 < sum(shares) < 100.5


def test_the_card_names_where_the_search_began(fitted):
    assert card(fitted).about.startswith("Searched from the sweep")
    design = replace(fitted.design, values=fitted.design.values[:0])
    bare = replace(fitted, design=design)  # whatever the study says: `--sets` may add some
    assert card(bare).about.startswith("Searched from the middle of the ranges")


def test_a_spot_apart_from_the_joint_fit_is_named(fitted):
    data = passed(fitted)
    rows = data.fit.intervals
    at = (pl.col("fit") == "p2") & (pl.col("scenario") == "I") & (pl.col("parameter") == "soft_tissue.grip")
    far = [
        pl.when(at).then(pl.col(end) + 1e3).otherwise(pl.col(end)).alias(end) for end in ("lower", "upper")
    ]
    for moved, apart in ((rows, {}), (rows.with_columns(far), {"p2": ["grip"]})):
        changed = with_tables(data, intervals=_wide(moved))
        assert apart_from_joint(changed) == apart
        (spots,) = (text for name, text in card(changed).facts if name == "Spots")
        assert ("p2 (grip)" if apart else "every spot agrees") in spots


def test_the_card_answers_in_one_sentence(fitted):
    data = passed(fitted)
    shear = card(data).lines[2]
    percent = 50.0 * (shear.upper - shear.lower) / shear.value
    assert card(data).title == (
        f"One Spongy material for all 2 spots: initial shear modulus {shear.text} MPa ± {percent:.0f} %"
    )
    words = (
        pl.when(pl.col("parameter") == "soft_tissue.grip").then(pl.lit("not")).otherwise("identifiability")
    )
    rows = data.fit.intervals.with_columns(identifiability=words)
    unknown = with_tables(data, intervals=rows)
    assert card(unknown).title.endswith("; grip is not identified by these presses")
    tables = make_tables(unknown)
    assert '<tr class="unknown"><th scope="row">grip' in render(
        unknown, tables, make_conclusion(unknown, tables), []
    )


def test_each_searched_region_is_named_with_its_law():
    plugins = Plugins.load()
    space = read_study(Path(plugins.studies["forearm-layered"].directory), plugins).space
    assert title_of(space, 1) == "Neo-Hookean skin and Yeoh soft tissue"
    assert title_of(space, 4) == "Neo-Hookean skin and Yeoh soft tissue, one set for all 4 spots"
    known = [replace(r, searched=(), fixed=dict.fromkeys(r.full_names, 1.0)) for r in space.regions]
    assert title_of(ParameterSpace(regions=tuple(known)), 1) == "Fixed material"
    assert title_of(ParameterSpace(regions=tuple(known)), 4) == "One fixed material for all 4 spots"


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_an_interval_that_the_search_range_cuts_is_marked(fitted, end):
    data = passed(fitted)
    assert card(data).cut == {}
    bound = getattr(data.searched["soft_tissue.grip"], end)
    is_grip = pl.col("parameter") == "soft_tissue.grip"
    cut = pl.when(is_grip).then(bound).otherwise(end).alias(end)
    rows = data.fit.intervals.with_columns(cut)
    found = card(with_tables(data, intervals=rows))
    assert found.cut == {"grip": f"{end} end cut by the search range"}


@pytest.mark.parametrize(
    ("formula", "html"),
    [
        ("Ψ = Σ_k c_k (Ĩ1 − 3)^k", "Ψ = Σ<sub>k</sub> c<sub>k</sub> (Ĩ<sub>1</sub> − 3)<sup>k</sup>"),
        ("λ̃1^m_k + κ/2 (ln J)²", "λ̃<sub>1</sub><sup>m<sub>k</sub></sup> + κ/2 (ln J)²"),
        ("μ / (2 b) (exp(b x) − 1) < 3", "μ / (2 b) (exp(b x) − 1) &lt; 3"),
    ],
)
def test_a_formula_has_raised_powers_and_lowered_indices(formula, html):
    assert str(typeset(formula)) == html


def test_the_chart_says_why_values_are_not_those_of_the_least_fopt(fitted):
    data = passed(fitted)
    tables = make_tables(data)
    said = "Circles are the most likely values under the error budget."
    pictures = {"intervals": b"<svg/>"}
    assert said in render(data, tables, make_conclusion(data, tables), [], pictures)
    bare = data.without_assessment()
    conclusion = make_conclusion(bare, make_tables(bare))
    page = render(bare, make_tables(bare), conclusion, [], pictures)
    assert said not in page
    assert "a range that fits about as well, not a 95 % interval" in page


def _wide(rows):
    """Intervals that all meet, unless they were moved far."""
    return rows.with_columns(lower=pl.col("lower") - 100.0, upper=pl.col("upper") + 100.0)


@pytest.mark.slow
def test_where_the_model_fails_a_banner_takes_the_place_of_parameters(fitted):
    fitted = refused(fitted)
    tables = make_tables(fitted)
    conclusion = make_conclusion(fitted, tables)
    assert conclusion.failure.startswith("No parameters can be read from this run: ")
    assert conclusion.warnings[0].what.startswith("The model ")
    page = render(fitted, tables, conclusion, [])
    assert f'<p class="banner" role="alert">{conclusion.failure[:60]}' in page
    assert 'class="answer"' not in page
    data = passed(fitted)
    page = render(data, make_tables(data), make_conclusion(data, {}), [])
    assert 'class="banner"' not in page
    assert 'class="answer"' in page


def relaxing(data, share):
    """The same run, its first spot's force fallen by a share of its peak in a rest of 1 s."""
    spot, response = next(iter(data.measured.items()))
    peak = float(abs(response["force"].ordinate).max())
    rest = Relaxation(
        channel="force",
        phase="dwell_1",
        duration_s=1.0,
        start_value=peak,
        fall=share * peak,
        fall_std=1e-3 * peak,
    )
    return replace(data, measured={**data.measured, spot: replace(response, relaxations=[rest])})


@pytest.mark.slow
def test_a_tissue_that_relaxed_has_apparent_moduli_below_a_banner(fitted):
    sentence = "The tissue at p1 relaxed by 12 % in 1 s; these are apparent moduli of this rate"
    data = relaxing(passed(fitted), 0.12)
    conclusion = make_conclusion(data, make_tables(data))
    assert conclusion.failure == ""
    assert f"{sentence}." in conclusion.sentences
    assert conclusion.warnings[0].what == sentence
    page = render(data, make_tables(data), conclusion, [])
    assert f'<p class="banner" role="alert">{sentence}.</p>' in page
    assert 'class="answer"' in page
    calm = relaxing(passed(fitted), 0.01)
    conclusion = make_conclusion(calm, make_tables(calm))
    assert not conclusion.apparent
    assert 'class="banner"' not in render(calm, make_tables(calm), conclusion, [])


def test_a_model_that_relaxes_in_all_that_is_weighed_has_no_apparent_moduli(fitted, monkeypatch):
    data = relaxing(fitted, 0.12)
    law = type(data.study.parametrisation)
    monkeypatch.setattr(law, "relaxing", frozenset({"force"}))
    assert apparent(data)
    monkeypatch.setattr(law, "relaxing", frozenset({"force", "torque"}))
    assert not apparent(data)


def test_the_failed_check_of_a_tissue_that_relaxed_takes_no_parameters_away(fitted):
    data = relaxing(passed(fitted), 0.12)
    row = data.fit.adequacy.head(1).with_columns(
        check=pl.lit("relaxation"), verdict=pl.lit("does not describe")
    )
    checks = pl.concat([data.fit.adequacy, row])
    words = data.fit.intervals.with_columns(identifiability=pl.lit("unclear"))
    data = with_tables(data, adequacy=checks, intervals=words)
    conclusion = make_conclusion(data, make_tables(data))
    assert conclusion.failure == ""
    assert {each.identifiability for each in conclusion.estimates} == {"unclear"}
    heads = [warning.what for warning in conclusion.warnings]
    assert heads[0].startswith("The tissue at p1 relaxed")
    assert not [what for what in heads if "does not describe" in what or "is unclear" in what]
    assert "relaxation" in make_tables(data)["inadequate"]["check"].to_list()


def test_warnings_of_what_leads_come_before_those_of_other_fits(fitted):
    data = at_end_of_range(passed(fitted), "soft_tissue.grip")
    ends = [w.why for w in make_conclusion(data, {}).warnings if "end of their range" in w.what]
    assert ends[0].startswith("grip at all spots, scenario I.")
    assert "grip at p1, scenario I" in ends[1]


def test_one_set_of_words_is_on_the_page_of_a_fit(fitted):
    data = passed(fitted)
    tables = make_tables(data)
    conclusion = make_conclusion(data, tables)
    row = data.fit.intervals.row(0, named=True)
    assert conclusion.identifiability[0] == (
        f"stiffness: {row['value']:.2f} MPa, 95 % interval {row['lower']:.2f} to {row['upper']:.2f} MPa; "
        "well identifiable."
    )
    (sweep,) = (made for made in laid_out(data, Report(tables=tables, files=(), conclusion=conclusion))
                if made.name == "identifiability")  # fmt: skip
    cells = [cell for block in sweep.blocks if isinstance(block, Table) for row in block.rows for cell in row]
    assert cells
    assert not [cell for cell in cells if isinstance(cell, Word)]


def test_a_cause_has_one_colour_whatever_its_rank(fitted):
    ranks = [[name for name, _ in causes] for _, causes in budget_bars(passed(fitted))]
    assert len({causes[0] for causes in ranks} | {causes[1] for causes in ranks}) > 1
    names = {name for causes in ranks for name in causes}
    assert len({colour_of(name) for name in names}) == len(names)
    assert len(set(COLOURS.values())) == len(CAUSES)


def test_causes_are_printed_side_by_side_in_percent(fitted):
    shares = printed("budget", fitted.table("budget"))
    assert shares.height == fitted.fit.intervals.height
    causes = shares.select(pl.exclude("fit", "scenario", "parameter"))
    assert causes.sum_horizontal().to_list() == pytest.approx([100.0] * shares.height, abs=0.5)


def said(data):
    """Lines of the terminal by their labels."""
    return summary_of(data.study, Report(conclusion=make_conclusion(data, {}), tables={})).labelled


def test_the_card_lists_what_no_interval_includes(fitted, monkeypatch):
    data = passed(fitted)
    study = data.study
    assert "Left out" not in dict(card(data).facts)
    monkeypatch.setattr(type(study.solver), "provides", replace(study.solver.provides, body="mesh"))
    assert dict(card(data).facts)["Left out"] == "errors of depth of the bone or base, position of the spots"
    assert said(data)["Left out"] == "errors of depth of the bone or base, position of the spots"
    (region,) = study.space.regions
    layered = replace(study.space, regions=(region, replace(region, region="skin")))
    assert (
        make_conclusion(replace(data, study=replace(study, space=layered)), {}).not_included[1]
        == "thickness of the layers"
    )
    budget = study.budget.model_copy(update={"friction": 0.0, "parameters": {"soft_tissue.bulk": 0.0}})
    stated = replace(data, study=replace(study, budget=budget))
    assert make_conclusion(stated, {}).not_included[2:] == (
        "friction (stated as exact)",
        "soft_tissue.bulk (stated as exact)",
    )


def test_a_cause_that_failed_is_on_the_card_and_a_warning(fitted):
    data = passed(fitted)
    lost = (
        data.table("budget")
        .filter(cause="gain")
        .with_columns(
            cause=pl.lit("onset p1"),
            status=pl.lit("p1: diverged: too deep"),
            share=pl.lit(None, pl.Float64),
            sd=pl.lit(None, pl.Float64),
        )
    )
    data = with_tables(data, budget=pl.concat([data.table("budget"), lost]))
    found = card(data)
    assert dict(found.facts)["Left out"] == "errors of onset p1 (failed)"
    warned = {each.what: each.why for each in make_conclusion(data, make_tables(data)).warnings}
    why = warned["Intervals leave out error sources that could not be simulated"]
    assert why.startswith("onset p1: p1: diverged: too deep.")
    assert all("onset p1" not in dict(causes) for _, causes in budget_bars(data))


def test_ranges_of_the_sweep_are_headed_by_what_they_are_and_say_not_identified(content):
    data = content()
    (section,) = (each for each in laid_out(data, Report.of(data)) if each.name == "identifiability")
    others = next(block for block in section.blocks if isinstance(block, Fold)).blocks[0]
    assert {"best set", "fitted optimum", "sets as good"} <= set(others.columns)
    words = {row[others.columns.index("identifiability")] for row in others.rows}
    assert words == {"well", "not identified"}


def test_the_ranges_of_the_sweep_have_the_digits_of_the_interval(content):
    data = content()
    ends = {"value": 13.9712, "optimum": 13.5123, "lower": 13.01234, "upper": 14.6321}
    known = data.table("identifiability").with_columns(pl.lit(end).alias(name) for name, end in ends.items())
    (section,) = (
        each
        for each in laid_out(data, Report.of(with_tables(data, identifiability=known)))
        if each.name == "identifiability"
    )
    table = next(block for block in section.blocks if isinstance(block, Table))
    shown = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    heads = ("best set", "fitted optimum", "lower", "upper")
    assert {tuple(row[head] for head in heads) for row in shown} == {("14.0", "13.5", "13.0", "14.6")}
