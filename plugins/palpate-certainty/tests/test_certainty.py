"""Intervals of fits of a tissue in closed form: causes, tables, and models that do not describe the data."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import palpate_report
from palpate.domain import (
    ParameterSpace,
    Refinement,
    RegionMaterial,
    Relaxation,
    Response,
    Simulation,
    Status,
)
from palpate.domain.channels import PRESS_AND_TWIST, TORQUE
from palpate.fit.fitted import Fitted
from palpate.fit.least_squares import LeastSquares
from palpate.fit.parametrisation import StandardParametrisation, StandardSettings
from palpate.fit.spot_term import Correction, is_along_slopes, is_same_job, pieces, steps_between
from palpate.plugins.catalogue import Plugins
from palpate.plugins.interfaces import SetFilter
from palpate.plugins.score import Score, ScoringRules
from palpate.plugins.search import Trial
from palpate.run.directory import RunDirectory
from palpate.run.result import FitResult, PosteriorResult
from palpate.stages import pipeline
from palpate.study.model import BudgetTable
from palpate_certainty.assessment import Assessment
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.emulated_curves import MeshCorrections, ScenarioDensity, SimulatedCurves
from palpate_certainty.error_sources import (
    MESH,
    ErrorSource,
    WithErrorSources,
    columns_of,
    drift_of,
    error_budget,
    error_sources_of,
    mesh_errors,
)
from palpate_certainty.mesh_error import N_SCATTER, N_SHAPES, SpotMesh, noted_errors
from palpate_certainty.tables import certainty_result
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden
from palpate_prediction.bands import values_at

TRUTH = np.array([0.08, 4.0])
BOTH = ("force", "torque")
BOTH_CHANNELS = {channel.name: channel for channel in PRESS_AND_TWIST}


@pytest.fixture
def ended(pressed, stage_of):
    """Fit curves of an Ogden tissue; returns the study, its measured curves, its case and its stage."""

    def made(material=None, searched=("c1", "m1"), truth=TRUTH, spots=("p1",), **changes):
        study = pressed.study_of(material or Ogden(), searched, spots=spots, **changes)
        source = pressed.study_of(Ogden(), ("c1", "m1"))
        measured = {
            spot: pressed.measured_at(source, truth, 0.004, seed) for seed, spot in enumerate(spots, 1)
        }
        stage = stage_of(study, measured)
        return study, measured, stage.run()[0], stage

    return made


def columns(case, *causes):
    return columns_of(case.end, causes, BOTH)[0]["p1", "force"]


def simulated(case):
    (term,) = case.end.problem.terms
    inputs = case.end.problem.inputs("p1", case.end.best.point)
    return case.end.problem.simulated(term, inputs)


def test_inputs_of_another_tilt_are_another_job(ended):
    problem = ended()[2].end.problem
    (term,) = problem.terms
    inputs = problem.inputs("p1", problem.point_of({}))
    tilted = replace(inputs, protocol=replace(term.protocol, tilt_deg=(2.0, 0.0)))
    assert is_same_job(inputs, inputs)
    assert not is_same_job(inputs, tilted)
    assert not is_along_slopes(inputs, tilted)


def test_inputs_of_a_stiffer_contact_are_another_job(ended):
    """Slopes lead to it, by the compliance of the contact."""
    problem = ended()[2].end.problem
    (term,) = problem.terms
    inputs = problem.inputs("p1", problem.point_of({}))
    stiffer = replace(inputs, protocol=replace(term.protocol, contact_penalty=2.0))
    assert not is_same_job(inputs, stiffer)
    assert is_along_slopes(inputs, stiffer)
    assert steps_between(inputs, stiffer, term.materials) == {"contact_compliance": -0.5}


def test_a_part_of_a_correction_by_a_rigid_contact_is_uncertain(ended):
    study, measured, case, _ = ended()
    (term,), residuals = case.end.problem.terms, case.end.best.residuals
    coarse = {name: curve.ordinate for name, curve in simulated(case).response.curves.items()}
    corrections = {
        name: Correction(added=0.01 * y, coarse=0.99 * y, contact=0.004 * y) for name, y in coarse.items()
    }
    found = error_budget(study, measured, [replace(term, corrections=corrections)], residuals, {}, {})
    for _, name, at, scale in pieces([term]):
        expected = ASSUMED.contact * 0.004 * (scale * coarse[name])[term.counted(name)]
        np.testing.assert_allclose(found["contact"]["contact"][at], expected, rtol=1e-3, atol=1e-9)


def test_a_gain_adds_its_share_of_the_curve(ended):
    *_, case, _ = ended()
    found, _ = columns_of(case.end, [ErrorSource(kind="gain", of="torque", sd=0.02)], BOTH)
    torque = simulated(case).response["torque"].ordinate
    np.testing.assert_allclose(found["p1", "torque"]["gain torque"], 0.02 * torque, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found["p1", "force"]["gain torque"], 0.0, atol=1e-12)


def test_the_mesh_adds_a_share_of_the_fitted_curve_without_noise(ended, monkeypatch):
    study, measured, case, _ = ended()
    provides = replace(study.solver.provides, body="mesh")
    monkeypatch.setattr(type(study.solver), "provides", provides)
    terms, curves = case.end.problem.terms, simulated(case).response
    found = error_budget(study, measured, terms, case.end.best.residuals, {}, {})[MESH]
    for term, name, at, scale in pieces(terms):
        usual = {"force": 0.03, "torque": 0.07}[name]
        expected = (usual * scale * curves[name].ordinate)[term.counted(name)]
        check_mesh_error(found, name, at, expected)


def check_mesh_error(found, channel, at, whole):
    """In part in proportion to the curve, in part varying along it; most of each common to all spots."""
    common, own = ([found[f"{of}{channel} {k}"][at] for k in range(1 + N_SHAPES)] for of in ("", "p1 "))
    assert np.sqrt(np.sum(np.square([*common, *own]))) == pytest.approx(np.linalg.norm(whole))
    share = ASSUMED.mesh_shared / (1.0 + ASSUMED.mesh_along**2)
    np.testing.assert_allclose(common[0], np.sqrt(share) * whole, rtol=1e-6, atol=1e-9)
    check_shared(common, own)


def check_shared(common, own):
    for one, other in zip(common, own, strict=True):
        np.testing.assert_allclose(other, np.sqrt(1.0 / ASSUMED.mesh_shared - 1.0) * one, atol=1e-12)


def test_force_and_torque_share_the_error_of_an_extrapolation(ended):
    study, measured, case, _ = ended()
    (term,), residuals = case.end.problem.terms, case.end.best.residuals
    coarse = {name: curve.ordinate for name, curve in simulated(case).response.curves.items()}
    added = {"force": -0.04 * coarse["force"], "torque": -1e-4 * coarse["torque"]}
    corrections = {name: Correction(added=added[name], coarse=y - added[name]) for name, y in coarse.items()}
    terms = [replace(term, corrections=corrections)]
    meshes = Refinement(ratio=2.0, at_rim=True)
    found = error_budget(study, measured, terms, residuals, {}, {"p1": SpotMesh(refinement=meshes)})[MESH]
    for _, name, at, scale in pieces(terms):
        convergence, inside = study.mesh_convergence(name), term.counted(name)
        share = meshes.left_over(convergence)
        left = ASSUMED.extrapolation * share / (1.0 + share) * added[name]
        np.testing.assert_allclose(found["extrapolation"][at], (scale * left)[inside], rtol=1e-6, atol=1e-12)
        common, own = ([found[f"{of}{name} {k}"][at] for k in range(N_SCATTER)] for of in ("", "p1 "))
        check_shared(common, own)
        largest = np.abs(measured["p1"][name].ordinate).max()
        size = convergence.scatter * largest * scale[inside]
        ratio = common[0] / (np.sqrt(ASSUMED.mesh_shared) * size)
        np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)  # the constant part: a share of the largest
        assert 1.0 / np.sqrt(N_SCATTER) < ratio[0] < 1.0


def test_the_scatter_of_a_small_curve_is_of_its_largest_value(ended):
    study, measured, case, _ = ended()
    (term,) = case.end.problem.terms
    nothing = {
        name: Correction(added=0.0 * y.ordinate, coarse=y.ordinate)
        for name, y in measured["p1"].curves.items()
    }
    terms, residuals = [replace(term, corrections=nothing)], np.empty_like(case.end.best.residuals)
    for _, name, at, scale in pieces(terms):
        residuals[at] = -0.6 * (scale * measured["p1"][name].ordinate)[term.counted(name)]
    meshes = {"p1": SpotMesh(refinement=Refinement(ratio=2.0, at_rim=True))}
    found = error_budget(study, measured, terms, residuals, {}, meshes)[MESH]
    errors = np.stack(list(found.values()), axis=1)
    shown = {row["channel"]: row["shown_by"] for row in mesh_errors(study, terms, residuals, errors, meshes)}
    assert shown == dict.fromkeys(BOTH, "usual scatter")


@pytest.mark.parametrize(
    ("budget", "has_fine_mesh", "word", "shown_by"),
    [
        ({}, False, "unclear", "one mesh"),
        ({"mesh": "7 %"}, False, "roughly", "the study"),
        ({}, True, "well", "two meshes"),
    ],
)
def test_the_usual_error_of_a_mesh_leaves_what_it_decides_unclear(
    ended, monkeypatch, budget, has_fine_mesh, word, shown_by
):
    """But for one that a study states, or that a finer mesh shows."""
    study, measured, case, _ = ended()
    provides = replace(study.solver.provides, body="mesh")
    monkeypatch.setattr(type(study.solver), "provides", provides)
    study = replace(study, budget=BudgetTable.model_validate(budget))
    if has_fine_mesh:
        (term,) = case.end.problem.terms
        nothing = {
            n: Correction(added=0.0 * y.ordinate, coarse=y.ordinate) for n, y in measured["p1"].curves.items()
        }
        monkeypatch.setattr(case.end.problem, "terms", (replace(term, corrections=nothing),))
    found = Assessment(study=study, measured=measured).run([case])
    shares = found.budget.filter(parameter="tissue.c1", cause="mesh")["share"]
    words = dict(found.intervals.select("parameter", "identifiability").iter_rows())
    assert shares[0] > 0.5
    errors = dict(found.mesh_errors.filter(shown_by=shown_by).select("channel", "relative_error").iter_rows())
    assert errors == pytest.approx({"force": 0.07 if budget else 0.03, "torque": 0.07})
    assert words["tissue.c1"] == word


def test_the_error_of_a_mesh_is_stated_or_noted_or_usual():
    coarse, fine = SpotMesh(edge_over_radius=0.5), SpotMesh(edge_over_radius=0.15)
    assert [coarse.error(name, of.mesh, {}) for name, of in BOTH_CHANNELS.items()] == [0.03, 0.07]
    assert [fine.error(name, of.mesh, {}) for name, of in BOTH_CHANNELS.items()] == [0.015, 0.035]
    assert fine.error("torque", TORQUE.mesh, {"": 0.02}) == 0.02
    assert fine.error("torque", TORQUE.mesh, {"torque": 0.02, "": 0.01}) == 0.02
    note = {"mesh_error": {"edge_over_radius": 0.3, "force": 0.01, "torque": None, "measured_on": "a limb"}}
    noted = SpotMesh(edge_over_radius=0.3, noted=noted_errors(note))
    assert [noted.error(name, of.mesh, {}) for name, of in BOTH_CHANNELS.items()] == [0.01, 0.07]
    assert noted_errors(None) == noted_errors({"mesh_error": "2 %"}) == {}
    locks = replace(noted, locking=0.1)
    found = [locks.error(name, of.mesh, {}) for name, of in BOTH_CHANNELS.items()]
    assert found == pytest.approx([0.11, 0.17])
    assert locks.error("torque", TORQUE.mesh, {"": 0.02}) == 0.02


def test_a_fixed_parameter_adds_its_slope(ended):
    study, *_, case, _ = ended()
    curve = simulated(case).response["force"]
    expected = 0.1 * study.space.complete({})["tissue.kappa"] * curve.slopes["tissue.kappa"]
    found = columns(case, ErrorSource(kind="fixed", of="tissue.kappa", sd=0.1))
    np.testing.assert_allclose(found["fixed tissue.kappa"], expected, rtol=1e-4)


def test_an_onset_adds_the_slope_along_the_depth(ended):
    *_, case, _ = ended()
    curve = simulated(case).response["force"]
    found = columns(case, ErrorSource(kind="onset", of="p1", sd=0.05, spots=("p1",)))["onset p1"]
    # Simulated curves are straight between their points, 0.5 mm apart.
    sides = np.diff(curve.ordinate) / np.diff(curve.abscissa)
    inside = 0.05 * (sides[1:] + sides[:-1]) / 2.0
    # The last measured point is deeper than this solver goes, and the others count for it.
    np.testing.assert_allclose(found[1:-1], inside, rtol=0.03)


def test_what_is_fitted_or_of_no_size_is_no_cause(ended, pressed):
    searched = StandardSettings.model_validate({"friction": {"lower": 0.2, "upper": 2.0}})
    study, measured, case, _ = ended(
        parametrisation=StandardParametrisation(searched), budget=BudgetTable(gain=0.0)
    )
    names = [p.name for p in case.end.problem.parameters]
    assert [c.name for c in error_sources_of(study, measured, names)] == ["onset p1", "fixed tissue.kappa"]


@pytest.mark.parametrize(("ratio", "sd"), [(0.3, 0.1), (0.48, 0.02 / 0.48), (-0.98, 0.02 / 0.98)])
def test_a_fixed_parameter_stays_physical_within_its_usual_error(ended, ratio, sd):
    study, measured, *_ = ended()
    material = NeoHookean()
    region = RegionMaterial(
        region="tissue", material=material, searched=material.parameters[:1], fixed={"nu": ratio}
    )
    study = replace(study, space=ParameterSpace(regions=(region,)))
    sds = {cause.of: cause.sd for cause in error_sources_of(study, measured, ["tissue.E"])}
    assert sds["tissue.nu"] == pytest.approx(sd)


def test_the_onset_is_as_uncertain_as_the_loader_found_it(ended):
    study, measured, *_ = ended()
    files = {"a": {"uncertainty": {"depth_mm": 0.03}}, "b": {"uncertainty": {"depth_mm": 0.04}}}
    logged = {"p1": replace(measured["p1"], record={"files": files})}
    sds = {c.kind: c.sd for c in error_sources_of(study, logged, [])}
    assert sds["onset"] == pytest.approx(np.hypot(0.03, 0.04) / np.sqrt(2.0))
    stated = replace(study, budget=BudgetTable.model_validate({"onset": "0.2 mm"}))
    assert {c.kind: c.sd for c in error_sources_of(stated, logged, [])}["onset"] == 0.2


def test_the_drift_is_as_uncertain_as_the_loader_found_it(ended):
    study, measured, *_ = ended()
    files = {"a": {"uncertainty": {"depth_mm": 0.03, "drift": {"force": 0.02}}}}
    logged = replace(measured["p1"], record={"files": files})
    assert drift_of(study, logged, "force") == pytest.approx(0.02)
    assert drift_of(study, logged, "torque") == drift_of(study, measured["p1"], "force") == 0.0
    stated = replace(study, budget=BudgetTable(zero=0.01))
    peak = np.abs(logged["force"].ordinate).max()
    assert drift_of(stated, logged, "force") == pytest.approx(0.01 * peak)


def test_a_tilt_has_two_directions_at_each_spot(ended):
    study, measured, case, _ = ended(spots=("p1", "p2"), budget=BudgetTable.model_validate({"tilt": "2 deg"}))
    tilts = [cause for cause in error_sources_of(study, measured, []) if cause.kind == "tilt"]
    assert [cause.of for cause in tilts] == ["p1 x", "p1 y", "p2 x", "p2 y"]
    assert {cause.label for cause in tilts} == {"tilt"}
    problem = case.end.problem
    both = WithErrorSources(problem.parametrisation, tilts)
    values = dict(zip(problem.names, TRUTH.tolist(), strict=True))
    values |= {"tilt p1 x": 1.0, "tilt p1 y": -0.5, "tilt p2 x": 0.0, "tilt p2 y": 0.0}
    at = {spot: both.inputs(study.space, spot, study.protocol, values).protocol for spot in ("p1", "p2")}
    assert at["p1"].tilt_deg == (2.0, -1.0)
    assert at["p2"].tilt_deg == (0.0, 0.0)


def test_a_solver_without_slopes_has_the_same_causes_by_differences(ended, pressed):
    study, measured, case, _ = ended()
    plain = replace(study, solver=pressed.Pressed(pressed.PressedSettings(exact=False)))
    causes = error_sources_of(study, measured, [])
    assert error_sources_of(plain, measured, []) == causes
    assert {"gain", "onset", "friction", "fixed"} == {c.kind for c in causes}
    exact = columns(case, *causes)
    simulate, stage = case.end.problem.simulate, pressed.Here(plain.solver)
    case.end.problem.study, case.end.problem.simulate = plain, stage.of
    found = columns(case, *causes)
    case.end.problem.study, case.end.problem.simulate = study, simulate
    np.testing.assert_allclose(found["fixed tissue.kappa"], exact["fixed tissue.kappa"], rtol=0.01)


@pytest.fixture
def assessed(ended):
    study, measured, case, _ = ended(spots=("p1", "p2"))
    return Assessment(study=study, measured=measured).run([case])


def test_tables_have_a_row_of_each_parameter_with_its_causes(assessed):
    found = assessed
    assert found.intervals["parameter"].to_list() == ["tissue.c1", "tissue.m1"]
    for row in found.intervals.iter_rows(named=True):
        assert row["lower"] < row["value"] < row["upper"]
        assert row["upper"] - row["lower"] > row["noise_upper"] - row["noise_lower"]
        assert row["identifiability"] in ("well", "roughly", "poorly", "not")
        of_it = found.budget.filter(parameter=row["parameter"])
        assert of_it["share"].sum() == pytest.approx(1.0)
        assert {"noise", "model", "gain", "onset", "tissue.kappa"} <= set(of_it["cause"])
    assert found.parameter_combinations.height == 2
    assert set(found.adequacy["verdict"]) == {"describes"}
    assert set(found.adequacy["check"]) == {"discrepancy", "spots", "ranges"}


def test_intervals_hold_the_truth(assessed):
    for row, truth in zip(assessed.intervals.iter_rows(named=True), TRUTH, strict=True):
        assert row["lower"] < truth < row["upper"]


def test_most_likely_values_have_the_intervals_and_draws_of_their_own(ended):
    budget = BudgetTable.model_validate({"friction": 0.3})
    study, measured, case, _ = ended(spots=("p1", "p2"), budget=budget)
    found = Assessment(study=study, measured=measured).run([case])
    row = {"fit": "all spots", "scenario": "I", "fopt": 0.1} | case.values()
    table = pl.DataFrame([row | {"spot": spot} for spot in study.spot_names])
    fit = FitResult(table=table, certainty=found)
    least, likely = fit.table.row(0, named=True), fit.joint("I").row(0, named=True)
    for row, truth in zip(found.intervals.iter_rows(named=True), TRUTH, strict=True):
        name, width = row["parameter"], row["upper"] - row["lower"]
        assert likely[name] == row["value"] != least[name]
        assert row["lower"] < truth < row["upper"]
        assert 0.0 < row["noise_upper"] - row["noise_lower"] < width
        assert found.draws[name].mean() == pytest.approx(row["value"], abs=0.1 * width)
    names, spots = case.end.problem.names, study.spot_names
    values = {name: likely[name] for name in names}
    of_joint = Fitted(source="fit", fit="all spots", scenario="I", values=values, spots=spots)
    bands_from = values_at("p1", of_joint, fit, PosteriorResult()).draws
    assert bands_from == found.draws.select(names).to_dicts()


@pytest.mark.parametrize("is_far", [False, True])
def test_another_material_approximates_the_data_or_does_not_describe_them(ended, monkeypatch, is_far):
    if is_far:
        monkeypatch.setattr("palpate_certainty.adequacy.MOST_DIFFERENCE", 0.01)
    study, measured, case, _ = ended(NeoHookean(), ("E", "nu"), truth=np.array([0.08, 7.5]))
    found = Assessment(study=study, measured=measured).run([case])
    failed = found.adequacy.filter(pl.col("verdict") != "describes")
    assert "discrepancy" in failed["check"].to_list()
    assert "more than the 2 % that the budget allows" in failed["message"][0]
    assert set(failed["verdict"]) == {"does not describe" if is_far else "approximates"}
    assert ("unclear" in set(found.intervals["identifiability"])) == is_far
    row = found.adequacy.filter(check="discrepancy", channel="force").row(0, named=True)
    assert 0.01 < row["difference"] < 0.2
    assert 0.9 < row["r2"] < 1.0


def test_a_tissue_that_relaxes_fails_the_check_and_its_words_are_unclear(ended):
    study, measured, case, _ = ended()
    rest = Relaxation(
        channel="force", phase="dwell_1", duration_s=1.0, start_value=10.0, fall=1.2, fall_std=0.02
    )
    rested = {"p1": replace(measured["p1"], relaxations=[rest])}
    found = Assessment(study=study, measured=rested).run([case])
    row = found.adequacy.filter(check="relaxation").row(0, named=True)
    assert row["verdict"] == "does not describe"
    assert row["message"].endswith("% in 1 s; these are apparent moduli of this rate")
    assert set(found.intervals["identifiability"]) == {"unclear"}
    calm = {"p1": replace(measured["p1"], relaxations=[replace(rest, fall=0.01)])}
    found = Assessment(study=study, measured=calm).run([case])
    row = found.adequacy.filter(check="relaxation").row(0, named=True)
    assert (row["verdict"], row["message"]) == ("describes", "")
    assert "unclear" not in set(found.intervals["identifiability"])


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
    found = certainty_result(assessed, study)
    assert notes.texts == [
        "warning: intervals and posteriors are of first order, since score 'logarithm' is not linear in the "
        "curves; how well parameters are identified is unclear"
    ]
    assert set(found.intervals["identifiability"]) == {"unclear"}
    assert (found.budget["status"] == "'logarithm' is not linear in the curves: first order").any()
    names = found.intervals["parameter"].to_list()
    truth = dict(zip(("tissue.c1", "tissue.m1"), TRUTH, strict=True))
    for name, lower, upper in found.intervals.select("parameter", "lower", "upper").iter_rows():
        assert lower < truth[name] < upper, (name, lower, upper)
    assert set(names) == set(truth)
    # The emulated misfit is that of the score itself.
    simulated = SimulatedCurves(case.end.problem, BOTH)
    values = case.end.problem.box.values(case.end.best.point)
    density = ScenarioDensity(case.end.problem, np.eye(case.end.problem.n_points), simulated, values)
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
        density = ScenarioDensity(corrected, np.eye(problem.n_points), curves, values)
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
    MeshCorrections(corrected, fitted)
    assert (np.array(asked) <= fitted).all()
    assert (np.array(asked) >= fitted - 0.02 * (box.upper - box.lower)).all()


def test_a_score_whose_residuals_mix_points_has_no_intervals_and_the_reason(ended, notes):
    study, measured, case, _ = ended(scoring=ScoringRules(score=Summed()))
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found.intervals.is_empty()
    assert "no intervals: residuals of score 'summed' depend on other points" in notes.texts[-1]


class Crowded(SetFilter):
    name, summary = "crowded", "rejects sets that come in hundreds, as those of a density do"

    def accept(self, space, values):
        return np.full(len(values), len(values) < 100)


def test_filters_that_reject_all_that_describes_the_curves_leave_no_intervals_and_the_reason(ended, notes):
    study, measured, case, _ = ended()
    case.end.problem.study = replace(study, filters=(Crowded(),))
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found.intervals.is_empty()
    assert "filters reject all 1,024 values that describe the curves as well as the fit" in notes.texts[-1]


def test_where_slopes_fail_at_the_fit_there_are_no_intervals_and_no_error(ended, notes):
    study, measured, case, stage = ended()
    simulate = stage.simulations.of
    case.end.problem.simulate = lambda jobs: [
        Simulation(job=each.job, status=Status.DIVERGED, response=None, message="too deep")
        for each in simulate(jobs)
    ]
    found = Assessment(study=study, measured=measured, progress=notes).run([case])
    assert found.intervals.is_empty()
    assert "no intervals: the error budget cannot be simulated" in notes.texts[-1]


def test_where_the_tangent_is_singular_at_the_fit_intervals_are_those_of_differences(ended):
    study, measured, case, stage = ended()
    exact = Assessment(study=study, measured=measured).run([case]).intervals
    simulate = stage.simulations.of

    def bare(simulation):
        curves = simulation.response.curves.items()
        plain = {name: replace(curve, slopes={}) for name, curve in curves}
        return replace(simulation, response=replace(simulation.response, curves=plain))

    case.end.problem.simulate = lambda jobs: [bare(each) for each in simulate(jobs)]
    case.end.trace.clear()
    found = Assessment(study=study, measured=measured).run([case])
    assert (found.budget["cause"] == "tissue.kappa").any()
    for end in ("lower", "upper"):
        np.testing.assert_allclose(found.intervals[end], exact[end], rtol=2e-3)


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
    lost = found.budget.filter(pl.col("status") != "included")
    assert set(lost["cause"]) == {"onset p1"}
    assert set(lost["status"]) == {"p1: diverged: too deep"}
    assert set(lost["fit"]) == {"all spots", "p1"}  # the other spot does not have it
    assert lost.select("share", "sd").null_count().row(0) == (lost.height, lost.height)
    words = {fit: set(rows["identifiability"]) for (fit,), rows in found.intervals.group_by("fit")}
    assert words["all spots"] == words["p1"] == {"unclear"} != words["p2"]
    kept = found.budget.filter(status="included")
    assert {"friction", "tissue.kappa", "gain"} & set(kept["cause"]) == {"tissue.kappa", "gain"}
    for fit, causes in (("p1", {"onset"}), ("all spots", set())):
        of_fit, before = (set(rows.filter(fit=fit)["cause"]) for rows in (kept, whole.budget))
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
    assert found.intervals.is_empty()
    assert "2 measured points for 2 parameters" in notes.texts[-1]


@pytest.mark.slow
@pytest.mark.usefixtures("one_figure")
def test_a_run_keeps_its_intervals(make_study, plugins, tmp_path):
    study = make_study(n_sets=0, search=LeastSquares())
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    kept = RunDirectory(tmp_path / "run").fit().certainty
    fits = result.fit.table.select("fit", "scenario").n_unique()
    assert kept.intervals.height == 2 * fits
    for name in ("intervals", "budget", "parameter_combinations", "adequacy"):
        assert getattr(kept, name).equals(getattr(result.fit.certainty, name))
    assert "intervals" in result.report.tables


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_without_the_plugin_a_run_ends_after_its_fit_and_its_words_are_unclear(make_study, plugins, tmp_path):
    study = make_study(search=LeastSquares())
    others = Plugins.load(study.plugin_files, entry_points=False, modules=[palpate_report])
    with_it, without = (pipeline.run_study(study, tmp_path / "run", each) for each in (plugins, others))
    assert with_it.fit.certainty.intervals.height
    assert without.fit.table.equals(with_it.fit.table)
    assert without.fit.certainty.intervals.is_empty()
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
    of_fit = assessment._linearised(case, *assessment.columns(case), None)
    box = case.end.problem.box
    values = box.lower + (box.upper - box.lower) * found.point
    (there,) = case.end.problem.evaluate([Trial(point=box.point(values), slopes=True)])
    white, slopes = of_fit.white @ there.residuals, of_fit.white @ there.jacobian
    assert np.abs(slopes.T @ white).max() < 1e-3 * np.linalg.norm(white) * np.linalg.norm(slopes)
