"""Error sources: their columns, their sizes, and inputs that one of them has changed."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import (
    Curve,
    ParameterSpace,
    Refinement,
    RegionMaterial,
    Response,
    Simulation,
    Status,
)
from palpate.domain.channels import PRESS_AND_TWIST, TORQUE
from palpate.fit.parametrisation import StandardParametrisation, StandardSettings
from palpate.fit.spot_term import (
    Correction,
    along_slopes,
    is_along_slopes,
    is_same_job,
    pieces,
    steps_between,
)
from palpate.study.model import BudgetTable
from palpate_certainty.assessment import Assessment
from palpate_certainty.assumptions import ASSUMED
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
from palpate_materials.neo_hookean import NeoHookean

from .ogden_fit import BOTH, TRUTH, columns, simulated

BOTH_CHANNELS = {channel.name: channel for channel in PRESS_AND_TWIST}


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


def test_slopes_lead_to_a_deeper_press_of_one_depth(ended):
    problem = ended()[2].end.problem
    (term,) = problem.terms
    inputs = problem.inputs("p1", problem.point_of({}))
    depth_mm = term.protocol.only_depth_mm
    deeper, twice = (
        replace(inputs, protocol=replace(term.protocol, path=path))
        for path in (
            term.protocol.path + 0.1 * (term.protocol.path > 0.0) * (1, 0),
            [*term.protocol.path, (0.5 * depth_mm, 0.0)],
        )
    )
    assert is_along_slopes(inputs, deeper)
    assert not is_same_job(inputs, deeper)
    assert not is_along_slopes(inputs, twice)
    assert steps_between(inputs, deeper, term.materials) == {"depth_mm": pytest.approx(0.1)}
    x, z = np.linspace(0.0, depth_mm, 5), np.array([0.0, -10.0, 10.0])
    curves = {
        "force": Curve(
            channel="force", abscissa=x, ordinate=x**2, slopes={"depth_mm": 2.0 * x**2 / depth_mm}
        ),
        "torque": Curve(channel="torque", abscissa=z, ordinate=z, slopes={"depth_mm": 3.0 * z}),
    }
    job = term.job(inputs, 0, slopes=True, fine=False)
    here = Simulation(job=job, status=Status.OK, response=Response(curves=curves))
    force, torque = along_slopes(here, inputs, deeper, ["force", "torque"]).response.curves.values()
    np.testing.assert_allclose(force.abscissa, x * (1.0 + 0.1 / depth_mm))
    np.testing.assert_allclose(force.ordinate, force.abscissa**2, atol=0.011)
    np.testing.assert_allclose(torque.abscissa, z)
    np.testing.assert_allclose(torque.ordinate, 1.3 * z)


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
    assert shown == dict.fromkeys(BOTH, "the scatter of other meshes")


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
    shares = found["budget"].filter(parameter="tissue.c1", cause="mesh")["share"]
    words = dict(found["intervals"].select("parameter", "identifiability").iter_rows())
    assert shares[0] > 0.5
    errors = dict(
        found["mesh_errors"].filter(shown_by=shown_by).select("channel", "relative_error").iter_rows()
    )
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


@pytest.mark.parametrize(("data", "sd"), [("simulated", 0.1), ("measured", 0.5)])
def test_a_value_that_is_fixed_for_real_tissue_is_hardly_known(ended, data, sd):
    study, measured, *_ = ended()
    study = replace(study, data=data)
    sds = {cause.of: cause.sd for cause in error_sources_of(study, measured, [])}
    assert sds["tissue.kappa"] == sd
    stated = replace(study, budget=BudgetTable(parameters={"tissue.kappa": 0.2}))
    assert {c.of: c.sd for c in error_sources_of(stated, measured, [])}["tissue.kappa"] == 0.2


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
