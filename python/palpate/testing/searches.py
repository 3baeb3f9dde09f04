"""Laws of searches, on residuals that are linear in the point."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from palpate.domain import FloatArray, Parameter
from palpate.domain.component import Component
from palpate.plugins.search import Evaluation, Search, SearchSpace, Trial
from palpate.testing.components import ComponentContract, missing

N_PARAMETERS = 3
MIDDLE = np.full(N_PARAMETERS, 0.5)

LEFT_OVER = 0.1
"""A residual that no point changes, as noise is."""

Fails = Callable[[int, FloatArray], bool]
"""Whether a trial fails, by its number and its point."""


def toy_space(start: FloatArray, *, exact_slopes: bool, seed: int = 1) -> SearchSpace:
    """What a search is given: parameters from 0 to 1, as many as coordinates of the start."""
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
        self._check(trials)
        self._answers = [self._evaluation(trial) for trial in trials]
        return True

    def _check(self, trials: Sequence[Trial]) -> None:
        assert len(trials) > 0, "asks for no trial; return the reason instead to end"
        assert len(self.points) + len(trials) <= self.most, f"has not ended after {self.most} evaluations"
        for trial in trials:
            point = np.asarray(trial.point)
            assert point.shape == self.start.shape, f"asks for a point of shape {point.shape}"
            assert ((point >= 0.0) & (point <= 1.0)).all(), f"asks for {point}, outside the unit box"

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

    @pytest.fixture
    def search(self) -> Search:
        """Provide the search under test."""
        missing("search", type(self).__name__)

    @pytest.fixture
    def component(self, search: Search) -> Component:
        """Provide the search."""
        return search

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
    said = run.message
    assert isinstance(said, str), f"ends with {said!r}, not with a text: return why it ended"
    assert said.strip(), "ends with an empty text: return why it ended"


def assert_found(run: Rehearsal, left: float) -> None:
    """Assert that a search ends near enough to the optimum."""
    assert_ended(run.run())
    assert run.left <= left, (
        f"ends after {len(run.points)} evaluations with {100.0 * run.left:.2g} % of what there was to gain "
        f"at the start left, more than {100.0 * left:g} %"
    )
