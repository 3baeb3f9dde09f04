"""Jobs of one limb through a solver, whatever the solver does."""

import traceback
from collections.abc import Callable, Iterator, Sequence
from time import perf_counter

from palpate.domain import Job, Limb, Response, Simulation, Status
from palpate.executors.work import Outcome
from palpate.interfaces import Solver
from palpate.results import plain

LONGEST_MESSAGE = 4000
"""Most characters of a solver's message that are kept."""

Task = tuple[int, Job]
"""A job and its place among all jobs of the sweep."""


class _InFlight:
    """The jobs that a solver has taken and not yet answered, in order."""

    def __init__(
        self, tasks: Sequence[Task], started: Callable[[int], None], going_on: Callable[[], bool]
    ) -> None:
        self._waiting = list(tasks)
        self._started = started
        self._going_on = going_on
        self.taken: dict[tuple[str, int], tuple[int, Job, float]] = {}
        self.n_answered = 0

    def feed(self) -> Iterator[Job]:
        while self._waiting and self._going_on():
            index, job = self._waiting.pop(0)
            self.taken[job.spot, job.set_id] = (index, job, perf_counter())
            self._started(index)
            yield job

    def answer(self, simulation: Simulation) -> Outcome | None:
        """Outcome of a simulation, or None for one that nobody asked for."""
        _check(simulation)
        name = (simulation.job.spot, simulation.job.set_id)
        if name not in self.taken:
            return None
        index, _, begun = self.taken[name]
        took = 0.0 < simulation.seconds < float("inf")
        outcome = Outcome(
            index=index,
            status=Status(simulation.status),
            response=simulation.response,
            message=_storable(simulation.message),
            seconds=simulation.seconds if took else perf_counter() - begun,
            diagnostics=plain(simulation.diagnostics),
        )
        del self.taken[name]
        self.n_answered += 1
        return outcome

    @property
    def left(self) -> list[Task]:
        return list(self._waiting)


def attempt(
    solver: Solver,
    limb: Limb | None,
    tasks: Sequence[Task],
    started: Callable[[int], None],
    going_on: Callable[[], bool] = lambda: True,
) -> Iterator[Outcome]:
    """Outcomes of jobs of one limb, each as it ends and exactly one for each job.

    Parameters
    ----------
    solver : Solver
    limb : Limb or None
    tasks : sequence of (index, Job)
    started : callable
        Told the index of a job when the solver takes it.
    going_on : callable
        Asked before the solver takes a job; where it says no the rest has no outcome.

    Notes
    -----
    A solver must not raise; if it does while it works on one job, that job has crashed and
    the others go on. If it worked on several, each is tried alone to find the culprit.
    """
    left = list(tasks)
    while left and going_on():
        flight = _InFlight(left, started, going_on)
        try:
            for simulation in solver.simulate_many(flight.feed(), limb):
                if (outcome := flight.answer(simulation)) is not None:
                    yield outcome
        except (Exception, SystemExit) as error:
            culprits = list(flight.taken.values())
            if len(culprits) == 1:
                index, _, begun = culprits[0]
                yield _crashed(index, error, begun)
            for index, job, _ in culprits if len(culprits) > 1 else ():
                yield _attempt_alone(solver, limb, (index, job), started)
            if not culprits and not flight.n_answered:
                yield from (_crashed(index, error, perf_counter()) for index, _ in flight.left)
                return
            left = flight.left
        else:
            unanswered = [(index, job) for index, job, _ in flight.taken.values()]
            if going_on():
                unanswered += flight.left
            yield from (_unanswered(index) for index, _ in unanswered)
            return


def _check(simulation: object) -> None:
    """Refuse what is no simulation, so that it is told as the solver's mistake with this job."""
    if not isinstance(simulation, Simulation):
        raise TypeError(f"the solver answered with a {type(simulation).__name__}, not a Simulation")
    if not isinstance(simulation.response, Response | None):
        raise TypeError(f"the response is a {type(simulation.response).__name__}, not a Response or None")


def _storable(message: object) -> str:
    """Text of a message, without what no file can hold, and without the middle of a very long one."""
    text = str(message)
    if len(text) > LONGEST_MESSAGE:
        text = f"{text[: LONGEST_MESSAGE // 2]} … {text[-LONGEST_MESSAGE // 2 :]}"
    return text.encode(errors="backslashreplace").decode().replace("\0", "\\0")


def _attempt_alone(solver: Solver, limb: Limb | None, task: Task, started: Callable[[int], None]) -> Outcome:
    flight = _InFlight([task], started, lambda: True)
    job = next(flight.feed())
    begun = perf_counter()
    try:
        return flight.answer(solver.simulate(job, limb)) or _unanswered(task[0])
    except (Exception, SystemExit) as error:
        return _crashed(task[0], error, begun)


def _crashed(index: int, error: BaseException, begun: float) -> Outcome:
    last_line = _storable(traceback.format_exception_only(error)[-1].strip())
    return Outcome(index=index, status=Status.CRASHED, message=last_line, seconds=perf_counter() - begun)


def _unanswered(index: int) -> Outcome:
    return Outcome(
        index=index, status=Status.UNREADABLE, message="the solver ended without a result for this job"
    )
