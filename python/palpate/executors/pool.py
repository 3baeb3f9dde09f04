"""Worker processes that may crash or hang without taking the sweep along.

Each worker loads the plugin files first and stays warm from batch to batch: it is handed many jobs
of few limbs, so that what a solver compiles or factorises serves all of them.
"""

import contextlib
import math
import os
import queue
import signal
import subprocess
import sys
import threading
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic
from typing import Any

from palpate.domain import Job, Limb, Simulation, Status
from palpate.errors import ExecutorError, PluginError
from palpate.executors.attempts import Result
from palpate.executors.machine import n_cores, thread_limits
from palpate.executors.sandbox import guarded, how_it_ended, kill_group
from palpate.executors.worker import OUT_OF_TIME, packed, receive, send
from palpate.plugins.execution import Batch
from palpate.plugins.registry import plugin_source

_Setup = tuple[tuple[tuple[Path, bytes], ...], bytes, float]
"""Plugin files with their content, the packed solver, and the memory limit [MB]."""

MOST_LIMBS = 8
"""Most limbs that a worker keeps."""

TICK_S = 1.0
"""Longest wait for a message, and the most that it counts: the machine may have slept meanwhile."""

PATIENCE = 10.0
"""Time by the clock that a worker may be silent, over the processor time of its jobs: one that waits for a
processor is slow, one that uses none hangs."""

START_LIMIT_S = 300.0
"""Longest time that a worker may take to import the solver."""

LONGEST_LINE = 2000
"""Bytes of a worker's output that are kept: its end, for a message."""

LAST_OUTPUT_S = 5.0
"""Longest wait for the end of an ended process's output: what it has started may hold the pipe open."""


def by_limb(jobs: Sequence[Job]) -> dict[str, deque[int]]:
    """Indices of the jobs on each limb."""
    groups: dict[str, deque[int]] = {}
    for index, job in enumerate(jobs):
        groups.setdefault(job.limb_name, deque()).append(index)
    return groups


