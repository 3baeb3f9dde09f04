"""Writes the ledger: results of a sweep, several to a group, each group on the disk as a whole.

Waiting for a disk takes milliseconds, and the sweep does not wait: a thread of this process
writes what has come in while the last group was being written. After :meth:`Writer.flush`, and at
the end, everything is on the disk; a kill at any moment costs what the thread had in hand.
"""

import hashlib
import json
import queue
import sqlite3
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from palpate.domain import Job, Simulation
from palpate.executors.answers import plain
from palpate.run.atomic_files import remove_temporary, write_whole
from palpate.run.ledger.curve_files import pack
from palpate.run.ledger.format import CURVES, LEDGER, TABLES, digest, disk_errors, is_blank
from palpate.run.ledger.reader import Ledger

_TORN = "the last group of simulations was not written completely; it is simulated again"

LARGEST_GROUP = 256
"""Most simulations that are written together."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished:
    """A simulation with all that is kept of it."""

    key: str
    simulation: Simulation
    quarantined: int = 0
    """Attempts after which the job was given up; 0: it was not."""


class Writer:
    """The one writer of a ledger, as a context; the caller holds the lock on the folder.

    Parameters
    ----------
    folder : Path
        The run directory, made where it is missing.
    check : callable
        Raises where the lock is lost; asked before each group.

    Attributes
    ----------
    repaired : str
        What of a killed runner's last writing was dropped, for people; empty where nothing was.

    Raises
    ------
    LedgerError
        The ledger is damaged, of another version, or cannot be written.
    """

    def __init__(self, folder: Path, check: Callable[[], None] = lambda: None) -> None:
        self.path = folder / LEDGER
        self._curves = folder / CURVES
        self._check = check
        self._waiting: queue.Queue[Finished | None] = queue.Queue(2 * LARGEST_GROUP)
        self._failure: BaseException | None = None
        with disk_errors(self.path):
            self._curves.mkdir(parents=True, exist_ok=True)
            # Read first: a writer drops for good what it cannot read of SQLite's log.
            with Ledger(folder) as before:
                self.repaired = _TORN if before.is_torn else ""
            self._connection = _opened(self.path)
            remove_temporary(self._curves)
        self._thread = threading.Thread(target=self._write_all, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Writer":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._waiting.put(None)
            self._thread.join()
        finally:
            self._connection.close()
        if kind is None:
            self._raise_failure()

    # -------------------------------------------------------------------- storing

    def store(self, finished: Finished) -> None:
        """Hand over a simulation; a later one of the same key takes its place.

        A LedgerError where an earlier one could not be written.
        """
        self._raise_failure()
        self._waiting.put(finished)

    def flush(self) -> None:
        """Wait until everything handed over is on the disk."""
        self._waiting.join()
        self._raise_failure()

    def plan(self, keys: Sequence[str], jobs: Sequence[Job]) -> None:
        """Note the jobs of the sweep that begins, with the key of each."""
        rows = [(job.spot, job.set_id, key) for key, job in zip(keys, jobs, strict=True)]
        with disk_errors(self.path):
            if self._connection.execute("SELECT * FROM jobs").fetchall() == sorted(rows):
                return
            with self._connection as transaction:
                transaction.execute("BEGIN IMMEDIATE")
                transaction.execute("DELETE FROM jobs")
                transaction.executemany("INSERT INTO jobs VALUES (?, ?, ?)", rows)

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure

    # ------------------------------------------------------------- in the thread

    def _write_all(self) -> None:
        while (group := self._next_group()) is not None:
            if self._failure is None:
                try:
                    self._check()
                    self._write(group)
                except BaseException as error:
                    self._failure = error
            for _ in group:
                self._waiting.task_done()

    def _next_group(self) -> list[Finished] | None:
        first = self._waiting.get()
        if first is None:
            return None
        group = [first]
        while len(group) < LARGEST_GROUP and not self._waiting.empty():
            following = self._waiting.get()
            if following is None:
                self._waiting.put(None)
                break
            group.append(following)
        return group

    def _write(self, group: Sequence[Finished]) -> None:
        """Curves first: a row on the disk promises that its curves are there."""
        last_of_key = {finished.key: finished for finished in group}
        with disk_errors(self.path):
            curves = self._write_curves(list(last_of_key.values()))
            with self._connection as transaction:
                transaction.execute("BEGIN IMMEDIATE")
                transaction.execute("INSERT INTO curve_files VALUES (?, ?, ?, ?)", (*curves, len(group)))
                for finished in group:
                    _insert(transaction, finished, curves[0])

    def _write_curves(self, group: Sequence[Finished]) -> tuple[str, int, str]:
        """Write the file of a group, even without curves: by its number a reader notices lost rows."""
        responses = {f.key: f.simulation.response for f in group if f.simulation.response is not None}
        (n_files,) = self._connection.execute("SELECT coalesce(max(rowid), 0) FROM curve_files").fetchone()
        name, content = f"{n_files + 1:06d}.parquet", pack(responses)
        write_whole(self._curves / name, content)
        return name, len(content), hashlib.sha256(content).hexdigest()


def _insert(transaction: sqlite3.Connection, finished: Finished, curves: str) -> None:
    simulation, key = finished.simulation, finished.key
    state, seconds = simulation.status.value, float(simulation.seconds)
    (n_before,) = transaction.execute("SELECT count(*) FROM attempts WHERE key = ?", (key,)).fetchone()
    row = (
        key,
        state,
        simulation.job.spot,
        int(simulation.job.set_id),
        simulation.message,
        seconds,
        n_before + 1,
        finished.quarantined,
        json.dumps(plain(simulation.diagnostics), allow_nan=False),
        None if simulation.response is None else curves,
        datetime.now(UTC).isoformat(timespec="milliseconds"),
    )
    transaction.execute(f"REPLACE INTO simulations VALUES ({_marks(12)})", (*row, digest(row)))
    attempt = (key, n_before + 1, state, simulation.message, seconds)
    transaction.execute(f"INSERT INTO attempts VALUES ({_marks(5)})", attempt)


def _marks(n: int) -> str:
    return ", ".join("?" * n)


def _opened(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=30.0)
    try:
        is_new = is_blank(connection)  # or its writer was killed before its first table was there
        # Where shared memory does not work SQLite stays with its older journal, which is as safe.
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        if is_new:
            connection.executescript(f"BEGIN IMMEDIATE; {TABLES} COMMIT;")
    except BaseException:
        connection.close()
        raise
    return connection
