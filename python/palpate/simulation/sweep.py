"""Simulations of a run: from its ledger, from the cache, else through an executor, each key once.

Only this process writes results to the run directory. A job that crashed is tried again by the next run; one
that was given up only with more attempts. The cache is a ledger too, of what would end the same way again: a
time-out or a crash depends on the machine.
"""

import contextlib
import functools
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import monotonic

import numpy as np

from palpate.domain import FINE, FloatArray, Job, Limb, Simulation, Status
from palpate.domain.channels import PRESS_AND_TWIST
from palpate.errors import PluginError, StoppedError, typed
from palpate.executors import Batch, Limits, Processes
from palpate.executors.attempts import usable
from palpate.plugins.execution import Executor
from palpate.plugins.guard import answering_for
from palpate.progress import SILENT, Progress, RunningJob, about
from palpate.run.keys import JobKeys
from palpate.run.ledger import Ledger, Writer
from palpate.simulation.cost import SWEEP, WORTH_SAYING_S, cost
from palpate.simulation.forecast import Forecast
from palpate.study.reading import Study

_Found = Iterator[tuple[str, Simulation]]
"""Simulations with their keys."""


def _no_check() -> None:
    """Default check: no lock is held."""


class Simulations:
    """Simulations of all stages of a command, as a context: each key once, every result stored.

    The stages use it in turn; the executor and the ledger stay open until the end.
    A stage that is stopped and runs again gets the same results.

    Parameters
    ----------
    folder : Path
        The run directory; nothing is written there before the first simulation.
    check : callable
        Raises where the lock on the folder is lost.
    on_simulated : callable
        Called with each simulation that was made, and neither kept nor cached.

    Attributes
    ----------
    limbs : dict of limb name to Limb
        A stage may add others, before it asks for jobs on them.
    known : mapping of key to Simulation
        Every one that was asked for so far.
    forecast : Forecast
        Simulations that the command has still to make.
    """

    def __init__(
        self,
        study: Study,
        folder: Path,
        limbs: Mapping[str, Limb],
        progress: Progress = SILENT,
        check: Callable[[], None] = _no_check,
        forecast: Forecast | None = None,
        on_simulated: Callable[[Simulation], None] = lambda simulation: None,
    ) -> None:
        self.study = study
        self.folder = folder
        self.limbs = dict(limbs)
        self.progress = progress
        self.forecast = forecast or Forecast()
        self._on_simulated = on_simulated
        self._is_time_said = False
        self._check = check
        self._keys = JobKeys(study.solver, self.limbs, study.trusted)
        self._first: dict[str, Mapping[str, FloatArray]] = {}
        self.known: dict[str, Simulation] = {}
        self._opened = contextlib.ExitStack()

    def __enter__(self) -> "Simulations":
        self._executor = self._opened.enter_context(executor_of(self.study))
        return self

    def __exit__(self, *raised: object) -> None:
        self._opened.__exit__(*raised)  # type: ignore[arg-type]

    def key(self, job: Job) -> str:
        """Return the key under which a job is simulated once."""
        return self._keys.key(job)

    def plan(self, jobs: Sequence[Job]) -> None:
        """Note the jobs of the sweep that begins, and begin its stage.

        Raises
        ------
        LedgerError
            The ledger cannot be written, or is damaged.
        """
        keys = list(map(self.key, jobs))
        self._writer.plan(keys, jobs)
        if not jobs:
            return
        self.progress.begin(SWEEP, len(set(keys)))
        by_key = dict(zip(keys, jobs, strict=True))
        self.forecast.correct(SWEEP, Counter(job.limb_name for job in by_key.values()))
        self._show_forecast()
        left = cost(self.study, by_key, self.folder, self.limbs, self.forecast.parts)
        if left.n_left and left.seconds_each is not None:
            self.progress.note(str(left))
        self._warn_of_full_disk(len(set(keys) - self._kept - self.known.keys()))

    def of(self, jobs: Sequence[Job]) -> list[Simulation]:
        """Return the simulation of each job; each is a step of the running stage.

        Raises
        ------
        LedgerError
            The ledger cannot be written, or is damaged.
        StoppedError
            The caller requested a stop; finished results are kept.
        """
        keys = list(map(self.key, jobs))
        n_jobs = Counter(keys)
        by_key: dict[str, Job] = {}
        for key, job in zip(keys, jobs, strict=True):
            by_key.setdefault(key, self._with_warm_start(job))
        for source in (self._in_memory, self._in_ledger, self._in_cache, self._simulated):
            for key, simulation in source(by_key):
                is_new = key not in self.known
                self.known[key] = simulation
                # Of a run each simulation is one, however many jobs and stages ask for it.
                for _ in range(int(is_new) if self.forecast.parts else n_jobs[key]):
                    self.forecast.ended(by_key[key].limb_name, simulation.seconds)
                    self.progress.step(simulation.status.value)
                    self._show_forecast()
            by_key = {key: job for key, job in by_key.items() if key not in self.known}
        if "_writer" in self.__dict__:  # made by the first result that is new
            self._writer.flush()
        if by_key:
            raise StoppedError(
                f"stopped with {len(self.known)} simulations finished and kept; "
                f"`palpate run {typed(self.folder)}` continues the run"
            )
        return [of_job(self.known[key], job) for key, job in zip(keys, jobs, strict=True)]

    def _with_warm_start(self, job: Job) -> Job:
        """Job that starts from the first set that was asked for on its path; a set of a design has its own.

        No key has that start: it changes a result by less than the solver's accuracy.
        """
        if job.set_id >= 0 or job.mesh or not self._takes_warm_starts:
            return job
        nothing = {region: values[:0] for region, values in job.thetas.items()}
        path = self.key(replace(job, thetas=nothing, slopes=False, surface=False, channels=PRESS_AND_TWIST))
        first = self._first.setdefault(path, job.thetas)
        if all(np.array_equal(first[region], values) for region, values in job.thetas.items()):
            return replace(job, is_warm_start=True)
        return replace(job, warm_starts={region: values[None] for region, values in first.items()})

    @functools.cached_property
    def _takes_warm_starts(self) -> bool:
        with answering_for(self.study.solver, "asking for its warm starts"):
            return self.study.solver.n_warm_starts(sys.maxsize) > 0

    # -------------------------------------------------------- where they come from

    def _in_memory(self, by_key: Mapping[str, Job]) -> _Found:
        return ((key, self.known[key]) for key in by_key if key in self.known)

    def _in_ledger(self, by_key: Mapping[str, Job]) -> _Found:
        if kept := {key: job for key, job in by_key.items() if key in self._kept}:
            with Ledger(self.folder) as ledger:
                yield from ledger.simulations(kept).items()

    def _in_cache(self, by_key: Mapping[str, Job]) -> _Found:
        if self.study.cache is None:
            return
        with Ledger(self.study.cache) as cache:
            for key, simulation in cache.simulations(by_key).items():
                self._writer.store(key, simulation)
                yield key, simulation

    def _simulated(self, by_key: Mapping[str, Job]) -> _Found:
        if not by_key or not self.progress.should_continue():
            return
        repeated: list[str] = []
        for batch in _warm_starts_first(by_key):
            keys, jobs = list(batch), list(batch.values())
            for index, simulation in results(
                self.study, self._executor, jobs, self.limbs, self.progress, self.forecast
            ):
                self._writer.store(keys[index], simulation)
                self._on_simulated(simulation)
                if self._cache is not None and simulation.status not in (Status.TIMED_OUT, Status.CRASHED):
                    self._cache.store(keys[index], simulation)
                if simulation.n_crashes and simulation.status is not Status.CRASHED:
                    repeated.append(simulation.message)
                yield keys[index], simulation
            self._say_time()
        if repeated:
            self.progress.note(f"{len(repeated)} simulations had to be repeated; the last: {repeated[-1]}")

    def _show_forecast(self) -> None:
        if self.forecast.is_whole:
            self.progress.expect(self.forecast.n_left, self.forecast.seconds_left)

    def _say_time(self) -> None:
        """Report once how long the command will take, after its first simulations."""
        seconds, n_left = self.forecast.seconds_left, self.forecast.n_left
        if not self._is_time_said and seconds is not None and seconds > WORTH_SAYING_S:
            self._is_time_said = True
            at_a_time = f"workers: {self.forecast.n_workers}"
            self.progress.note(f"about {n_left} more simulations, {about(seconds)} ({at_a_time})")

    # ------------------------------------------------------------------- the ledger

    @functools.cached_property
    def _writer(self) -> Writer:
        return self._opened.enter_context(Writer(self.folder, self._check))

    @functools.cached_property
    def _cache(self) -> Writer | None:
        """The cache to write to; results of trusted code are not shared: they are for this run only."""
        if self.study.cache is None or self.study.trusted:
            return None
        return self._opened.enter_context(Writer(self.study.cache))

    @functools.cached_property
    def _kept(self) -> set[str]:
        """Keys that earlier commands have finished for good."""
        with Ledger(self.folder) as ledger:
            return ledger.final(self.study.time_limit_s, self.study.n_attempts)

    def _warn_of_full_disk(self, n_left: int) -> None:
        """Warn before the first simulation if the disk may become full."""
        with Ledger(self.folder) as ledger:
            # Default size of a simulation on the disk: two curves of 300 points.
            wanted_MB = n_left * (ledger.bytes_each() or 15_000) * 1e-6
        free_MB = shutil.disk_usage(self.folder).free * 1e-6
        if wanted_MB > free_MB:
            self.progress.note(
                f"{self.folder}: {free_MB:.1f} MB are free, but the {n_left} remaining simulations need "
                f"about {wanted_MB:.1f} MB; free disk space or name another folder; a full disk stops a run "
                "but loses nothing"
            )


