"""``n_sets = 0``: a fit from the ranges alone, with every stage and command."""

import pytest

from palpate.domain import Response, Scenario
from palpate.fit.least_squares import LeastSquares
from palpate.stages import pipeline
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


def test_a_scenario_is_not_fitted_where_it_weighs_nothing(pressed, stage_of):
    scenarios = (pressed.SCENARIO, Scenario(name="II", weights={"torque": 1.0}))
    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3"), spots=("p1", "p2"), scenarios=scenarios)
    whole = pressed.measured_at(study, next(pressed.truths(study, 1, seed=3)))
    pressed_only = Response(curves={"force": whole["force"]})
    assert len(stage_of(study, {"p1": whole, "p2": pressed_only}).run()) == 5
