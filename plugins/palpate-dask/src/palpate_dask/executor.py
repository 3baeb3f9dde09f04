"""The executor: jobs to a Dask cluster, outcomes back as they come."""

from collections.abc import Iterator

from palpate.executors import Outcome, Work, n_cores
from palpate.executors.pool import packed_or_refused
from palpate.plugins.interfaces import Executor
from palpate_dask.settings import DaskSettings


class DaskExecutor(Executor):
    """Runs the jobs on a Dask cluster, each in a process of palpate's own beside Dask's.

    Notes
    -----
    Every outcome is its own answer, so what is finished is kept whatever becomes of the cluster.
    Where the scheduler ends the sweep stops with an error, and the next run goes on.
    """

    name = "dask"
    summary = "a Dask cluster: this machine, an address, or the nodes of a batch system"
    Settings = DaskSettings

    def outcomes(self, work: Work) -> Iterator[Outcome]:
        """Yield the outcome of each job as it comes.

        Raises
        ------
        ExecutorError
            No scheduler, no workers, workers with other versions, or the scheduler ended.
        PluginError
            The solver or a material cannot be sent, or a worker process cannot start.
        """
        if not work.jobs:
            return
        packed_or_refused(work.solver, f"solver '{work.solver.name}'")
        packed_or_refused(work.jobs[0], "a material of the study")
        n_workers = min(work.n_workers or n_cores(), len(work.jobs))
        from palpate_dask.flow import outcomes_on_cluster  # here: who lists plugins needs no Dask

        yield from outcomes_on_cluster(self.settings, work, n_workers)