def _warm_starts_first(by_key: Mapping[str, Job]) -> Iterator[dict[str, Job]]:
    """Batches, those first that others start from: so no worker has to repeat them."""
    batches: dict[int, dict[str, Job]] = {}
    for key, job in by_key.items():
        n_warm_starts = len(next(iter(job.warm_starts.values()))) if job.warm_starts else 0
        batches.setdefault(n_warm_starts, {})[key] = job
    return (batches[n_warm_starts] for n_warm_starts in sorted(batches))


def of_job(simulation: Simulation, job: Job) -> Simulation:
    """Put the result under another name, where two jobs have one key."""
    return simulation if simulation.job is job else replace(simulation, job=job)


@contextlib.contextmanager
def executor_of(study: Study) -> Iterator[Executor]:
    """Executor of the study's jobs; closed at the end."""
    executor = study.executor or Processes()
    try:
        yield executor
    finally:
        with answering_for(executor, "closing it"):
            executor.close()


def results(
    study: Study,
    executor: Executor,
    jobs: Sequence[Job],
    limbs: Mapping[str, Limb],
    progress: Progress = SILENT,
    forecast: Forecast | None = None,
) -> Iterator[tuple[int, Simulation]]:
    """Place and simulation of each job, as it comes; nothing is kept.

    An ExecutorError or PluginError where they cannot be submitted, or the executor violates its contract.
    """
    limits = Limits(time_s=study.time_limit_s, memory_MB=study.memory_limit_MB, n_attempts=study.n_attempts)
    started: dict[int, RunningJob] = {}

    def running(indices: Sequence[int]) -> None:
        for index in indices:
            name = jobs[index].limb_name
            label = f"fine mesh {jobs[index].spot}" if name.endswith(FINE) else jobs[index].spot
            usual_s = None if forecast is None else forecast.usual_s(name)
            started.setdefault(index, RunningJob(label, monotonic(), usual_s))
        for index in started.keys() - set(indices):
            del started[index]
        progress.running(list(started.values()))

    batch = Batch(
        solver=study.solver,
        jobs=jobs,
        limbs=limbs,
        limits=limits,
        n_workers=study.n_workers,
        plugin_files=study.plugin_files,
        should_continue=progress.should_continue,
        running=running,
    )
    for index, answer in _answers(executor, batch):
        running([each for each in started if each != index])
        yield index, replace(usable(jobs[index], answer, answer.seconds), n_crashes=answer.n_crashes)


