"""Designs: inside the ranges, the same for the same seed, and filtered."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.builtins import LatinHypercube
from palpate.domain import ParameterSpace
from palpate.errors import SamplingError
from palpate.interfaces import Sampler, SetFilter
from palpate.sampling import draw_design


class Corners(Sampler):
    name = "corners"
    summary = "the two extreme corners"

    def draw(self, n_sets, n_parameters, seed):
        points = np.zeros((n_sets, n_parameters))
        points[1::2] = 1.0
        return points


class Outside(Sampler):
    name = "outside"
    summary = "leaves the cube"

    def draw(self, n_sets, n_parameters, seed):
        return np.full((n_sets, n_parameters), 1.5)


class Stiff(SetFilter):
    name = "stiff"
    summary = "keeps the stiffer"

    def accept(self, space, values):
        return values[:, 0] > 0.5


class Nothing(SetFilter):
    name = "nothing"
    summary = "rejects all"

    def accept(self, space, values):
        return np.zeros(len(values), dtype=bool)


class Indices(SetFilter):
    name = "indices"
    summary = "returns the wrong thing"

    def accept(self, space, values):
        return np.arange(len(values))


def test_the_corners_of_the_cube_are_exactly_the_bounds(space):
    design = draw_design(space, Corners(), 2, seed=0)
    assert design.values[0].tolist() == [p.lower for p in space.parameters]
    assert design.values[1].tolist() == [p.upper for p in space.parameters]


def test_a_hypercube_visits_every_slice_of_every_range(space):
    design = draw_design(space, LatinHypercube(), 50, seed=3)
    for column, p in enumerate(space.parameters):
        slices = np.floor((design.values[:, column] - p.lower) / (p.upper - p.lower) * 50)
        assert sorted(slices) == list(range(50))


def test_the_seed_decides_the_design(space):
    one, same, other = (draw_design(space, LatinHypercube(), 9, seed).values for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_filters_keep_rows_and_the_number_drawn_is_remembered(space):
    drawn = draw_design(space, LatinHypercube(), 20, seed=1)
    kept = draw_design(space, LatinHypercube(), 20, seed=1, filters=[Stiff()])
    assert np.array_equal(kept.values, drawn.values[drawn.values[:, 0] > 0.5])
    assert (kept.n_drawn, drawn.n_drawn) == (20, 20)
    assert 0 < kept.n_sets < 20


def test_a_filter_that_rejects_all_is_named(space):
    with pytest.raises(SamplingError, match=r"'nothing' rejects all \d+ sets; widen"):
        draw_design(space, LatinHypercube(), 8, seed=1, filters=[Stiff(), Nothing()])


def test_a_filter_must_answer_with_booleans(space):
    with pytest.raises(SamplingError, match="'indices' returned int64"):
        draw_design(space, LatinHypercube(), 8, seed=1, filters=[Indices()])


def test_a_sampler_must_stay_in_the_cube(space):
    with pytest.raises(SamplingError, match=r"'outside' returned .* in \[1.5, 1.5\]"):
        draw_design(space, Outside(), 8, seed=1)


def test_nothing_to_search_is_an_error(space):
    region = replace(space.regions[0], searched=(), fixed={"stiffness": 0.4, "grip": 20.0})
    with pytest.raises(SamplingError, match="every parameter is fixed"):
        draw_design(ParameterSpace(regions=(region,)), LatinHypercube(), 8, seed=1)


def test_at_least_one_set(space):
    with pytest.raises(SamplingError, match="0 sets"):
        draw_design(space, LatinHypercube(), 0, seed=1)
