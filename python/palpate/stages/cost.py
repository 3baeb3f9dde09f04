"""How long a sweep will take, from simulations that are there or from one that is timed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.domain import Job, Limb
from palpate.executors import InProcess, Processes
from palpate.executors.attempts import simulate_alone
from palpate.executors.machine import n_fitting
from palpate.progress import duration
from palpate.run.ledger import Ledger
from palpate.run.ledger.cache import ResultCache
from palpate.study.reading import Study

SHORT_S = 30.0
"""Time of a first simulation up to which a second is timed: the first one also compiles."""

MOST_TIMES = 50
"""Shared simulations whose times stand for all of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What is left of a sweep.

    Parameters
    ----------
    n_left : int
        Simulations to do; jobs that ask for the same one count once.
    seconds_each : float or None
        Of one simulation on one worker; None where none is known.
    n_workers : int
        0 where only the executor knows.
    """

    n_left: int
    seconds_each: float | None
    n_workers: int

    @property
    def seconds(self) -> float | None:
        """Time of all that is left; None where it is unknown."""
        if self.seconds_each is None or not self.n_workers:
            return None
        return self.seconds_each * self.n_left / min(self.n_workers, max(1, self.n_left))

    def __str__(self) -> str:
        if self.seconds_each is None:
            return f"{self.n_left} simulations to do"
        if self.seconds is None:
            return f"{self.n_left} simulations to do, each about {duration(self.seconds_each)} here"
        return (
            f"{self.n_left} simulations to do, about {duration(self.seconds)} "
            f"(workers: {self.n_workers}); then the fit"
        )


def cost(study: Study, jobs: Mapping[str, Job], folder: Path | None) -> Cost:
    """What is left of the jobs, by key, after those in a run directory and in the study's cache."""
    with_times: dict[str, float] = {}
    others: list[float] = []
    if folder is not None:
        with Ledger(folder) as ledger:
            entries = ledger.entries()
        with_times = {key: entry.seconds for key, entry in entries.items() if key in jobs}
        others = [entry.seconds for entry in entries.values()]
    if study.cache is not None:
        cache = ResultCache(study.cache)
        cached = [key for key in jobs if key not in with_times and cache.holds(key)]
        loaded = (cache.load(key, jobs[key]) for key in cached[:MOST_TIMES])
        seconds = [found.seconds for found in loaded if found is not None]
        with_times |= dict.fromkeys(cached, float(np.mean(seconds)) if seconds else 0.0)
    known = list(with_times.values()) or others
    return Cost(
        n_left=len(jobs.keys() - with_times.keys()),
        seconds_each=float(np.mean(known)) if known else None,
        n_workers=_n_workers(study),
    )


def timed(study: Study, jobs: Sequence[Job], limbs: Mapping[str, Limb]) -> float:
    """Seconds of one simulation in this process."""
    seconds: list[float] = []
    for job in jobs[:2]:
        if not seconds or seconds[0] < SHORT_S:
            seconds.append(simulate_alone(study.solver, job, limbs.get(job.limb_name)).seconds)
    return min(seconds)


def _n_workers(study: Study) -> int:
    match study.executor:
        case None | Processes():
            return study.n_workers or n_fitting(study.memory_limit_MB)
        case InProcess():
            return 1
        case _:
            return 0
