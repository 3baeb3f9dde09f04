"""The line on what to do next names the cause that widens the worst interval, and what reduces it."""

import html
import re
from dataclasses import replace

import polars as pl
import pytest

from palpate.api import Indentation
from palpate.api.fit import ALL_SPOTS, Adequacy
from palpate.domain.indenter import Sphere
from palpate.fit.least_squares import LeastSquares
from palpate.study.model import BudgetTable
from palpate_report.answer.next_step import (
    AFTER_REFUSAL,
    CAUSES,
    REMEDIES,
    SETTINGS,
    WRITE_UP,
    next_step,
    typed,
)
from palpate_report.answer.result import Report, make_conclusion
from palpate_report.data.marks import with_minus
from palpate_report.page.html import render
from palpate_report.stage import summary_of

from .fits import at_end_of_range, refused, with_tables

WORST, OTHER = "soft_tissue.grip", "soft_tissue.stiffness"


@pytest.fixture
def fitted(content):
    """A fit whose model describes the data; the interval of one of its two parameters is wide."""
    data = content(search=LeastSquares(), truth={OTHER: 0.45, WORST: 22.0})
    return with_words(data, {OTHER: "roughly", WORST: "poorly"})


def with_words(data, words):
    is_worst = pl.col("parameter") == WORST
    known = data.fit.intervals.with_columns(
        lower=pl.when(is_worst).then(pl.col("value") * 0.1).otherwise(pl.col("value") * 0.9),
        upper=pl.when(is_worst).then(pl.col("value") * 1.9).otherwise(pl.col("value") * 1.1),
        identifiability=pl.col("parameter").replace(words),
    )
    fine = data.fit.adequacy.with_columns(verdict=pl.lit("describes"), message=pl.lit(""))
    return with_tables(data, intervals=known, adequacy=fine)


def because(data, cause, share=0.58):
    """The data with a budget in which one cause of the wide interval leads; of the other one it is noise."""
    rows = [(WORST, cause, share), (WORST, "other", 1.0 - share - 0.01), (OTHER, "noise", 1.0)]
    budget = pl.DataFrame(
        [
            {"fit": ALL_SPOTS, "scenario": "I", "parameter": name, "cause": of, "share": part,
             "sd": part, "status": "included"}
            for name, of, part in rows
        ]
    )  # fmt: skip
    return with_tables(data, budget=budget)


def pressed(data, **changes):
    """The data of a study that presses with a sphere."""
    protocol = Indentation(indenter=Sphere(radius_mm=7.5), path=[[0.0, 0.0], [10.0, 0.0]], friction=1.0)
    return replace(data, study=replace(data.study, protocol=protocol, **changes))


def said(data):
    return make_conclusion(data, {}).next_step


def again(data):
    """The command after a change of the study."""
    return typed("then `palpate run {run} --go-on`", data)


def rank(data):
    return f"`palpate next {data.folder} --for {WORST}`"


@pytest.mark.parametrize(("folder", "shown"), [("arm", "arm"), ("a b/arm", "'a b/arm'"), ("/x/y", "/x/y")])
def test_commands_name_the_folder_of_the_run(fitted, monkeypatch, tmp_path, folder, shown):
    monkeypatch.chdir(tmp_path)
    data = replace(because(pressed(fitted), "range"), folder=tmp_path / folder)
    assert said(data).endswith(f"`palpate next {shown} --for {WORST}`")
    assert said(replace(data, unfinished="2 of 3")) == f"finish the run: `palpate run {shown}`"


