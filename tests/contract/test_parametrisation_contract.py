"""The parametrisation of the core keeps its contract, and each law fails on what breaks it."""

import inspect
from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Parameter, ParameterSpace, RegionMaterial
from palpate.fit.parametrisation import StandardParametrisation, StandardSettings
from palpate.testing import LinearMaterial, ParametrisationContract

RATIO = {"lower": 0.5, "upper": 1.5}


class TestStandard(ParametrisationContract):
    @pytest.fixture
    def parametrisation(self):
        return StandardParametrisation()


class TestWithEverything(ParametrisationContract):
    @pytest.fixture
    def parametrisation(self):
        onset = {"lower": "-0.3 mm", "upper": "0.3 mm"}
        gains = {"force": RATIO, "torque": {**RATIO, "by": "all"}}
        return StandardParametrisation(StandardSettings(friction=RATIO, depth_offset=onset, gains=gains))

    @pytest.fixture
    def space(self):
        material = LinearMaterial()
        searched = tuple(replace(p, by="spot") for p in material.parameters)
        region = RegionMaterial(region="skin", material=material, searched=searched, fixed={})
        return ParameterSpace(regions=(region,))


class Twice(StandardParametrisation):
    def parameters(self, space, spots):
        return (*super().parameters(space, spots), *space.parameters)


class WithoutARegion(StandardParametrisation):
    def inputs(self, space, spot, protocol, values):
        found = super().inputs(space, spot, protocol, values)
        return replace(found, thetas={"skin": found.thetas["skin"]})


class Vain(StandardParametrisation):
    def parameters(self, space, spots):
        vain = Parameter(name="vain", unit="1", lower=0.0, upper=1.0, kind="shape", description="")
        return (*super().parameters(space, spots), vain)


class Forgetful(StandardParametrisation):
    def parameters(self, space, spots):
        return super().parameters(space, spots)[:1]

    def inputs(self, space, spot, protocol, values):
        return super().inputs(space, spot, protocol, {**values, "fat.e": 0.3})


class Rounding(StandardParametrisation):
    def inputs(self, space, spot, protocol, values):
        return super().inputs(
            space, spot, protocol, {name: round(value, 1) for name, value in values.items()}
        )


class Restless(StandardParametrisation):
    def inputs(self, space, spot, protocol, values):
        noise = np.random.default_rng().normal(1.0, 0.01)
        return super().inputs(space, spot, protocol, {name: noise * value for name, value in values.items()})


class StartsElsewhere(StandardParametrisation):
    def start(self, protocols):
        return {"skin.e@p1": 0.3, "growth": 0.0}


@pytest.mark.parametrize(
    ("broken", "law", "reason"),
    [
        (Twice, "names_each_value_once", "name each once"),
        (WithoutARegion, "gives_every_spot_what_is_simulated", "no values for region 'fat'"),
        (Vain, "every_value_changes_something", "'vain' changes nothing"),
        (Forgetful, "every_searched_parameter_of_a_material_is_changed", "no value changes 'fat.e'"),
        (Rounding, "inputs_are_smooth", "inputs jump along 'skin.e'"),
        (Restless, "the_same_values_give_the_same_inputs", "other inputs the second time"),
        (StartsElsewhere, "starts_what_it_searches", r"starts \['growth'\]"),
    ],
)
def test_each_law_fails_on_what_breaks_it(broken, law, reason):
    contract = ParametrisationContract()
    given = {"parametrisation": broken()}

    def fixture(name):
        if name not in given:
            made = getattr(ParametrisationContract, name).__wrapped__
            given[name] = made(contract, *map(fixture, list(inspect.signature(made).parameters)[1:]))
        return given[name]

    test = getattr(contract, f"test_{law}")
    with pytest.raises(AssertionError, match=reason):
        test(*map(fixture, inspect.signature(test).parameters))
