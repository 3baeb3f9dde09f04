"""A coarse mesh with a known error, corrected by a few runs of a finer one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from hypothesis.extra.numpy import arrays

from palpate.domain import Curve, Indentation, Refinement, Response, Simulation, Status
from palpate.domain.channels import FORCE, LATERAL_FORCE, TORQUE
from palpate.domain.indenter import Sphere
from palpate.fit.alike import changed_like
from palpate.fit.mesh_correction import (
    MOVED_ERROR,
    NEAR,
    EndSlopes,
    FineRun,
    errors_of,
    fine_run,
)
from palpate.fit.problem import Problem
from palpate.fit.spot_term import Correction, NotRankedError
from palpate.fit.stage import Case
from palpate.fit.tables import _mesh
from palpate.plugins.interfaces import Solver
from palpate.plugins.parametrisation import SpotInputs
from palpate.study.model import BudgetTable
from palpate_materials.relaxation import FORCE_OVER_TIME
from palpate_materials.uncoupled import Ogden

TRUTH = np.array([0.08, 4.0])
NAMES = ("tissue.c1", "tissue.m1")


class Softening(Solver):
    """Its coarse mesh is the stiffer the larger the exponent m1 is: corrections of other sets are wrong."""

    name, summary = "softening", "strips whose coarse mesh depends on the material"

    def __init__(self, exact):
        super().__init__()
        self.exact, self.provides = exact, exact.provides

    def simulate(self, job, limb):
        found = self.exact.simulate(job, limb)
        if job.mesh:
            return found
        m1, curves = job.thetas["tissue"][1], {}
        for name, curve in found.response.curves.items():
            stiffer = 0.3 * np.sqrt(np.abs(curve.abscissa) / np.abs(curve.abscissa).max()) * (m1 / 4.0) ** 2
            slopes = {of: (1.0 + stiffer) * each for of, each in curve.slopes.items()}
            if slopes:
                slopes["tissue.m1"] = slopes["tissue.m1"] + curve.ordinate * stiffer * 2.0 / m1
            curves[name] = replace(curve, ordinate=(1.0 + stiffer) * curve.ordinate, slopes=slopes)
        return replace(found, response=Response(curves=curves))


@pytest.fixture
def fit(pressed, stage_of, notes):
    """Fit curves of a fine mesh with a coarse one that is 5 to 10 % stiffer; returns stage and cases."""

    def made(spots=("p1",), fine=("p1",), solver=None, noise=0.0, refinement=None, **changes):
        coarse = solver or pressed.Pressed(pressed.PressedSettings(stiffer=0.05))
        study = pressed.study_of(Ogden(), ("c1", "m1"), solver=coarse, spots=spots, **changes)
        exact = replace(study, solver=pressed.Pressed(pressed.PressedSettings(stiffer=0.05)))
        measured = pressed.measured_at(exact, TRUTH, noise=noise, fine=True)
        stage = stage_of(study, measured, {f"{spot}/fine": None for spot in fine})
        stage.progress, stage.refinement = notes, refinement or {}
        return stage, stage.run()

    return made


def errors(values):
    return np.abs(np.array([values[name] for name in NAMES]) / TRUTH - 1.0)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_corrected_fit_has_the_truth_of_the_fine_mesh(fit, noise):
    stage, (case,) = fit(noise=noise)
    assert errors(case.coarse).max() > 0.05
    assert errors(case.values()).max() < (0.02 if noise else 1e-3)
    assert case.n_fine == stage.simulations.n_fine <= 3
    assert case.is_settled


@given(
    channel=st.sampled_from([FORCE, TORQUE, LATERAL_FORCE, FORCE_OVER_TIME]),
    ratio=st.floats(1.05, 5.0),
    at_rim=st.booleans(),
    error=st.floats(-0.2, 0.2),
)
def test_an_error_of_the_order_of_its_channel_is_extrapolated_away(channel, ratio, at_rim, error):
    exact, order = np.array([0.0, 1.0, 3.0]), channel.mesh.rim_order if at_rim else channel.mesh.order
    coarse, fine = ((1.0 + error * size**order) * exact for size in (1.0, 1.0 / ratio))
    left_over = {channel.name: Refinement(ratio=ratio, at_rim=at_rim).left_over(channel.mesh)}
    run = FineRun(coarse={channel.name: coarse}, fine={channel.name: fine}, left_over=left_over)
    assert coarse + run.corrections[channel.name].added == pytest.approx(exact, abs=1e-9)


def test_a_force_over_time_converges_as_the_force_does():
    refinement = Refinement(ratio=1.5, at_rim=True)
    assert refinement.left_over(FORCE_OVER_TIME.mesh) == refinement.left_over(FORCE.mesh)
    assert refinement.left_over(FORCE.mesh) < refinement.left_over(TORQUE.mesh)
    assert Refinement().left_over(TORQUE.mesh) == 0.0


def test_what_is_left_of_an_extrapolation_falls_with_the_finer_mesh():
    sizes = [Refinement(ratio=2.0, finer_over_reach=edge).scatter(TORQUE.mesh) for edge in (0.4, 0.2, 0.1)]
    assert sizes == pytest.approx([2.0 * TORQUE.mesh.scatter, TORQUE.mesh.scatter, 0.5 * TORQUE.mesh.scatter])


def test_a_fit_extrapolates_by_the_sizes_of_its_meshes(fit):
    moved = []
    for ratio in (1.0, 1.5):
        meshes = Refinement(ratio=ratio, at_rim=True)
        stage, (case,) = fit(refinement={"p1": meshes}, fine_runs=1)
        (row,) = (row for row in _mesh(case) if row["parameter"] == "tissue.c1")
        moved.append(row["corrected"] - row["coarse"])
        left_over = {name: meshes.left_over(of.mesh) for name, of in stage.study.channels.items()}
        assert [run.left_over for run in stage._fine["p1"]] == [left_over]
    assert abs(moved[1]) > 1.05 * abs(moved[0])


def test_what_is_fitted_is_the_fine_residual(fit):
    stage, (case,) = fit(noise=0.01)
    end = case.end
    (term,) = end.problem.terms
    inputs = end.problem.inputs("p1", end.best.point)
    (fine,) = stage.simulations.of([term.job(inputs, -1, slopes=False, fine=True)])
    bare = replace(term, corrections={})
    residuals = bare.residuals(fine, inputs)
    assert residuals @ residuals == pytest.approx(end.best.fopt, rel=0.02)


def test_without_a_finer_mesh_nothing_is_corrected(fit):
    stage, (case,) = fit(fine=())
    assert (stage.simulations.n_fine, case.n_fine, case.coarse) == (0, 0, {})
    assert errors(case.values()).max() > 0.05


def test_as_many_fine_runs_as_the_study_allows(fit):
    stage, (case,) = fit(fine_runs=1)
    assert stage.simulations.n_fine == 1
    assert errors(case.values()).max() < 0.5 * errors(case.coarse).max()
    assert fit(fine_runs=0)[0].simulations.n_fine == 0


def test_only_spots_with_a_finer_mesh_are_corrected(fit):
    stage, cases = fit(spots=("p1", "p2"), fine=("p2",))
    ends = {case.label: errors(case.values()).max() for case in cases}
    assert ends["p2"] < 1e-3 < ends["all spots"] < ends["p1"]
    assert {job for job, *_ in stage._fine.items()} == {"p2"}


def test_the_first_spot_corrects_the_others_until_their_finer_meshes_are_simulated(fit):
    stage, _ = fit(spots=("p1", "p2"), fine=("p1", "p2"), fine_runs=1)
    away = {
        spot: np.abs(runs[0].inputs.thetas["tissue"][:2] / TRUTH - 1.0).max()
        for spot, runs in stage._fine.items()
    }
    assert away["p1"] > 0.05
    assert away["p2"] < 1e-3
    (alone, _) = fit(spots=("p1", "p2"), fine=("p2",), fine_runs=1)
    assert alone._fine.keys() == {"p2"}, "a spot without a finer mesh borrows none"


def test_a_spot_pressed_deeper_than_its_protocol_borrows_a_correction(fit):
    """The last measured point is beyond the simulated curve: nothing is added there."""
    stage, (case, *_) = fit(spots=("p1", "p2"), fine=("p1", "p2"), fine_runs=1)
    _, term = case.end.problem.terms
    curves = {
        name: np.where(np.arange(c.ordinate.size) < c.ordinate.size - 1, c.ordinate, np.nan)
        for name, c in term.measured.curves.items()
    }
    stage._n_fine.clear()
    borrowed = stage._borrowed(term, case.end, curves)
    assert borrowed.keys() == curves.keys()
    for correction in borrowed.values():
        assert np.isfinite(correction.added).all()
        assert correction.added[-1] == 0.0 != correction.added[-2]
        assert np.isnan(correction.coarse[-1])


def test_fits_of_spots_use_the_fine_runs_of_the_joint_one(fit):
    stage, cases = fit(spots=("p1", "p2"), fine=("p1", "p2"), noise=0.01)
    assert max(errors(case.values()).max() for case in cases) < 0.02
    assert stage.simulations.n_fine <= 6
    # Both spots have the same curves, so their own optimum is the joint one.
    assert sum(case.n_fine for case in cases if case.label != "all spots") <= 2


def test_a_fine_simulation_that_fails_leaves_the_coarse_fit_with_a_warning(fit, pressed):
    class Coarse(pressed.Pressed):
        def simulate(self, job, limb):
            if job.mesh:
                return Simulation(job=job, status=Status.DIVERGED, response=None, message="no equilibrium")
            return super().simulate(job, limb)

    stage, (case,) = fit(solver=Coarse(pressed.PressedSettings(stiffer=0.05)))
    assert case.values() == pytest.approx(case.coarse, rel=0.01)
    assert not case.is_settled
    assert stage.simulations.n_fine == 1
    assert stage.progress.texts == ["warning: no correction by the finer mesh: p1: diverged: no equilibrium"]


@given(
    curves=arrays(float, (2, 6), elements=st.floats(-10.0, 10.0)),
    change=arrays(float, 6, elements=st.floats(-10.0, 10.0)),
    size=st.floats(0.1, 10.0),
)
def test_a_moved_correction_keeps_its_sign_and_begins_along_its_slopes(curves, change, size):
    coarse, added = curves
    assume(np.linalg.norm(coarse) > 1.0)
    assume(np.linalg.norm(added) > 1.0)
    correction = Correction(added=added, coarse=coarse)
    assert correction.at(coarse, change) @ added > 0.0
    slope = (correction.at(coarse, 1e-6 * change) - correction.at(coarse, -1e-6 * change)) / 2e-6
    np.testing.assert_allclose(slope, change, atol=1e-6)
    scaled = correction.at(size * coarse, size * change)  # where all moduli are larger, slopes are smaller
    np.testing.assert_allclose(scaled, size * correction.at(coarse, change), rtol=1e-9, atol=1e-9)


def test_a_correction_is_wrong_by_half_of_what_slopes_have_moved(fit):
    stage, (case,) = fit(noise=0.01)
    (term,) = case.end.problem.terms
    run = stage._fine["p1"][0]

    def wrong(by):
        inputs = replace(run.inputs, thetas={name: by * theta for name, theta in run.inputs.thetas.items()})
        return errors_of(run, term, inputs, run.coarse), inputs

    assert not any(np.any(each) for each in wrong(1.0)[0].values())
    found, inputs = wrong(1.2)
    for name, error in found.items():
        correction = run.corrections[name]
        change = correction.change_to(inputs, term.materials)
        moved = correction.at(run.coarse[name], change) - correction.at(run.coarse[name])
        np.testing.assert_allclose(error, MOVED_ERROR * moved, atol=1e-12)
    assert any(np.any(each) for each in found.values())


@pytest.mark.parametrize("stiffer", [0.05, 0.2])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_what_has_settled_moves_no_parameter_by_much_of_its_standard_deviation(fit, pressed, stiffer, noise):
    """By the finer mesh at the end, of which the fit has not asked."""
    stage, (case,) = fit(solver=pressed.Pressed(pressed.PressedSettings(stiffer=stiffer)), noise=noise)
    assert case.is_settled
    assert moved(stage, case) <= NEAR


def test_a_perfect_model_settles_without_an_error_of_calibration(fit, pressed):
    """A model is not taken to be better than what the budget leaves unexplained."""
    solver = pressed.Pressed(pressed.PressedSettings(stiffer=0.2))
    _, (case,) = fit(solver=solver, budget=BudgetTable(gain=0.0))
    assert case.end.best.fopt < 1e-6
    assert case.is_settled


def moved(stage, case):
    """Shift of the parameters, in standard deviations, by what the corrections miss of the finer mesh."""
    end = case.end
    (term,) = end.problem.terms
    inputs = end.problem.inputs("p1", end.best.point)
    (fine,) = stage.simulations.of([term.job(inputs, -1, slopes=False, fine=True)])
    missed = replace(term, corrections={}).residuals(fine, inputs) - end.best.residuals
    shift = np.linalg.lstsq(end.at_end().jacobian, missed)[0]
    return float((np.abs(shift) / EndSlopes.of(end).sd).max())


def test_a_correction_that_was_moved_far_is_not_settled(pressed, stage_of):
    coarse = Softening(pressed.Pressed())
    study = pressed.study_of(Ogden(), ("c1", "m1"), solver=coarse)
    measured = pressed.measured_at(study, TRUTH, fine=True)
    ends = {}
    for most in (1, 3):
        stage = stage_of(replace(study, fine_runs=most), measured, {"p1/fine": None})
        (case,) = stage.run()
        ends[most] = case.is_settled, case.n_fine, errors(case.values()).max()
    assert ends[1][:2] == (False, 1)
    assert ends[3][0]
    assert ends[3][1] > 1
    assert ends[3][2] < ends[1][2]


def test_standard_deviations_are_those_of_linear_regression(fit, pressed):
    """Where residuals are white noise and larger than what the budget expects of a model."""
    _, (case,) = fit(noise=0.02, fine=(), budget=BudgetTable(gain=0.0))
    found = case.end.at_end()
    n, n_parameters = found.jacobian.shape
    variance = found.residuals @ found.residuals / (n - n_parameters)
    white = variance * np.linalg.inv(found.jacobian.T @ found.jacobian)
    dense = n / (2 * 10.0)  # points for each that counts
    slopes = EndSlopes.of(case.end)
    np.testing.assert_allclose(slopes.sd, np.sqrt(dense * np.diag(white)), rtol=0.05)
    gained = EndSlopes.of(fit(noise=0.02, fine=())[1][0].end)  # a gain of both channels by 1 % moves c1 alone
    assert gained.sd[0] > slopes.sd[0]


@given(
    curves=arrays(float, (2, 6), elements=st.floats(-10.0, 10.0)),
    size=st.floats(0.1, 10.0),
    missing=st.integers(0, 5),
)
def test_a_correction_is_exact_where_all_moduli_are_scaled(curves, size, missing):
    """Curves are homogeneous of degree 1 in the moduli, on either mesh."""
    coarse, fine = curves
    assume(np.linalg.norm(coarse[:missing]) > 1e-3)
    coarse[missing:] = np.nan
    correction = FineRun(coarse={"force": coarse}, fine={"force": fine}).corrections["force"]
    scaled = size * np.stack([coarse, 2.0 * coarse])
    expected = size * np.stack([fine, 2.0 * fine])
    np.testing.assert_allclose(
        (scaled + correction.at(scaled))[:, :missing], expected[:, :missing], atol=1e-9
    )
    assert np.array_equal(correction.at(coarse), correction.added)


def corrected_by(curves, inputs, name, left_over=0.0):
    """Correction of the force by ordinates of both meshes, and slopes of both in one name."""
    coarse, fine, of_coarse, of_fine = curves
    run = FineRun(
        coarse={"force": coarse},
        fine={"force": fine},
        left_over={"force": left_over},
        slopes={"force": {name: (of_coarse, of_fine)}},
        inputs=inputs,
    )
    return run.corrections["force"]


@given(
    curves=arrays(float, (4, 6), elements=st.floats(-10.0, 10.0)),
    left_over=st.sampled_from([0.0, 0.8]),
)
def test_with_slopes_of_both_meshes_a_corrected_curve_has_those_of_the_finer_one(curves, left_over):
    """Extrapolated as its ordinates are."""
    coarse, fine, of_coarse, of_fine = curves
    assume(np.linalg.norm(coarse) > 1.0)
    ogden, base = (
        {"tissue": Ogden()},
        SpotInputs(thetas={"tissue": np.array([0.08, 4.0, 1.0])}, protocol=None),
    )
    correction = corrected_by(curves, base, "tissue.m1", left_over)

    def corrected(step):
        here = coarse + step * of_coarse
        inputs = replace(base, thetas={"tissue": base.thetas["tissue"] + [0.0, step, 0.0]})
        return here + correction.at(here, correction.change_to(inputs, ogden))

    whole = 1.0 + left_over
    np.testing.assert_allclose(corrected(0.0), coarse + whole * (fine - coarse), atol=1e-9)
    slope = (corrected(1e-5) - corrected(-1e-5)) / 2e-5
    np.testing.assert_allclose(slope, of_coarse + whole * (of_fine - of_coarse), atol=1e-5)


@given(
    curves=arrays(float, (4, 6), elements=st.floats(-10.0, 10.0)),
    penalty=st.sampled_from([0.5, 1.0, 4.0]),
)
def test_a_corrected_curve_has_a_rigid_contact(curves, penalty):
    """Of the finer mesh, however much the contact of the coarse one gives way."""
    coarse, fine, of_coarse, of_fine = curves
    assume(np.linalg.norm(coarse) > 1.0)
    press = Indentation(
        indenter=Sphere(radius_mm=7.5),
        path=np.array([[0.0, 0.0], [2.0, 0.0]]),
        friction=0.5,
        contact_penalty=penalty,
    )
    base = SpotInputs(thetas={}, protocol=press)
    correction = corrected_by(curves, base, "contact_compliance")

    def corrected(step):
        here = coarse + step * of_coarse
        stiffer = replace(press, contact_penalty=1.0 / (press.contact_compliance + step))
        inputs = replace(base, protocol=stiffer)
        return here + correction.at(here, correction.change_to(inputs, {}))

    np.testing.assert_allclose(corrected(0.0), fine - of_fine / penalty, atol=1e-9)
    np.testing.assert_allclose(corrected(1e-5), corrected(0.0), atol=1e-7)


def test_slopes_of_a_corrected_fit_are_those_of_the_finer_mesh(fit, pressed):
    """Where the coarse mesh errs by more for some materials, or a fit knows too little of its values."""
    stage, (case,) = fit(solver=Softening(pressed.Pressed()), fine_runs=1)
    end = case.end
    (term,) = end.problem.terms
    base = stage._fine["p1"][0].inputs.thetas["tissue"][:2]
    finer = Problem(
        end.problem.study,
        [replace(term, corrections={})],
        stage.simulations.of,
        end.problem.parametrisation,
        fine=True,
    )
    slopes = [problem.jacobian(base) for problem in (end.problem, finer)]
    bare = end.problem.restated([replace(term, corrections={})]).jacobian(base)
    np.testing.assert_allclose(slopes[0], slopes[1], atol=1e-4 * np.abs(slopes[1]).max())
    assert np.abs(bare - slopes[1]).max() > 0.05 * np.abs(slopes[1]).max()


def test_a_curve_that_misses_points_corrects_nothing_there(fit):
    stage, (case,) = fit(noise=0.01)
    (term,) = case.end.problem.terms
    inputs = case.end.problem.inputs("p1", case.end.best.point)
    job = term.job(inputs, -1, slopes=False, fine=True)
    (fine,) = stage.simulations.of([job])
    part = {
        name: replace(c, abscissa=c.abscissa[:-2], ordinate=c.ordinate[:-2])
        for name, c in fine.response.curves.items()
    }
    short = replace(fine, response=replace(fine.response, curves=part))
    some = replace(term, rules=replace(term.rules, minimum_coverage=0.5))
    run = fine_run(some, inputs, fine, short)
    for correction in run.corrections.values():
        assert np.isfinite(correction.added).all()
        assert correction.added[-1] == 0.0
    with pytest.raises(NotRankedError, match="covers"):
        fine_run(replace(term, rules=replace(term.rules, minimum_coverage=1.0)), inputs, fine, short)


def test_a_fit_with_a_far_correction_is_fitted_with_the_near_one_that_is_known(fit, pressed):
    stage, (case,) = fit(solver=Softening(pressed.Pressed()))
    first, *_, last = stage._fine["p1"]
    stage._fine["p1"] = [last, first]  # where another scenario has asked for the far one
    other = Case("p1", ("p1",), case.scenario)
    stage._search([other], {id(other): [case.values()]})
    assert errors(other.values()).max() > 2.0 * errors(case.values()).max()
    stage._correct([other])
    (term,) = other.end.problem.terms
    assert term.corrections["force"].is_same(last.corrections["force"])
    assert (other.n_fine, other.is_settled) == (0, True)


@pytest.mark.parametrize("zero", ["known", "curve"])
@pytest.mark.parametrize("end", [1.0, 0.0])
def test_a_curve_of_zeros_shows_no_change_of_another(zero, end):
    of = Curve(channel="force", abscissa=np.linspace(0.0, 1.0, 5), ordinate=np.ones(5))
    path = np.linspace(0.0, 1.0, 5) if end else np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    curve = np.full(5, 0.0 if zero == "curve" else 1.0)
    known = np.full(5, 0.0 if zero == "known" else 1.0)
    assert changed_like(np.ones(5), of, known, path, curve).tolist() == [0.0] * 5


def test_a_curve_that_ends_early_borrows_the_same_change_up_to_its_end():
    path = np.linspace(0.0, 10.0, 41)
    curve = path**1.5
    of = Curve(channel="force", abscissa=path, ordinate=curve)
    cut = np.where(path <= 9.0, curve, np.nan)
    whole, part = (changed_like(0.03 * curve, of, curve, path, ordinate) for ordinate in (curve, cut))
    np.testing.assert_allclose(part[path <= 9.0], whole[path <= 9.0])
    assert not part[path > 9.0].any()
