"""Laws of what draws parameter sets and of what drops some of them."""

import numpy as np
import pytest

from palpate.domain import BoolArray, FloatArray, ParameterSpace
from palpate.domain.component import Component
from palpate.plugins.interfaces import Sampler, SetFilter
from palpate.testing.components import ComponentContract, missing


class SamplerContract(ComponentContract):
    """Laws of a sampler; override ``sampler``."""

    @pytest.fixture
    def sampler(self) -> Sampler:
        """Provide the sampler under test."""
        missing("sampler", type(self).__name__)

    @pytest.fixture
    def component(self, sampler: Sampler) -> Component:
        """Provide the sampler."""
        return sampler

    def test_draws_in_the_open_unit_cube(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        assert points.shape == (16, 3), f"16 sets of 3 parameters are drawn as {points.shape}"
        assert ((points > 0.0) & (points < 1.0)).all(), (
            f"points from {points.min():g} to {points.max():g}: draw in the open unit cube, palpate spreads "
            "them over the ranges"
        )

    def test_a_seed_decides_the_draw(self, sampler: Sampler) -> None:
        points, again = (sampler.draw(16, 3, 1) for _ in range(2))
        np.testing.assert_array_equal(points, again, "one seed gives two draws: take every number from it")
        assert not np.array_equal(points, sampler.draw(16, 3, 2)), "two seeds give one draw"

    def test_an_extension_begins_with_the_points_there_were(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        extended = sampler.extend(points, 32, 1)
        assert extended.shape == (32, 3), f"an extension to 32 sets has the shape {extended.shape}"
        np.testing.assert_array_equal(extended[:16], points, "an extension changes the sets there were")


class SetFilterContract(ComponentContract):
    """Laws of a set filter; override ``set_filter``, ``space`` and ``values``."""

    @pytest.fixture
    def set_filter(self) -> SetFilter:
        """Provide the filter under test."""
        missing("set_filter", type(self).__name__)

    @pytest.fixture
    def space(self) -> ParameterSpace:
        """Provide what is searched."""
        missing("space", type(self).__name__)

    @pytest.fixture
    def values(self) -> FloatArray:
        """Provide sets (n_sets, n_parameters) of which the filter keeps some and drops some."""
        missing("values", type(self).__name__)

    @pytest.fixture
    def component(self, set_filter: SetFilter) -> Component:
        """Provide the filter."""
        return set_filter

    @pytest.fixture
    def kept(self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray) -> BoolArray:
        """Provide its verdict on ``values``."""
        return set_filter.accept(space, values)

    def test_keeps_some_and_drops_some(self, values: FloatArray, kept: BoolArray) -> None:
        assert kept.shape == (len(values),), f"a verdict of shape {kept.shape} on {len(values)} sets"
        assert kept.dtype == np.bool_, f"a verdict of {kept.dtype}, not of true and false"
        assert 0 < kept.sum() < len(values), (
            f"keeps {kept.sum()} of {len(values)}: it does not distinguish them"
        )

    def test_judges_each_set_for_itself(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray, kept: BoolArray
    ) -> None:
        said = "the verdict on a set depends on the other sets"
        np.testing.assert_array_equal(set_filter.accept(space, values[::-1]), kept[::-1], said)
        np.testing.assert_array_equal(set_filter.accept(space, values[:1]), kept[:1], said)

    def test_takes_no_sets_at_all(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray
    ) -> None:
        shape = set_filter.accept(space, values[:0]).shape
        assert shape == (0,), f"a verdict of shape {shape} on no sets"
