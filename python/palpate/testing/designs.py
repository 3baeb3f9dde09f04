"""Laws of what draws parameter sets and of what drops some of them."""

# ruff: noqa: D102 - the name of a test says what must hold

import numpy as np
import pytest

from palpate.domain import (
    BoolArray,
    FloatArray,
    ParameterSpace,
)
from palpate.interfaces import (
    Component,
    Sampler,
    SetFilter,
)
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
        assert points.shape == (16, 3)
        assert ((points > 0.0) & (points < 1.0)).all()

    def test_a_seed_decides_the_draw(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        np.testing.assert_array_equal(points, sampler.draw(16, 3, 1))
        assert not np.array_equal(points, sampler.draw(16, 3, 2))

    def test_an_extension_begins_with_the_points_there_were(self, sampler: Sampler) -> None:
        points = sampler.draw(16, 3, 1)
        np.testing.assert_array_equal(sampler.extend(points, 32, 1)[:16], points)


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
        assert kept.shape == (len(values),)
        assert kept.dtype == np.bool_
        assert 0 < kept.sum() < len(values)

    def test_judges_each_set_for_itself(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray, kept: BoolArray
    ) -> None:
        np.testing.assert_array_equal(set_filter.accept(space, values[::-1]), kept[::-1])
        np.testing.assert_array_equal(set_filter.accept(space, values[:1]), kept[:1])

    def test_takes_no_sets_at_all(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray
    ) -> None:
        assert set_filter.accept(space, values[:0]).shape == (0,)
