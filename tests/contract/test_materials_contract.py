"""The shipped materials and their filter under the contracts of palpate.testing."""

import numpy as np
import pytest

from palpate.domain import ParameterSpace, RegionMaterial
from palpate.errors import MaterialError
from palpate.testing import MaterialContract, SetFilterContract
from palpate_materials import Demiray, Drucker, MooneyRivlin, NeoHookean, Ogden, VerondaWestmann, Yeoh
from palpate_materials.ogden import OgdenSettings


class TestMaterials(MaterialContract):
    @pytest.fixture(
        params=[
            Ogden(),
            Ogden(OgdenSettings(terms=2)),
            Yeoh(),
            NeoHookean(),
            MooneyRivlin(),
            VerondaWestmann(),
            Demiray(),
        ],
        ids=[
            "ogden",
            "ogden2",
            "yeoh",
            "neo_hookean",
            "mooney_rivlin",
            "veronda_westmann",
            "demiray",
        ],
    )
    def material(self, request):
        return request.param


class TestDrucker(SetFilterContract):
    @pytest.fixture
    def set_filter(self):
        return Drucker()

    @pytest.fixture
    def space(self):
        yeoh = Yeoh()
        region = RegionMaterial(region="soft_tissue", material=yeoh, searched=yeoh.parameters, fixed={})
        return ParameterSpace(regions=(region,))

    @pytest.fixture
    def values(self, space):
        lower, upper = np.array([[p.lower, p.upper] for p in space.parameters]).T
        return lower + (upper - lower) * np.random.default_rng(0).random((20, lower.size))


class Lopsided(NeoHookean):
    """Stiffer along the first stretch."""

    def energy(self, stretches, theta):
        return super().energy(stretches, theta) * (1 + 0.1 * (stretches[..., 0] - 1) ** 2)


class Offset(NeoHookean):
    """Not zero at rest."""

    def energy(self, stretches, theta):
        return super().energy(stretches, theta) + 1e-3


class Saturated(NeoHookean):
    """Not proportional to its modulus."""

    def energy(self, stretches, theta):
        xp = stretches.__array_namespace__()
        return xp.tanh(super().energy(stretches, theta))


class TestContractCatches:
    """Each law fails on a material that breaks it."""

    contract = MaterialContract()
    theta = np.array([[0.1, 0.45]])
    gradients = np.eye(3) + np.random.default_rng(0).uniform(-0.2, 0.2, (2, 3, 3))

    def test_asymmetry(self):
        with pytest.raises(AssertionError):
            self.contract.test_energy_is_symmetric_in_the_stretches(Lopsided(), self.theta)

    def test_an_energy_at_rest(self):
        with pytest.raises(MaterialError, match="undeformed"):
            self.contract.test_reference_state_is_sound(Offset(), self.theta)

    def test_an_energy_out_of_proportion(self):
        with pytest.raises(AssertionError):
            self.contract.test_moduli_scale_the_energy(Saturated(), self.theta, self.gradients)
