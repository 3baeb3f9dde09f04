"""Where jobs run: in this very process, or in worker processes of this machine."""

import contextlib
from collections.abc import Iterator

from palpate.executors.attempts import attempt
from palpate.executors.machine import n_cores, n_fitting, thread_limits
from palpate.executors.pool import Pool, by_spot
from palpate.executors.work import Limits, Outcome, Work
from palpate.plugins.interfaces import Executor

__all__ = [
    "InProcess",
    "Limits",
    "Outcome",
    "Pool",
    "Processes",
    "Work",
    "attempt",
    "n_cores",
    "thread_limits",
]


class InProcess(Executor):
    """Runs the jobs in this very process.

    Nothing has to be started, but no limit holds: a job that hangs or ends the process takes
    the sweep along.
    """

    name = "in_process"
    holds_limits = False
    summary = "one after the other in palpate's own process; no time or memory limit holds there"

    def outcomes(self, work: Work) -> Iterator[Outcome]:
        """Yield the outcome of each job as it ends."""

        def started(index: int) -> None:
            work.running(1)

        for spot, indices in by_spot(work.jobs).items():
            tasks = [(i, work.jobs[i]) for i in indices]
            yield from attempt(work.solver, work.limbs.get(spot), tasks, started, work.going_on)


class Processes(Executor):
    """Runs the jobs in worker processes of this machine, replaced when they die or hang."""

    name = "processes"
    summary = "worker processes of this machine, each held to its share of the cores"

    def outcomes(self, work: Work) -> Iterator[Outcome]:
        """Yield the outcome of each job as it comes.

        Raises
        ------
        PluginError
            The solver or a material cannot be sent to a worker, or a worker cannot start.
        """
        if not work.jobs:
            return
        n_processes = min(work.n_workers or n_fitting(work.limits.memory_MB), len(work.jobs))
        with contextlib.closing(Pool(work, n_processes)) as pool:
            yield from pool.outcomes(work.jobs)
