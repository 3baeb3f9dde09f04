"""Candidates whose error of the mesh a finer mesh of their own shows."""

import re
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Job, Refinement, Response, Status
from palpate.limb.loading import load_limbs, refinement
from palpate.run.directory import RunDirectory
from palpate.run.ledger import Ledger
from palpate.run.result import ALL_SPOTS
from palpate.stages import pipeline
from palpate.study.reading import read_study
from palpate.testing.bench import HalfSpaceOnMesh
from palpate_certainty.mesh_error import SpotMesh
from palpate_planning.candidates import Allowed, candidates, extended_study
from palpate_planning.presses import press_meshes
from palpate_planning.propose import PlanOptions, before_any_press, choose_presses, propose

PRESSES = Allowed(protocol={"depth": ["2 mm", "5 mm"], "twist": [[], ["4 deg"]]})


def _refined(design, presses):
    """The design where each press has a mesh with a finer one, simulated by a solver that needs meshes."""
    study = replace(design.study, solver=HalfSpaceOnMesh(HalfSpaceOnMesh.Settings()))
    meshes = {press.name: SpotMesh(refinement=Refinement(ratio=1.2)) for press in presses}
    return replace(design, study=study, meshes=meshes)


def _finer(study, jobs, factors):
    """Simulations whose force the finer mesh of a press changes by a factor; None: it diverges."""
    for job in jobs:
        found = study.solver.simulate(job, None)
        if job.mesh:
            factor = factors[job.spot]
            curves = found.response.curves
            force = replace(curves["force"], ordinate=(factor or 1.0) * curves["force"].ordinate)
            status = Status.DIVERGED if factor is None else found.status
            found = replace(found, response=Response(curves={**curves, "force": force}), status=status)
        yield found


def test_candidate_tells_the_less_the_more_its_own_finer_mesh_changes(run):
    study, _, plugins = run
    press, *_ = candidates(study, plugins, Allowed(protocol={"depth": ["2 mm"], "twist": [[]]}))

    def width(factor, *, is_refined=True):
        asked = []

        def simulate(jobs):
            asked.extend(job for job in jobs if job.mesh)
            return list(_finer(study, jobs, {press.name: factor}))

        (scenario,) = (s for s in study.scenarios if s.name == study.generalise_by)
        abscissae = {name: channel.abscissa for name, channel in plugins.channels.items()}
        design, points = before_any_press(study, scenario, simulate, abscissae, 3)
        design = _refined(design, [press] if is_refined else [])
        found = choose_presses(design, [], [press], points, PlanOptions(), {})
        assert len(asked) == is_refined  # once, at the first point
        return found.steps[0].chosen.goal

    alone = width(1.0, is_refined=False)
    assert width(1.0) < width(4.0)
    assert width(1.0) < alone  # a finer mesh has shown that the usual error is too large
    assert width(None) == pytest.approx(alone)  # without an answer the error is that of one mesh


@pytest.fixture
def meshed(tmp_path, pressed_meshes):
    """Study of one press on a block of tetrahedra, and its plugins."""
    return pressed_meshes(tmp_path)


def test_finer_mesh_is_that_of_a_study_with_the_press(meshed):
    study, plugins = meshed
    presses = candidates(study, plugins, PRESSES)
    meshes, finer = press_meshes(study, presses)
    assert meshes.keys() == {press.name for press in presses}
    for press in presses[::2]:  # a twist refines nothing else
        own = replace(study, spots=(replace(study.spots[0], protocol=press.protocol),))
        limbs = load_limbs(own)
        found = finer[f"{press.name}/fine"].mesh
        assert np.array_equal(found.points_mm, limbs["p1/fine"].mesh.points_mm)
        assert meshes[press.name].refinement == refinement(own, limbs)["p1"]
        assert meshes[press.name].refinement.ratio > 1.0
    shallow, twisted, deep, _ = (finer[f"{press.name}/fine"] for press in presses)
    assert shallow is twisted is not deep
    off, none = press_meshes(replace(study, fine_runs=0), presses)
    assert not none
    assert {mesh.refinement for mesh in off.values()} == {Refinement()}


