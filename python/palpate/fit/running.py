"""Runs searches of several problems side by side, and keeps the best evaluation of each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.domain import FloatArray, Job, Parameter, Simulation
from palpate.errors import PalpateError, PluginError
from palpate.fit.box import on_grid
from palpate.fit.problem import ROUNDING, Problem
from palpate.plugins.guard import answering_for
from palpate.plugins.search import Asking, Evaluation, Search, SearchSpace, Trial
from palpate.run.result import UNSEEN

MOST_EVALUATIONS = 100_000
"""Evaluations after which a search that does not end is stopped."""

SEEN = 1e-9
"""Slope of the residuals in a coordinate, over the largest one, below which no curve depends on it."""


@dataclass(slots=True, eq=False)
class Fit:
    """A search of one problem, as far as it is.

    Parameters
    ----------
    start : (n_parameters,) array
        Point of the box where the search starts.
    is_rough : bool
        Whether another search goes on from its end, so that its last steps are not worth their simulations.

    Attributes
    ----------
    best : Evaluation or None
        That with the least objective; None where every one failed.
    trace : list of Evaluation
        Every one, in the order asked.
    n_asked : list of int
        How many jobs the problem had asked for by each of them.
    message : str
        Why the search ended.
    """

    problem: Problem
    start: FloatArray
    is_rough: bool = False
    best: Evaluation | None = None
    trace: list[Evaluation] = field(default_factory=list)
    n_asked: list[int] = field(default_factory=list)
    message: str = ""

    @property
    def objective(self) -> float:
        """Least Σ r² so far."""
        return np.inf if self.best is None else self.best.objective

    def at_end(self) -> Evaluation:
        """Evaluation where the search has ended, with slopes; a search may not have asked for them there.

        Raises
        ------
        PalpateError
            There are none.
        """
        assert self.best is not None
        same = (each for each in self.trace if np.array_equal(each.point, self.best.point))
        found = next((each for each in same if each.jacobian is not None), None)
        if found is None:
            (found,) = self.problem.evaluate([Trial(point=self.best.point, slopes=True)])
        if found.jacobian is None:
            raise PalpateError(found.failure)
        return found

    def at_bounds(self) -> list[tuple[Parameter, bool]]:
        """Parameters that ended at a bound beyond which there are other values; True for a lower one."""
        assert self.best is not None
        found = []
        for parameter, at in zip(self.problem.parameters, self.best.point, strict=True):
            is_lowest = at <= ROUNDING and parameter.lower > parameter.physical_lower
            is_highest = at >= 1.0 - ROUNDING and parameter.upper < parameter.physical_upper
            if is_lowest or is_highest:
                found.append((parameter, bool(is_lowest)))
        return found

    def unseen(self) -> list[str]:
        """Names of the values on which no curve depends wherever there are slopes, and no prior holds."""
        rates = [np.abs(each.jacobian).max(axis=0) for each in self.trace if each.jacobian is not None]
        most = np.max(rates, axis=0) if rates else np.ones(self.start.size)
        seen = most > SEEN * most.max()
        searched = zip(self.problem.parameters, seen, strict=True)
        return [p.name for p, is_seen in searched if p.prior is None and not is_seen]

    def inseparable(self) -> list[str]:
        """Names of the values that can change together without any residual, by the latest slopes."""
        slopes = [each.jacobian for each in self.trace if each.jacobian is not None]
        sizes = np.linalg.norm(slopes[-1], axis=0) if slopes else np.zeros(1)
        seen = np.flatnonzero(sizes > SEEN * sizes.max())
        if len(seen) < 2:
            return []
        _, strengths, axes = np.linalg.svd(slopes[-1][:, seen] / sizes[seen], full_matrices=False)
        # Least singular value of the slopes, over the largest, below which no curve separates some values.
        if strengths[-1] >= 1e-6 * strengths[0]:
            return []
        return [self.problem.parameters[i].name for i in seen[np.abs(axes[-1]) > 0.1]]

    def remarks(self) -> str:
        """Sentence on the values by their slopes, behind why the search ended."""
        remarks = ""
        if unseen := self.unseen():
            remarks += f"; {UNSEEN} depends on {', '.join(unseen)}, left where the search started"
        if inseparable := self.inseparable():
            remarks += f"; {UNSEEN} separates {', '.join(inseparable)}: fix one or give it a prior"
        return remarks

    def take(self, evaluations: Sequence[Evaluation]) -> None:
        """Keep what was evaluated."""
        self.trace.extend(evaluations)
        self.n_asked += [len(self.problem.asked)] * len(evaluations)
        for each in evaluations:
            if each.objective < self.objective:
                self.best = each


def run_searches(
    search: Search,
    fits: Sequence[Fit],
    simulate: Callable[[Sequence[Job]], Sequence[Simulation]],
    seed: int,
    stepped: Callable[[Fit], None] = lambda fit: None,
) -> None:
    """Search every problem; what they ask for in each round is simulated side by side.

    A search that raises, or asks for something that is no point of the box, ends with its best
    evaluation and the reason.

    Parameters
    ----------
    stepped : callable
        Called after each round with each fit that has gone on.
    """
    asking: list[tuple[Fit, Asking]] = []
    wanted: list[Sequence[Trial]] = []
    for fit in fits:
        asked = _asking(search, _space(fit, seed))
        _next(search, fit, asked, None, asking, wanted)
    while asking:
        jobs: list[Job] = []
        finishing = [fit.problem.begin(trials, jobs) for (fit, _), trials in zip(asking, wanted, strict=True)]
        simulations = simulate(jobs)
        unfinished, asking, wanted = asking, [], []
        for (fit, asked), finish in zip(unfinished, finishing, strict=True):
            evaluations = finish(simulations)
            fit.take(evaluations)
            _next(search, fit, asked, evaluations, asking, wanted)
            stepped(fit)


def first_asked(search: Search, fit: Fit, seed: int) -> None:
    """Ask a search for its first trials, to see that it can.

    Raises
    ------
    PluginError
        It raises, ends without a trial, or asks for what is no point of the box.
    """
    wanted: list[Sequence[Trial]] = []
    _next(search, fit, _asking(search, _space(fit, seed)), None, [], wanted)
    if not wanted:
        raise PluginError(f"it asks for no trial: {fit.message}")


def _asking(search: Search, space: SearchSpace) -> Asking:
    """Call a search with its first step, where whatever it raises is caught."""
    return (yield from search.search(space))


def _space(fit: Fit, seed: int) -> SearchSpace:
    solver = fit.problem.study.solver
    # Curves whose mesh is not corrected yet, or of one of several spots, are wrong by far more than this.
    roughness = 10.0 if fit.is_rough else 1.0
    return SearchSpace(
        parameters=fit.problem.parameters,
        log=tuple(bool(each) for each in fit.problem.box.log),
        start=fit.start,
        exact_slopes=solver.provides.slopes,
        accuracy=roughness * solver.provides.accuracy,
        seed=seed,
        accepts=fit.problem.accepts,
    )


def _next(
    search: Search,
    fit: Fit,
    asked: Asking,
    evaluations: Sequence[Evaluation] | None,
    asking: list[tuple[Fit, Asking]],
    wanted: list[Sequence[Trial]],
) -> None:
    """Let a search go on with its answers; it joins those that ask, or has ended."""
    try:
        with answering_for(search, "searching"):
            try:
                trials = next(asked) if evaluations is None else asked.send(evaluations)
            except StopIteration as end:
                fit.message = str(end.value or "ended") + fit.remarks()
                return
            if len(trials) == 0:
                raise ValueError("it asked for no trial")
            trials = [_sound(trial, fit) for trial in trials]
            if len(fit.trace) + len(trials) > MOST_EVALUATIONS:
                raise ValueError(f"it asked for more than {MOST_EVALUATIONS} evaluations")
    except PalpateError as error:
        fit.message = str(error)
        return
    asking.append((fit, asked))
    wanted.append(trials)


def _sound(trial: Trial, fit: Fit) -> Trial:
    """The trial with a point of its own: what a search does with its array later changes no result."""
    point, n = np.array(trial.point, dtype=np.float64), fit.start.size
    if point.shape != (n,) or not ((point >= 0.0) & (point <= 1.0)).all():
        raise ValueError(f"it asked for {point}, which is no point of the unit box of {n} coordinates")
    if not np.array_equal(point, fit.start):
        point = on_grid(point, fit.problem.study.solver.provides.accuracy)
    point.setflags(write=False)
    return Trial(point=point, slopes=bool(trial.slopes))
