"""Intervals of fits of a tissue in closed form: causes, tables, and models that do not describe the data."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import palpate_report
from palpate.api.fit import THRESHOLDS, Adequacy
from palpate.domain import (
    Relaxation,
    Response,
    Simulation,
    Status,
)
from palpate.fit.fitted import Fitted
from palpate.fit.least_squares import LeastSquares
from palpate.fit.spot_term import Correction
from palpate.plugins.catalogue import Plugins
from palpate.plugins.interfaces import SetFilter
from palpate.plugins.score import Score, ScoringRules
from palpate.plugins.search import Trial
from palpate.run.directory import RunDirectory
from palpate.run.result import FitResult
from palpate.stages import pipeline
from palpate.study.model import BudgetTable
from palpate_certainty.adequacy import Closeness, checks
from palpate_certainty.assessment import Assessment
from palpate_certainty.emulated_curves import EmulatedProblem, SimulatedCurves
from palpate_certainty.tables import certainty_tables
from palpate_materials.neo_hookean import NeoHookean
from palpate_prediction.bands import values_at

from .ogden_fit import BOTH, TRUTH, simulated


@pytest.fixture
def assessed(ended):
    study, measured, case, _ = ended(spots=("p1", "p2"))
    return Assessment(study=study, measured=measured).run([case])


def test_tables_have_a_row_of_each_parameter_with_its_causes(assessed):
    found = assessed
    assert found["intervals"]["parameter"].to_list() == ["tissue.c1", "tissue.m1"]
    for row in found["intervals"].iter_rows(named=True):
        assert row["lower"] < row["value"] < row["upper"]
        assert row["identifiability"] in ("well", "roughly", "poorly", "not")
        of_it = found["budget"].filter(parameter=row["parameter"])
        assert of_it["share"].sum() == pytest.approx(1.0)
        assert {"noise", "model", "gain", "onset", "tissue.kappa"} <= set(of_it["cause"])
    assert found["parameter_combinations"].height == 2
    assert set(found["adequacy"]["verdict"]) == {"describes"}
    assert set(found["adequacy"]["check"]) == {"discrepancy", "shape", "spots", "ranges"}


def test_intervals_hold_the_truth(assessed):
    for row, truth in zip(assessed["intervals"].iter_rows(named=True), TRUTH, strict=True):
        assert row["lower"] < truth < row["upper"]


def test_most_likely_values_have_the_intervals_and_draws_of_their_own(ended):
    budget = BudgetTable.model_validate({"friction": 0.3})
    study, measured, case, _ = ended(spots=("p1", "p2"), budget=budget)
    found = Assessment(study=study, measured=measured).run([case])
    row = {"fit": "all spots", "scenario": "I", "fopt": 0.1} | case.values()
    table = pl.DataFrame([row | {"spot": spot} for spot in study.spot_names])
    fit = FitResult(table=table, intervals=found["intervals"], adequacy=found["adequacy"])
    least, likely = fit.table.row(0, named=True), fit.joint("I").row(0, named=True)
    for row, truth in zip(found["intervals"].iter_rows(named=True), TRUTH, strict=True):
        name, width = row["parameter"], row["upper"] - row["lower"]
        assert likely[name] == row["value"] != least[name]
        assert row["lower"] < truth < row["upper"]
        assert found["draws"][name].mean() == pytest.approx(row["value"], abs=0.1 * width)
    names, spots = case.end.problem.names, study.spot_names
    values = {name: likely[name] for name in names}
    of_joint = Fitted(source="fit", fit="all spots", scenario="I", values=values, spots=spots)
    bands_from = values_at("p1", of_joint, lambda name: found.get(name, pl.DataFrame())).draws
    assert bands_from == found["draws"].select(names).to_dicts()


@pytest.mark.parametrize("is_far", [False, True])
def test_another_material_approximates_the_data_or_does_not_describe_them(ended, monkeypatch, is_far):
    if is_far:
        closer = replace(THRESHOLDS, close_difference=0.01)
        monkeypatch.setattr("palpate_certainty.adequacy.THRESHOLDS", closer)
    study, measured, case, _ = ended(NeoHookean(), ("E", "nu"), truth=np.array([0.08, 7.5]))
    found = Assessment(study=study, measured=measured).run([case])
    failed = found["adequacy"].filter(pl.col("verdict") != "describes")
    assert "discrepancy" in failed["check"].to_list()
    assert "more than the 2 % that the budget allows" in failed["message"][0]
    assert set(failed["verdict"]) == {"does not describe" if is_far else "approximates"}
    assert ("unclear" in set(found["intervals"]["identifiability"])) == is_far
    row = found["adequacy"].filter(check="discrepancy", channel="force").row(0, named=True)
    assert 0.01 < row["difference"] < 0.2
    assert 0.9 < row["r2"] < 1.0


def test_a_tissue_that_relaxes_fails_the_check_and_its_words_are_unclear(ended):
    study, measured, case, _ = ended()
    rest = Relaxation(
        channel="force", phase="dwell_1", duration_s=1.0, start_value=10.0, fall=1.2, fall_std=0.02
    )
    rested = {"p1": replace(measured["p1"], relaxations=[rest])}
    found = Assessment(study=study, measured=rested).run([case])
    row = found["adequacy"].filter(check="relaxation").row(0, named=True)
    assert row["verdict"] == "does not describe"
    assert row["message"].endswith("% in 1 s; these are apparent moduli of this rate")
    assert set(found["intervals"]["identifiability"]) == {"unclear"}
    calm = {"p1": replace(measured["p1"], relaxations=[replace(rest, fall=0.01)])}
    found = Assessment(study=study, measured=calm).run([case])
    row = found["adequacy"].filter(check="relaxation").row(0, named=True)
    assert (row["verdict"], row["message"]) == ("describes", "")
    assert "unclear" not in set(found["intervals"]["identifiability"])


class Logarithm(Score):
    """Errors relative to each ordinate, from a tenth of the largest one on."""

    name, summary = "logarithm", "logarithm of simulated over measured"

    def weights(self, measured):
        y = np.abs(measured.ordinate)
        return (y > 0.1 * y.max()).astype(float)

    def residuals(self, measured, simulated, used):
        least = 1e-3 * np.abs(measured.ordinate).max()
        here, there = (np.maximum(np.abs(y), least) for y in (simulated, measured.ordinate))
        return np.log(here / there) / np.sqrt(used.sum())


class Summed(Logarithm):
    name = "summed"

    def residuals(self, measured, simulated, used):
        return np.cumsum(super().residuals(measured, simulated, used), axis=-1)


def test_a_score_that_is_not_linear_has_intervals_of_first_order_and_unclear_words(ended, notes):
    study, measured, case, _ = ended(scoring=ScoringRules(score=Logarithm()))
    certainty = Assessment(study=study, measured=measured, progress=notes)
    assessed = certainty.assessed([case])
    found = certainty_tables(assessed, study)
    assert notes.texts == [
        "warning: intervals and posteriors are of first order, since score 'logarithm' is not linear in the "
        "curves; how well parameters are identified is unclear"
    ]
    assert set(found["intervals"]["identifiability"]) == {"unclear"}
    assert (found["budget"]["status"] == "'logarithm' is not linear in the curves: first order").any()
    names = found["intervals"]["parameter"].to_list()
    truth = dict(zip(("tissue.c1", "tissue.m1"), TRUTH, strict=True))
    for name, lower, upper in found["intervals"].select("parameter", "lower", "upper").iter_rows():
        assert lower < truth[name] < upper, (name, lower, upper)
    assert set(names) == set(truth)
    # The emulated misfit is that of the score itself.
    simulated = SimulatedCurves(case.end.problem, BOTH)
    values = case.end.problem.box.values(case.end.best.point)
    density = EmulatedProblem(case.end.problem, simulated, values)
    runs = simulated.runs(case.end.best.point[None] + np.array([[0.0, 0.0], [0.05, -0.03]]), slopes=False)
    fopts = [
        each.fopt
        for each in case.end.problem.evaluate(
            [Trial(point=p) for p in case.end.best.point[None] + np.array([[0.0, 0.0], [0.05, -0.03]])]
        )
    ]
    np.testing.assert_allclose(density.misfit(runs.values, runs.ordinates), fopts, rtol=1e-9)


def test_emulated_curves_are_corrected_as_those_of_the_fit_are(ended):
    _, _, case, _ = ended()
    problem, base = case.end.problem, case.end.problem.inputs("p1", case.end.best.point)
    (term,), rng = problem.terms, np.random.default_rng(1)
    corrections = {
        name: Correction(
            added=0.03 * curve.ordinate,
            coarse=curve.ordinate,
            slopes={f"tissue.{of}": rng.normal(size=curve.ordinate.size) for of in ("c1", "m1")},
            base=base,
        )
        for name, curve in simulated(case).response.curves.items()
    }
    corrected = problem.restated([replace(term, corrections=corrections)])
    points = rng.uniform(0.2, 0.8, (5, 2))
    curves = SimulatedCurves(problem, BOTH)
    runs = curves.runs(points, slopes=False)
    expected = [each.residuals for each in corrected.evaluate([Trial(point=p) for p in points])]
    for values in (problem.box.values(case.end.best.point), problem.box.lower, problem.box.upper):
        density = EmulatedProblem(corrected, curves, values)
        found = density.white(runs.values, runs.ordinates)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_what_meshes_add_is_asked_for_at_the_fit_alone(ended, monkeypatch):
    """In the middle of their ranges, shares that relax may sum to more than 1."""
    _, _, case, _ = ended()
    problem, asked = case.end.problem, []
    (term,), curves = problem.terms, simulated(case).response.curves
    inputs = problem.inputs("p1", case.end.best.point)
    corrections = {name: Correction(added=c.ordinate, coarse=c.ordinate) for name, c in curves.items()}
    corrected = problem.restated([replace(term, corrections=corrections)])
    monkeypatch.setattr(type(problem), "inputs_at", lambda _, __, at: asked.append(at) or inputs)
    box = problem.box
    fitted = box.upper
    EmulatedProblem(corrected, SimulatedCurves(problem, BOTH), fitted)
    assert (np.array(asked) <= fitted).all()
    assert (np.array(asked) >= fitted - 0.02 * (box.upper - box.lower)).all()


def test_a_score_whose_residuals_mix_points_has_no_intervals_and_the_reason(ended, notes):
    study, measured, case, _ = ended(scoring=ScoringRules(score=Summed()))
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found["intervals"].is_empty()
    assert "no intervals: residuals of score 'summed' depend on other points" in notes.texts[-1]


class Crowded(SetFilter):
    name, summary = "crowded", "rejects sets that come in hundreds, as those of a density do"

    def accept(self, space, values):
        return np.full(len(values), len(values) < 100)


def test_filters_that_reject_all_that_describes_the_curves_leave_no_intervals_and_the_reason(ended, notes):
    study, measured, case, _ = ended()
    case.end.problem.study = replace(study, filters=(Crowded(),))
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found["intervals"].is_empty()
    assert "filters reject all 1,024 values that describe the curves as well as the fit" in notes.texts[-1]


def test_where_slopes_fail_at_the_fit_there_are_no_intervals_and_no_error(ended, notes):
    study, measured, case, stage = ended()
    simulate = stage.simulations.of
    case.end.problem.simulate = lambda jobs: [
        Simulation(job=each.job, status=Status.DIVERGED, response=None, message="too deep")
        for each in simulate(jobs)
    ]
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found["intervals"].is_empty()
    assert "no intervals: the error budget cannot be simulated" in notes.texts[-1]


def test_where_the_tangent_is_singular_at_the_fit_intervals_are_those_of_differences(ended):
    study, measured, case, stage = ended()
    exact = Assessment(study=study, measured=measured).run([case])["intervals"]
    simulate = stage.simulations.of

    def bare(simulation):
        curves = simulation.response.curves.items()
        plain = {name: replace(curve, slopes={}) for name, curve in curves}
        return replace(simulation, response=replace(simulation.response, curves=plain))

    case.end.problem.simulate = lambda jobs: [bare(each) for each in simulate(jobs)]
    case.end.trace.clear()
    found = Assessment(study=study, measured=measured).run([case])
    assert (found["budget"]["cause"] == "tissue.kappa").any()
    for end in ("lower", "upper"):
        np.testing.assert_allclose(found["intervals"][end], exact[end], rtol=2e-3)


def failing_deeper_than(most_mm, spot, simulate):
    def simulated(jobs):
        return [
            Simulation(job=job, status=Status.DIVERGED, response=None, message="too deep")
            if job.protocol.path[:, 0].max() > most_mm and job.spot == spot
            else simulation
            for job, simulation in zip(jobs, simulate(jobs), strict=True)
        ]

    return simulated


@pytest.mark.slow
def test_a_cause_that_cannot_be_simulated_is_left_out_alone_and_leaves_the_words_unclear(ended, notes):
    study, measured, _, stage = ended(spots=("p1", "p2"))
    cases = [case for case in stage._cases if case.scenario.name == "I"]
    whole = Assessment(study=study, measured=measured).run(cases)
    for case in cases:
        case.end.problem.simulate = failing_deeper_than(10.0, "p1", stage.simulations.of)
    found = Assessment(study=study, measured=measured, progress=notes).run(cases)
    assert notes.texts == ["warning: intervals are without the cause 'onset p1': p1: diverged: too deep"]
    lost = found["budget"].filter(pl.col("status") != "included")
    assert set(lost["cause"]) == {"onset p1"}
    assert set(lost["status"]) == {"p1: diverged: too deep"}
    assert set(lost["fit"]) == {"all spots", "p1"}  # the other spot does not have it
    assert lost.select("share", "sd").null_count().row(0) == (lost.height, lost.height)
    words = {fit: set(rows["identifiability"]) for (fit,), rows in found["intervals"].group_by("fit")}
    assert words["all spots"] == words["p1"] == {"unclear"} != words["p2"]
    kept = found["budget"].filter(status="included")
    assert {"friction", "tissue.kappa", "gain"} & set(kept["cause"]) == {"tissue.kappa", "gain"}
    for fit, causes in (("p1", {"onset"}), ("all spots", set())):
        of_fit, before = (set(rows.filter(fit=fit)["cause"]) for rows in (kept, whole["budget"]))
        assert before - of_fit == causes
    for _, rows in kept.group_by("fit", "parameter"):
        assert rows["share"].sum() == pytest.approx(1.0)


def test_fewer_points_than_parameters_have_no_interval(ended, notes):
    study, measured, case, _ = ended()
    few = [
        replace(term, measured=Response(curves={"force": term.measured["force"].cut(slice(17, 19))}))
        for term in case.end.problem.terms
    ]
    short = [replace(term, weights={"force": 1.0}) for term in few]
    case.end.problem.terms = tuple(short)
    case.end.trace.clear()
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found["intervals"].is_empty()
    assert "2 measured points for 2 parameters" in notes.texts[-1]


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_run_keeps_its_intervals(make_study, plugins, tmp_path):
    study = make_study(n_sets=0, search=LeastSquares())
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    kept = RunDirectory(tmp_path / "run")
    fits = result.fit.table.select("fit", "scenario").n_unique()
    assert kept.fit().intervals.height == 2 * fits
    for name in ("intervals", "budget", "parameter_combinations", "adequacy"):
        assert kept.table(name).height
    assert kept.fit().intervals.equals(result.fit.intervals)
    assert "intervals" in result.report.tables


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_without_the_plugin_a_run_ends_after_its_fit_and_its_words_are_unclear(make_study, plugins, tmp_path):
    study = make_study(search=LeastSquares())
    others = Plugins.load(study.plugin_files, entry_points=False, modules=[palpate_report])
    with_it, without = (pipeline.run_study(study, tmp_path / "run", each) for each in (plugins, others))
    assert with_it.fit.intervals.height
    assert without.fit.table.equals(with_it.fit.table)
    assert without.fit.intervals.is_empty()
    assert {each.identifiability for each in without.report.conclusion.estimates} == {"unclear"}


def test_curves_on_a_mesh_are_linear_around_the_fit_and_of_a_relaxing_tissue_once_more(ended, monkeypatch):
    study, measured, case, _ = ended()
    assessment = Assessment(study=study, measured=measured)
    columns = assessment.columns(case)
    monkeypatch.setattr(type(study.solver), "provides", replace(study.solver.provides, body="mesh"))
    of_fit = assessment.assess(case, *columns)
    monkeypatch.setattr(type(study.parametrisation), "times_s", {"relaxed.1s": 1.0})
    again = assessment.assess(case, *columns)
    np.testing.assert_allclose(again.linear.point, of_fit.point, rtol=1e-9)
    assert np.abs(of_fit.linear.point - of_fit.point).max() > 1e-6
    assert again.misfits == of_fit.misfits


def test_without_a_mesh_the_most_likely_values_are_those_of_simulated_curves(ended):
    """The misfit that weighs residuals by their errors has no slope there."""
    study, measured, case, _ = ended()
    assessment = Assessment(study=study, measured=measured)
    found = assessment.assess(case, *assessment.columns(case))
    np.testing.assert_allclose(found.linear.point, found.point, rtol=1e-9)
    columns, failures = assessment.columns(case)
    of_fit = assessment._weighed(case, assessment._points(case.end, columns, None, None), failures, None)
    box = case.end.problem.box
    values = box.lower + (box.upper - box.lower) * found.point
    (there,) = case.end.problem.evaluate([Trial(point=box.point(values), slopes=True)])
    white, slopes = of_fit.white @ there.residuals, of_fit.white @ there.jacobian
    assert np.abs(slopes.T @ white).max() < 1e-3 * np.linalg.norm(white) * np.linalg.norm(slopes)


@pytest.mark.parametrize(("difference", "verdict"), [(0.1, Adequacy.APPROXIMATES), (0.3, Adequacy.FAILS)])
def test_values_at_the_end_of_a_range_approximate_curves_that_they_are_close_to(difference, verdict):
    close = {0: Closeness(difference=difference, r2=0.99)}
    found = {each.name: each.verdict for each in checks({}, {}, close, (0.5, {}), None, 1e-6)}
    assert found["ranges"] is verdict
