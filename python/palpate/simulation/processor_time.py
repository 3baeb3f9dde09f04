"""Processor time of all commands that worked on a run, by stage and work: ``processor_time.json``.

Stages and jobs record themselves: a stage is charged with the time of this process while it runs, and a
simulation brings its own (:func:`palpate.executors.attempts.attempt`), in whatever process it ran.
"""

import contextlib
import json
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from time import process_time
from typing import Self

import polars as pl

from palpate.domain import FINE, Simulation
from palpate.executors.attempts import PROCESSOR, SLOPES, WORKER, children_s, spent_on_jobs_here
from palpate.progress import Progress
from palpate.run.atomic_files import write_whole

FILE = "processor_time.json"

PATHS, OF_SLOPES, FINE_PATHS, WORKERS, OWN = "paths", "slopes", "fine meshes", "workers", "other work"
"""Kinds of work: simulations on the spots' meshes, their slopes, simulations on finer meshes with slopes,
start and transfers of worker processes, and a stage's computation in this process."""

SCHEMA = {"stage": pl.String, "work": pl.String, "n_simulations": pl.Int64, "processor_s": pl.Float64}


def own_s() -> float:
    """Processor time of this process without the jobs that it has simulated itself."""
    return process_time() - spent_on_jobs_here()


class ProcessorTime:
    """Adds up what one command spends on a run.

    Parameters
    ----------
    began_s : float
        When the command began, by this clock.
    clock : callable
        Processor time of this process that no job has recorded.
    """

    def __init__(self, folder: Path, began_s: float, clock: Callable[[], float] = own_s) -> None:
        self._folder, self._clock = folder, clock
        self._last_s = began_s
        self._stage = "start-up"  # the interpreter, imports, the study and its inputs
        self._spent: defaultdict[tuple[str, str], float] = defaultdict(float)
        self._n: defaultdict[tuple[str, str], int] = defaultdict(int)
        self._earlier: pl.DataFrame | None = None

    @classmethod
    def of_command(cls, folder: Path, progress: Progress) -> Self:
        """Time of a command from its beginning, where its progress knows that, else from now on."""
        began_s = process_time() if progress.began_processor_s is None else progress.began_processor_s
        # Before the first worker has ended, the children of a process of its own have read meshes and files.
        of_children_s = children_s() if began_s == 0.0 else 0.0
        return cls(folder, began_s - spent_on_jobs_here() - of_children_s)

    @contextlib.contextmanager
    def charging(self, stage: str) -> Iterator[None]:
        """Charge what this process does meanwhile to a stage."""
        self._note()
        before, self._stage = self._stage, stage
        try:
            yield
        finally:
            self.write()
            self._stage = before

    def simulated(self, simulation: Simulation) -> None:
        """Charge a simulation that was made for the running stage; a lost one counts by its duration."""
        of = simulation.diagnostics
        total = float(of.get(PROCESSOR, simulation.seconds))
        is_fine = simulation.job.limb_name.endswith(FINE)
        slopes = 0.0 if is_fine else min(float(of.get(SLOPES, 0.0)), total)
        self._n[self._stage, FINE_PATHS if is_fine else PATHS] += 1
        self._n[self._stage, OF_SLOPES] += slopes > 0.0
        self._spent[self._stage, FINE_PATHS if is_fine else PATHS] += total - slopes
        self._spent[self._stage, OF_SLOPES] += slopes
        self._spent[self._stage, WORKERS] += float(of.get(WORKER, 0.0))

    def write(self) -> None:
        """Keep the time spent so far, with the time of earlier commands, if the folder can be written."""
        self._note()
        if self._earlier is None:
            self._earlier = processor_time(self._folder)
        rows = [(*key, self._n[key], seconds) for key, seconds in self._spent.items() if seconds > 0.0]
        every = pl.concat([self._earlier, pl.DataFrame(rows, schema=SCHEMA, orient="row")])
        summed = every.group_by("stage", "work", maintain_order=True).sum()
        with contextlib.suppress(OSError):  # no run waits for a disk or fails for this file
            write_whole(self._folder / FILE, json.dumps(summed.to_dicts(), indent=1).encode(), durable=False)

    def _note(self) -> None:
        now_s = self._clock()
        self._spent[self._stage, OWN] += max(0.0, now_s - self._last_s)
        self._last_s = now_s


def processor_time(folder: Path) -> pl.DataFrame:
    """Processor time of a run by stage and work; without rows where nothing has recorded any."""
    try:
        return pl.DataFrame(json.loads((folder / FILE).read_bytes()), schema=SCHEMA).drop_nulls()
    except (OSError, ValueError, TypeError, RecursionError, pl.exceptions.PolarsError):
        return pl.DataFrame(schema=SCHEMA)


COST_HEADS = ("stage", "work", "simulations", "processor time (s)", "share")


def cost_rows(spent: pl.DataFrame) -> list[tuple[str, str, str, str, str]]:
    """Rows under :data:`COST_HEADS` for people: the largest first, those below 1 % as one, and the sum."""
    total = float(spent["processor_s"].sum())
    large = pl.col("processor_s") >= 0.01 * total
    rows = spent.filter(large).sort("processor_s", descending=True).rows()
    rest = spent.filter(~large).select("n_simulations", "processor_s").sum().row(0)
    shown = [*rows, *([("others", "", *rest)] if rest[1] else []), ("together", "", 0, total)]
    return [
        (stage, work, str(n or "–"), f"{seconds:.1f}", f"{100.0 * seconds / (total or 1.0):.0f} %")
        for stage, work, n, seconds in shown
    ]