@pytest.mark.slow
@pytest.mark.parametrize("is_fitted", [True, False])
def test_finer_meshes_narrow_what_is_expected_of_a_press(meshed, tmp_path, is_fitted):
    """Here every mesh answers alike, so that the usual error is shown to be too large."""
    study, plugins = meshed
    goals, n_asked = [], []
    for fine_runs in (1, 0):
        folder, each = tmp_path / f"run-{fine_runs}", replace(study, fine_runs=fine_runs)
        if is_fitted:
            pipeline.run_study(each, folder, plugins)
        n_known = _n_simulated(folder)
        found = propose(each, folder, plugins, options=PlanOptions(allowed=PRESSES, n_points=2))
        goals.append(found.steps[0].chosen.goal)
        n_asked.append(_n_simulated(folder) - n_known)
    assert goals[0] < goals[1]
    assert n_asked[0] - n_asked[1] == 4  # one for each candidate


def _n_simulated(folder):
    with Ledger(folder) as ledger:
        return len(ledger.seconds())


@pytest.mark.parametrize(("bone", "is_possible"), [("2 mm", True), ("3000 mm", False)])
def test_a_bone_that_leaves_the_limb_refuses_no_candidate(tmp_path, pressed_meshes, notes, bone, is_possible):
    """It is ranked without that cause, which is said; the simulations of causes are announced."""
    solver = {"name": "half_space_on_mesh"}
    study, plugins = pressed_meshes(tmp_path, solver=solver, budget={"bone": bone, "mesh": 0.01})
    allowed = Allowed(protocol={"depth": ["2 mm"], "twist": [[]]})
    options = PlanOptions(allowed=allowed, n_points=2, n_presses=1)
    found = propose(study, tmp_path / "plan", plugins, notes, options)
    assert not found.refused
    warned = [text for text in notes.texts if "without the cause 'bone'" in text]
    assert len(warned) == (not is_possible)
    (announced,) = (text for text in notes.texts if "parameter values" in text)
    most = sum(int(text) for text in re.findall(r"(?:=|up to) (\d+)", announced))
    n_simulated = _n_simulated(tmp_path / "plan")
    assert (n_simulated == most) if is_possible else (n_simulated < most), (n_simulated, announced)


@pytest.mark.slow
def test_what_finer_meshes_leave_is_expected_as_the_fit_has_it(tmp_path, pressed_meshes):
    """Each press has an error of its own mesh, also where it is at a place that has been pressed."""
    solver = {"name": "half_space_on_mesh"}
    study, plugins = pressed_meshes(
        tmp_path, solver=solver, budget={"gain": 0.0, "onset": "0 mm", "bone": "0 mm"}
    )
    pipeline.run_study(study, tmp_path / "run", plugins)
    allowed = Allowed(protocol={"depth": ["5 mm"], "twist": [["4 deg"]]})
    found = propose(study, tmp_path / "run", plugins, options=PlanOptions(allowed=allowed, n_points=2))
    press = found.steps[0].chosen.press.press
    materials = {region.region: region.material for region in study.space.regions}
    thetas = study.space.thetas(np.array([study.truth[p.name] for p in study.space.parameters]))
    job = Job(spot="p1", set_id=0, materials=materials, thetas=thetas, protocol=press.protocol)
    measured = study.solver.simulate(job, load_limbs(study)["p1"]).response
    study.loader.save(tmp_path / "press.txt", measured)
    _, written = extended_study(tmp_path / "run", study.file, None, tmp_path / "press.txt")
    pipeline.run_study(read_study(written, plugins), tmp_path / "more", plugins)
    widths = [_widths(RunDirectory(tmp_path / each).fit()) for each in ("run", "more")]
    expected = found.steps[0].chosen.widths
    # With the press the fit sees more of the scale of the errors.
    np.testing.assert_allclose(widths[1] / widths[0], expected, rtol=0.17)


def _widths(fit):
    shown = fit.intervals.filter(scenario="both")
    joint = shown.filter(fit=ALL_SPOTS)
    shown = joint if joint.height else shown
    return (shown["upper"] - shown["lower"]).to_numpy()
