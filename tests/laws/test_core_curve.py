"""Laws of paths, against numpy.interp on every branch."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from palpate import _core
from palpate.errors import CurveError

Floats = NDArray[np.float64]


@st.composite
def loops(draw: st.DrawFn) -> tuple[Floats, Floats, Floats, Floats]:
    """Simulated x, y and measured x of one loop, and its turning points."""
    legs = draw(st.lists(st.floats(1, 20), min_size=1, max_size=4))
    sign = draw(st.sampled_from([-1.0, 1.0]))
    turns = np.cumsum([draw(st.floats(-5, 5)), *(sign * (-1) ** k * leg for k, leg in enumerate(legs))])
    n_sim, n_exp = draw(st.integers(0, 12)), draw(st.integers(0, 40))
    sim_x, exp_x = walk(turns, n_sim), walk(turns, n_exp)
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    return sim_x, rng.normal(size=sim_x.size), exp_x, turns


def walk(turns: Floats, n_between: int) -> Floats:
    """A path through the turning points with as many points on every leg."""
    legs = [np.linspace(a, b, n_between + 2)[1:] for a, b in pairwise(turns)]
    return np.concatenate([turns[:1], *legs])


def by_numpy(sim_x: Floats, sim_y: Floats, at_x: Floats, n_legs: int) -> Floats:
    """numpy.interp leg by leg; every leg has the same number of points."""
    values = np.full(at_x.size, np.nan)
    n_sim, n_at = (sim_x.size - 1) // n_legs, (at_x.size - 1) // n_legs
    for leg in range(n_legs):
        sim = slice(leg * n_sim, (leg + 1) * n_sim + 1)
        at = slice(leg * n_at + (leg > 0), (leg + 1) * n_at + 1)
        order = np.argsort(sim_x[sim])
        values[at] = np.interp(at_x[at], sim_x[sim][order], sim_y[sim][order])
    return values


@given(loops())
def test_each_branch_agrees_with_numpy(loop):
    sim_x, sim_y, exp_x, turns = loop
    values, covered = _core.interpolate(sim_x, sim_y, exp_x)
    assert covered.all()
    np.testing.assert_allclose(
        values, by_numpy(sim_x, sim_y, exp_x, turns.size - 1), rtol=1e-12, atol=1e-12 * np.abs(sim_y).max()
    )


@given(loops())
def test_branches_meet_at_the_turning_points(loop):
    _, _, exp_x, turns = loop
    found = _core.branches(exp_x)
    assert [start for start, _ in found] == [0, *(stop - 1 for _, stop in found[:-1])]
    np.testing.assert_array_equal([exp_x[start] for start, _ in found], turns[:-1])
    assert found[-1][1] == exp_x.size


@given(loops(), st.floats(0, 1))
def test_a_shortened_simulation_leaves_only_the_rest_uncovered(loop, share):
    sim_x, sim_y, exp_x, _ = loop
    n_kept = 2 + int(share * (sim_x.size - 2))
    whole, _ = _core.interpolate(sim_x, sim_y, exp_x)
    values, covered = _core.interpolate(sim_x[:n_kept], sim_y[:n_kept], exp_x)
    travelled = np.abs(np.diff(exp_x, prepend=exp_x[0])).cumsum()
    reached = np.abs(np.diff(sim_x[:n_kept])).sum()
    clear = np.abs(travelled - reached) > 1e-6
    np.testing.assert_array_equal(covered[clear], (travelled <= reached)[clear])
    np.testing.assert_array_equal(values[covered & clear], whole[covered & clear])
    assert np.isnan(values[~covered]).all()


@given(loops())
def test_strided_and_reversed_views_are_read_in_place(loop):
    sim_x, sim_y, exp_x, _ = loop
    padded = np.full((exp_x.size, 3), np.nan)
    padded[:, 1] = exp_x
    expected = _core.interpolate(sim_x, sim_y, exp_x)
    views = sim_x[::-1].copy()[::-1], sim_y[::-1].copy()[::-1], padded[:, 1]
    for got, wanted in zip(_core.interpolate(*views), expected, strict=True):
        np.testing.assert_array_equal(got, wanted)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([], "abscissa is empty"),
        ([1.0], "one point"),
        ([2.0, 2.0], "never moves"),
        ([0.0, 1.0, np.nan], r"abscissa\[2\] is NaN"),
        ([0.0, -np.inf], r"abscissa\[1\] is -inf"),
    ],
)
def test_a_bad_path_is_named(path, message):
    with pytest.raises(CurveError, match=message):
        _core.branches(np.array(path, dtype=float))


def test_paths_that_do_not_correspond_are_named():
    rising, loop = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0])
    with pytest.raises(CurveError, match="branch 0 of the simulated path sim_x is rising"):
        _core.interpolate(rising, rising, rising[::-1])
    with pytest.raises(CurveError, match="sim_x has 2 branches but at_x has only 1"):
        _core.interpolate(loop, loop, rising)
    with pytest.raises(CurveError, match="sim_y has 2 values but sim_x has 3"):
        _core.interpolate(rising, rising[:2], rising)


@pytest.mark.parametrize("wrong", [[0.0, 1.0], np.arange(3), np.zeros((2, 2))])
def test_another_type_or_shape_names_the_argument(wrong):
    path = np.array([0.0, 1.0])
    with pytest.raises(TypeError, match="at_x"):
        _core.interpolate(path, path, wrong)
