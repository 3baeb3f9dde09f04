"""Steps of the default search, on functions of a point."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from palpate.domain import Parameter
from palpate.fit.least_squares import LeastSquares, LeastSquaresSettings
from palpate.plugins.search import Evaluation, SearchSpace
from palpate.testing import Rehearsal

UNITS = {"modulus": "MPa", "shape": "1"}


@dataclass
class Answers:
    """Answers a search by a function of the point to residuals, whose slopes are differences."""

    residuals: object
    start: tuple
    kind: str | tuple = "shape"
    bounds: tuple = (0.0, 1.0)
    exact_slopes: bool = True
    accepts: object = None
    accuracy: float = 1e-4
    fails: object = staticmethod(lambda point: False)
    has_slopes: object = staticmethod(lambda n: True)
    asked: list = field(default_factory=list)
    objectives: list = field(default_factory=list)
    message: str = ""

    def run(self, **settings):
        lower, upper = self.bounds
        n = len(self.start)
        kinds = (self.kind,) * n if isinstance(self.kind, str) else self.kind
        more = {} if self.accepts is None else {"accepts": lambda p: np.array([self.accepts(x) for x in p])}
        space = SearchSpace(
            parameters=tuple(
                Parameter(
                    name="p", unit=UNITS[kind], lower=lower, upper=upper, kind=kind, description="of a test"
                )
                for kind in kinds
            ),
            log=tuple(kind == "modulus" for kind in kinds),
            start=np.array(self.start),
            exact_slopes=self.exact_slopes,
            accuracy=self.accuracy,
            seed=1,
            **more,
        )
        asking = LeastSquares(LeastSquaresSettings(**settings)).search(space)
        answers = None
        while True:
            try:
                trials = asking.send(answers)
            except StopIteration as end:
                self.message = end.value
                return self
            answers = [self._answer(trial) for trial in trials]

    def _answer(self, trial):
        self.asked.append(trial)
        if self.fails(trial.point) or (self.accepts is not None and not self.accepts(trial.point)):
            self.objectives.append(np.inf)
            return Evaluation(point=trial.point, objective=np.inf, fopt=np.inf, failure="diverged")
        r = np.asarray(self.residuals(trial.point))
        self.objectives.append(float(r @ r))
        slopes = None
        if trial.slopes and self.has_slopes(len(self.asked) - 1):
            steps = 1e-7 * np.eye(trial.point.size)
            slopes = np.stack(
                [(self.residuals(trial.point + s) - self.residuals(trial.point - s)) / 2e-7 for s in steps],
                axis=1,
            )
        return Evaluation(
            point=trial.point,
            objective=float(r @ r),
            fopt=float(r @ r),
            residuals=r,
            jacobian=slopes,
            failure="no slopes" if trial.slopes and slopes is None else "",
        )

    @property
    def best(self):
        return self.asked[int(np.argmin(self.objectives))].point


def linear(point):
    return np.array([point[0] - 0.4, 2.0 * (point[1] - 0.7), 0.05])


def test_a_linear_problem_takes_one_step_and_one_look():
    run = Answers(linear, (0.5, 0.5)).run()
    np.testing.assert_allclose(run.best, [0.4, 0.7], atol=1e-9)
    assert len(run.asked) == 2
    assert run.message == "converged"


def test_curves_in_proportion_to_moduli_take_one_step_in_logarithms_too():
    ratio = 100.0
    run = Answers(
        lambda p: np.array([ratio ** p[0] - 7.0, ratio ** p[1] - 4.0]), (0.3, 0.4), "modulus", (0.01, 1.0)
    ).run()
    np.testing.assert_allclose(ratio**run.best, [7.0, 4.0], rtol=1e-5)
    assert len(run.asked) == 2


def test_a_curved_valley_is_followed_to_its_end():
    run = Answers(lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 0.9 - p[0]]), (0.1, 0.9)).run()
    np.testing.assert_allclose(run.best, [0.9, 0.81], atol=1e-3)


def test_a_step_is_kept_only_if_it_gains():
    """A model that overshoots: the step is taken back and shortened until it gains."""
    run = Answers(lambda p: np.array([np.tanh(40.0 * (p[0] - 0.5))]), (0.57,)).run(first_step=1.0)
    assert max(run.objectives) > run.objectives[0]
    assert run.best[0] == pytest.approx(0.5, abs=1e-3)


def test_what_no_residual_sees_stays_where_it_is():
    run = Answers(lambda p: np.array([p[0] - 0.4, 0.1]), (0.5, 0.37)).run()
    assert run.best == pytest.approx([0.4, 0.37], abs=1e-9)


def test_two_that_compensate_each_other_end_on_their_line():
    run = Answers(lambda p: np.array([p[0] + p[1] - 0.8, 0.1]), (0.6, 0.6)).run()
    assert run.best.sum() == pytest.approx(0.8)
    assert run.best == pytest.approx([0.4, 0.4], abs=1e-3)  # the nearest point of that line


def test_without_exact_slopes_only_kept_points_are_differenced():
    run = Answers(
        lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 0.9 - p[0]]), (0.1, 0.9), exact_slopes=False
    ).run()
    with_slopes = [t.point for t in run.asked if t.slopes]
    objectives = [float(r @ r) for r in map(run.residuals, with_slopes)]
    assert objectives == sorted(objectives, reverse=True)
    assert len(with_slopes) < len(run.asked) - len(with_slopes) + 2


def test_differences_below_the_solvers_scatter_are_not_followed():
    run = Answers(lambda p: np.array([1e-6 * (p[0] - 0.4)]), (0.5,), accuracy=1e-4).run()
    assert (len(run.asked), run.message) == (1, "converged")


def test_it_steps_along_the_edge_of_what_filters_accept():
    """The way to the least leaves the accepted region, whose edge is curved; the least is inside."""

    def accepts(p):
        return bool(p[1] <= 0.25 + 3.0 * (p[0] - 0.3) ** 2)

    run = Answers(
        lambda p: np.array([p[0] - 0.95, 5.0 * (p[1] - 0.9), 0.01]), (0.2, 0.2), accepts=accepts
    ).run()
    assert np.isfinite(run.objectives).all(), "asked for a refused point"
    np.testing.assert_allclose(run.best, [0.95, 0.9], atol=1e-3)


def test_a_least_that_filters_refuse_is_come_near():
    run = Answers(
        lambda p: np.array([p[0] - 0.9, p[1] - 0.9, 0.01]), (0.2, 0.2), accepts=lambda p: p.sum() <= 1.0
    ).run()
    np.testing.assert_allclose(run.best, [0.5, 0.5], atol=0.02)


def test_where_simulations_fail_the_step_shrinks():
    run = Answers(lambda p: np.array([p[0] - 0.8, 0.01]), (0.5,), fails=lambda p: p[0] > 0.7).run()
    assert 0.6 < run.best[0] <= 0.7


def test_where_slopes_are_missing_a_secant_leads_on():
    """Slopes at the start alone: a curved problem is still solved to its end."""
    curved = Answers(
        lambda p: np.array([np.exp(p[0]) - np.exp(0.6), p[1] ** 2 - 0.25, 0.01]),
        (0.3, 0.3),
        has_slopes=lambda n: n == 0,
    ).run()
    np.testing.assert_allclose(curved.best, [0.6, 0.5], atol=2e-3)
    assert curved.message == "converged"


@pytest.mark.parametrize("accuracy", [1e-4, 1e-9])
def test_what_is_left_to_gain_fits_the_solvers_accuracy(accuracy):
    def missed(point):
        return np.sin(3.0 * point[0]) - np.sin(2.4)

    run = Answers(lambda p: np.array([missed(p), 0.1]), (0.7,), accuracy=accuracy).run()
    assert missed(run.best) ** 2 <= 100.0 * accuracy * 0.01
    steps = [
        len(Answers(lambda p: np.array([missed(p), 0.1]), (0.7,), accuracy=accuracy).run(**more).asked)
        for more in ({}, {"tolerance": 0.5})
    ]
    assert steps[0] >= steps[1]


def test_why_it_ends_is_in_its_message():
    assert Answers(linear, (0.5, 0.5), fails=lambda p: True).run().message == (
        "the start cannot be simulated (diverged)"
    )
    hill = Answers(lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 0.9 - p[0]]), (0.1, 0.9)).run(max_steps=2)
    assert hill.message == "stopped after 2 steps"
    lost = Rehearsal(LeastSquares(), has_slopes=False).run()
    assert lost.message == "stopped at the start: no slopes: diverged"


def test_a_valley_of_moduli_and_exponents_is_followed_to_its_end():
    """A modulus goes with a power where an exponent is searched: straight in logarithms, bent in values."""
    stretch = np.linspace(1.0, 7.0, 20)

    def curve(point):
        terms = (1e-4 * 1e5 ** point[k] * stretch ** (10.0 * point[k + 1]) for k in (0, 2))
        return sum(terms)

    wanted = np.array([0.3, 0.6, 0.8, 0.1])
    found = Answers(
        lambda point: curve(point) - curve(wanted),
        start=(0.7, 0.4, 0.7, 0.3),
        kind=("modulus", "shape", "modulus", "shape"),
        bounds=(1e-4, 10.0),
    ).run()
    assert min(found.objectives) < 1e-6
    assert len(found.asked) <= 50
