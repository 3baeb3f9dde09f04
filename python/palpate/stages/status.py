"""Progress of a run, read from its folder, during the run or after it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Status
from palpate.errors import StudyError
from palpate.run.directory import RunDirectory
from palpate.run.fit_state import FitState, read_fit_state
from palpate.run.ledger import Ledger
from palpate.run.lock import Runner, living_runner_of
from palpate.run.result import FIRST_ANSWER
from palpate.scoring import selection
from palpate.simulation.processor_time import processor_time


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatus:
    """State of a run directory.

    Parameters
    ----------
    runner : Runner or None
        The process that runs there now.
    n_simulations : int
        Simulations of the whole run, with an estimate for its fit; jobs that ask for the same one count once.
    states : mapping of state to number
        Of the finished simulations.
    seconds_left : float or None
        Estimated from the pace of this runner, or as the fit forecasts it; None if unknown.
    failures : DataFrame
        status, reason, n, example, remedy; most frequent first.
    fit : FitState or None
        How far the fit is; None before it begins, and once it has ended.
    result : mapping of label to str
        Lines with which the run ended: conclusion, parameters, warnings, what to do next, and the page. Empty
        while it goes on without a first answer.
    intervals : sequence of mapping
        Rows of the table ``intervals`` of a finished run, or of its first answer.
    is_first_answer : bool
        Whether ``result`` and ``intervals`` are of the first fit of a run that has not ended.
    has_ended : bool
        Whether the last whole run in the folder has ended; True where its stages were run one by one.
    cost : DataFrame
        Processor time by stage and work, as :func:`palpate.simulation.processor_time.processor_time` has it.
    """

    folder: Path
    runner: Runner | None
    n_simulations: int
    states: Mapping[str, int]
    seconds_left: float | None
    failures: pl.DataFrame
    fit: FitState | None
    result: Mapping[str, str] = field(default_factory=dict)
    intervals: Sequence[Mapping[str, Any]] = ()
    is_first_answer: bool = False
    has_ended: bool = True
    cost: pl.DataFrame = field(default_factory=pl.DataFrame)

    @property
    def n_finished(self) -> int:
        """Simulations that are finished, however they ended."""
        return sum(self.states.values())

    @property
    def is_unfinished(self) -> bool:
        """Whether nobody works on what is left."""
        is_left = self.n_finished < self.n_simulations or self.fit is not None
        return self.runner is None and (is_left or not self.has_ended)


def status(folder: Path) -> RunStatus:
    """State of the run in a folder; a StudyError where there is none, a LedgerError of a corrupt ledger."""
    run = RunDirectory(folder)
    run.manifest()  # refused where there is none
    with Ledger(folder) as ledger:
        n_left = ledger.counts().get("left", 0)
        rows = ledger.frame()
    runner, state = living_runner_of(folder), read_fit_state(folder)
    states = dict(rows["state"].value_counts().sort("count", "state", descending=[True, False]).iter_rows())
    n_to_do = n_left + ((state and state.n_left) or 0)
    has_ended = not run.records.is_going_on
    is_ended = has_ended and runner is None and not n_left and state is None
    lines, pace = run.result(), _seconds_left(rows, n_left, runner)
    is_first = bool(lines) and not is_ended and run.records.is_current(FIRST_ANSWER)
    is_known = is_ended or is_first
    return RunStatus(
        folder=folder,
        runner=runner,
        n_simulations=n_to_do + sum(states.values()),
        states=states,
        seconds_left=pace if state is None or runner is None else state.seconds_left,
        failures=failures(rows),
        fit=state,
        result=lines if is_known else {},
        intervals=_intervals(run, is_first=is_first) if is_known else [],
        is_first_answer=is_first,
        has_ended=has_ended,
        cost=processor_time(folder),
    )


def _intervals(run: RunDirectory, *, is_first: bool) -> list[dict[str, Any]]:
    """Rows of the intervals of a run; empty where there are none that can be read."""
    try:
        return run.table("first_answer/intervals" if is_first else "intervals").to_dicts()
    except StudyError:
        return []


def failures(rows: pl.DataFrame) -> pl.DataFrame:
    """Group failed simulations by status and reason, with a remedy."""
    failed = rows.rename({"state": "status"}).filter(pl.col("status") != Status.OK.value)
    failed = failed.unique("key", keep="first", maintain_order=True)
    return selection.by_reason(selection.failures(failed))


def _seconds_left(rows: pl.DataFrame, n_left: int, runner: Runner | None) -> float | None:
    """Estimate from the pace of the latest results that this runner simulated."""
    if runner is None or n_left == 0 or rows.is_empty():
        return None
    since = datetime.strptime(runner.since, "%Y-%m-%d %H:%M:%S UTC").replace(tzinfo=UTC)
    ended = pl.col("finished_at").str.to_datetime(time_zone="UTC")
    # A result that would have had to begin before the runner is one of the cache.
    own = rows.select(ended, began=ended - pl.duration(milliseconds=1000.0 * pl.col("seconds")))
    times = own.filter(pl.col("began") >= since)["finished_at"].sort().tail(200)
    if len(times) < 2:
        return None
    seconds: float = (times[-1] - times[0]).total_seconds()
    return n_left * seconds / (len(times) - 1)
