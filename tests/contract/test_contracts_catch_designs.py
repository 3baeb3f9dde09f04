"""Each law of samplers and set filters fails on what breaks it, with the reason."""

import numpy as np
import pytest

from palpate import ParameterSpace, Sampler, SetFilter
from palpate.testing import SamplerContract, SetFilterContract


class Sound(Sampler):
    name, summary = "sound", "independent points"

    def draw(self, n_sets, n_parameters, seed):
        return np.random.default_rng(seed).uniform(0.01, 0.99, (n_sets, n_parameters))


class OutOfTheCube(Sound):
    def draw(self, n_sets, n_parameters, seed):
        return 10 * super().draw(n_sets, n_parameters, seed)


class Unseeded(Sound):
    def draw(self, n_sets, n_parameters, seed):
        return np.random.default_rng().uniform(0.01, 0.99, (n_sets, n_parameters))


class Stuck(Sound):
    def draw(self, n_sets, n_parameters, seed):
        return super().draw(n_sets, n_parameters, 0)


class Restless(Sound):
    def extend(self, points, n_total, seed):
        return self.draw(n_total, points.shape[1], seed + 1)


@pytest.mark.parametrize(
    ("test", "sampler", "message"),
    [
        ("draws_in_the_open_unit_cube", OutOfTheCube(), "draw in the open unit cube"),
        ("a_seed_decides_the_draw", Unseeded(), "one seed gives two draws"),
        ("a_seed_decides_the_draw", Stuck(), "two seeds give one draw"),
        ("an_extension_begins_with_the_points_there_were", Restless(), "changes the sets there were"),
    ],
)
def test_a_samplers_fault_is_reported(test, sampler, message):
    getattr(SamplerContract(), f"test_{test}")(Sound())
    with pytest.raises(AssertionError, match=message):
        getattr(SamplerContract(), f"test_{test}")(sampler)


class Low(SetFilter):
    name, summary = "low", "keeps small values"

    def accept(self, space, values):
        return values[:, 0] < 0.5


class BelowTheMean(Low):
    """Judges a set by the others."""

    def accept(self, space, values):
        return values[:, 0] < values[:, 0].mean()


class Lenient(Low):
    def accept(self, space, values):
        return np.ones(len(values), dtype=bool)


class InShares(Low):
    def accept(self, space, values):
        return super().accept(space, values).astype(float)


SPACE, VALUES = ParameterSpace(regions=()), np.linspace(0.0, 2.0, 9)[:, None]


@pytest.mark.parametrize(
    ("test", "keep", "message"),
    [
        ("keeps_some_and_drops_some", Lenient(), "keeps 9 of 9"),
        ("keeps_some_and_drops_some", InShares(), "a verdict of float64"),
        ("judges_each_set_for_itself", BelowTheMean(), "depends on the other sets"),
    ],
)
def test_a_filters_fault_is_reported(test, keep, message):
    contract = SetFilterContract()

    def hold(each):
        kept = each.accept(SPACE, VALUES)
        if test == "keeps_some_and_drops_some":
            contract.test_keeps_some_and_drops_some(VALUES, kept)
        else:
            contract.test_judges_each_set_for_itself(each, SPACE, VALUES, kept)

    hold(Low())
    contract.test_takes_no_sets_at_all(Low(), SPACE, VALUES)
    with pytest.raises(AssertionError, match=message):
        hold(keep)
