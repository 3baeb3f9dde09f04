"""Reads a ledger, whether or not somebody writes to it meanwhile."""

import contextlib
import hashlib
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import polars as pl

from palpate.domain import Job, RecordedSimulation, Response, Simulation, SimulationId, Status
from palpate.errors import CurveError, LedgerError
from palpate.executors.answers import reject_nonphysical
from palpate.run.atomic_files import temporary_name, write_whole
from palpate.run.ledger.curve_files import unpack
from palpate.run.ledger.format import (
    CURVES,
    LEDGER,
    TABLES,
    check_complete,
    check_sound,
    curve_file,
    damaged,
    digest,
    disk_errors,
    is_blank,
    last_curve_file,
)


class Entry(NamedTuple):
    """What decides whether a job is to be done again."""

    status: Status
    seconds: float
    quarantined: int
    """How often it had ended its worker when it was given up; 0: it was not."""


class Ledger:
    """Reads a ledger, whether or not somebody writes to it meanwhile.

    Parameters
    ----------
    folder : Path
        The run directory. One without a ledger reads as one with nothing in it.

    Attributes
    ----------
    is_torn : bool
        Whether a writer was killed, or is at work, between its last curves and their rows.

    Raises
    ------
    LedgerError
        Not a ledger, of another version, or damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / LEDGER
        n_files = last_curve_file(folder)
        self._connection = self._open()
        try:
            with disk_errors(self.path):
                self.is_torn = check_complete(self._connection, self.path, n_files)
        except BaseException:
            self._connection.close()
            raise

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def _open(self) -> sqlite3.Connection:
        if self.path.exists():
            with disk_errors(self.path):
                connection = _read_only(self.path)
                if not is_blank(connection):
                    check_sound(connection, self.path)
                    return connection
                connection.close()
        connection = sqlite3.connect(":memory:")
        connection.executescript(TABLES)
        return connection

    # -------------------------------------------------------------------- reading

    def entries(self) -> dict[str, Entry]:
        """How each finished simulation ended, by key."""
        statuses = {status.value: status for status in Status}
        rows = self._all("SELECT key, state, seconds, quarantined FROM simulations")
        try:
            return {
                key: Entry(statuses[state], seconds, quarantined) for key, state, seconds, quarantined in rows
            }
        except KeyError as error:
            raise damaged(self.path, f"a row of 'simulations' has the state {error}") from None

    def finished_of_last_sweep(self) -> set[str]:
        """Keys of the sweep begun last that are finished."""
        return {key for (key,) in self._all("SELECT key FROM jobs JOIN simulations USING (key)")}

    def finished_sets(self) -> set[int]:
        """``set_id`` of the sweep begun last that are finished at every spot."""
        query = "SELECT jobs.set_id FROM jobs LEFT JOIN simulations USING (key) GROUP BY jobs.set_id "
        return {set_id for (set_id,) in self._all(f"{query} HAVING count(state) = count(*)")}

    def planned(self) -> dict[tuple[str, int], str]:
        """Key of each job of the sweep begun last, by spot and set_id."""
        rows = self._all("SELECT spot, set_id, key FROM jobs")
        return {(spot, set_id): key for spot, set_id, key in rows}

    def frame_of_last_sweep(self) -> pl.DataFrame:
        """One row for each job of the sweep begun last that is finished."""
        texts = ("spot", "key", "state", "message", "curves", "finished_at")
        names = [*texts, "set_id", "seconds", "n_attempts"]
        query = f"SELECT jobs.spot, {', '.join(names[1:]).replace('set_id', 'jobs.set_id')} FROM jobs "
        rows = self._all(f"{query} JOIN simulations USING (key) ORDER BY jobs.spot, jobs.set_id")
        schema = dict.fromkeys(texts, pl.String)
        return pl.DataFrame(rows, schema=names, schema_overrides=schema, orient="row")

    def copy_to(self, folder: Path) -> None:
        """Copy ledger and curves, as of one moment even while somebody writes, to a folder without them."""
        if (folder / LEDGER).exists():
            raise LedgerError(f"{folder / LEDGER}: already there; name a folder without a run")
        with disk_errors(folder):
            (folder / CURVES).mkdir(parents=True, exist_ok=True)
            part = folder / temporary_name(LEDGER)
            with contextlib.closing(sqlite3.connect(part)) as copy:
                self._connection.backup(copy)
                names = [name for (name,) in copy.execute("SELECT name FROM curve_files")]
            for name in names:
                _link(curve_file(self.folder, name), curve_file(folder, name))
            part.replace(folder / LEDGER)

    def counts(self) -> dict[str, int]:
        """Simulations of the sweep begun last by state; ``left`` counts those to be done.

        Jobs with one key count as one simulation.
        """
        rows = self._all(
            "SELECT coalesce(state, 'left'), count(*) FROM (SELECT DISTINCT key FROM jobs) "
            "LEFT JOIN simulations USING (key) GROUP BY 1 ORDER BY 2 DESC, 1"
        )
        return dict(rows)

    def bytes_each(self) -> float | None:
        """What a finished simulation takes on the disk, on average; None where there is none."""
        ((n_finished, n_bytes),) = self._all(
            "SELECT (SELECT count(*) FROM simulations), (SELECT coalesce(sum(size), 0) FROM curve_files)"
        )
        return (n_bytes + max(0, _size(self.path))) / n_finished if n_finished else None

    def frame(self, table: str) -> pl.DataFrame:
        """One of the tables as a data frame."""
        with disk_errors(self.path):
            return pl.read_database(f"SELECT * FROM {table}", self._connection, infer_schema_length=None)

    def simulations(self, jobs: Mapping[str, Job]) -> dict[str, Simulation]:
        """Finished simulations of jobs by key; those whose curves are gone are left out.

        Raises
        ------
        LedgerError
            A row or a file of curves holds something else than what was written.
        """
        recorded = self.recorded({key: job.id for key, job in jobs.items()})
        return {key: _of_job(jobs[key], each) for key, each in recorded.items()}

    def recorded(self, ids: Mapping[str, SimulationId]) -> dict[str, RecordedSimulation]:
        """Finished simulations as :meth:`simulations` has them, for a reader without the jobs."""
        rows = {row["key"]: row for row in self._rows(list(ids))}
        try:
            responses = self._responses(rows.values())
            return {
                key: _recorded(ids[key], row, responses.get(key))
                for key, row in rows.items()
                if row["curves"] is None or key in responses
            }
        except (IndexError, ValueError, RecursionError, pl.exceptions.PolarsError) as error:
            raise damaged(self.path, f"a row cannot be read ({error})") from error

    def without_curves(self) -> set[str]:
        """Keys whose file of curves is missing or cut short; their simulations have to be done again."""
        gone = {
            name
            for name, size in self._all("SELECT name, size FROM curve_files")
            if _size(curve_file(self.folder, name)) < size
        }
        if not gone:
            return set()
        keys = self._all("SELECT key, curves FROM simulations")
        return {key for key, name in keys if name in gone}

    def _rows(self, keys: Sequence[str]) -> Iterator[sqlite3.Row]:
        for begin in range(0, len(keys), 500):
            some = keys[begin : begin + 500]
            marks = ",".join("?" * len(some))
            for row in self._all(f"SELECT * FROM simulations WHERE key IN ({marks})", some, named=True):
                if row["digest"] != digest(tuple(row)[:-1]):
                    raise damaged(self.path, f"the row of simulation {row['key']} is not as it was written")
                yield row

    def _responses(self, rows: Iterable[sqlite3.Row]) -> dict[str, Response | CurveError]:
        by_file: dict[str, list[str]] = {}
        for row in rows:
            if row["curves"] is not None:
                by_file.setdefault(row["curves"], []).append(row["key"])
        files = {name: rest for name, *rest in self._all("SELECT name, size, sha256 FROM curve_files")}
        responses: dict[str, Response | CurveError] = {}
        for name, keys in by_file.items():
            if name not in files:
                raise damaged(self.path, f"curve_files has no row '{name}'")
            size, sha256 = files[name]
            if (content := self._content(name, size, sha256, len(keys))) is not None:
                responses |= unpack(content, keys)
        return responses

    def _content(self, name: str, size: int, sha256: str, n_keys: int) -> bytes | None:
        """Content of a file of curves; None where it is missing or cut short."""
        path = curve_file(self.folder, name)
        content = path.read_bytes() if path.is_file() else b""
        if len(content) < size:
            return None
        if hashlib.sha256(content).hexdigest() != sha256:
            raise LedgerError(
                f"{path}: not as it was written; the disk may be failing. Restore a copy, or delete the file "
                f"to have its {n_keys} simulations done again"
            )
        return content

    def _all(self, query: str, values: Sequence[object] = (), *, named: bool = False) -> list[Any]:
        with disk_errors(self.path):
            cursor = self._connection.cursor()
            if named:
                cursor.row_factory = sqlite3.Row
            return cursor.execute(query, values).fetchall()


def _of_job(job: Job, recorded: RecordedSimulation) -> Simulation:
    """Make the simulation of a job; an answer that cannot be used is unreadable, whoever kept it."""
    return reject_nonphysical(
        Simulation(
            job=job,
            status=recorded.status,
            response=recorded.response,
            message=recorded.message,
            seconds=recorded.seconds,
            diagnostics=recorded.diagnostics,
        )
    )


def _recorded(
    number: SimulationId, row: sqlite3.Row, response: Response | CurveError | None
) -> RecordedSimulation:
    status, message = Status(row["state"]), row["message"]
    if isinstance(response, CurveError):
        status, message, response = Status.UNREADABLE, str(response), None
    return RecordedSimulation(
        id=number,
        status=status,
        response=response,
        message=message,
        seconds=row["seconds"],
        diagnostics=json.loads(row["diagnostics"]),
    )


# ------------------------------------------------------------------- connections


def _read_only(path: Path) -> sqlite3.Connection:
    """Open a ledger that somebody may be writing to, or in a folder where nothing can be written."""
    location = f"file:{quote(str(path.resolve()))}?mode=ro"
    connection = sqlite3.connect(location, uri=True, isolation_level=None)
    try:
        connection.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.OperationalError:
        connection.close()
        # A reader needs to write next to the file, unless the last writer has closed it.
        if _size(path.with_name(f"{path.name}-wal")) > 0:
            raise
        connection = sqlite3.connect(f"{location}&immutable=1", uri=True, isolation_level=None)
    return connection


def _link(source: Path, target: Path) -> None:
    """Let a second name stand for a file that nobody ever changes; copy it where that cannot be."""
    if not source.exists():
        return  # done again in the copy, as it would be here
    try:
        os.link(source, target, follow_symlinks=False)
    except OSError:
        write_whole(target, source.read_bytes())


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1
