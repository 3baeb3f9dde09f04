"""From the middle of the paper's ranges, without a sweep, the fit ends in the basin of the truth.

The benchmark ``bench_search.py`` does the same for 40 truths of each material.
"""

from dataclasses import replace

import numpy as np
import pytest

from palpate.answer.table import _at_limit
from palpate.domain import Parameter
from palpate.fit.problem import Problem
from palpate.fit.starts import accepted_start
from palpate_materials.neo_hookean import NeoHookean
from palpate_materials.uncoupled import Ogden, Yeoh

N_TRUTHS = 4


@pytest.mark.parametrize(
    ("material", "searched"),
    [
        (Ogden(), ("c1", "m1", "kappa")),
        (Yeoh(), ("c1", "c2", "c3")),
        (NeoHookean(), ("E", "nu")),
    ],
    ids=["ogden", "yeoh", "neo-hookean"],
)
def test_the_right_basin_from_the_middle_of_the_ranges(pressed, stage_of, material, searched):
    study = pressed.study_of(material, searched, [pressed.Rising()])
    for i, row in enumerate(pressed.truths(study, N_TRUTHS, seed=3)):
        stage = stage_of(study, pressed.measured_at(study, row, noise=0.01, seed=i))
        case = stage.run()[0]
        at_truth = stage.problem(case, {}).fopt(row)
        assert case.end.objective <= 1.01 * at_truth, (row, case.values())
        message, _, widened = case.end.message.partition("; ")
        assert message == "converged"
        assert stage.simulations.n_coarse <= (30 if widened else 15), widened  # then there is one more search


@pytest.mark.parametrize(
    ("material", "searched", "values"),
    [
        (Ogden(), ("c1", "m1"), [0.0012, 12.0]),
        (Ogden(), ("c1", "m1"), [2.0, 25.0]),
        (Yeoh(), ("c1", "c2", "c3"), [0.165, 3.7e-4, 0.0148]),
    ],
)
def test_values_far_outside_of_the_ranges_are_found(pressed, stage_of, material, searched, values):
    study = pressed.study_of(material, searched, [pressed.Rising()])
    case = stage_of(study, pressed.measured_at(study, np.array(values))).run()[0]
    assert list(case.values().values()) == pytest.approx(values, rel=1e-2)
    assert not case.end.at_bounds()


@pytest.mark.parametrize(("value", "at_end"), [(1.0, False), (1.0 + 1e-15, False), (0.0, True), (-3.0, True)])
def test_an_end_of_a_widened_range_counts_and_a_physical_limit_does_not(value, at_end):
    searched = Parameter(
        name="a",
        unit="",
        kind="shape",
        description="",
        lower=0.0,
        upper=1.0,
        physical_lower=-9.0,
        physical_upper=1.0,
    )
    assert _at_limit(searched, value) is at_end


def test_a_start_that_filters_refuse_is_moved_to_the_middle_of_what_they_accept(pressed, stage_of):
    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3"), [pressed.Rising()])
    stage = stage_of(study, pressed.measured_at(study, next(pressed.truths(study, 1, seed=3))))
    problem = stage.run()[0].end.problem
    middle = np.full(3, 0.5)
    assert not problem.accepts(middle[None])[0]
    moved = accepted_start(problem, middle)
    assert problem.accepts(moved[None])[0]
    assert np.array_equal(accepted_start(problem, moved), moved)


def test_what_spots_share_is_filtered_once(pressed, stage_of):
    asked = []

    class Counted(pressed.Rising):
        def accept(self, space, values):
            asked.append(len(values))
            return super().accept(space, values)

    study = pressed.study_of(Yeoh(), ("c1", "c2", "c3"), [Counted()])
    stage = stage_of(study, pressed.measured_at(study, next(pressed.truths(study, 1, seed=3))))
    one = stage.run()[0].end.problem
    terms = [*one.terms, *(replace(one.terms[0], spot=spot) for spot in ("p2", "p3"))]
    several = Problem(study, terms, stage.simulations.of, study.parametrisation)
    points = np.random.default_rng(0).uniform(size=(40, 3))
    asked.clear()
    accepted = several.accepts(points)
    assert asked == [40]
    assert 0 < accepted.sum() < 40
    assert np.array_equal(accepted, one.accepts(points))
