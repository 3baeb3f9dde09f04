"""The searches of the core keep the contract of searches."""

import pytest

from palpate.fit.least_squares import LeastSquares
from palpate.fit.searches import BestSet, DifferentialEvolution
from palpate.testing.fits import SearchContract


class TestLeastSquares(SearchContract):
    @pytest.fixture
    def search(self):
        return LeastSquares()


class TestDE(SearchContract):
    @pytest.fixture
    def search(self):
        return DifferentialEvolution()


class TestBestSet(SearchContract):
    @pytest.fixture
    def search(self):
        return BestSet()

    @pytest.fixture
    def left(self):
        return 1.0
