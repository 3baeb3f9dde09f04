"""Estimates of how long a run will take, from simulations that are there or from one that is timed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.domain import Job, Limb
from palpate.executors import InProcess, Processes
from palpate.executors.attempts import simulate_alone
from palpate.executors.machine import n_fitting
from palpate.progress import FIRST_LOOK, LONG_S, Progress, about, duration
from palpate.run.ledger import Ledger
from palpate.study.reading import Study

SHORT_S = 30.0
"""Time of a first simulation up to which a second is timed: the first one also compiles."""

WORTH_SAYING_S = 10.0
"""Time of a fit from which `palpate check` reports how long it will take."""

OTHER_SCENARIO, OF_SPOT = 0.3, 1.5
"""Simulations at a spot by the joint fit of another scenario, over those of the first; by its own fit."""

SLOPES = 1.4
"""Time of a simulation with exact slopes over one without."""

GROWTH = 1.4
"""Power of the number of nodes with which the time of a simulation grows."""


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
        About how many simulations the fit needs; 0 where there is none, or the search does not know.
    n_spots : int
        Spots, whose simulations a fit runs side by side.
    fit_factor : float
        Time of all simulations of the fit, of slopes and finer meshes too, over that of as many plain ones.
    has_fit : bool
        Whether there is one, and not the best set of the sweep as it is.
    """

    n_left: int
    seconds_each: float | None
    n_workers: int
    n_fit: int = 0
    n_spots: int = 1
    fit_factor: float = 1.0
    has_fit: bool = True

    @property
    def seconds(self) -> float | None:
        """Time of the sweep; None where it is unknown."""
        return self._seconds(self.n_left, max(1, self.n_left))

    @property
    def fit_seconds(self) -> float | None:
        """Time of the fit, about; None where it is unknown."""
        found = self._seconds(self.n_fit, self.n_spots) if self.n_fit else None
        return None if found is None else found * self.fit_factor

    def _seconds(self, n: int, side_by_side: int) -> float | None:
        if self.seconds_each is None or not self.n_workers:
            return None
        return self.seconds_each * n / min(self.n_workers, side_by_side)

    def __str__(self) -> str:
        parts = []
        if self.n_left:
            parts.append(f"{self.n_left} simulations to do{self._time(self.seconds)}")
        if self.n_fit:
            parts.append(f"about {self.n_fit} simulations of the fit{self._time(self.fit_seconds)}")
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


def cost(study: Study, jobs: Mapping[str, Job], folder: Path | None, limbs: Mapping[str, Limb]) -> Cost:
    """Simulations and time left of a run whose sweep has these jobs, by key.

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
    known, n_fit = list(with_times.values()) or others, _n_fit(study)
    return Cost(
        n_left=len(jobs.keys() - with_times.keys()),
        seconds_each=float(np.mean(known)) if known else None,
        n_workers=_n_workers(study),
        # What is there besides the sweep is mostly of an earlier fit.
        n_fit=max(0, n_fit - len(others)),
        n_spots=len(study.spots),
        fit_factor=_fit_factor(study, limbs, n_fit),
        has_fit=study.search.name != "sweep",
    )


def _n_fit(study: Study) -> int:
    """About how many simulations of the coarse meshes a fit needs; 0 where that is not known."""
    n_spots, n_scenarios = len(study.spots), len(study.scenarios)
    each = study.search.usual_trials * (1.0 + OTHER_SCENARIO * (n_scenarios - 1))
    if study.search.usual_trials and n_spots > 1:
        each += OF_SPOT * n_scenarios
    if not study.solver.provides.slopes:
        each *= 1 + 2 * len(study.parametrisation.parameters(study.space, study.spot_names))
    return round(n_spots * each)


def _fit_factor(study: Study, limbs: Mapping[str, Limb], n_fit: int) -> float:
    """Time of a fit over that of its coarse simulations without slopes."""
    pairs = [
        (limbs[name], limbs[f"{name}/fine"])
        for name in study.spot_names
        if name in limbs and f"{name}/fine" in limbs
    ]
    finer = sum(float((fine.mesh.n_nodes / limb.mesh.n_nodes) ** GROWTH) for limb, fine in pairs)
    return (SLOPES if study.solver.provides.slopes else 1.0) + study.fine_runs * finer / max(1, n_fit)


def timed(study: Study, jobs: Sequence[Job], limbs: Mapping[str, Limb]) -> float:
    """Seconds of one simulation in this process: of the first job, and of a second one if that was short."""
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


class FitTime:
    """Says once how long the fit of a run will take, as soon as the time of a simulation is known.

    Parameters
    ----------
    folder : Path
        The run directory.
    swept : mapping of key to Job
        Jobs of the sweep.
    """

    def __init__(
        self,
        study: Study,
        folder: Path,
        limbs: Mapping[str, Limb],
        swept: Mapping[str, Job],
        progress: Progress,
    ) -> None:
        self._study, self._folder, self._limbs = study, folder, limbs
        self._swept, self._progress = swept, progress
        self._is_said = False

    def update(self) -> None:
        """See whether the time is known."""
        if self._is_said:
            return
        left = replace(cost(self._study, self._swept, self._folder, self._limbs), n_left=0)
        self._is_said = left.seconds_each is not None
        if (left.fit_seconds or 0.0) > WORTH_SAYING_S:
            self._progress.note(f"{left}")
