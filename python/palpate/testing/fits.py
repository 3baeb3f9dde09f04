"""Contracts of samplers and filters, parametrisations and searches."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from palpate.domain import (
    BoolArray,
    Curve,
    FloatArray,
    Indentation,
    Parameter,
    ParameterName,
    ParameterSpace,
    Protocol,
    RegionMaterial,
    Response,
)
from palpate.domain.indenter import Sphere
from palpate.fit.box import Box
from palpate.plugins.interfaces import Sampler, SetFilter
from palpate.plugins.parametrisation import Parametrisation, SpotInputs
from palpate.plugins.search import Evaluation, Search, SearchSpace, Trial
from palpate.testing.components import ComponentContract, overridden
from palpate.testing.executors import LinearMaterial


class SamplerContract(ComponentContract):
    """Laws of a sampler; override ``sampler``."""

    sampler = overridden("the sampler under test")

    component = pytest.fixture(lambda self, sampler: sampler)

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

    set_filter = overridden("the filter under test")

    space = overridden("what is searched")

    values = overridden("sets (n_sets, n_parameters) of which the filter keeps some and drops some")

    component = pytest.fixture(lambda self, set_filter: set_filter)

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
        message = "the verdict on a set depends on the other sets"
        np.testing.assert_array_equal(set_filter.accept(space, values[::-1]), kept[::-1], message)
        np.testing.assert_array_equal(set_filter.accept(space, values[:1]), kept[:1], message)

    def test_takes_no_sets_at_all(
        self, set_filter: SetFilter, space: ParameterSpace, values: FloatArray
    ) -> None:
        shape = set_filter.accept(space, values[:0]).shape
        assert shape == (0,), f"a verdict of shape {shape} on no sets"


class ParametrisationContract(ComponentContract):
    """Laws of a parametrisation; override ``parametrisation``, and the study that it is for if need be."""

    parametrisation = overridden("the parametrisation under test")

    component = pytest.fixture(lambda self, parametrisation: parametrisation)

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
        searched = {*map(ParameterName.parse, tried.box.names)}
        every = {str(name.at(spot)) for name in searched for spot in ("", *tried.spots)}
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


_LINE = np.arange(5.0)
PRESS = Response(
    curves={"force": Curve(channel="force", abscissa=_LINE, ordinate=_LINE**2, time_s=2.0 * _LINE)}
)
"""A press of 4 mm in 8 s."""


def _numbers(inputs: SpotInputs) -> FloatArray:
    parts = [np.ravel(inputs.thetas[region]) for region in sorted(inputs.thetas)]
    if isinstance(inputs.protocol, Indentation):
        parts += [inputs.protocol.path.ravel(), np.array([inputs.protocol.friction])]
    else:
        parts += [inputs.protocol.paths[channel] for channel in sorted(inputs.protocol.paths)]
    for each in (inputs.offsets, inputs.gains):
        parts.append(np.array([each[name] for name in sorted(each)]))
    if inputs.observe is not None:
        parts += [curve.ordinate for curve in inputs.observe(PRESS).curves.values()]
    return np.concatenate(parts)


def _at(point: FloatArray, i: int, share: float) -> FloatArray:
    moved = point.copy()
    moved[i] = share
    return moved


N_PARAMETERS = 3
MIDDLE = np.full(N_PARAMETERS, 0.5)

LEFT_OVER = 0.1
"""A residual that no point changes, as noise is."""

Fails = Callable[[int, FloatArray], bool]
"""Whether a trial fails, by its number and its point."""


def toy_space(start: FloatArray, *, exact_slopes: bool, seed: int = 1) -> SearchSpace:
    """Space that a search is given: parameters from 0 to 1, as many as coordinates of the start."""
    parameters = tuple(
        Parameter(name=f"p{i}", unit="1", lower=0.0, upper=1.0, kind="shape", description="of a toy")
        for i in range(start.size)
    )
    return SearchSpace(
        parameters=parameters,
        log=(False,) * start.size,
        start=start.copy(),
        exact_slopes=exact_slopes,
        accuracy=1e-4,
        seed=seed,
    )


@dataclass(eq=False)
class Rehearsal:
    """A search of the toy r = matrix · (point − least), with one more residual of ``LEFT_OVER``.

    Parameters
    ----------
    matrix : (n, n) array
    least : (n,) array
        Where r is least; perhaps outside the box.
    start : (n,) array
    has_slopes : bool
        False: no slopes can be had, although the residuals can.
    most : int
        Evaluations after which the search is stopped, which breaks its contract.
    """

    search: Search
    matrix: FloatArray = field(default_factory=lambda: np.eye(N_PARAMETERS))
    least: FloatArray = field(default_factory=lambda: np.array([0.3, 0.7, 0.55]))
    start: FloatArray = field(default_factory=MIDDLE.copy)
    exact_slopes: bool = True
    fails: Fails = lambda number, point: False
    has_slopes: bool = True
    most: int = 10_000

    def __post_init__(self) -> None:
        self.points: list[FloatArray] = []
        self.objectives: list[float] = []
        self.message: object = None
        self._asking = self.search.search(toy_space(self.start, exact_slopes=self.exact_slopes))
        self._answers: list[Evaluation] | None = None

    def run(self) -> "Rehearsal":
        """Answer until the search ends."""
        while self.step():
            pass
        return self

    def step(self) -> bool:
        """Answer one round; whether there was one."""
        try:
            trials = next(self._asking) if self._answers is None else self._asking.send(self._answers)
        except StopIteration as end:
            self.message = end.value
            return False
        assert len(trials) > 0, "asks for no trial; return the reason instead to end"
        assert len(self.points) + len(trials) <= self.most, f"has not ended after {self.most} evaluations"
        for trial in trials:
            point = np.asarray(trial.point)
            assert point.shape == self.start.shape, f"asks for a point of shape {point.shape}"
            assert ((point >= 0.0) & (point <= 1.0)).all(), f"asks for {point}, outside the unit box"
        self._answers = [self._evaluation(trial) for trial in trials]
        return True

    def residuals(self, point: FloatArray) -> FloatArray:
        """Residuals (n + 1,) at a point."""
        return np.append(self.matrix @ (point - self.least), LEFT_OVER)

    def _evaluation(self, trial: Trial) -> Evaluation:
        number, point = len(self.points), np.array(trial.point, dtype=np.float64)
        self.points.append(point)
        if self.fails(number, point):
            self.objectives.append(np.inf)
            return Evaluation(point=point, objective=np.inf, fopt=np.inf, failure="diverged: a toy")
        r = self.residuals(point)
        fopt = float(r @ r)
        self.objectives.append(fopt)
        jacobian = (
            np.vstack([self.matrix, np.zeros(point.size)]) if trial.slopes and self.has_slopes else None
        )
        return Evaluation(
            point=point,
            objective=fopt,
            fopt=fopt,
            residuals=r,
            jacobian=jacobian,
            failure="" if self.has_slopes or not trial.slopes else "no slopes: diverged",
        )

    @property
    def left(self) -> float:
        """Share of what there was to gain at the start that is still to gain at the best point."""
        found = lsq_linear(self.matrix, self.matrix @ self.least, bounds=(0.0, 1.0), tol=1e-14)
        least, start = 2.0 * found.cost + LEFT_OVER**2, self.residuals(self.start)
        return float((min(self.objectives) - least) / (start @ start - least))


def _valley() -> tuple[FloatArray, FloatArray]:
    """Matrix and least of parameters that compensate each other: 30 times steeper across than along."""
    along = np.array([1.0, -1.0, 0.5]) / 1.5
    matrix = 30.0 * np.eye(N_PARAMETERS) - 29.0 * np.outer(along, along)
    return matrix, MIDDLE + 0.6 * along


class SearchContract(ComponentContract):
    """Laws of a search; override ``search``, and ``left`` if it is not to find the optimum."""

    search = overridden("the search under test")

    component = pytest.fixture(lambda self, search: search)

    @pytest.fixture
    def left(self) -> float:
        """Share of what there was to gain at the start that may be left at the end."""
        return 0.01

    @pytest.mark.parametrize("exact_slopes", [True, False])
    def test_finds_the_least_of_a_bowl(self, search: Search, left: float, exact_slopes: bool) -> None:
        assert_found(Rehearsal(search, exact_slopes=exact_slopes), left)

    def test_follows_a_valley(self, search: Search, left: float) -> None:
        matrix, least = _valley()
        assert_found(Rehearsal(search, matrix, least), left)

    def test_finds_a_least_at_a_bound(self, search: Search, left: float) -> None:
        matrix = np.array([[1.0, 0.8, 0.0], [0.0, 1.0, 0.5], [0.3, 0.0, 1.0]])
        assert_found(Rehearsal(search, matrix, np.array([1.4, 0.4, -0.3])), left)

    def test_leaves_a_bound(self, search: Search, left: float) -> None:
        assert_found(Rehearsal(search, start=np.array([0.0, 1.0, 0.0])), left)

    def test_the_same_answers_bring_the_same_questions(self, search: Search) -> None:
        first, again = Rehearsal(search).run(), Rehearsal(search).run()
        assert np.array_equal(first.points, again.points), (
            "a search that starts again asks for other points: take every number from space.seed"
        )

    def test_searches_side_by_side_do_not_meet(self, search: Search) -> None:
        """One object searches all spots and scenarios at the same time."""
        matrix, least = _valley()
        alone = [Rehearsal(search).run(), Rehearsal(search, matrix, least).run()]
        together = [Rehearsal(search), Rehearsal(search, matrix, least)]
        going = list(together)
        while going:
            going = [each for each in going if each.step()]
        for one, other in zip(alone, together, strict=True):
            assert np.array_equal(one.points, other.points), (
                "depends on another search of the same object: keep what changes in variables of `search`"
            )

    @pytest.mark.parametrize(
        "fails",
        [
            pytest.param(lambda number, point: True, id="all"),
            pytest.param(lambda number, point: number == 0, id="first"),
            pytest.param(lambda number, point: number % 3 == 1, id="every third"),
            pytest.param(lambda number, point: bool(point[1] > 0.6), id="near the least"),
        ],
    )
    def test_survives_failed_trials(self, search: Search, fails: Fails) -> None:
        run = Rehearsal(search, fails=fails).run()
        assert_ended(run)
        if np.isfinite(run.objectives[0]):
            assert min(run.objectives) <= run.objectives[0]

    def test_survives_without_slopes(self, search: Search) -> None:
        assert_ended(Rehearsal(search, has_slopes=False).run())


def assert_ended(run: Rehearsal) -> None:
    """Assert that a search has ended with a reason."""
    message = run.message
    assert isinstance(message, str), f"ends with {message!r}, not with a text: return why it ended"
    assert message.strip(), "ends with an empty text: return why it ended"


def assert_found(run: Rehearsal, left: float) -> None:
    """Assert that a search ends near enough to the optimum."""
    assert_ended(run.run())
    assert run.left <= left, (
        f"ends after {len(run.points)} evaluations with {100.0 * run.left:.2g} % of what there was to gain "
        f"at the start left, more than {100.0 * left:g} %"
    )
