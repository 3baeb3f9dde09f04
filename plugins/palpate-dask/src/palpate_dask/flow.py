"""Jobs on their way to a Dask cluster, and results on their way back."""

import contextlib
import pickle
import secrets
from collections import deque
from collections.abc import Iterator
from concurrent.futures import CancelledError
from time import monotonic

from distributed import Client, Future, as_completed
from distributed.scheduler import KilledWorker

from palpate.api import PalpateError, Simulation, Status
from palpate.api.executors import Batch, ExecutorError, packed
from palpate_dask.cluster import connected
from palpate_dask.executor import DaskSettings
from palpate_dask.worker_runtime import Shared, WorkerRuntime, run_tasks, shared_by

WAITING_PER_THREAD = 1
"""Jobs that wait on the cluster for each that runs there, so that no worker is ever idle."""

COUNT_EACH_S = 1.0
"""Time between two counts of the cluster's threads."""


class Connection:
    """A cluster with the runtime on its workers, which both stay from one batch to the next.

    Parameters
    ----------
    n_workers : int
        Workers of a cluster on this machine.

    Raises
    ------
    ExecutorError
        No scheduler answers, no worker comes, or dask-jobqueue is missing.
    """

    def __init__(self, settings: DaskSettings, n_workers: int) -> None:
        self.n_workers = n_workers
        self._cluster, self._runtime = contextlib.ExitStack(), contextlib.ExitStack()
        self._client = self._cluster.enter_context(connected(settings, n_workers))
        self._shared: Shared | None = None

    def results(self, batch: Batch) -> Iterator[tuple[int, Simulation]]:
        """Yield the result of each job as it comes."""
        if (shared := shared_by(batch)) != self._shared:
            self._runtime.close()
            self._name = self._runtime.enter_context(_runtime_on_workers(self._client, shared))
            self._shared = shared
        yield from _Flow(self._client, self._name, batch).results()

    def close(self) -> None:
        """End the runtime with all of its processes, and the cluster where it was made for this."""
        with self._cluster, self._runtime:
            pass


@contextlib.contextmanager
def _runtime_on_workers(client: Client, shared: Shared) -> Iterator[str]:
    """Install the runtime on every worker, those that come later included, and take all down at the end."""
    name = f"palpate-{secrets.token_hex(6)}"
    try:
        client.register_plugin(WorkerRuntime(shared, name), name=name)
    except PalpateError:
        raise
    except Exception as error:
        raise ExecutorError(
            f"a Dask worker cannot start: {type(error).__name__}: {error}; "
            "install palpate, palpate-dask and the study's plugins there, of the same versions as here"
        ) from error
    try:
        yield name
    finally:
        # A scheduler that is gone has nothing to take down.
        with contextlib.suppress(Exception):
            if client.status == "running":
                client.unregister_worker_plugin(name)


class _Flow:
    """Keeps as many jobs on the cluster as it can work on, and one more for each."""

    def __init__(self, client: Client, runtime: str, batch: Batch) -> None:
        self._client = client
        self._runtime = runtime
        self._batch = batch
        self._waiting = deque(range(len(batch.jobs)))
        self._sent: dict[Future, int] = {}
        self._n_room, self._counted = 0, -COUNT_EACH_S

    def results(self) -> Iterator[tuple[int, Simulation]]:
        answers = as_completed(loop=self._client.loop, raise_errors=False)
        while True:
            try:
                for future in self._send():
                    answers.add(future)
                if not self._sent:
                    return
                future = next(answers)
                found = self._answer(future, self._sent.pop(future))
            except (OSError, CancelledError) as error:
                raise _gone() from error
            yield from found

    def _send(self) -> list[Future]:
        """Hand out what the cluster has room for; nothing once the batch is stopped."""
        sent: list[Future] = []
        n_room = self._room()
        while self._waiting and len(self._sent) < n_room and self._batch.should_continue():
            index = self._waiting.popleft()
            tasks = packed([(index, self._batch.jobs[index])])
            future = self._client.submit(run_tasks, self._runtime, tasks, pure=False)
            self._sent[future] = index
            sent.append(future)
            self._batch.running(list(self._sent.values())[: n_room // (1 + WAITING_PER_THREAD)])
        return sent

    def _room(self) -> int:
        """Number of jobs that the cluster is given; the scheduler is not asked after each of them."""
        if monotonic() - self._counted > COUNT_EACH_S:
            n_threads = sum(self._client.nthreads().values())
            self._n_room, self._counted = (1 + WAITING_PER_THREAD) * max(1, n_threads), monotonic()
        return self._n_room

    def _answer(self, future: Future, index: int) -> list[tuple[int, Simulation]]:
        if future.status == "finished":
            return pickle.loads(future.result())
        if future.status == "error":
            error = future.exception()
            if isinstance(error, KilledWorker):
                lost = f"the machines that Dask put this job on were lost, the last one {error.last_worker}"
                job, n = self._batch.jobs[index], self._batch.limits.n_attempts
                return [(index, Simulation(job=job, status=Status.CRASHED, message=lost, n_crashes=n))]
            if isinstance(error, PalpateError):
                raise error
            raise ExecutorError(
                f"a Dask worker failed: {type(error).__name__}: {error}; everything finished is kept: "
                "fix the cluster, then `palpate run`"
            )
        raise _gone()


def _gone() -> ExecutorError:
    return ExecutorError(
        "the Dask scheduler is gone, or has forgotten a job; everything finished is kept: "
        "start it again, then `palpate run`"
    )