class Pool:
    """Hands jobs to workers and replaces the workers that die; those that live stay warm for more.

    Parameters
    ----------
    batch : Batch
        The first of those to be run; its jobs start with :meth:`results`.
    n_processes : int
        Most workers at a time.
    n_threads : int, optional
        Threads of each; by itself its share of this machine's cores.

    Raises
    ------
    PluginError
        The solver cannot be sent to a worker.
    """

    def __init__(self, batch: Batch, n_processes: int, n_threads: int | None = None) -> None:
        self._batch = batch
        self._n_wanted = self._n_processes = n_processes
        self._n_threads = n_threads or max(1, n_cores() // n_processes)
        self._setup = _setup(batch)
        self._pending: dict[str, deque[int]] = {}
        self._alone: deque[int] = deque()
        self._n_failed_starts = 0
        self._crashes: Counter[int] = Counter()
        self._unbegun: Counter[int] = Counter()
        self._ends: dict[int, str] = {}
        self._events: queue.SimpleQueue[tuple[_Worker, tuple[Any, ...]]] = queue.SimpleQueue()
        self._workers: list[_Worker] = []
        self.is_running = False

    def serves(self, batch: Batch, n_processes: int) -> bool:
        """Whether the workers can run another batch, which has jobs for so many of them."""
        if self.is_running or n_processes > self._n_wanted:
            return False
        return batch.n_workers == self._batch.n_workers and _setup(batch) == self._setup

    def holds(self, limb_name: str) -> bool:
        """Whether a worker has this limb already."""
        return any(limb_name in worker.limbs for worker in self._workers)

    def results(self, batch: Batch) -> Iterator[Result]:
        """Results as they come, one for each job; fewer if the batch is stopped.

        The batch has the solver, the plugin files and the memory limit of the first. Whoever leaves before
        the last result has to :meth:`close` the pool. A PluginError where a material cannot be sent to a
        worker, or workers end before they are ready; an ExecutorError where the system starts no worker.
        """
        packed_or_refused(batch.jobs[0], "a material of the study")
        self._batch, self._pending, n_left = batch, by_limb(batch.jobs), len(batch.jobs)
        for left in (self._alone, self._crashes, self._unbegun, self._ends):
            left.clear()
        for worker in list(self._workers):
            if worker.has_ended:  # while it had nothing to do: no job of these is to blame
                self._dismiss(worker)
        self.is_running = True
        while n_left:
            if not self.is_running:
                raise ExecutorError("the executor was closed, or given other jobs, before these had ended")
            if batch.should_continue():
                self._staff()
            else:
                for worker in [each for each in self._workers if not each.started]:  # between two jobs
                    self._dismiss(worker)
                if not self._workers:
                    break
            for result in self._next_results():
                n_left -= 1
                yield result
        self.is_running = False

    def close(self) -> None:
        """Stop every worker, whatever it does."""
        for worker in self._workers:
            worker.stop()
        self._workers = []
        self.is_running = False

    def kill(self) -> None:
        """End every worker process, from any thread; whoever waits for results sees them gone."""
        for worker in list(self._workers):
            worker.kill()

    # ---------------------------------------------------------------- handing out

    def _staff(self) -> None:
        """Start missing workers and give the idle ones something to do."""
        n_waiting = len(self._alone) + sum(map(len, self._pending.values()))
        n_free = sum(not worker.assigned for worker in self._workers)
        for _ in range(min(self._n_processes - len(self._workers), n_waiting - n_free)):
            self._start()
        for worker in self._workers:
            if worker.ready and not worker.assigned:
                self._assign(worker)

    def _start(self) -> None:
        try:
            self._workers.append(_Worker(self._setup, self._n_threads, self._events))
        except OSError as error:
            self._n_processes = len(self._workers)  # this machine has no room for more
            if not self._workers:
                raise ExecutorError(
                    f"cannot start a worker process: {error.strerror}; raise the limit (ulimit -n, -u), "
                    "free memory, or set executor.name = 'in_process'"
                ) from error

    def _assign(self, worker: "_Worker") -> None:
        indices = self._take(worker)
        if not indices:
            return
        jobs = self._batch.jobs
        worker.limb_name = jobs[indices[0]].limb_name
        limb = self._batch.limbs.get(worker.limb_name)
        if limb is not None:
            worker.keep(worker.limb_name, limb)
        worker.assigned, worker.silent_s = indices, 0.0
        worker.tell("jobs", limb is not None, packed([(i, jobs[i]) for i in indices]), self._limit_s)

    def _take(self, worker: "_Worker") -> list[int]:
        """Take the next jobs for a worker, all of one limb: best of one that it has already.

        While any job waits no worker is idle: it then gets a limb that others have too.
        """
        if self._alone:
            return [self._alone.popleft()]
        waiting = {name: indices for name, indices in self._pending.items() if indices}
        if not waiting:
            return []
        others = [other for other in self._workers if other is not worker]
        served = {other.limb_name for other in others if other.assigned}
        kept = {name for other in others for name in other.limbs}

        def suitability(name: str) -> tuple[bool, bool, bool, bool, int]:
            is_last, is_there = name == worker.limb_name, name in worker.limbs
            return is_last, is_there, name not in served, name not in kept, len(waiting[name])

        name = max(waiting, key=suitability)
        n_waiting = sum(map(len, waiting.values()))
        n_taken = min(16, -(-n_waiting // (2 * self._n_processes)), len(waiting[name]))
        return [waiting[name].popleft() for _ in range(n_taken)]

    # ------------------------------------------------------------------ listening

    def _next_results(self) -> list[Result]:
        """Act on one message, or on a worker that is silent for too long."""
        for worker in self._workers:
            if worker.silent_s > self._patience_s(worker):
                return self._silent(worker)
        asked_s, event = monotonic(), None
        with contextlib.suppress(queue.Empty):
            event = self._events.get(timeout=TICK_S)
        waited_s = min(monotonic() - asked_s, TICK_S)
        for worker in self._workers:
            worker.silent_s += waited_s
        if event is None or event[0] not in self._workers:
            return []
        worker, message = event
        worker.silent_s = 0.0
        return self._handle(worker, *message)

    def _handle(self, worker: "_Worker", kind: str, *content: Any) -> list[Result]:  # noqa: ANN401 - each kind has its own
        if kind == "ready":
            worker.ready = True
            self._n_failed_starts = 0
        elif kind == "started":
            worker.started.add(content[0])
            self._batch.running([index for each in self._workers for index in each.started])
        elif kind == "done":
            ((index, simulation),) = content
            worker.started.discard(index)
            worker.assigned.remove(index)
            if how := self._ends.get(index):
                repeated = f"repeated, as its worker had ended: {how}"
                message = "; ".join(filter(None, (simulation.message, repeated)))
                simulation = replace(simulation, message=message, n_crashes=self._crashes[index] or 1)
            return [(index, simulation)]
        elif kind == "unable":
            raise PluginError(f"a worker process cannot load the study's plugins: {content[0]}")
        elif kind == "gone":
            return self._gone(worker)
        return []

    @property
    def _limit_s(self) -> float:
        """Processor time that a job may take with all threads of its worker."""
        return self._batch.limits.time_s * self._n_threads

    def _patience_s(self, worker: "_Worker") -> float:
        if not worker.ready:
            return START_LIMIT_S
        n_jobs = max(1, len(worker.started)) if worker.assigned else math.inf
        return PATIENCE * self._batch.limits.time_s * n_jobs

    # -------------------------------------------------------------------- failing

    def _silent(self, worker: "_Worker") -> list[Result]:
        suspects = self._dismiss(worker)
        if not worker.ready:
            raise PluginError(
                f"a worker process did not load the solver within {START_LIMIT_S:g} s; last output: "
                f"{worker.last_output or 'none'}"
            )
        limit = f"{PATIENCE:g} times {self._batch.limits.time_s:g} s"
        return self._timed_out(suspects, worker, f"{worker.silent_s:.1f} s without an answer (limit {limit})")

    def _timed_out(self, suspects: list[int], worker: "_Worker", after: str) -> list[Result]:
        """Time-out of the job of a stopped worker; several jobs are tried again, each alone."""
        if len(suspects) > 1:
            self._alone.extend(suspects)
            return []
        seconds = max(worker.silent_s, self._batch.limits.time_s)
        return [self._lost(index, Status.TIMED_OUT, seconds, f"stopped after {after}") for index in suspects]

    def _lost(self, index: int, status: Status, seconds: float, message: str, n_crashes: int = 0) -> Result:
        job = self._batch.jobs[index]
        return index, Simulation(
            job=job, status=status, seconds=seconds, message=message, n_crashes=n_crashes
        )

    def _gone(self, worker: "_Worker") -> list[Result]:
        """Try the jobs of a worker that died again, alone, before they are quarantined or out of time."""
        worker.await_end()
        had_begun = bool(worker.started)
        suspects = self._dismiss(worker)
        if not worker.ready:
            self._n_failed_starts += 1
            # Workers that may end in a row before they are ready, for each of the processes wanted.
            if self._n_failed_starts < 3 * self._n_processes:
                return []  # another is started in its place
            raise PluginError(
                f"{self._n_failed_starts} worker processes in a row ended before they were ready (the last: "
                f"{worker.how_it_ended()}); check that the plugins import in a fresh Python, and that there "
                "is memory for executor.n_workers of them; finished simulations are kept"
            )
        if worker.killed_by == OUT_OF_TIME:
            limit = f"{self._batch.limits.time_s:g} s for each thread"
            return self._timed_out(suspects, worker, f"{self._limit_s:g} s of processor time (limit {limit})")
        self._ends |= dict.fromkeys(suspects, worker.how_it_ended())
        if not had_begun:
            # Somebody else may have ended it between two jobs; what dies on being handed over dies again.
            self._unbegun.update(suspects)
            self._alone.extend(index for index in suspects if self._unbegun[index] == 1)
            suspects = [index for index in suspects if self._unbegun[index] > 1]
        self._crashes.update(suspects)
        n_attempts = self._batch.limits.n_attempts
        final = [index for index in suspects if self._crashes[index] >= n_attempts]
        self._alone.extend(index for index in suspects if self._crashes[index] < n_attempts)
        times = {1: "once", 2: "twice"}.get(n_attempts, f"{n_attempts} times")
        message = f"the worker process ended {times} on this job: {worker.how_it_ended()}"
        # Signals that come from outside a job: from the system when memory runs out, or from a person.
        n_crashes = 0 if worker.killed_by in (signal.SIGKILL, signal.SIGTERM) else n_attempts
        how = Status.CRASHED, worker.silent_s, message, n_crashes
        return [self._lost(index, *how) for index in final]

    def _dismiss(self, worker: "_Worker") -> list[int]:
        """Stop a worker, take back the jobs that it had not started, and return those it had."""
        worker.stop()
        self._workers.remove(worker)
        suspects = [i for i in worker.assigned if i in worker.started] or worker.assigned[:1]
        for index in reversed(worker.assigned):
            if index not in suspects:
                self._pending[self._batch.jobs[index].limb_name].appendleft(index)
        return suspects


def _setup(batch: Batch) -> _Setup:
    """Setup of a worker, sent before its first job and kept: plugin files as this process has them."""
    solver = packed_or_refused(batch.solver, f"solver '{batch.solver.name}'")
    files = tuple((path, plugin_source(path)) for path in batch.plugin_files)
    return files, solver, batch.limits.memory_MB


def packed_or_refused(value: object, what: str) -> bytes:
    """Pickle what every worker process is to be sent.

    Raises
    ------
    PluginError
        It cannot be sent.
    """
    try:
        return packed(value)
    except Exception as error:
        raise PluginError(
            f"{what} cannot be sent to a worker process ({type(error).__name__}: {error}); define it in an "
            "importable module or a plugin file, or set executor.name = 'in_process'"
        ) from error


class _Worker:
    """One worker process, and the threads that read its answers and its output."""

    def __init__(
        self, setup: _Setup, n_threads: int, events: "queue.SimpleQueue[tuple[_Worker, tuple[Any, ...]]]"
    ) -> None:
        self.ready = False
        self.limb_name: str | None = None
        self.limbs: dict[str, Limb] = {}
        self.assigned: list[int] = []
        self.started: set[int] = set()
        self.silent_s = 0.0
        self.last_output = ""
        self._output = b""
        search_path = os.pathsep.join(path or os.getcwd() for path in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", "from palpate.executors.worker import main; main()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, **thread_limits(n_threads), "PYTHONPATH": search_path},
            start_new_session=True,  # Ctrl-C is for this process, which then stops the workers
        )
        self._guard = contextlib.ExitStack()
        self._guard.enter_context(guarded(self._process.pid))
        self._readers = (
            threading.Thread(target=self._listen, args=(events,), daemon=True),
            threading.Thread(target=self._keep_output, daemon=True),
        )
        for reader in self._readers:
            reader.start()
        self.tell(*setup)

    def _listen(self, events: "queue.SimpleQueue[tuple[_Worker, tuple[Any, ...]]]") -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream, contextlib.suppress(EOFError, OSError, ValueError):
            while True:
                events.put((self, receive(stream)))
        events.put((self, ("gone",)))

    def _keep_output(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as stream:
            while chunk := os.read(stream.fileno(), 1 << 16):
                self._output = (self._output + chunk)[-LONGEST_LINE:]

    def tell(self, *message: object) -> None:
        assert self._process.stdin is not None
        # A worker that has died is reported by its listener.
        with contextlib.suppress(BrokenPipeError):
            send(self._process.stdin, message)

    def keep(self, name: str, limb: Limb) -> None:
        """Send a limb that is not there; the one that was used longest ago makes room for it."""
        if self.limbs.pop(name, None) is not limb:
            if len(self.limbs) == MOST_LIMBS:
                del self.limbs[next(iter(self.limbs))]
            self.tell("limb", name, packed(limb), tuple(self.limbs))
        self.limbs[name] = limb

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def await_end(self) -> None:
        """Let a process that has closed its end finish by itself, so that its exit code is its own."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=5.0)

    def kill(self) -> None:
        """End the process with everything that it started."""
        kill_group(self._process)

    def stop(self) -> None:
        """End the process, let go of all that it held here, and keep its last words."""
        self.kill()
        self._process.wait()
        self._guard.close()
        for reader in self._readers:
            reader.join(LAST_OUTPUT_S)  # it closes what it reads
        with contextlib.suppress(BrokenPipeError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        lines = self._output.decode(errors="replace").splitlines()
        self.last_output = next((line.strip() for line in reversed(lines) if line.strip()), "")

    @property
    def killed_by(self) -> int:
        """Number of the signal that ended the process; 0: it ended by itself."""
        return max(0, -(self._process.returncode or 0))

    def how_it_ended(self) -> str:
        """Exit code or signal, and the last line of output."""
        how = how_it_ended(self._process.returncode)
        return f"{how}; last output: {self.last_output}" if self.last_output else how
