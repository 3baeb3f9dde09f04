"""Every job that is not done yet: through an executor, into the ledger, each key once.

Only this process writes results. A job that crashed is tried again by the next run; one that is
quarantined only with more attempts.
"""

import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.domain import Job, Limb, Simulation, Status
from palpate.errors import PluginError, StoppedError
from palpate.executors import Batch, JobResult, Limits, Processes
from palpate.executors.attempts import job_result
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import Solver
from palpate.progress import SILENT, CountsRunning, Progress
from palpate.run.ledger import Entry, Finished, Ledger, Writer
from palpate.run.ledger.cache import ResultCache
from palpate.study.reading import Study

USUAL_BYTES = 15_000
"""What a simulation takes on the disk where none is there to tell: two curves of 300 points."""


def _no_check() -> None:
    """Nothing has to be checked where no lock is held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """What is to be simulated, and where it is kept.

    Parameters
    ----------
    jobs, keys : sequences
        In the same order; jobs of one key are simulated once.
    folder : Path
        The run directory.
    check : callable
        Raises where the lock on the folder is lost.
    """

    study: Study
    jobs: Sequence[Job]
    keys: Sequence[str]
    limbs: Mapping[str, Limb]
    folder: Path
    progress: Progress
    check: Callable[[], None] = _no_check


@dataclass(slots=True)
class _State:
    """Keys that are done; the simulation is None where the ledger has it."""

    done: dict[str, Simulation | None] = field(default_factory=dict)
    statuses: dict[str, Status] = field(default_factory=dict)


def run_sweep(sweep: Sweep) -> dict[str, Simulation]:
    """Simulate what is missing, and return every simulation of the sweep by key.

    Raises
    ------
    LedgerError
        The ledger cannot be written, or is damaged.
    StoppedError
        The caller asked to stop; what is finished is kept.
    """
    by_key: dict[str, Job] = {}
    for key, job in zip(sweep.keys, sweep.jobs, strict=True):
        by_key.setdefault(key, job)
    with Writer(sweep.folder, sweep.check) as writer:
        if writer.repaired:
            sweep.progress.note(writer.repaired)
        writer.plan(sweep.keys, sweep.jobs)
        state = _found(sweep, by_key)
        _tell(sweep, state)
        _warn_of_full_disk(sweep, len(by_key) - len(state.done))
        _take_from_cache(sweep, by_key, state, writer)
        _simulate_missing(sweep, by_key, state, writer)
    if len(state.done) < len(by_key):
        raise StoppedError(
            f"stopped with {len(state.done)} of {len(by_key)} simulations finished and kept; "
            f"`palpate resume {sweep.folder}` goes on from there"
        )
    return _complete(sweep, by_key, state)


def is_final(entry: Entry, study: Study) -> bool:
    """Whether a finished simulation stays as it is, rather than being tried again."""
    match entry.status:
        case Status.TIMED_OUT:
            return study.time_limit_s <= entry.seconds
        case Status.CRASHED:
            return entry.quarantined >= study.n_attempts
        case _:
            return True


def _found(sweep: Sweep, by_key: Mapping[str, Job]) -> _State:
    """Read from the ledger what is done."""
    with Ledger(sweep.folder) as ledger:
        entries, gone = ledger.entries(), ledger.without_curves()
    state = _State()
    for key in by_key:
        entry = entries.get(key)
        if entry is not None and key not in gone and is_final(entry, sweep.study):
            state.done[key] = None
            state.statuses[key] = entry.status
    if lost := len(gone & by_key.keys()):
        sweep.progress.note(f"curves of {lost} simulations are missing or cut short; they are done again")
    return state


def _missing(by_key: Mapping[str, Job], state: _State) -> list[str]:
    return [key for key in by_key if key not in state.done]


def _tell(sweep: Sweep, state: _State) -> None:
    sweep.progress.begin("simulate", len(sweep.keys))
    for key in sweep.keys:
        if key in state.statuses:
            sweep.progress.step(state.statuses[key].value)


def _warn_of_full_disk(sweep: Sweep, n_left: int) -> None:
    """Warn before the first simulation that there may be no room for the last."""
    with Ledger(sweep.folder) as ledger:
        wanted_MB = n_left * (ledger.bytes_each() or USUAL_BYTES) * 1e-6
    free_MB = shutil.disk_usage(sweep.folder).free * 1e-6
    if wanted_MB > free_MB:
        sweep.progress.note(
            f"{sweep.folder}: {free_MB:.1f} MB are free, and the {n_left} simulations to come take about "
            f"{wanted_MB:.1f} MB; make room or name another folder; a full disk stops a run but loses nothing"
        )


def _take_from_cache(sweep: Sweep, by_key: Mapping[str, Job], state: _State, writer: Writer) -> None:
    if sweep.study.cache is None:
        return
    cache, n_jobs = ResultCache(sweep.study.cache), Counter(sweep.keys)
    for key in _missing(by_key, state):
        if (simulation := cache.load(key, by_key[key])) is not None:
            writer.store(Finished(key=key, simulation=simulation))
            _settle(sweep, state, key, simulation, n_jobs[key])


def _simulate_missing(sweep: Sweep, by_key: Mapping[str, Job], state: _State, writer: Writer) -> None:
    keys, n_jobs = _missing(by_key, state), Counter(sweep.keys)
    if not keys or not sweep.progress.should_continue():
        return
    # Results of code that is only trusted to equal its key's are for this run alone.
    shared = sweep.study.cache if not sweep.study.trusted else None
    cache = ResultCache(shared) if shared else None
    jobs = [by_key[key] for key in keys]
    for result in results(sweep.study, sweep.study.solver, jobs, sweep.limbs, sweep.progress):
        key = keys[result.index]
        simulation = result.simulation(by_key[key])
        quarantined = sweep.study.n_attempts if result.quarantined else 0
        writer.store(Finished(key=key, simulation=simulation, quarantined=quarantined))
        if cache is not None:
            cache.store(key, simulation)
        _settle(sweep, state, key, simulation, n_jobs[key])


def _settle(sweep: Sweep, state: _State, key: str, simulation: Simulation, n_jobs: int) -> None:
    state.done[key] = simulation
    for _ in range(n_jobs):
        sweep.progress.step(simulation.status.value)


def results(
    study: Study,
    solver: Solver,
    jobs: Sequence[Job],
    limbs: Mapping[str, Limb],
    progress: Progress = SILENT,
) -> Iterator[JobResult]:
    """Results of jobs where the study lets them run, each as it comes; nothing is kept.

    Raises
    ------
    ExecutorError, PluginError
        They cannot be handed to where they are to run, or the executor does not keep its contract.
    """
    limits = Limits(time_s=study.time_limit_s, memory_MB=study.memory_limit_MB, n_attempts=study.n_attempts)
    executor = study.executor or Processes()
    batch = Batch(
        solver=solver,
        jobs=jobs,
        limbs=limbs,
        limits=limits,
        n_workers=study.n_workers,
        plugin_files=study.plugin_files,
        should_continue=progress.should_continue,
        running=progress.running if isinstance(progress, CountsRunning) else lambda n_running: None,
    )
    waiting = set(range(len(jobs)))
    with answering_for(executor, "starting the simulations"):
        found = iter(executor.results(batch))
    while True:
        with answering_for(executor, "running the simulations"):
            result = next(found, None)
            if result is None:
                break
            if not isinstance(result, JobResult) or result.index not in waiting:
                raise ValueError(f"it yielded {result!r:.200}, not the JobResult of a job that was waiting")
        waiting.discard(result.index)
        job = jobs[result.index]
        sound = job_result(result.index, job, result.simulation(job), result.seconds)
        yield replace(sound, quarantined=result.quarantined)
    if waiting and progress.should_continue():
        raise PluginError(
            f"executor '{executor.name}' ended without a result for {len(waiting)} of {len(jobs)} jobs; "
            "what is finished is kept; set executor.name = 'processes', or report it to the plugin's author"
        )


def _complete(sweep: Sweep, by_key: Mapping[str, Job], state: _State) -> dict[str, Simulation]:
    """Read what earlier runs have simulated, and put it with what this one has."""
    earlier = {key: by_key[key] for key, simulation in state.done.items() if simulation is None}
    with Ledger(sweep.folder) as ledger:
        found = ledger.simulations(earlier)
    return {**found, **{key: s for key, s in state.done.items() if s is not None}}
