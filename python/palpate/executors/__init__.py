"""Where jobs run: in this very process, or in worker processes of this machine."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from palpate.domain import Job, Limb
from palpate.executors.attempts import attempt
from palpate.executors.pool import Pool, by_spot, n_cores, thread_limits
from palpate.executors.work import Limits, Outcome, Work
from palpate.interfaces import Executor, Solver

__all__ = ["InProcess", "Outcome", "Processes", "local", "n_cores", "run", "thread_limits"]


class InProcess(Executor):
    """Runs the jobs in this very process.

    Nothing has to be started, but no limit holds: a job that hangs or ends the process takes
    the sweep along.
    """

    name = "in_process"
    summary = "one after the other in palpate's own process; no time or memory limit holds there"

    def outcomes(self, work: Work) -> Iterator[Outcome]:
        """Yield the outcome of each job as it ends."""
        for spot, indices in by_spot(work.jobs).items():
            tasks = [(i, work.jobs[i]) for i in indices]
            yield from attempt(work.solver, work.limbs.get(spot), tasks, lambda index: None, work.going_on)


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
        n_processes = min(work.n_workers or n_cores(), len(work.jobs))
        with contextlib.closing(Pool(work, n_processes)) as pool:
            yield from pool.outcomes()


def local(n_workers: int) -> Executor:
    """Executor of a study that names none: one worker is this very process."""
    return InProcess() if n_workers == 1 else Processes()


def run(
    solver: Solver,
    jobs: Sequence[Job],
    limbs: Mapping[str, Limb],
    *,
    n_workers: int,
    time_limit_s: float,
    plugin_files: Sequence[Path] = (),
) -> Iterator[Outcome]:
    """Simulate jobs on this machine, yielding each outcome as it comes, exactly one for each job.

    Parameters
    ----------
    solver : Solver
    jobs : sequence of Job
    limbs : mapping of spot name to Limb
        Empty for a solver that needs none.
    n_workers : int
        1: in this process. Otherwise worker processes; 0 means one per core.
    time_limit_s : float
        A job that takes longer is stopped (not with ``n_workers=1``).
    plugin_files : sequence of Path
        One-file plugins that the workers load before anything else.

    Raises
    ------
    PluginError
        The solver or a material cannot be sent to a worker, or a worker cannot start.
    """
    work = Work(
        solver=solver,
        jobs=jobs,
        limbs=limbs,
        limits=Limits(time_s=time_limit_s),
        n_workers=n_workers,
        plugin_files=plugin_files,
    )
    return local(n_workers).outcomes(work)
