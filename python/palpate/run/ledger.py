"""Finished simulations by key: ``ledger.sqlite`` of a run, or of a cache that several studies share.

::

    simulations   one row per key: spot, set_id, state, message, seconds, attempts …
    arrays        by key and channel: abscissa, ordinate, std, and slopes as d_ and the parameter's name, as
                  little-endian doubles; without a channel, surface: states of the skin as .npz
    jobs          spot and set_id → key, for the last sweep

A simulation that is reported as stored is on the disk, and outlives a loss of power. Any SQLite reads it,
while somebody writes to it too: ``numpy.frombuffer(data)`` makes an array of a blob.
"""

import contextlib
import hashlib
import io
import json
import sqlite3
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import polars as pl

from palpate.domain import Curve, FloatArray, Job, Response, Simulation, Status, SurfaceStates
from palpate.errors import LedgerError
from palpate.executors.answers import plain
from palpate.run.atomic_files import temporary_name
from palpate.run.ownership import KEPT, reason

VERSION = 4
"""Version of the tables; a ledger of another one is refused."""

APPLICATION = 0x70616C70
"""Marks a SQLite file as a ledger: «palp»."""

LEDGER = "ledger.sqlite"

TABLES = f"""
BEGIN IMMEDIATE;
CREATE TABLE IF NOT EXISTS simulations (
    key TEXT PRIMARY KEY, spot TEXT NOT NULL, set_id INTEGER NOT NULL, state TEXT NOT NULL,
    message TEXT NOT NULL, seconds REAL NOT NULL, n_crashes INTEGER NOT NULL, diagnostics TEXT NOT NULL,
    n_attempts INTEGER NOT NULL, finished_at TEXT NOT NULL, digest TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS arrays (
    key TEXT NOT NULL, channel TEXT NOT NULL, name TEXT NOT NULL, data BLOB NOT NULL,
    PRIMARY KEY (key, channel, name));
CREATE TABLE IF NOT EXISTS jobs (
    spot TEXT NOT NULL, set_id INTEGER NOT NULL, key TEXT NOT NULL, PRIMARY KEY (spot, set_id));
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
COMMIT;
"""

SLOPE, SURFACE = "d_", "surface"

_Arrays = dict[tuple[str, str], bytes]
"""Content of arrays by channel and name."""


