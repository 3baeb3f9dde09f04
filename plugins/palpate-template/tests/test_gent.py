"""The contract of a material, and what is particular to this one."""

import numpy as np
import pytest

from palpate import mechanics
from palpate.testing import MaterialContract
from palpate_template import Gent


class TestGent(MaterialContract):
    @pytest.fixture
    def material(self):
        return Gent()


def test_initial_moduli_are_its_parameters():
    mu, kappa = mechanics.initial_moduli(Gent(), np.array([0.05, 30.0, 1.0]))
    assert mu == pytest.approx(0.05, rel=1e-12)
    assert kappa == pytest.approx(1.0, rel=1e-12)


def test_becomes_neo_hookean_without_a_limit():
    stretches = np.array([1.5, 1.0, 1.0 / 1.5])
    without_limit = 0.05 / 2 * (np.sum(stretches**2) - 3.0)
    assert Gent().energy(stretches, np.array([0.05, 1e9, 1.0])) == pytest.approx(without_limit, rel=1e-6)
