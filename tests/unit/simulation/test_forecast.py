"""Forecast of a run: what is left, and its time, by the simulations that have ended."""

from itertools import pairwise
from types import SimpleNamespace

import pytest
from hypothesis import given, strategies as st

from palpate.simulation.forecast import Forecast, Part, work_of

LIMBS = {name: SimpleNamespace(mesh=SimpleNamespace(n_nodes=n)) for name, n in
         (("p1", 1000), ("p2", 1000), ("p1/fine", 8000))}  # fmt: skip
FIT = Part(stage="fit", counts={"p1": 4, "p2": 4, "p1/fine": 1}, side_by_side=2)
CAUSES = Part(stage="intervals", counts={"p1": 3, "p2": 3})


def forecast(*parts, n_workers=2):
    made = Forecast(n_workers=n_workers)
    made.expect(parts, LIMBS)
    return made


def test_a_finer_mesh_takes_as_long_as_its_nodes_make_it():
    of_run = forecast(FIT)
    of_run.ended("p1", 2.0)
    fine_s = 2.0 * work_of("p1/fine", LIMBS)
    assert of_run.usual_s("p1/fine") == pytest.approx(fine_s)
    assert fine_s > 30.0
    assert (of_run.n_left, of_run.seconds_left) == (8, pytest.approx((7 * 2.0 + fine_s) / 2))


@given(seconds=st.floats(0.1, 100.0), n_workers=st.integers(1, 16))
def test_the_time_left_falls_with_each_simulation_and_ends_at_nothing(seconds, n_workers):
    of_run, left = forecast(FIT, CAUSES, n_workers=n_workers), []
    for name, n in (("p1", 7), ("p2", 7), ("p1/fine", 1)):
        for _ in range(n):
            of_run.ended(name, seconds * work_of(name, LIMBS))
            left.append(of_run.seconds_left)
    assert all(later <= before * (1.0 + 1e-9) for before, later in pairwise(left))
    assert (of_run.n_left, of_run.seconds_left) == (0, 0.0)


def test_more_simulations_than_usual_leave_what_comes_later():
    of_run = forecast(Part(stage="fit", counts={"p1": 1}), CAUSES)
    for _ in range(9):
        of_run.ended("p2", 1.0)
    assert of_run.n_left == 1 + 3


@pytest.mark.parametrize("parts", [(), (Part(stage="fit", counts=None), CAUSES)])
def test_nobody_knows_the_time_of_a_search_that_nobody_knows(parts):
    of_run = forecast(*parts)
    of_run.ended("p1", 1.0)
    assert (of_run.is_whole, of_run.seconds_left) == (False, None)


def test_before_the_first_simulation_there_is_no_time_and_no_executor_gives_one():
    assert forecast(FIT).seconds_left is None
    unknown = forecast(FIT, n_workers=0)
    unknown.ended("p1", 1.0)
    assert (unknown.n_left, unknown.seconds_left) == (8, None)
