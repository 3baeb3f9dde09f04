"""The executor: jobs to a Dask cluster, results back as they come."""

import weakref
from collections.abc import Iterator
from typing import TYPE_CHECKING

from palpate.api.executors import Batch, Executor, JobResult, n_cores, packed_or_refused
from palpate_dask.settings import DaskSettings

if TYPE_CHECKING:
    from palpate_dask.flow import Connection


class DaskExecutor(Executor[DaskSettings]):
    """Runs the jobs on a Dask cluster, each in a worker process of palpate.

    Notes
    -----
    Each result is returned as it comes, so finished jobs are kept if the cluster fails. If the
    scheduler ends, the sweep stops with an error, and the next run continues it. Cluster and
    worker processes wait for the next batch until :meth:`close`.
    """

    name = "dask"
    summary = "a Dask cluster: this machine, an address, or the nodes of a batch system"

    _connection: "Connection | None" = None

    def results(self, batch: Batch) -> Iterator[JobResult]:
        """Yield the result of each job as it comes.

        Raises
        ------
        ExecutorError
            No scheduler, no workers, workers with other versions, or the scheduler ended.
        PluginError
            The solver or a material cannot be sent, or a worker process cannot start.
        """
        if not batch.jobs:
            return
        packed_or_refused(batch.solver, f"solver '{batch.solver.name}'")
        packed_or_refused(batch.jobs[0], "a material of the study")
        connection, is_over = self._connected(batch.n_workers or n_cores()), False
        try:
            yield from connection.results(batch)
            is_over = True
        finally:
            if not is_over:  # the caller left early, or it failed
                self.close()

    def close(self) -> None:
        """End every process of a worker, and the cluster where it was made for this executor."""
        if self._connection is not None:
            self._close_connection()
            self._connection = None

    def _connected(self, n_workers: int) -> "Connection":
        """Keep the connection of the batch before where it has as many workers."""
        from palpate_dask.flow import Connection  # here: who lists plugins needs no Dask

        if self._connection is None or self._connection.n_workers != n_workers:
            self.close()
            self._connection = Connection(self.settings, n_workers)
            self._close_connection = weakref.finalize(self, self._connection.close)
        return self._connection
