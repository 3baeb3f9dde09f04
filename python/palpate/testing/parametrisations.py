"""Laws of parametrisations."""

from collections.abc import Sequence

import numpy as np
import pytest

from palpate.domain import FloatArray, Indentation, ParameterSpace, Protocol, RegionMaterial
from palpate.domain.component import Component
from palpate.domain.indenter import Sphere
from palpate.fit.box import Box
from palpate.plugins.parametrisation import Parametrisation, SpotInputs
from palpate.testing.components import ComponentContract, missing
from palpate.testing.executors import LinearMaterial


class ParametrisationContract(ComponentContract):
    """Laws of a parametrisation; override ``parametrisation``, and the study that it is for if need be."""

    @pytest.fixture
    def parametrisation(self) -> Parametrisation:
        """Provide the parametrisation under test."""
        missing("parametrisation", type(self).__name__)

    @pytest.fixture
    def component(self, parametrisation: Parametrisation) -> Component:
        """Provide the parametrisation."""
        return parametrisation

    @pytest.fixture
    def space(self) -> ParameterSpace:
        """Provide the materials and what is searched of them: of skin and fat, a stiffness each."""
        material = LinearMaterial()
        regions = (
            RegionMaterial(region=name, material=material, searched=material.parameters, fixed={})
            for name in ("skin", "fat")
        )
        return ParameterSpace(regions=tuple(regions))

    @pytest.fixture
    def spots(self) -> Sequence[str]:
        """Provide names of spots."""
        return ("p1", "p2")

    @pytest.fixture
    def protocol(self) -> Protocol:
        """Provide what is done at each of them: a press and a twist."""
        path = np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 20.0)])
        return Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=0.5)

    @pytest.fixture
    def tried(
        self,
        parametrisation: Parametrisation,
        space: ParameterSpace,
        spots: Sequence[str],
        protocol: Protocol,
    ) -> "_Tried":
        """Provide the parametrisation of all spots together."""
        return _Tried(parametrisation, space, spots, protocol)

    def test_names_each_value_once(
        self, parametrisation: Parametrisation, space: ParameterSpace, spots: Sequence[str]
    ) -> None:
        for together in (spots[:1], spots):
            names = [p.name for p in parametrisation.parameters(space, together)]
            assert names, f"searches nothing at {', '.join(together)}"
            assert len(set(names)) == len(names), f"names {names} at {', '.join(together)}; name each once"

    def test_gives_every_spot_what_is_simulated(self, tried: "_Tried") -> None:
        for point in tried.points:
            for spot in tried.spots:
                inputs = tried.inputs(spot, point)
                for region in tried.space.regions:
                    assert region.region in inputs.thetas, f"gives no values for region '{region.region}'"
                    shape = np.shape(inputs.thetas[region.region])
                    expected = (len(region.material.parameters),)
                    assert shape == expected, (
                        f"gives '{region.region}' values of shape {shape}, not {expected}"
                    )
                assert type(inputs.protocol) is type(tried.protocol), "makes another kind of test"
                numbers = _numbers(inputs)
                assert np.isfinite(numbers).all(), f"gives values that are not finite: {numbers}"
                assert all(gain > 0.0 for gain in inputs.gains.values()), f"gives gains {dict(inputs.gains)}"

    def test_the_same_values_give_the_same_inputs(self, tried: "_Tried") -> None:
        for point in tried.points:
            once, again = tried.numbers(point), tried.numbers(point)
            assert np.array_equal(once, again), "the same values give other inputs the second time"

    def test_every_value_changes_something(self, tried: "_Tried") -> None:
        for i, name in enumerate(tried.box.names):
            low, high = (tried.numbers(_at(tried.points[0], i, end)) for end in (0.0, 1.0))
            assert not np.array_equal(low, high), f"'{name}' changes nothing at any spot; leave it out"

    def test_every_searched_parameter_of_a_material_is_changed(self, tried: "_Tried") -> None:
        thetas = [
            [tried.inputs(spot, point).thetas for point in (np.zeros(tried.n), np.ones(tried.n))]
            for spot in tried.spots
        ]
        for region in tried.space.regions:
            names = [p.name for p in region.material.parameters]
            for parameter in region.searched:
                at = names.index(parameter.name)
                changed = any(low[region.region][at] != high[region.region][at] for low, high in thetas)
                assert changed, (
                    f"no value changes '{region.region}.{parameter.name}', which the study searches"
                )

    def test_inputs_are_smooth(self, tried: "_Tried") -> None:
        """The change along each value is the sum of its slopes."""
        shares = np.linspace(0.1, 0.9, 81)
        middles, step = 0.5 * (shares[1:] + shares[:-1]), 1e-4
        for i, name in enumerate(tried.box.names):
            numbers = [tried.numbers(_at(tried.points[0], i, at)) for at in (shares[0], shares[-1])]
            slopes = [
                tried.numbers(_at(tried.points[0], i, at + step))
                - tried.numbers(_at(tried.points[0], i, at - step))
                for at in middles
            ]
            by_slopes = np.sum(slopes, axis=0) / (2.0 * step) * (shares[1] - shares[0])
            change = numbers[1] - numbers[0]
            assert np.allclose(by_slopes, change, rtol=0.02, atol=1e-6 * np.abs(change).max()), (
                f"inputs jump along '{name}': they change by {change}, by their slopes {by_slopes}; "
                "they are differentiated, so keep them smooth"
            )

    def test_starts_what_it_searches(self, tried: "_Tried") -> None:
        given = tried.parametrisation.start(dict.fromkeys(tried.spots, tried.protocol))
        names = {name for p in tried.box.names for name in (p, p.partition("@")[0])}
        every = {f"{name}@{spot}" for name in names for spot in tried.spots} | names
        assert set(given) <= every, f"starts {sorted(set(given) - every)}, which it does not search"
        assert all(np.isfinite(value) for value in given.values()), f"starts at {dict(given)}"


class _Tried:
    """A parametrisation of some spots together, at points of its box."""

    def __init__(
        self,
        parametrisation: Parametrisation,
        space: ParameterSpace,
        spots: Sequence[str],
        protocol: Protocol,
    ) -> None:
        self.parametrisation, self.space, self.spots, self.protocol = parametrisation, space, spots, protocol
        self.box = Box(parametrisation.parameters(space, spots))
        self.n = len(self.box.names)
        self.points = np.random.default_rng(1).uniform(0.2, 0.8, (3, self.n))

    def inputs(self, spot: str, point: FloatArray) -> SpotInputs:
        values = dict(zip(self.box.names, self.box.values(point).tolist(), strict=True))
        return self.parametrisation.inputs(self.space, spot, self.protocol, values)

    def numbers(self, point: FloatArray) -> FloatArray:
        """Everything that the spots are given, as one array."""
        return np.concatenate([_numbers(self.inputs(spot, point)) for spot in self.spots])


def _numbers(inputs: SpotInputs) -> FloatArray:
    parts = [np.ravel(inputs.thetas[region]) for region in sorted(inputs.thetas)]
    if isinstance(inputs.protocol, Indentation):
        parts += [inputs.protocol.path.ravel(), np.array([inputs.protocol.friction])]
    else:
        parts += [inputs.protocol.paths[channel] for channel in sorted(inputs.protocol.paths)]
    for each in (inputs.offsets, inputs.gains):
        parts.append(np.array([each[name] for name in sorted(each)]))
    return np.concatenate(parts)


def _at(point: FloatArray, i: int, share: float) -> FloatArray:
    moved = point.copy()
    moved[i] = share
    return moved
