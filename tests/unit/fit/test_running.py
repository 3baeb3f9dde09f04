"""Searches side by side: one batch for all, the answers of each alone, and bad searches end no other."""

import re
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from palpate.domain import Parameter
from palpate.fit import running
from palpate.fit.least_squares import LeastSquares
from palpate.fit.running import Fit, run_searches
from palpate.fit.searches import DifferentialEvolution
from palpate.plugins.provides import Provides
from palpate.plugins.search import Evaluation, Search, Trial

START = np.array([0.5, 0.5])


@dataclass(eq=False)
class Bowl:
    """A problem whose jobs are points, and whose simulations are their residuals."""

    least: tuple
    fails: object = staticmethod(lambda point: False)
    batches: list = field(default_factory=list)
    asked = ()
    study = SimpleNamespace(solver=SimpleNamespace(provides=Provides(slopes=True)))
    box = SimpleNamespace(log=(False, False))
    parameters = tuple(
        Parameter(name=n, unit="1", lower=0.0, upper=1.0, kind="shape", description="of a test") for n in "ab"
    )

    def accepts(self, points):
        return np.ones(len(points), dtype=bool)

    def begin(self, trials, jobs):
        first = len(jobs)
        jobs += [(self, trial.point) for trial in trials]
        return lambda found: [self.answer(trial, found[first + i]) for i, trial in enumerate(trials)]

    def answer(self, trial, residuals):
        if self.fails(trial.point):
            return Evaluation(point=trial.point, objective=np.inf, fopt=np.inf, failure="diverged")
        fopt = float(residuals @ residuals)
        slopes = np.diag([1.0, 3.0, 0.0])[:, :2] if trial.slopes else None
        return Evaluation(point=trial.point, objective=fopt, fopt=fopt, residuals=residuals, jacobian=slopes)


class Batches:
    """Simulates, and notes how many jobs there were at a time."""

    def __init__(self):
        self.sizes = []

    def __call__(self, jobs):
        self.sizes.append(len(jobs))
        return [np.append((point - problem.least) * [1.0, 3.0], 0.1) for problem, point in jobs]


def fits(*leasts, **more):
    return [Fit(Bowl(np.array(least), **more), START) for least in leasts]


@pytest.mark.parametrize("search", [LeastSquares(), DifferentialEvolution()])
def test_a_fit_finds_the_same_whatever_runs_at_the_same_time(search):
    leasts = [(0.3, 0.6), (1.5, 0.2), (0.5, 0.5), (0.9, 0.1)]
    together = fits(*leasts)
    run_searches(search, together, Batches(), seed=1)
    for least, fit in zip(leasts, together, strict=True):
        (alone,) = fits(least)
        run_searches(search, [alone], Batches(), seed=1)
        assert np.array_equal([e.point for e in fit.trace], [e.point for e in alone.trace])
        assert (fit.message, fit.objective) == (alone.message, alone.objective)


def test_rounding_errors_of_another_process_lead_to_the_same_points():
    def rounded_otherwise(jobs):
        return [residuals * (1.0 + 1e-13) for residuals in Batches()(jobs)]

    (first,), (other,) = fits((1 / 3, 0.61)), fits((1 / 3, 0.61))
    run_searches(LeastSquares(), [first], Batches(), seed=1)
    run_searches(LeastSquares(), [other], rounded_otherwise, seed=1)
    assert len(first.trace) > 1
    assert first.objective != other.objective
    assert np.array_equal([e.point for e in first.trace], [e.point for e in other.trace])


def test_a_round_is_one_batch():
    batches = Batches()
    run_searches(LeastSquares(), fits((0.3, 0.6), (0.5, 0.5), (1.5, 0.2)), batches, seed=1)
    assert batches.sizes[0] == 3  # every start
    assert batches.sizes[1] == 2  # the second start is its own end
    assert 0 not in batches.sizes


def test_the_best_evaluation_is_kept_and_every_one_is_in_the_trace():
    (fit,) = fits((0.3, 0.6))
    steps = []
    run_searches(
        DifferentialEvolution(), [fit], Batches(), seed=1, stepped=lambda f: steps.append(len(f.trace))
    )
    assert fit.objective == min(e.objective for e in fit.trace)
    assert steps == sorted(steps)
    assert steps[-1] == len(fit.trace)
    # Trials are arrays of the search: what it does with them later changes no evaluation.
    assert all(e.objective == pytest.approx(((e.point - [0.3, 0.6]) ** 2 @ [1, 9]) + 0.01) for e in fit.trace)


def test_where_everything_fails_there_is_no_best():
    (fit,) = fits((0.3, 0.6), fails=lambda point: True)
    run_searches(LeastSquares(), [fit], Batches(), seed=1)
    assert (fit.best, fit.objective) == (None, np.inf)
    assert fit.message == "the start cannot be simulated (diverged)"


class Then(Search):
    """Asks for the start, then does something else."""

    name, summary, then = "then", "of a test", None

    def search(self, space):
        yield [Trial(point=space.start)]
        yield from self.then(space)
        return "ended"


def raises(self, space):
    raise ZeroDivisionError("of a test")
    yield


def exits(self, space):
    raise SystemExit(3)
    yield


def once(trials):
    def then(self, space):
        yield trials

    return then


@pytest.mark.parametrize(
    ("then", "message"),
    [
        (raises, "'then' .* raised ZeroDivisionError: of a test"),
        (exits, "'then' .* raised SystemExit"),
        (once([]), "asked for no trial"),
        (once(None), "'then' .* raised TypeError"),
        (once([None]), "'then' .* raised AttributeError"),
        (once([Trial(point=np.array([0.5]))]), "no point of the unit box of 2"),
        (once([Trial(point=np.array([0.5, 1.01]))]), "no point of the unit box of 2"),
        (once([Trial(point=np.array([0.5, np.nan]))]), "no point of the unit box of 2"),
        (once([Trial(point="middle")]), "'then' .* raised ValueError"),
    ],
)
def test_a_search_that_goes_wrong_keeps_its_best_and_the_reason(then, message):
    """The others go on."""
    wrong, right = fits((0.4, 0.5), (0.3, 0.6))
    search = type("Wrong", (Then,), {"then": then})()

    class OnlyOne(Then):
        def search(self, space):
            which = search if self.first else LeastSquares()
            self.first = False
            return which.search(space)

        first = True

    run_searches(OnlyOne(), [wrong, right], Batches(), seed=1)
    assert wrong.objective == pytest.approx(0.02)
    assert right.best.point == pytest.approx([0.3, 0.6], abs=1e-6)
    assert right.message == "converged"
    assert re.search(message, wrong.message), wrong.message


def test_a_search_without_end_is_stopped(monkeypatch):
    monkeypatch.setattr(running, "MOST_EVALUATIONS", 50)

    def forever(self, space):
        while True:
            yield [Trial(point=space.start)] * 7

    (fit,) = fits((0.3, 0.6))
    run_searches(type("Endless", (Then,), {"then": forever})(), [fit], Batches(), seed=1)
    assert "more than 50 evaluations" in fit.message
    assert len(fit.trace) <= 50


def test_an_end_without_a_word_has_a_message():
    class Mute(Then):
        def search(self, space):
            yield [Trial(point=space.start)]

    (fit,) = fits((0.3, 0.6))
    run_searches(Mute(), [fit], Batches(), seed=1)
    assert fit.message == "ended"
