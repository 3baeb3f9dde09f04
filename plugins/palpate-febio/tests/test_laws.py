"""Laws of FEBio's steps, record and verdict, for any protocol."""

import numpy as np
from hypothesis import given, strategies as st

from palpate.domain import Indentation, Status
from palpate.domain.indenter import Sphere
from palpate.executors.sandbox import Ended
from palpate_febio.log import GOOD_BANNER
from palpate_febio.outcome import judge
from palpate_febio.steps import halved, steps_of, up_to_first_turn

places = st.tuples(st.floats(0.0, 10.0), st.floats(-170.0, 170.0))
paths = st.lists(places, min_size=1, max_size=5).map(lambda rows: np.array([(0.0, 0.0), *rows]))


def protocol(path):
    return Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=1.0)


@given(paths, st.integers(1, 30), st.floats(0.5, 50.0))
def test_steps_visit_every_waypoint_in_order_and_respect_their_limit(path, depth_steps, step_deg):
    steps = steps_of(protocol(path), depth_steps, step_deg)
    visited = np.column_stack([steps.depth_mm, steps.rotation_deg])
    start = 0
    for waypoint in path:
        there = np.flatnonzero((visited[start:] == waypoint).all(axis=1))
        assert there.size
        start += int(there[0])
    assert np.abs(np.diff(steps.rotation_deg)).max() <= step_deg * (1 + 1e-9)
    assert np.abs(np.diff(steps.depth_mm)).max() <= max(path[:, 0].max(), 1e-9) / depth_steps * (1 + 1e-9)


@given(paths)
def test_halving_is_undone_by_every_second_and_a_first_turn_has_no_turn(path):
    steps = steps_of(protocol(path), 3, 20.0)
    np.testing.assert_array_equal(halved(steps).rotation_deg[::2], steps.rotation_deg)
    moving = np.diff(up_to_first_turn(steps).rotation_deg)
    assert (moving >= 0.0).all() or (moving <= 0.0).all()


@given(paths, st.integers(1, 2**31 - 1))
def test_the_input_and_output_of_febio_are_read_back(path, seed):
    steps = steps_of(protocol(path), 3, 30.0)
    reaction = np.random.default_rng(seed).standard_normal((steps.n + 1, 2)) + 0.1
    record = "".join(
        f"*Step  = {k}\n*Time  = {k}\n*Data  = z\n2,{7.5 - steps.depth_mm[k]:.12g},"
        f"{np.deg2rad(steps.rotation_deg[k]):.12g},0,0,{-reaction[k, 0]:.12g},0,0,{reaction[k, 1]:.12g}\n"
        for k in range(steps.n + 1)
    )
    well = Ended(exit_code=0, stopped="", tail="", seconds=1.0)
    verdict = judge(well, GOOD_BANNER, record, steps, 7.5)
    assert verdict.status is Status.OK, verdict.message
    np.testing.assert_allclose(verdict.states.wrench[:, [0, 5]], reaction, rtol=1e-11)
