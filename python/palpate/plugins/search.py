"""Searches: from evaluations of a problem to the parameters for which it fits best.

A search asks and receives: it yields :class:`Trial` objects, points of the unit box that it wants
evaluated, and receives an :class:`Evaluation` for each. Everything that it asks for is simulated
where the study runs and kept in the run's ledger, so a search that is started again with the same
space comes to the same end without simulating anything twice. It must therefore be deterministic.
"""

import threading
from abc import abstractmethod
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from typing import ClassVar

import numpy as np

from palpate.domain import BoolArray, FloatArray, Parameter
from palpate.domain.component import Component, SettingsT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchSpace:
    """Problem as a search may know it.

    Parameters
    ----------
    parameters : tuple of Parameter
        What is searched, in the order of a point's coordinates: each goes from 0 at its lower bound
        to 1 at its upper one, evenly in its logarithm if ``log``.
    start : (n_parameters,) array
        Point to start from.
    exact_slopes : bool
        Whether slopes come with a simulation; otherwise each costs two more for each parameter.
    accuracy : float
        Scatter of simulated curves, relative to their size: smaller differences mean nothing.
    accepts : callable
        Which points (n, n_parameters) no filter of the study refuses, as (n,) booleans; costs no simulation.
    """

    parameters: tuple[Parameter, ...]
    log: tuple[bool, ...]
    start: FloatArray
    exact_slopes: bool
    accuracy: float
    seed: int
    accepts: Callable[[FloatArray], BoolArray] = lambda points: np.ones(len(points), dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """A point (n_parameters,) of the unit box to evaluate, and whether its slopes are wanted."""

    point: FloatArray
    slopes: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """Result of a trial.

    Parameters
    ----------
    point : (n_parameters,) array
    objective : float
        Σ r²: Fopt and the priors; infinite where the trial failed.
    fopt : float
        Without the priors.
    residuals : (n_points,) array or None
        None where a simulation failed, a filter refuses the point, or a curve does not reach far enough.
    jacobian : (n_points, n_parameters) array or None
        Derivative of the residuals in the coordinates; None where it was not wanted or could not be had.
    failure : str
        Why there are no residuals, or no slopes; empty where there is nothing to report.
    """

    point: FloatArray
    objective: float
    fopt: float
    residuals: FloatArray | None = None
    jacobian: FloatArray | None = None
    failure: str = ""


Asking = Generator[Sequence[Trial], Sequence[Evaluation], str]
"""Yields trials, receives their evaluations in the same order, and returns why it ended."""


def asking(optimise: Callable[[Callable[..., Evaluation]], str]) -> Asking:
    """Trials of an optimiser that calls a function for each point, one after the other.

    It works in a thread, which ends with it, or at its next call after this generator was closed.

    Parameters
    ----------
    optimise : callable
        Called with ``evaluate``, a function of a point and whether slopes are wanted (by itself not) that
        returns the :class:`Evaluation`. It returns why it ended.
    """
    asked: SimpleQueue[Trial | str | BaseException] = SimpleQueue()
    answers: SimpleQueue[Evaluation | None] = SimpleQueue()

    def evaluate(point: FloatArray, slopes: bool = False) -> Evaluation:
        asked.put(Trial(point=np.array(point, dtype=np.float64), slopes=slopes))
        if (evaluation := answers.get()) is None:
            answers.put(None)  # an optimiser that catches this and asks again has no other answer
            raise GeneratorExit
        return evaluation

    def work() -> None:
        try:
            asked.put(optimise(evaluate))
        except BaseException as error:
            asked.put(error)

    threading.Thread(target=work, daemon=True).start()
    try:
        while isinstance(found := asked.get(), Trial):
            (evaluation,) = yield [found]
            answers.put(evaluation)
    finally:
        answers.put(None)
    if isinstance(found, BaseException):
        raise found
    return found


class Search(Component[SettingsT]):
    """Finds the point of the unit box at which a problem fits best."""

    local: ClassVar[bool] = True
    """Whether where it ends depends on where it starts: it is then run from each basin of the sweep."""

    usual_trials: ClassVar[int] = 0
    """Trials that it usually takes from a start far away, to estimate the time of a run; 0: not known."""

    @abstractmethod
    def search(self, space: SearchSpace) -> Asking:
        """Ask for trials until there is nothing to gain.

        The best evaluation of all is the result, so a search has only to return why it ended, such as
        ``"converged"``. Trials that are yielded together are simulated side by side.

        Yields
        ------
        sequence of Trial
            Points in the box; the same point is never simulated twice.

        Returns
        -------
        str
            Why it ended, for people.
        """