class Ledger:
    """Reads a ledger, whether or not somebody writes to it meanwhile.

    Parameters
    ----------
    folder : Path
        The run directory, or the cache. One without a ledger reads as one with nothing in it.

    Raises
    ------
    LedgerError
        Not a ledger, of another version, or damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / LEDGER
        with disk_errors(self.path):
            self._connection = _opened(self.path, "rw") if self.path.exists() else sqlite3.connect(":memory:")
            if not _is_sound(self._connection, self.path):
                self._connection.close()
                self._connection = sqlite3.connect(":memory:")
                self._connection.executescript(TABLES)

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def sweep(self) -> pl.DataFrame:
        """One row for each job of the last sweep.

        Returns
        -------
        DataFrame
            spot, set_id, key, and of its simulation state, message, seconds and finished_at: null
            where it is not finished.
        """
        return self._frame(
            "SELECT jobs.spot, jobs.set_id, key, state, message, seconds, finished_at "
            "FROM jobs LEFT JOIN simulations USING (key) ORDER BY jobs.spot, jobs.set_id"
        )

    def counts(self) -> dict[str, int]:
        """Simulations of the last sweep by state; ``left`` counts those to be done.

        Jobs with one key count as one simulation.
        """
        states = self.sweep().unique("key").select(pl.col("state").fill_null("left"))
        return dict(states.group_by("state").len().sort("len", "state", descending=[True, False]).iter_rows())

    def seconds(self) -> dict[str, float]:
        """Time of each finished simulation by key."""
        return dict(self._rows("SELECT key, seconds FROM simulations"))

    def final(self, time_limit_s: float, n_attempts: int) -> set[str]:
        """Keys of simulations that stay as they are with these limits, rather than being tried again."""
        rows = self._rows(
            "SELECT key FROM simulations WHERE CASE state WHEN 'timed_out' THEN seconds >= ? "
            "WHEN 'crashed' THEN n_crashes >= ? ELSE 1 END",
            (time_limit_s, n_attempts),
        )
        return {key for (key,) in rows}

    def bytes_each(self) -> float | None:
        """Size of a finished simulation on the disk, on average; None where there is none."""
        ((n_finished,),) = self._rows("SELECT count(*) FROM simulations")
        return self.path.stat().st_size / n_finished if n_finished else None

    def frame(self) -> pl.DataFrame:
        """Finished simulations, as the table ``simulations`` has them."""
        return self._frame("SELECT * FROM simulations")

    def simulations(self, jobs: Mapping[str, Job]) -> dict[str, Simulation]:
        """Finished simulations of jobs by key; a job may be no more than its name.

        Raises
        ------
        LedgerError
            A row or a curve is not as it was written.
        """
        found, every = {}, list(jobs)
        for keys in (every[begin : begin + 500] for begin in range(0, len(every), 500)):
            among = f"WHERE key IN ({_marks(len(keys))})"
            arrays: dict[str, _Arrays] = defaultdict(dict)  # damage can also change a key
            for key, channel, name, data in self._rows(f"SELECT * FROM arrays {among} ORDER BY rowid", keys):
                arrays[key][channel, name] = data
            for row in self._rows(f"SELECT * FROM simulations {among}", keys):
                *content, digest = row
                key = content[0]
                if digest != _digest(content, arrays[key]):
                    raise damaged(self.path, f"simulation {key} is not as it was written")
                found[key] = _simulation(jobs[key], content, arrays[key])
        return found

    def copy_to(self, folder: Path) -> None:
        """Copy the ledger, as of one moment even while somebody writes, to a folder without one."""
        if (folder / LEDGER).exists():
            raise LedgerError(f"{folder / LEDGER}: already there; name a folder without a run")
        with disk_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            part = folder / temporary_name(LEDGER)
            with contextlib.closing(sqlite3.connect(part)) as copy:
                self._connection.backup(copy)
            part.replace(folder / LEDGER)

    def _rows(self, query: str, values: Sequence[object] = ()) -> list[Any]:
        with disk_errors(self.path):
            return self._connection.execute(query, values).fetchall()

    def _frame(self, query: str) -> pl.DataFrame:
        with disk_errors(self.path):
            cursor = self._connection.execute(query)
            types = {"set_id": pl.Int64, "n_crashes": pl.Int64, "n_attempts": pl.Int64, "seconds": pl.Float64}
            schema = {name: types.get(name, pl.String) for name, *_ in cursor.description}
            return pl.DataFrame(cursor.fetchall(), schema=schema, orient="row")


class Writer:
    """Writes a ledger, as a context; the caller holds the lock on a run directory.

    Waiting for a disk takes milliseconds, and a sweep does not wait: a thread writes what has come in while
    the last group was being written. After :meth:`flush`, and at the end, everything is on the disk; a kill
    at any moment costs what the thread had in hand.

    Parameters
    ----------
    folder : Path
        The run directory, or the cache; made where it is missing.
    check : callable
        Raises where the lock is lost; asked before each group.

    Raises
    ------
    LedgerError
        The ledger is damaged, of another version, or cannot be written.
    """

    def __init__(self, folder: Path, check: Callable[[], None] = lambda: None) -> None:
        self.path = folder / LEDGER
        self._check = check
        self._waiting: deque[tuple[str, Simulation]] = deque()
        with disk_errors(self.path):
            folder.mkdir(parents=True, exist_ok=True)
            self._connection = _opened(self.path, "rwc")
            # The journal's removal, which commits, is on the disk too before anything is reported as stored.
            self._connection.execute("PRAGMA synchronous = EXTRA")
            if not _is_sound(self._connection, self.path):
                self._connection.executescript(TABLES)
        self._thread = ThreadPoolExecutor(1)
        self._last: Future[None] = self._thread.submit(self._write_waiting)

    def __enter__(self) -> "Writer":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._thread.shutdown()
        finally:
            self._connection.close()
        if kind is None:
            self._last.result()

    def store(self, key: str, simulation: Simulation) -> None:
        """Hand over a simulation; a later one of the same key takes its place.

        A LedgerError where an earlier one could not be written.
        """
        if self._last.done():
            self._last.result()
        self._waiting.append((key, simulation))
        self._last = self._thread.submit(self._write_waiting)

    def flush(self) -> None:
        """Wait until everything handed over is on the disk."""
        self._last.result()

    def plan(self, keys: Sequence[str], jobs: Sequence[Job]) -> None:
        """Note the jobs of the sweep that begins, with the key of each."""
        rows = [(job.spot, job.set_id, key) for key, job in zip(keys, jobs, strict=True)]
        self.flush()
        with disk_errors(self.path):
            if self._connection.execute("SELECT * FROM jobs").fetchall() == sorted(rows):
                return
            with self._connection as transaction:
                transaction.execute("BEGIN IMMEDIATE")
                transaction.execute("DELETE FROM jobs")
                transaction.executemany("INSERT INTO jobs VALUES (?, ?, ?)", rows)

    def _write_waiting(self) -> None:
        """Write all that waits; what cannot be written waits on."""
        if not (group := list(self._waiting)):
            return
        self._check()
        with disk_errors(self.path), self._connection as transaction:
            transaction.execute("BEGIN IMMEDIATE")
            for key, simulation in group:
                _insert(transaction, key, simulation)
        for _ in group:
            self._waiting.popleft()


# -------------------------------------------------------------------------- rows


def _insert(transaction: sqlite3.Connection, key: str, simulation: Simulation) -> None:
    query = "SELECT coalesce(max(n_attempts), 0) FROM simulations WHERE key = ?"
    (n_before,) = transaction.execute(query, (key,)).fetchone()
    arrays = _arrays(simulation)
    row = (
        key,
        simulation.id.spot,
        int(simulation.id.set_id),
        simulation.status.value,
        simulation.message,
        float(simulation.seconds),
        simulation.n_crashes,
        json.dumps(plain(simulation.diagnostics), allow_nan=False),
        n_before + 1,
        datetime.now(UTC).isoformat(timespec="milliseconds"),
    )
    values = (*row, _digest(row, arrays))
    transaction.execute(f"REPLACE INTO simulations VALUES ({_marks(len(values))})", values)
    transaction.execute("DELETE FROM arrays WHERE key = ?", (key,))
    transaction.executemany(
        "INSERT INTO arrays VALUES (?, ?, ?, ?)", ((key, *name, data) for name, data in arrays.items())
    )


def _arrays(simulation: Simulation) -> _Arrays:
    """Curves and states of the skin as arrays: the inverse of what :func:`_simulation` does with them."""
    found: dict[tuple[str, str], FloatArray] = {}
    for channel, curve in simulation.response.curves.items() if simulation.response is not None else ():
        found[channel, "abscissa"], found[channel, "ordinate"] = curve.abscissa, curve.ordinate
        optional = {"std": curve.std, "time_s": curve.time_s}
        found |= {(channel, name): values for name, values in optional.items() if values is not None}
        found |= {(channel, SLOPE + name): slope for name, slope in curve.slopes.items()}
    arrays = {name: np.asarray(array, "<f8").tobytes() for name, array in found.items()}
    if simulation.surface is not None:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **simulation.surface.compact())
        arrays["", SURFACE] = buffer.getvalue()
    return arrays


def _simulation(job: Job, row: Sequence[Any], arrays: _Arrays) -> Simulation:
    _, _, _, state, message, seconds, n_crashes, diagnostics, *_ = row
    curves: dict[str, dict[str, FloatArray]] = {}
    surface = None
    for (channel, name), data in arrays.items():
        if channel:
            curves.setdefault(channel, {})[name] = np.frombuffer(data, "<f8")
        else:
            with np.load(io.BytesIO(data)) as states:
                surface = SurfaceStates(**{each.name: states[each.name] for each in fields(SurfaceStates)})
    return Simulation(
        job=job,
        status=Status(state),
        response=Response(curves={c: _curve(c, a) for c, a in curves.items()}) if curves else None,
        message=message,
        seconds=seconds,
        diagnostics=json.loads(diagnostics),
        surface=surface,
        n_crashes=n_crashes,
    )


def _curve(channel: str, arrays: Mapping[str, FloatArray]) -> Curve:
    return Curve(
        channel=channel,
        abscissa=arrays["abscissa"],
        ordinate=arrays["ordinate"],
        std=arrays.get("std"),
        time_s=arrays.get("time_s"),
        slopes={n.removeprefix(SLOPE): a for n, a in arrays.items() if n.startswith(SLOPE)},
    )


def _digest(row: Sequence[object], arrays: _Arrays) -> str:
    """Short hash of all that is kept of a simulation."""
    digest = hashlib.blake2b(json.dumps([*row, *arrays]).encode(), digest_size=8)
    for data in arrays.values():
        digest.update(data)
    return digest.hexdigest()


def _marks(n: int) -> str:
    return ", ".join("?" * n)


# -------------------------------------------------------------------------- file


def _opened(path: Path, mode: str) -> sqlite3.Connection:
    location = f"file:{quote(str(path.resolve()))}?mode={mode}"
    # Longest wait for another process that reads or writes the file.
    return sqlite3.connect(location, uri=True, isolation_level=None, check_same_thread=False, timeout=30.0)


def _is_sound(connection: sqlite3.Connection, path: Path) -> bool:
    """False for a file whose writer was killed before its tables were there.

    A LedgerError where it is no ledger, one of another version, or one whose structure is damaged.
    """
    try:
        ((n_tables,),) = connection.execute("SELECT count(*) FROM sqlite_master")
        ((application,),) = connection.execute("PRAGMA application_id")
        ((version,),) = connection.execute("PRAGMA user_version")
        if n_tables == application == 0:
            return False
        if application != APPLICATION:
            raise LedgerError(f"{path}: not a ledger of palpate; move it away, or name another folder")
        if version != VERSION:
            raise LedgerError(
                f"{path}: of version {version}, while this palpate reads version {VERSION}; "
                "install the palpate that wrote it, or name another folder"
            )
        for table in ("simulations", "jobs"):  # of arrays those are verified that are read
            ((verdict,),) = connection.execute(f"PRAGMA quick_check('{table}')")
            if verdict != "ok":
                raise damaged(path, verdict)
    except BaseException:
        connection.close()
        raise
    return True


@contextlib.contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn what SQLite and the file system raise into a LedgerError with what to do."""
    try:
        yield
    except sqlite3.Error as error:
        raise LedgerError(_explained(path, error)) from error
    except UnicodeDecodeError as error:
        raise damaged(path, f"a text is not UTF-8 ({error.reason})") from error
    except OSError as error:
        where = error.filename or path
        raise LedgerError(f"{where}: {reason(error)}; {KEPT}") from error


def _explained(path: Path, error: sqlite3.Error) -> str:
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")):
        return str(damaged(path, str(error)))
    if name.startswith("SQLITE_FULL"):
        return f"{path}: no space is left on the disk; make room; {KEPT}"
    if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
        return f"{path}: cannot be written ({error}); copy the folder to where it can be, or name another"
    return f"{path}: {error} ({name or 'SQLite'}); check the disk; {KEPT}"


def damaged(path: Path, place: str) -> LedgerError:
    """Error that names the place of a damage, and what to do."""
    return LedgerError(
        f"{path}: damaged: {place}; the disk may be failing. Restore a copy, or move the file away: the "
        "simulations are then done again"
    )
