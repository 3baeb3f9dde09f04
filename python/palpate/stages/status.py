"""Progress of a run, read from its folder, during the run or after it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Job, Scenario, Status
from palpate.run.directory import RunDirectory
from palpate.run.fit_state import FitState, read_fit_state
from palpate.run.ledger import Ledger
from palpate.run.lock import Runner, living_runner_of
from palpate.run.manifest import scoring_rules
from palpate.scoring import scores as scoring, selection


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatus:
    """State of a run directory.

    Parameters
    ----------
    runner : Runner or None
        The process that runs there now.
    n_simulations : int
        Simulations of the sweep; jobs that ask for the same one count once.
    states : mapping of state to number
        Of the finished simulations.
    seconds_left : float or None
        Estimated from the pace of this runner; None if unknown.
    failures : DataFrame
        status, reason, n, example, remedy; most frequent first.
    best : DataFrame
        spot, scenario, set_id, fopt: least so far.
    fit : FitState or None
        How far the fit is; None before it begins, and once it has ended.
    result : mapping of label to str
        Lines with which the run ended: conclusion, parameters, warnings, what to do next, and the page. Empty
        while it goes on.
    """

    folder: Path
    runner: Runner | None
    n_simulations: int
    states: Mapping[str, int]
    seconds_left: float | None
    failures: pl.DataFrame
    best: pl.DataFrame
    fit: FitState | None
    result: Mapping[str, str] = field(default_factory=dict)

    @property
    def n_finished(self) -> int:
        """Simulations that are finished, however they ended."""
        return sum(self.states.values())

    @property
    def is_unfinished(self) -> bool:
        """Whether nobody works on what is left."""
        return self.runner is None and (self.n_finished < self.n_simulations or self.fit is not None)


@dataclass
class Watcher:
    """Watches a run directory, and scores each simulation once."""

    folder: Path
    _scores: list[pl.DataFrame] = field(default_factory=list)
    _scored: set[str] = field(default_factory=set)

    def status(self) -> RunStatus:
        """Read the state of the run.

        Raises
        ------
        StudyError
            The folder is no run directory.
        LedgerError
            Its ledger is corrupt or of another version.
        """
        run = RunDirectory(self.folder)
        manifest = run.manifest()
        with Ledger(self.folder) as ledger:
            counts, rows = ledger.counts(), ledger.sweep().drop_nulls("state")
            self._score(run, manifest, ledger, rows)
        # Some have no score, such as those without a declared channel.
        unranked = selection.unranked(pl.concat(self._scores)) if self._scores else pl.DataFrame()
        runner, n_left = living_runner_of(self.folder), counts.pop("left", 0)
        state = read_fit_state(self.folder)
        is_ended = runner is None and not n_left and state is None
        return RunStatus(
            folder=self.folder,
            runner=runner,
            n_simulations=n_left + sum(counts.values()),
            states=counts,
            seconds_left=_seconds_left(rows, n_left, runner),
            failures=failures(rows, unranked),
            best=self._best(manifest),
            fit=state,
            result=run.result() if is_ended else {},
        )

    def _score(
        self, run: RunDirectory, manifest: Mapping[str, Any], ledger: Ledger, rows: pl.DataFrame
    ) -> None:
        rules = scoring_rules(manifest)
        if rules is None:
            return
        states = [status.value for status in rules.ranked_statuses]
        new = rows.filter(pl.col("state").is_in(states), ~pl.col("key").is_in(list(self._scored)))
        if new.is_empty():
            return
        measured = run.measured(tuple(manifest["spots"]))
        for spot, of_spot in new.group_by("spot", maintain_order=True):
            named = of_spot.select("key", "spot", "set_id").iter_rows()
            jobs = {key: Job(spot=name, set_id=set_id) for key, name, set_id in named}
            found = ledger.simulations(jobs)
            of_spot_measured = {str(spot[0]): measured[str(spot[0])]}
            self._scores.append(scoring.score(found.values(), of_spot_measured, rules, _scenarios(manifest)))
        self._scored.update(new["key"])

    def _best(self, manifest: Mapping[str, Any]) -> pl.DataFrame:
        if not self._scores:
            return pl.DataFrame()
        candidates = selection.objectives(pl.concat(self._scores), _scenarios(manifest))
        return selection.least_fopt(candidates).select("spot", "scenario", "set_id", "fopt")


def _scenarios(manifest: Mapping[str, Any]) -> list[Scenario]:
    return [Scenario(name=name, weights=weights) for name, weights in manifest["scenarios"].items()]


def failures(rows: pl.DataFrame, unranked: pl.DataFrame) -> pl.DataFrame:
    """Group failed and unranked simulations by status and reason, with a remedy."""
    failed = rows.rename({"state": "status"}).filter(pl.col("status") != Status.OK.value)
    failed = failed.unique("key", keep="first", maintain_order=True)
    if not unranked.is_empty():
        columns = ["spot", "set_id", "status", "message"]
        ended = unranked.join(failed, on=["spot", "set_id"], how="anti")
        failed = pl.concat([failed.select(columns), ended.select(columns)])
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
