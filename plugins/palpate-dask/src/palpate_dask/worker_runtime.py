"""The runtime on each Dask worker: worker processes that are reused from job to job.

A job never runs in Dask's process. The same code as on one machine enforces its limits of time,
memory and attempts, and its crash or hang does not affect Dask.
"""

import pickle
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from distributed import Worker, WorkerPlugin, get_worker

from palpate.api import Simulation, Solver
from palpate.api.executors import Batch, ExecutorError, Limits, Pool, n_cores, packed
from palpate.api.runs import installed_code, load_file, plugin_source

IDLE_S = 300.0
"""Seconds after which idle processes are ended: their run may have ended."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shared:
    """Parts that all jobs of a batch have in common; packed, each worker opens them once.

    Parameters
    ----------
    solver, limbs : bytes
        Packed.
    plugin_files : tuple of (Path, bytes)
        Each with its content, which a worker loads whatever is there.
    versions : mapping
        What :func:`versions` gave where the study is.
    """

    solver: bytes
    limbs: bytes
    limits: Limits
    plugin_files: tuple[tuple[Path, bytes], ...]
    versions: Mapping[str, str]


def shared_by(batch: Batch) -> Shared:
    """Collect what all jobs have in common."""
    return Shared(
        solver=packed(batch.solver),
        limbs=packed(dict(batch.limbs)),
        limits=batch.limits,
        plugin_files=tuple((path.resolve(), plugin_source(path)) for path in batch.plugin_files),
        versions=versions(batch.solver),
    )


class WorkerRuntime(WorkerPlugin):  # type: ignore[misc]
    """Runs jobs on one Dask worker, each in a process that outlives it."""

    def __init__(self, shared: Shared, name: str) -> None:
        self.shared = shared
        self.name = name

    def setup(self, worker: Worker) -> None:
        """Load the plugins; a worker that would compute with other versions is an ExecutorError."""
        for path, source in self.shared.plugin_files:
            load_file(path, source)
        solver = pickle.loads(self.shared.solver)
        refuse_others(worker.address, self.shared.versions, versions(solver))
        self._ended = threading.Event()
        self._batch = Batch(
            solver=solver,
            jobs=(),
            limbs=pickle.loads(self.shared.limbs),
            limits=self.shared.limits,
            plugin_files=[path for path, _ in self.shared.plugin_files],
            should_continue=lambda: not self._ended.is_set(),
        )
        self._n_threads = max(1, n_cores() // worker.state.nthreads)
        self._lock = threading.Lock()
        self._idle: list[Pool] = []
        self._timer = threading.Timer(IDLE_S, self._close_idle)
        self._busy: set[Pool] = set()

    def teardown(self, worker: Worker) -> None:
        """End every process, whatever it does."""
        self._ended.set()
        with self._lock:
            busy = list(self._busy)
        for pool in busy:
            pool.kill()
        self._close_idle()

    def run(self, tasks: Sequence[tuple[int, Any]]) -> list[tuple[int, Simulation]]:
        """Results of jobs of one limb, each with its index in the batch."""
        jobs = [job for _, job in tasks]
        pool = self._take(jobs[0].limb_name)
        try:
            batch = replace(self._batch, jobs=jobs)
            return [(tasks[place][0], simulation) for place, simulation in pool.results(batch)]
        finally:
            self._give_back(pool)

    def _take(self, limb_name: str) -> Pool:
        with self._lock:
            self._timer.cancel()
            pool = max(self._idle, key=lambda each: each.holds(limb_name), default=None)
            if pool is None:
                pool = Pool(self._batch, 1, self._n_threads)
            else:
                self._idle.remove(pool)
            self._busy.add(pool)
        return pool

    def _give_back(self, pool: Pool) -> None:
        with self._lock:
            self._busy.discard(pool)
            self._idle.append(pool)
            if not self._busy:
                self._timer = threading.Timer(IDLE_S, self._close_idle)
                self._timer.daemon = True
                self._timer.start()
        if self._ended.is_set():
            self._close_idle()

    def _close_idle(self) -> None:
        with self._lock:
            self._timer.cancel()
            idle, self._idle = self._idle, []
        for pool in idle:
            pool.close()


def run_tasks(runtime: str, tasks: bytes) -> bytes:
    """Run jobs where Dask put them; what a Dask worker is asked to do.

    Parameters
    ----------
    runtime : str
        Name of the :class:`WorkerRuntime` of the batch.
    tasks : bytes
        Packed pairs of index and Job.
    """
    found: WorkerRuntime = get_worker().plugins[runtime]
    return packed(found.run(pickle.loads(tasks)))


# ----------------------------------------------------------------------- versions


def versions(solver: Solver) -> dict[str, str]:
    """Versions of everything that decides a result and is not sent, here."""
    found = {"python": ".".join(map(str, sys.version_info[:2])), f"solver {solver.name}": solver.version()}
    return found | {name: version(name) for name in ("palpate", "distributed", "numpy")} | installed_code()


def refuse_others(where: str, wanted: Mapping[str, str], found: Mapping[str, str]) -> None:
    """Refuse versions that differ by an ExecutorError that names both."""
    differing = [
        f"{name} {found.get(name, 'absent')} instead of {wanted.get(name, 'none')}"
        for name in {**wanted, **found}
        if wanted.get(name) != found.get(name)
    ]
    if differing:
        raise ExecutorError(
            f"worker {where} would compute with other versions: {'; '.join(differing)}; "
            "install the same there as here"
        )
