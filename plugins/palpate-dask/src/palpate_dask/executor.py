"""The executor: jobs to a Dask cluster, results back as they come."""

from collections.abc import Iterator

from palpate.api import Batch, Executor, JobResult, n_cores, packed_or_refused
from palpate_dask.settings import DaskSettings


class DaskExecutor(Executor[DaskSettings]):
    """Runs the jobs on a Dask cluster, each in a worker process of palpate.

    Notes
    -----
    Each result is returned as it comes, so finished jobs are kept if the cluster fails. If the
    scheduler ends, the sweep stops with an error, and the next run continues it.
    """

    name = "dask"
    summary = "a Dask cluster: this machine, an address, or the nodes of a batch system"

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
        n_workers = min(batch.n_workers or n_cores(), len(batch.jobs))
        from palpate_dask.flow import results_on_cluster  # here: who lists plugins needs no Dask

        yield from results_on_cluster(self.settings, batch, n_workers)
