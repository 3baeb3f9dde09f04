"""``n_sets = 0``: a fit from the ranges alone, with every stage and command."""

import shutil
from collections import Counter
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from palpate.domain import Response, Scenario
from palpate.fit.least_squares import LeastSquares
from palpate.plugins.catalogue import Plugins
from palpate.progress import Progress
from palpate.stages import pipeline
from palpate.study.reading import read_study
from palpate_materials.uncoupled import Yeoh

TRUTH = {"soft_tissue.stiffness": 0.4, "soft_tissue.grip": 20.0}


@pytest.mark.usefixtures("one_figure")
def test_a_fit_without_a_sweep_finds_the_tissue_and_is_reported(make_study, plugins, tmp_path):
    study = make_study(n_sets=0, search=LeastSquares(), truth=TRUTH)
    result = pipeline.run_study(study, tmp_path / "run", plugins)
    assert (result.design.n_sets, result.simulations, result.scores.height) == (0, (), 0)
    fitted = result.fit.of_spots()["p1", "I"]
    assert fitted["soft_tissue.stiffness"] == pytest.approx(0.4, rel=1e-5)
    assert fitted["soft_tissue.grip"] == pytest.approx(20.0, rel=1e-5)
    assert not result.report.conclusion.without_result
    assert all(path.exists() for path in result.report.files)


class Expecting(Progress):
    def __init__(self):
        self.expected = []

    def expect(self, n_left, seconds_left):
        self.expected.append(n_left)


@pytest.mark.usefixtures("one_figure")
def test_a_complete_run_that_is_made_again_expects_no_simulation(make_study, plugins, tmp_path):
    study = make_study(n_sets=0, search=LeastSquares())
    first, again = Expecting(), Expecting()
    for progress in (first, again):
        pipeline.run_study(study, tmp_path / "run", plugins, progress)
    assert max(first.expected) > 0
    assert again.expected == []


def test_a_scenario_is_not_fitted_where_it_weighs_nothing(pressed, stage_of):
    scenarios = (pressed.SCENARIO, Scenario(name="II", weights={"torque": 1.0}))
    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3"), spots=("p1", "p2"), scenarios=scenarios)
    whole = pressed.measured_at(study, next(pressed.truths(study, 1, seed=3)))
    pressed_only = Response(curves={"force": whole["force"]})
    assert len(stage_of(study, {"p1": whole, "p2": pressed_only}).run()) == 5


class OnMesh:
    """A solver whose simulations are costly: it has a mesh."""

    @property
    def provides(self):
        return replace(super().provides, body="mesh")


@pytest.mark.parametrize(("is_on_mesh", "most"), [(True, 0.5), (False, 1.0)])
def test_one_spot_leads_a_joint_fit_to_near_the_answer(pressed, stage_of, is_on_mesh, most):
    """Every other spot is simulated for the last steps alone, where simulations are costly."""
    solver = type("Costly", (OnMesh, pressed.Pressed), {}) if is_on_mesh else pressed.Pressed
    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3"), solver=solver(), spots=("p1", "p2", "p3"))
    truth = next(pressed.truths(study, 1, seed=3))
    stage = stage_of(study, pressed.measured_at(study, truth))
    joint, *_ = stage.run()
    n = Counter(spot for spot, *_ in stage.simulations.known)
    assert list(joint.values().values()) == pytest.approx(truth, rel=1e-3)
    assert n["p2"] == n["p3"] <= most * n["p1"]
    assert sorted(case.label for case in stage._cases) == ["all spots", "p1", "p2", "p3"]


@pytest.mark.parametrize(
    ("given", "ends"),
    [
        ("0.1 to 0.15", "0.1…0.15 to 0.1…0.225 MPa"),
        ("0.2 to 0.3", "0.2…0.3 to 0.1333…0.3 MPa"),
        ("0.1 to 0.12", "0.1…0.12 to 0.1…0.2074 MPa"),  # in two steps
    ],
)
def test_a_range_at_whose_end_a_fit_ends_is_widened_and_reported(tmp_path, given, ends):
    """The known answer of Treloar's rubber, 0.1847 MPa, is outside of the study's range."""
    shutil.copytree(Path(str(files("palpate_materials") / "studies" / "treloar")), tmp_path / "rubber")
    file, (lower, upper) = tmp_path / "rubber" / "study.toml", given.split(" to ")
    text = file.read_text().replace("n_sets = 250", "n_sets = 0")
    file.write_text(
        text.replace('lower = "0.1 MPa", upper = "0.3 MPa"', f'lower = "{lower} MPa", upper = "{upper} MPa"')
    )
    study = read_study(file, Plugins.load())
    found = pipeline.run_study(study, tmp_path / "run", without=["contours", "report"]).fit
    joint = found.table.row(0, named=True)
    assert joint["specimen.c1"] == pytest.approx(0.1847019, rel=1e-3)
    assert joint["at_bound"] == ""
    assert f"range of specimen.c1 widened from {ends}" in joint["message"]
    interval = found.intervals.row(0, named=True)
    assert interval["lower"] < joint["specimen.c1"] < interval["upper"]