def _answers(executor: Executor, batch: Batch) -> Iterator[tuple[int, Simulation]]:
    """Place and answer of each job, as the executor yields it; refuse anything else that it yields."""
    waiting = set(range(n_jobs := len(batch.jobs)))
    with answering_for(executor, "starting the simulations"):
        found = iter(executor.results(batch))
    while True:
        with answering_for(executor, "running the simulations"):
            result = next(found, None)
            if result is None:
                break
            match result:
                case (int(index), Simulation() as answer) if index in waiting:
                    waiting.discard(index)
                case _:
                    wrong = "not the place and the Simulation of a job that was waiting"
                    raise ValueError(f"it yielded {result!r:.200}, {wrong}")
        yield index, answer
    if waiting and batch.should_continue():
        raise PluginError(
            f"executor '{executor.name}' ended without a result for {len(waiting)} of {n_jobs} jobs; "
            "finished results are kept; set executor.name = 'processes', or report it to the plugin's author"
        )


class KeptSimulations(Simulations):
    """Simulations that a run directory has; one that it lacks stops the caller, and nothing is written."""

    def _in_cache(self, by_key: Mapping[str, Job]) -> _Found:
        return iter(())

    def _simulated(self, by_key: Mapping[str, Job]) -> _Found:
        return iter(())
