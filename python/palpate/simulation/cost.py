"""Estimates of how long a run will take, from simulations that are there or from one that is timed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.domain import Job, Limb
from palpate.executors import InProcess, Processes
from palpate.executors.attempts import simulate_alone
from palpate.executors.machine import n_fitting
from palpate.progress import FIRST_LOOK, LONG_S, about, duration
from palpate.run.ledger import Ledger
from palpate.simulation.forecast import Part, work_of
from palpate.study.reading import Study

WORTH_SAYING_S = 10.0
"""Time of a fit from which `palpate check` reports how long it will take."""

OTHER_SCENARIO, OF_SPOT = 0.3, 1.5
"""Simulations at a spot by the joint fit of another scenario, over those of the first; by its own fit."""

SWEEP = "simulate"
"""Stage that simulates the sweep, whose results are in the ledger."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Simulations and time left of a run.

    Parameters
    ----------
    n_left : int
        Simulations of the sweep to do; jobs that ask for the same one count once.
    seconds_each : float or None
        Of one simulation on one worker; None where none is known.
    n_workers : int
        0 where only the executor knows.
    n_fit : int
        About how many simulations all later stages need; 0 where there are none, or the search does not know.
    fit_work : float
        Time of those on one worker, over the time of one simulation on a spot's own mesh.
    n_spots : int
        Spots, whose simulations a fit runs side by side.
    has_fit : bool
        Whether there is one, and not the best set of the sweep as it is.
    """

    n_left: int
    seconds_each: float | None
    n_workers: int
    n_fit: int = 0
    fit_work: float = 0.0
    n_spots: int = 1
    has_fit: bool = True

    @property
    def seconds(self) -> float | None:
        """Time of the sweep; None where it is unknown."""
        return self._seconds(self.n_left, max(1, self.n_left))

    @property
    def fit_seconds(self) -> float | None:
        """Time of all stages after the sweep, about; None where it is unknown."""
        return self._seconds(self.fit_work, self.n_spots) if self.n_fit else None

    def _seconds(self, n: float, side_by_side: int) -> float | None:
        if self.seconds_each is None or not self.n_workers:
            return None
        return self.seconds_each * n / min(self.n_workers, side_by_side)

    def __str__(self) -> str:
        parts = []
        if self.n_left:
            parts.append(f"{self.n_left} simulations to do{self._time(self.seconds)}")
        if self.n_fit:
            parts.append(f"about {self.n_fit} simulations{self._time(self.fit_seconds)}")
        elif self.has_fit:
            parts.append("the fit")
        return f"{'; then '.join(parts)}{f' (workers: {self.n_workers})' if self.n_workers else ''}"

    def _time(self, seconds: float | None) -> str:
        if self.seconds_each is None:
            return ""
        if seconds is None:
            return f", each {about(self.seconds_each)} here"
        # What starts and compiles then takes longer than all simulations.
        if seconds < WORTH_SAYING_S and self.seconds_each < 1.0:
            return f", each {about(self.seconds_each)}"
        return f", about {duration(seconds)}"

    def first_look(self, n_sets: int) -> str:
        """Duration of a smaller first look in words; empty where it is not worth one."""
        if (self.seconds or 0.0) <= LONG_S or n_sets <= FIRST_LOOK:
            return ""
        return f"a first look of about {duration((self.seconds or 0.0) * FIRST_LOOK / n_sets)}"


def cost(
    study: Study,
    jobs: Mapping[str, Job],
    folder: Path | None,
    limbs: Mapping[str, Limb],
    parts: Sequence[Part] = (),
) -> Cost:
    """Simulations and time left of a run whose sweep has these jobs, by key, and then these parts.

    Those that are in the run directory ``folder`` or in the study's cache are not left.
    """
    with_times: dict[str, float] = {}
    others: list[float] = []
    if folder is not None:
        with Ledger(folder) as ledger:
            seconds = ledger.seconds()
        with_times = {key: each for key, each in seconds.items() if key in jobs}
        others = [each for key, each in seconds.items() if key not in jobs]
    if study.cache is not None:
        with Ledger(study.cache) as cache:
            with_times = {k: s for k, s in cache.seconds().items() if k in jobs} | with_times
    known, later = list(with_times.values()) or others, [part for part in parts if part.stage != SWEEP]
    n_later = 0 if any(part.counts is None for part in later) else sum(part.n for part in later)
    work = sum(n * work_of(name, limbs) for part in later for name, n in (part.counts or {}).items())
    # What is there besides the sweep is mostly of an earlier fit.
    n_fit = max(0, n_later - len(others))
    return Cost(
        n_left=len(jobs.keys() - with_times.keys()),
        # Few simulations are on finer meshes, but these take many times as long.
        seconds_each=float(np.median(known)) if known else None,
        n_workers=n_workers(study),
        n_fit=n_fit,
        fit_work=work * n_fit / max(1, n_later),
        n_spots=len(study.spots),
        has_fit=study.search.name != "sweep",
    )


def n_of_fit(study: Study) -> int | None:
    """About how many simulations on its own mesh the fit needs of a spot; None where that is not known."""
    if not study.search.usual_trials:
        return None
    n_scenarios = len(study.scenarios)
    each = study.search.usual_trials * (1.0 + OTHER_SCENARIO * (n_scenarios - 1))
    if len(study.spots) > 1:
        each += OF_SPOT * n_scenarios
    if not study.solver.provides.slopes:
        each *= 1 + 2 * len(study.parametrisation.parameters(study.space, study.spot_names))
    return round(each)


def timed(study: Study, jobs: Sequence[Job], limbs: Mapping[str, Limb]) -> float:
    """Seconds of one simulation in this process: of the first job, and of a second one if that was short.

    Without a sweep, of one with slopes.
    """
    seconds: list[float] = []
    for job in jobs[:2]:
        # Time of a first simulation up to which a second is timed: the first one also compiles.
        if not seconds or seconds[0] < 30.0:
            seconds.append(simulate_alone(study.solver, job, limbs.get(job.limb_name)).seconds)
    # Time of a simulation with exact slopes, as a fit asks for them, over one without.
    return min(seconds) * (1.4 if study.solver.provides.slopes and not study.n_sets else 1.0)


def n_workers(study: Study) -> int:
    """Simulations that run at a time; 0 where only the executor knows."""
    match study.executor:
        case None | Processes():
            return study.n_workers or n_fitting(study.memory_limit_MB)
        case InProcess():
            return 1
        case _:
            return 0
