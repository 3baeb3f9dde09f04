"""Executors of jobs: this process, or worker processes of this machine."""

import weakref
from collections.abc import Iterator

from palpate.domain import Simulation
from palpate.executors.attempts import attempt
from palpate.executors.machine import n_cores, n_fitting, thread_limits
from palpate.executors.pool import Pool, by_limb
from palpate.plugins.execution import Batch, Executor, Limits

__all__ = ["Batch", "InProcess", "Limits", "Pool", "Processes", "attempt", "n_cores", "thread_limits"]


class InProcess(Executor):
    """Runs the jobs in this process.

    Nothing has to be started, but no limit is enforced: a job that hangs or crashes the process
    stops the sweep.
    """

    name = "in_process"
    holds_limits = False
    summary = "one after the other in palpate's process; no time or memory limit there"

    def results(self, batch: Batch) -> Iterator[tuple[int, Simulation]]:
        """Yield the place and simulation of each job as it ends."""

        def started(index: int) -> None:
            batch.running([index])

        for name, indices in by_limb(batch.jobs).items():
            tasks = [(i, batch.jobs[i]) for i in indices]
            yield from attempt(batch.solver, batch.limbs.get(name), tasks, started, batch.should_continue)


class Processes(Executor):
    """Runs the jobs in worker processes of this machine, replaced when they die or hang.

    They wait for the next batch, with what the solver has compiled, until :meth:`close` or until
    nothing refers to this executor any more. It runs one batch at a time.
    """

    name = "processes"
    summary = "worker processes of this machine, each held to its share of the cores"

    _pool: Pool | None = None

    def results(self, batch: Batch) -> Iterator[tuple[int, Simulation]]:
        """Yield the place and simulation of each job as it comes.

        Raises
        ------
        PluginError
            The solver or a material cannot be sent to a worker, or a worker cannot start.
        """
        if not batch.jobs:
            return
        n_processes = min(batch.n_workers or n_fitting(batch.limits.memory_MB), len(batch.jobs))
        pool = self._pool
        if pool is None or not pool.serves(batch, n_processes):
            self.close()
            pool = self._pool = Pool(batch, n_processes)
            self._close_pool = weakref.finalize(self, pool.close)
        try:
            yield from pool.results(batch)
        finally:
            if pool.is_running:  # the caller left early, or it failed
                self.close()

    def close(self) -> None:
        """Stop every worker."""
        if self._pool is not None:
            self._close_pool()
            self._pool = None
