"""Run jobs of one limb with a solver; every job gets a result."""

import os
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from time import perf_counter, process_time

from palpate.domain import Job, Limb, Simulation, Status
from palpate.errors import CurveError
from palpate.executors.answers import checked, reject_nonphysical, storable
from palpate.plugins.interfaces import Solver

LONGEST_TRACEBACK = 20_000
"""Most characters of a traceback that are kept."""

PROCESSOR, SLOPES, WORKER = "processor_s", "slopes_s", "worker_s"
"""Diagnostics of a simulation: its processor time, its part for slopes where the solver has measured that,
and what its worker process has spent besides, on its start and on transfers."""

_jobs_here_s = 0.0


def spent_on_jobs_here() -> float:
    """Processor time of this process that :func:`attempt` has spent on jobs."""
    return _jobs_here_s


Task = tuple[int, Job]
"""A job and its place among all jobs of the sweep."""

Result = tuple[int, Simulation]
"""A simulation and the place of its job."""


class _InFlight:
    """Jobs that a solver has taken and not yet answered, in order."""

    def __init__(
        self, tasks: Sequence[Task], started: Callable[[int], None], should_continue: Callable[[], bool]
    ) -> None:
        self.waiting = list(tasks)
        self._started = started
        self._should_continue = should_continue
        self.taken: list[tuple[int, Job, float]] = []
        self.n_answered = 0

    def feed(self) -> Iterator[Job]:
        while self.waiting and self._should_continue():
            index, job = self.waiting.pop(0)
            self.taken.append((index, job, perf_counter()))
            self._started(index)
            yield job

    def answer(self, answer: object) -> Result | None:
        """Result of a simulation, or None for a job that was not requested."""
        if not isinstance(answer, Simulation):
            checked(answer)
            return None
        if (place := self._place_of(answer.job)) is None:
            return None
        index, job, started_s = self.taken.pop(place)
        self.n_answered += 1
        return index, usable(job, answer, perf_counter() - started_s)

    def _place_of(self, answered: Job) -> int | None:
        """Find the job itself, or the only one with the name of a copy."""
        for place, (_, job, _) in enumerate(self.taken):
            if job is answered:
                return place
        same = [place for place, (_, job, _) in enumerate(self.taken) if _name(job) == _name(answered)]
        return same[0] if len(same) == 1 else None


def _name(job: Job) -> tuple[object, ...]:
    return job.limb_name, job.set_id, job.slopes, job.surface


def attempt(
    solver: Solver,
    limb: Limb | None,
    tasks: Sequence[Task],
    started: Callable[[int], None],
    should_continue: Callable[[], bool] = lambda: True,
) -> Iterator[Result]:
    """Results of jobs of one limb, each as it ends, with its processor time; exactly one for each job.

    Parameters
    ----------
    started : callable
        Called with the index of a job when the solver takes it.
    should_continue : callable
        Called before the solver takes a job; if False, the rest has no result.

    Notes
    -----
    A solver must not raise. If it raises during one job, that job has crashed and the others
    continue. If it raises during several, each is run alone to find the cause.
    """
    global _jobs_here_s
    attempted = _attempted(solver, limb, tasks, started, should_continue)
    while True:
        own_s, before_s = process_time(), children_s()
        result = next(attempted, None)
        own_s = process_time() - own_s
        if result is None:
            return
        _jobs_here_s += own_s
        index, simulation = result
        spent_s = own_s + children_s() - before_s
        yield index, replace(simulation, diagnostics={**simulation.diagnostics, PROCESSOR: spent_s})


def children_s() -> float:
    """Processor time of the programs that this process has started and waited for."""
    times = os.times()
    return times.children_user + times.children_system


def _attempted(
    solver: Solver,
    limb: Limb | None,
    tasks: Sequence[Task],
    started: Callable[[int], None],
    should_continue: Callable[[], bool],
) -> Iterator[Result]:
    left = list(tasks)
    while left and should_continue():
        flight = _InFlight(left, started, should_continue)
        try:
            for simulation in solver.simulate_many(flight.feed(), limb):
                if (result := flight.answer(simulation)) is not None:
                    yield result
        except (Exception, SystemExit) as error:
            culprits = flight.taken
            if len(culprits) == 1:
                index, job, started_s = culprits[0]
                yield index, _failed(job, error, started_s)
            for index, job, _ in culprits if len(culprits) > 1 else ():
                started(index)
                yield index, simulate_alone(solver, job, limb)
            if not culprits and not flight.n_answered:
                yield from ((index, _failed(job, error, perf_counter())) for index, job in flight.waiting)
                return
            left = flight.waiting
        else:
            missed = [*flight.taken, *(flight.waiting if should_continue() else ())]
            yield from ((index, _unanswered(job)) for index, job, *_ in missed)
            return


def simulate_alone(solver: Solver, job: Job, limb: Limb | None) -> Simulation:
    """Simulate one job in this process; an error of the solver becomes its status."""
    started_s = perf_counter()
    try:
        answer = solver.simulate(job, limb)
    except (Exception, SystemExit) as error:
        return _failed(job, error, started_s)
    if isinstance(answer, Simulation) and _name(answer.job) != _name(job):
        return _unanswered(job)
    return usable(job, answer, perf_counter() - started_s)


def usable(job: Job, answer: object, seconds: float) -> Simulation:
    """Simulation of a job by an answer: ``unreadable`` with the reason where it cannot be used."""
    try:
        simulation = reject_nonphysical(replace(checked(answer), job=job))
        took = 0.0 < simulation.seconds < float("inf")
    except Exception as error:
        return _failed(job, error, perf_counter() - seconds)
    return simulation if took else replace(simulation, seconds=seconds)


def _failed(job: Job, error: BaseException, started_s: float) -> Simulation:
    """Simulation that raised: curves that cannot be used are unreadable, anything else is a crash."""
    whole = "".join(traceback.format_exception(error))
    return Simulation(
        job=job,
        status=Status.UNREADABLE if isinstance(error, CurveError) else Status.CRASHED,
        message=storable(traceback.format_exception_only(error)[-1].strip()),
        seconds=perf_counter() - started_s,
        diagnostics={"traceback": storable(whole, LONGEST_TRACEBACK)},
    )


def _unanswered(job: Job) -> Simulation:
    message = "the solver ended without a result for this job"
    return Simulation(job=job, status=Status.UNREADABLE, message=message)
