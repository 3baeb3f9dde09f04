"""Where searches start: basins of a sweep, values that are known, the right stiffness."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import Design, Parameter, Response
from palpate.domain.channels import TORQUE
from palpate.fit.starts import WORST, basins, scaled_start
from palpate_materials.uncoupled import Yeoh

AXES = tuple(
    Parameter(name=n, unit="1", lower=0.0, upper=1.0, kind="shape", description="of a test") for n in "ab"
)


def sweep(function, n=12):
    values = np.array([(a, b) for a in np.linspace(0, 1, n) for b in np.linspace(0, 1, n)])
    fopt = [float(function(row)) for row in values]
    design = Design(parameters=AXES, values=values, seed=1, n_drawn=len(values))
    return design, pl.DataFrame({"set_id": np.arange(len(values)), "fopt": fopt})


def two(row, worse=0.01):
    return min(((row - [0.2, 0.2]) ** 2).sum(), 9.0 * ((row - [0.8, 0.7]) ** 2).sum() + worse) + 0.01


def test_each_basin_once_the_best_first():
    design, fopt = sweep(two)
    found = basins(design, fopt, 5)
    np.testing.assert_allclose([list(each.values()) for each in found], [(2 / 11, 2 / 11), (9 / 11, 8 / 11)])
    assert basins(design, fopt, 1) == found[:1]
    assert basins(design, fopt.sort("fopt", descending=True), 5) == found, "the order of rows does not count"


def test_a_basin_that_fits_far_worse_is_no_start():
    for worse, n_basins in ((0.05, 2), (0.01 * WORST, 1)):
        assert len(basins(*sweep(lambda row, worse=worse: two(row, worse)), 5)) == n_basins


def test_a_single_set_is_a_basin_and_no_set_is_none():
    design, fopt = sweep(two)
    assert basins(design, fopt.head(1), 5) == [{"a": 0.0, "b": 0.0}]
    assert basins(design, fopt.clear(), 5) == []


@pytest.fixture
def problem(pressed, stage_of):
    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3"), [pressed.Rising()])
    row = next(pressed.truths(study, 1, seed=3))
    stage = stage_of(study, pressed.measured_at(study, row))
    made = stage.run()[0].end.problem
    made.truth = row
    return made


def test_known_values_are_taken_and_the_others_are_in_the_middle(problem):
    upper = problem.parameters[0].upper
    assert problem.point_of({"tissue.c1": upper, "unknown": 3.0}).tolist() == [1.0, 0.5, 0.5]
    assert problem.point_of({}).tolist() == [0.5, 0.5, 0.5]


@pytest.mark.parametrize("factor", [0.5, 0.8, 1.5])
def test_the_right_multiple_is_found_from_one_simulation(problem, factor):
    """All searched moduli are wrong by one factor; the fixed bulk modulus is a part of the answer."""
    wrong = problem.box.point(factor * problem.truth)
    before, after = (problem.fopt(problem.box.values(p)) for p in (wrong, scaled_start(problem, wrong)))
    assert after < 0.2 * before


@pytest.mark.parametrize("degree", [0, 1])
def test_a_channel_of_degree_0_does_not_decide_the_multiple(pressed, stage_of, degree):
    """A torque over the first coefficient is the same for all multiples of a set."""

    class Ratio(pressed.Pressed):
        def simulate(self, job, limb):
            found = super().simulate(job, limb)
            (theta,) = job.thetas.values()
            curves = {name: replace(curve, slopes={}) for name, curve in found.response.curves.items()}
            curves["torque"] = replace(curves["torque"], ordinate=curves["torque"].ordinate / theta[0])
            return replace(found, response=Response(curves=curves))

    solver = Ratio(pressed.PressedSettings(exact=False))
    channels = {"torque": replace(TORQUE, degree=degree)}
    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3", "kappa"), solver=solver, channels=channels)
    row = next(pressed.truths(study, 1, seed=3))
    problem = stage_of(study, pressed.measured_at(study, row)).run()[0].end.problem
    found = problem.box.values(scaled_start(problem, problem.box.point(0.8 * row)))
    assert np.allclose(found, row, rtol=1e-6) is (degree == 0)


def test_a_start_that_cannot_be_simulated_stays(problem, monkeypatch):
    start = problem.box.point(problem.truth)
    monkeypatch.setattr(problem, "evaluate", lambda trials: [type("E", (), {"residuals": None})()])
    assert np.array_equal(scaled_start(problem, start), start)


def test_a_start_stays_where_the_scaled_one_cannot_be_simulated(problem, monkeypatch):
    wrong, evaluate = problem.box.point(0.5 * problem.truth), problem.evaluate

    def failing(trials):
        (found,) = evaluate(trials)
        return [found if np.array_equal(found.point, wrong) else replace(found, residuals=None)]

    monkeypatch.setattr(problem, "evaluate", failing)
    assert np.array_equal(scaled_start(problem, wrong), wrong)
