"""The samplers of the core keep the samplers' contract."""

import pytest

from palpate.plugins.interfaces import Sampler
from palpate.sampling.samplers import LatinHypercube, OptimisedLatinHypercube, Sobol
from palpate.testing import SamplerContract


class TestLatinHypercube(SamplerContract):
    @pytest.fixture(params=[False, True], ids=["anywhere", "centred"])
    def sampler(self, request: pytest.FixtureRequest) -> Sampler:
        return LatinHypercube(LatinHypercube.Settings(centred=request.param))


class TestOptimisedLatinHypercube(SamplerContract):
    @pytest.fixture(params=["cd", "maximin", "correlation"])
    def sampler(self, request: pytest.FixtureRequest) -> Sampler:
        return OptimisedLatinHypercube(OptimisedLatinHypercube.Settings(criterion=request.param))


class TestSobol(SamplerContract):
    @pytest.fixture
    def sampler(self) -> Sampler:
        return Sobol()