def test_advice_names_a_study_file_of_another_name(fitted, monkeypatch, tmp_path):
    """The run is continued by its own folder, which knows the file."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "my fp" / "soft.toml"
    ended = at_end_of_range(because(fitted, "friction"), WORST)
    study = replace(ended.study, file=file, plugin_files=())
    data = replace(ended, study=study, folder=tmp_path / "runs" / "x")
    assert said(data) == "widen the range of grip in soft.toml, then `palpate run runs/x --go-on`"
    assert (
        typed(AFTER_REFUSAL["ranges"], data)
        == "widen the ranges in soft.toml, then `palpate run runs/x --go-on`"
    )
    assert typed(AFTER_REFUSAL["specimen"], data).endswith(
        "`palpate compare 'my fp/soft.toml' --materials all`"
    )
    lab = replace(data, study=replace(data.study, plugin_files=(tmp_path / "lab.py",)))
    assert "`palpate --plugin lab.py compare 'my fp/soft.toml'" in typed(AFTER_REFUSAL["specimen"], lab)
    file.parent.mkdir()
    file.write_text('[study]\nplugins = ["../lab.py"]\n')
    assert "`palpate compare 'my fp/soft.toml'" in typed(AFTER_REFUSAL["specimen"], lab)
    whole = replace(data, study=replace(data.study, file=file.with_name("study.toml")))
    assert typed(AFTER_REFUSAL["specimen"], whole).endswith("`palpate compare 'my fp' --materials all`")


def budgeted(data, **keys):
    """The data of a study whose budget states these keys."""
    return replace(data, study=replace(data.study, budget=BudgetTable(**keys)))


def checked(data, probability, failed=()):
    """The data of a fit whose curves miss so probably, and which has failed some checks."""
    about = {"fit": ALL_SPOTS, "scenario": "I", "channel": "force", "probability": probability}
    words = {name: "does not describe" if name in failed else "describes" for name in CHECKS}
    rows = [about | {"check": k, "verdict": words[k], "message": f"{k} is bad"} for k in CHECKS]
    return with_tables(data, adequacy=pl.DataFrame(rows))


CHECKS = ("discrepancy", "ranges")


@pytest.mark.parametrize("cause", sorted(REMEDIES))
def test_each_cause_has_its_remedy_with_its_share_the_parameter_and_its_setting(fitted, cause):
    data = because(budgeted(fitted), cause)
    basis = f" that `[budget] {SETTINGS[cause]}` has by default" if cause in SETTINGS else ""
    remedy = typed(REMEDIES[cause], data)
    assert said(data) == f"grip is limited by {CAUSES[cause]}{basis}: 58 % of its variance; {remedy}"
    if cause in SETTINGS:
        stated = budgeted(
            data, **{SETTINGS[cause]: "1 deg" if cause == "tilt" else STATED.get(cause, "1 mm")}
        )
        assert f" that `[budget] {SETTINGS[cause]}` states: 58 % " in said(stated)


STATED = dict.fromkeys(("gain", "zero", "friction"), "2 %") | {"layers": 0.2}


def test_a_first_contact_that_the_log_shows_is_no_default(fitted):
    files = {"p1.csv": {"uncertainty": {"depth_mm": 0.02}}}
    measured = {n: replace(r, record={**r.record, "files": files}) for n, r in fitted.measured.items()}
    data = because(replace(budgeted(fitted), measured=measured), "onset")
    assert said(data).startswith(
        "grip is limited by first contact, as the log shows it: 58 % of its variance"
    )
    assert "`[budget] onset` states: 58 %" in said(budgeted(data, onset="1 mm"))


def test_a_thickness_that_a_spot_states_is_not_of_the_budget(fitted):
    (first, *others) = fitted.study.spots
    spots = (replace(first, layers_mm={"skin": (1.6, 0.2)}), *others)
    data = because(replace(fitted, study=replace(fitted.study, spots=spots)), "layers")
    assert said(data).startswith(f"grip is limited by {CAUSES['layers']} that `[spot.layers]` states: 58 %")


@pytest.mark.parametrize("probability", [0.06, 0.3, 0.9])
def test_a_model_that_passes_its_checks_is_not_to_be_changed(fitted, probability):
    data = checked(because(budgeted(pressed(fitted), discrepancy={"force": "1 %", "torque": "3 %"}), "model"),
                   probability)  # fmt: skip
    assert said(data) == (
        "grip is limited by model error that `[budget] discrepancy` states (force 1 %, torque 3 %): 58 % of "
        f"its variance; rank further presses: {rank(data)}"
    )
    test = replace(data, study=replace(data.study, protocol=None))
    assert said(test).endswith("; measure another kind of test")


def test_a_smaller_model_error_is_not_proposed_where_the_curves_show_a_larger_one(fitted):
    step = said(checked(because(pressed(fitted), "model"), 0.01))
    assert "more than `[budget] discrepancy` states" in step
    assert "smaller" not in step
    assert "material" not in step


@pytest.mark.parametrize("failed", CHECKS)
def test_after_a_refusal_the_check_that_failed_decides(fitted, failed):
    data = checked(pressed(fitted), 1e-9, [failed])
    assert make_conclusion(data, {}).failure
    assert said(data) == typed(AFTER_REFUSAL[failed], data)
    assert ("compare other laws" in said(data)) == (failed == "discrepancy")
    test = replace(data, study=replace(data.study, protocol=None))
    assert said(test) == typed(AFTER_REFUSAL["specimen" if failed == "discrepancy" else failed], data)


@pytest.mark.parametrize(("of_spots", "is_of_law"), [("describes", False), ("approximates", True)])
def test_another_law_is_proposed_where_a_spot_alone_is_not_described(fitted, of_spots, is_of_law):
    data = because(pressed(fitted), "onset")
    is_together = pl.col("fit") == data.together
    verdict = pl.when(is_together).then(pl.lit("approximates")).otherwise(pl.lit(of_spots))
    data = with_tables(data, adequacy=data.fit.adequacy.with_columns(verdict=verdict))
    assert set(data.fit.adequacy.filter(~is_together)["check"]) >= {"discrepancy"}
    step = next_step(data, make_conclusion(data, {}).estimates, model=Adequacy.APPROXIMATES)
    assert ("compare other laws" in step) == is_of_law
    assert (REMEDIES["onset"] in step) != is_of_law


def test_a_fit_that_misses_everything_asks_for_units_and_columns(fitted):
    nothing = pl.lit(0.1)
    table = fitted.fit.table.with_columns(r2_force=nothing, r2_torque=nothing)
    reported = fitted.fit.reported.clear()
    data = replace(fitted, fit=replace(fitted.fit, table=table, reported=reported))
    assert said(data) == typed(AFTER_REFUSAL[""], data)


def test_every_cause_in_words_is_answered(fitted):
    for cause in CAUSES:
        assert "elsewhere" not in said(because(pressed(fitted), cause))


def test_a_mesh_that_leads_is_refined_by_the_setting_that_is_missing(fitted):
    first = because(pressed(fitted, fine_runs=0), "mesh")
    assert said(first).endswith(
        f'; set `fine_runs = 1` and `fine_edge = "1.7 mm"` in `[fit]`, {again(first)}'
    )
    for edge_mm, then in ((2.0, "1.4 mm"), (None, "1.2 mm")):
        spots = tuple(replace(spot, fine_edge_mm=edge_mm) for spot in fitted.study.spots)
        finer = because(pressed(fitted, spots=spots, fine_runs=1), "mesh")
        assert said(finer).endswith(f'; set `fine_edge = "{then}"` in `[fit]`, {again(finer)}')


def test_a_mesh_that_a_run_refines_by_itself_may_have_more_nodes_or_errs_as_meshes_do(fitted):
    spots = tuple(replace(spot, fine_edge_mm=None) for spot in fitted.study.spots)
    data = because(pressed(fitted, spots=spots, fine_runs=1, fine_nodes=20_000), "mesh")
    refined = replace(data, fit=replace(data.fit, mesh=pl.DataFrame({"coarse": [1.0]})))
    assert said(refined).endswith(f"; raise `fine_nodes` (20,000) in `[fit]`, {again(refined)}")
    row = {"fit": ALL_SPOTS, "scenario": "I", "spot": "p1", "channel": "force", "relative_error": 0.003}
    table = pl.DataFrame([row]).with_columns(shown_by=pl.lit("the scatter of other meshes"))
    scattered = with_tables(refined, mesh_errors=table)
    assert said(scattered).endswith(f"; rank further presses: {rank(refined)}")


def test_the_error_of_the_meshes_has_a_line_with_the_interval_that_it_decides_most(fitted):
    data = because(fitted, "mesh")
    errors = [("p1", "force", 0.003), ("p1", "torque", 0.0071), ("p2", "torque", 0.009)]
    rows = [
        {"fit": ALL_SPOTS, "scenario": "I", "spot": spot, "channel": channel, "relative_error": error}
        for spot, channel, error in errors
    ]
    table = pl.DataFrame(rows).with_columns(shown_by=pl.lit("two meshes"))
    found = make_conclusion(with_tables(data, mesh_errors=table), {})
    line = "error 0.9 % in torque, 0.3 % in force (from two meshes); 58 % of the variance of grip"
    assert found.lines(data.study)["Mesh"] == line
    assert "Mesh" not in make_conclusion(data, {}).lines(data.study)


@pytest.mark.parametrize("cause", ["range", "priors"])
def test_a_parameter_that_the_curves_do_not_know_needs_another_press_or_test(fitted, cause):
    data = because(fitted, cause)
    test = replace(data, study=replace(data.study, protocol=None))
    why = "is known by its prior alone" if cause == "priors" else "hardly changes the curves"
    assert said(test) == f"grip {why}: measure another kind of test"
    assert rank(data) in said(pressed(data))


def test_a_fixed_parameter_that_leads_is_to_be_measured(fitted):
    step = said(because(fitted, "soft_tissue.kappa"))
    assert step.startswith("grip is limited by soft_tissue.kappa: 58 % of its variance; ")
    assert "`[budget.parameters]`" in step


def test_where_all_is_known_it_is_to_be_written_up(fitted):
    known = with_words(fitted, {OTHER: "well", WORST: "well"})
    assert said(because(known, "mesh")) == typed(WRITE_UP, fitted)


def test_a_range_that_ends_too_early_comes_before_every_cause(fitted):
    ended = at_end_of_range(because(fitted, "friction"), WORST)
    assert said(ended).startswith("widen the range of grip ")
    # What the curves do not tell ends somewhere, whatever the range.
    assert "widen" not in said(with_words(ended, {OTHER: "well", WORST: "not"}))


def test_without_a_result_it_says_what_is_missing(content, fitted):
    data = refused(content(search=LeastSquares()))
    assert make_conclusion(data, {}).failure
    assert said(data) in [typed(each, data) for each in AFTER_REFUSAL.values()]
    assert "palpate run" in said(replace(fitted, unfinished="2 of 3"))
    assert "least_squares" in said(content())


def test_page_terminal_and_json_have_the_same_line(fitted):
    data = because(fitted, "friction")
    report = Report(tables={}, conclusion=make_conclusion(data, {}))
    step = report.conclusion.next_step
    summary = summary_of(data.study, report)
    assert dict(summary.labelled)["Next"] == summary.values["next"] == step
    shown = re.sub("<[^>]+>", "", render(data, {}, report.conclusion, []))
    assert with_minus(step.replace("`", "")) in html.unescape(shown)
