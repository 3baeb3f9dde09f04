"""Designs: inside the ranges, the same for the same seed, and filtered."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.stats import qmc

from palpate.domain import ParameterSpace
from palpate.errors import ParameterError, SamplingError
from palpate.plugins.interfaces import Sampler, SetFilter
from palpate.sampling.drawing import draw_design, kept_sets
from palpate.sampling.samplers import LatinHypercube, OptimisedLatinHypercube, Sobol


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

    def reason(self, space, row):
        return "too soft"

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


def test_filters_keep_rows_and_the_number_drawn_is_remembered(space):
    drawn = draw_design(space, LatinHypercube(), 20, seed=1)
    kept = draw_design(space, LatinHypercube(), 20, seed=1, filters=[Stiff()], max_draws=20)
    assert np.array_equal(kept.values, drawn.values[drawn.values[:, 0] > 0.5])
    assert (kept.n_drawn, drawn.n_drawn) == (20, 20)
    assert 0 < kept.n_sets < 20


def test_a_filter_that_rejects_all_is_named(space):
    with pytest.raises(SamplingError, match=r"'nothing' rejects all \d+ sets \(the first: too soft\); widen"):
        draw_design(space, LatinHypercube(), 8, seed=1, filters=[Stiff(), Nothing()])


def test_a_filter_must_return_booleans(space):
    with pytest.raises(SamplingError, match="'indices' returned int64"):
        draw_design(space, LatinHypercube(), 8, seed=1, filters=[Indices()])


def test_a_sampler_must_stay_in_the_cube(space):
    with pytest.raises(SamplingError, match=r"'outside' returned .* in \[1.5, 1.5\]"):
        draw_design(space, Outside(), 8, seed=1)


def test_nothing_to_search_is_an_error(space):
    region = replace(space.regions[0], searched=(), fixed={"stiffness": 0.4, "grip": 20.0})
    with pytest.raises(SamplingError, match="every parameter is fixed"):
        draw_design(ParameterSpace(regions=(region,)), LatinHypercube(), 8, seed=1)


def test_no_set_is_drawn_where_none_is_wanted(space):
    assert draw_design(space, LatinHypercube(), 0, seed=1).values.shape == (0, 2)
    # Without a number of its own any design is the beginning of each larger one.
    few, more, many = (draw_design(space, LatinHypercube(), 0, seed=1, n_total=n).values for n in (5, 12, 40))
    assert [len(each) for each in (few, more, many)] == [5, 12, 40]
    assert np.array_equal(more, draw_design(space, LatinHypercube(), 12, seed=1).values)
    assert np.array_equal(few, more[:5])
    assert np.array_equal(more, many[:12])
    with pytest.raises(SamplingError, match="-1 sets"):
        draw_design(space, LatinHypercube(), -1, seed=1)


class Seldom(SetFilter):
    name = "seldom"
    summary = "keeps one in ten"

    def accept(self, space, values):
        p = space.parameters[0]
        return values[:, 0] > p.upper - 0.1 * (p.upper - p.lower)

    def reason(self, space, row):
        return "it is seldom"


class Forgetful(LatinHypercube):
    name = "forgetful"

    def extend(self, points, n_total, seed):
        return self.draw(n_total, points.shape[1], seed + 1)


SAMPLERS = [
    LatinHypercube(),
    OptimisedLatinHypercube(OptimisedLatinHypercube.Settings(n_swaps=500)),
    OptimisedLatinHypercube(OptimisedLatinHypercube.Settings(n_swaps=500, centred=False)),
    Sobol(),
    Corners(),
]


@pytest.mark.parametrize("sampler", SAMPLERS, ids=lambda s: s.name)
def test_refilling_keeps_the_sets_there_are_and_adds_what_lacks(space, sampler):
    filters = [Stiff(), Stiff()] if sampler.name == "corners" else [Seldom(), Stiff()]
    design = draw_design(space, sampler, 24, seed=5, filters=filters, max_draws=64 * 24)
    once = draw_design(space, sampler, 24, seed=5)
    kept_at_once = once.values[filters[0].accept(space, once.values)]
    assert np.array_equal(design.values[: len(kept_at_once)], kept_at_once)
    assert design.n_sets == 24
    assert 24 < design.n_drawn <= 64 * 24
    assert filters[0].accept(space, design.values).all()
    again = draw_design(space, sampler, 24, seed=5, filters=filters, max_draws=64 * 24)
    assert np.array_equal(again.values, design.values)
    assert again.n_drawn == design.n_drawn


def test_refilling_without_need_changes_nothing(space):
    plain, refilled = (draw_design(space, LatinHypercube(), 20, 1, max_draws=m) for m in (20, 160))
    assert np.array_equal(plain.values, refilled.values)
    assert refilled.n_drawn == 20


def test_a_share_too_small_is_reported(space):
    reason = r"only \d+ of 80 sets \(.* %\) pass 'seldom', but 20 are requested; 'seldom' rejects \d+ "
    reason += r"\(the first: it is seldom\); narrow .*sampling.max_draws to 160 or"
    with pytest.raises(SamplingError, match=reason):
        draw_design(space, LatinHypercube(), 20, seed=1, filters=[Seldom()], max_draws=80)
    with pytest.raises(SamplingError, match=r"'nothing' rejects all 40 sets"):
        draw_design(space, LatinHypercube(), 20, seed=1, filters=[Nothing(), Stiff()], max_draws=40)


def test_a_sampler_must_keep_what_it_extends(space):
    with pytest.raises(SamplingError, match="'forgetful' changed points"):
        draw_design(space, Forgetful(), 20, seed=1, filters=[Seldom()])


def test_an_optimised_hypercube_is_more_even_than_a_plain_one(space):
    plain = LatinHypercube().draw(60, 3, 1)
    settings = OptimisedLatinHypercube.Settings
    by_cd, by_distance, by_correlation = (
        OptimisedLatinHypercube(settings(criterion=c)).draw(60, 3, 1)
        for c in ("cd", "maximin", "correlation")
    )
    assert qmc.discrepancy(by_cd) < 0.4 * qmc.discrepancy(plain)
    assert pdist(by_distance).min() > 3 * pdist(plain).min()
    assert np.abs(np.corrcoef(by_correlation.T) - np.eye(3)).max() < 1e-3
    design = draw_design(space, OptimisedLatinHypercube(), 60, seed=1)
    p = space.parameters[0]
    slices = np.floor((design.values[:, 0] - p.lower) / (p.upper - p.lower) * 60)
    assert sorted(slices) == list(range(60))


def test_a_log_scale_spreads_the_logarithm(space):
    region = space.regions[0]
    first = region.searched[0]
    low, high = replace(first, lower=1.0, upper=100.0, scale="log"), region.searched[1:]
    design = draw_design(
        ParameterSpace(regions=(replace(region, searched=(low, *high)),)), LatinHypercube(), 50, seed=1
    )
    decades = np.log10(design.values[:, 0])
    assert sorted(np.floor(decades / 2 * 50)) == list(range(50))
    corners = draw_design(ParameterSpace(regions=(replace(region, searched=(low, *high)),)), Corners(), 2, 0)
    assert corners.values[:, 0].tolist() == [1.0, 100.0]


def test_a_log_scale_keeps_off_zero(space):
    with pytest.raises(ParameterError, match=r"log scale needs bounds > 0, got -1 to 2"):
        replace(space.parameters[0], lower=-1.0, upper=2.0, physical_lower=-5.0, scale="log")


@pytest.mark.parametrize("sampler", ["lhs", "optimised_lhs", "sobol"])
def test_a_design_is_extended_with_every_set_in_its_place(space, plugins, sampler):
    sampler = plugins.samplers[sampler]()
    designs = [draw_design(space, sampler, 12, 1, n_total=n) for n in (5, 0, 20, 30, 96)]
    assert [design.n_sets for design in designs] == [5, 12, 20, 30, 96]
    for shorter, longer in pairwise(designs):
        np.testing.assert_array_equal(longer.values[: shorter.n_sets], shorter.values)


def test_a_first_look_at_a_filtered_design_is_its_first_sets(space, plugins):
    class Half(SetFilter):
        name, summary = "half", "every set in the lower half"

        def accept(self, space, values):
            return values[:, 0] < 0.55

    arguments = (space, plugins.samplers["lhs"](), 12, 1, (Half(),))
    whole = draw_design(*arguments, max_draws=48)
    for n in (2, 7, 12):
        look = draw_design(*arguments, max_draws=48, n_total=n)
        np.testing.assert_array_equal(look.values, whole.values[:n])


def narrowed(space, upper):
    region = space.regions[0]
    first, *rest = region.searched
    searched = (replace(first, upper=upper), *rest)
    return replace(space, regions=(replace(region, searched=searched),))


def test_narrower_ranges_start_with_the_finished_sets_inside_them(space, plugins):
    sampler = plugins.samplers["lhs"]()
    wide, narrow = draw_design(space, sampler, 40, 1), narrowed(space, 0.4)
    finished = set(range(0, 40, 2))
    inside = [i for i in sorted(finished) if wide.values[i, 0] <= 0.4]
    kept = kept_sets(narrow, 1, wide, finished)
    np.testing.assert_array_equal(kept, wide.values[inside])
    design = draw_design(narrow, sampler, 40, 1, kept=kept)
    fresh = draw_design(narrow, sampler, 40, 1)
    n_kept = len(inside)
    assert (design.n_sets, design.n_drawn, design.n_kept) == (40, 40, n_kept)
    np.testing.assert_array_equal(design.values[:n_kept], kept)
    np.testing.assert_array_equal(design.values[n_kept:], fresh.values[: 40 - n_kept])
    # Once more, extended, cut, and narrowed again.
    again = kept_sets(narrow, 1, design, set())
    longer = draw_design(narrow, sampler, 40, 1, n_total=60, kept=again)
    np.testing.assert_array_equal(longer.values[:40], design.values)
    shorter = draw_design(narrow, sampler, 40, 1, n_total=2, kept=again)
    assert (shorter.n_sets, shorter.n_kept) == (2, 2)
    narrower = narrowed(space, 0.2)
    third = kept_sets(narrower, 1, design, range(40))
    np.testing.assert_array_equal(third, design.values[design.values[:, 0] <= 0.2])


def test_other_ranges_than_narrower_ones_keep_no_sets(space, plugins):
    sampler = plugins.samplers["lhs"]()
    design = draw_design(space, sampler, 12, 1)
    assert kept_sets(narrowed(space, 0.4), 2, design, range(12)) is None
    assert kept_sets(narrowed(space, 1.5), 1, design, range(12)) is None
    assert kept_sets(space, 1, design, range(12)).size == 0
    assert kept_sets(narrowed(space, 0.11), 1, design, ()).size == 0


def test_kept_sets_pass_the_filters_of_the_study_and_may_be_all_there_is(space, plugins):
    class Left(SetFilter):
        name, summary = "left", "every set in the lower part"

        def accept(self, space, values):
            return values[:, 0] < 0.3

    sampler = plugins.samplers["lhs"]()
    wide, narrow = draw_design(space, sampler, 60, 1), narrowed(space, 0.4)
    kept = kept_sets(narrow, 1, wide, range(60))
    for draws in (12, 96):
        design = draw_design(narrow, sampler, 12, 1, (Left(),), max_draws=draws, kept=kept)
        assert design.n_sets == 12 if draws > 12 else 0 < design.n_sets <= 12
        assert (design.values[:, 0] < 0.3).all()
    assert draw_design(narrow, sampler, 5, 1, kept=kept).n_kept == 5
