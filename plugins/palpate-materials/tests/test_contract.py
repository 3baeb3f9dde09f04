"""The shipped materials and their filter under the contracts of palpate.testing."""

import numpy as np
import pytest

from palpate.domain import ParameterSpace, RegionMaterial
from palpate.testing import MaterialContract, SetFilterContract
from palpate_materials import (
    ArrudaBoyce,
    Demiray,
    Drucker,
    Gent,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    VerondaWestmann,
    Yeoh,
)
from palpate_materials.uncoupled import OgdenSettings


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
            Gent(),
            ArrudaBoyce(),
        ],
        ids=[
            "ogden",
            "ogden2",
            "yeoh",
            "neo_hookean",
            "mooney_rivlin",
            "veronda_westmann",
            "demiray",
            "gent",
            "arruda_boyce",
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


def test_materials_are_equal_by_class_and_settings():
    assert Yeoh() == Yeoh()
    assert Ogden() != Ogden(OgdenSettings(terms=2))
    assert len({Yeoh(), Yeoh(), NeoHookean()}) == 2
