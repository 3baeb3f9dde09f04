"""Jobs of one limb through a solver, whatever the solver does."""

import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

from palpate.domain import Job, Limb, Response, Simulation, Status
from palpate.interfaces import Solver
from palpate.results import plain

Task = tuple[int, Job]
"""A job and its place among all jobs of the sweep."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of the job at ``index``; a :class:`Simulation` that can leave its process."""

    index: int
    status: Status
    response: Response | None = None
    message: str = ""
    seconds: float = 0.0
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    def simulation(self, job: Job) -> Simulation:
        """Put the outcome together with its job."""
        return Simulation(
            job=job,
            status=self.status,
            response=self.response,
            message=self.message,
            seconds=self.seconds,
            diagnostics=self.diagnostics,
        )


class _InFlight:
    """The jobs that a solver has taken and not yet answered, in order."""

    def __init__(self, tasks: Sequence[Task], started: Callable[[int], None]) -> None:
        self._waiting = list(tasks)
        self._started = started
        self.taken: dict[tuple[str, int], tuple[int, Job, float]] = {}

    def feed(self) -> Iterator[Job]:
        while self._waiting:
            index, job = self._waiting.pop(0)
            self.taken[job.spot, job.set_id] = (index, job, perf_counter())
            self._started(index)
            yield job

    def answer(self, simulation: Simulation) -> Outcome | None:
        """Outcome of a simulation, or None for one that nobody asked for."""
        found = self.taken.pop((simulation.job.spot, simulation.job.set_id), None)
        if found is None:
            return None
        index, _, begun = found
        return Outcome(
            index=index,
            status=simulation.status,
            response=simulation.response,
            message=simulation.message,
            seconds=simulation.seconds or perf_counter() - begun,
            diagnostics=plain(simulation.diagnostics),
        )

    @property
    def left(self) -> list[Task]:
        return list(self._waiting)


def attempt(
    solver: Solver, limb: Limb | None, tasks: Sequence[Task], started: Callable[[int], None]
) -> Iterator[Outcome]:
    """Outcomes of jobs of one limb, each as it ends and exactly one for each job.

    Parameters
    ----------
    solver : Solver
    limb : Limb or None
    tasks : sequence of (index, Job)
    started : callable
        Told the index of a job when the solver takes it.

    Notes
    -----
    A solver must not raise; if it does while it works on one job, that job has crashed and
    the others go on. If it worked on several, each is tried alone to find the culprit.
    """
    left = list(tasks)
    while left:
        flight = _InFlight(left, started)
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
            if not culprits:
                yield from (_crashed(index, error, perf_counter()) for index, _ in flight.left)
                return
            left = flight.left
        else:
            unanswered = [(index, job) for index, job, _ in flight.taken.values()] + flight.left
            yield from (_unanswered(index) for index, _ in unanswered)
            return


def _attempt_alone(solver: Solver, limb: Limb | None, task: Task, started: Callable[[int], None]) -> Outcome:
    flight = _InFlight([task], started)
    job = next(flight.feed())
    begun = perf_counter()
    try:
        return flight.answer(solver.simulate(job, limb)) or _unanswered(task[0])
    except (Exception, SystemExit) as error:
        return _crashed(task[0], error, begun)


def _crashed(index: int, error: BaseException, begun: float) -> Outcome:
    last_line = traceback.format_exception_only(error)[-1].strip()
    return Outcome(index=index, status=Status.CRASHED, message=last_line, seconds=perf_counter() - begun)


def _unanswered(index: int) -> Outcome:
    return Outcome(
        index=index, status=Status.UNREADABLE, message="the solver ended without a result for this job"
    )
