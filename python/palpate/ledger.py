"""What was computed, what failed and why: ``ledger.sqlite`` and the curves beside it.

::

    ledger.sqlite    simulations   one row per key: state, message, seconds, attempts …
                     attempts      one row per attempt: state, message, seconds, settings
                     jobs          spot and set_id → key, for the sweep begun last
                     curve_files   size and SHA-256 of each file in curves/
    curves/<n>.parquet             curves of one or more simulations, by key

A simulation counts as finished once its row is on the disk, and its row is written after
its curves are. Any SQLite and any Parquet reader opens both without palpate::

    polars.read_database("SELECT * FROM simulations", sqlite3.connect("ledger.sqlite"))
    polars.scan_parquet("curves/*.parquet").filter(polars.col("key") == key)
"""

import contextlib
import errno
import hashlib
import json
import os
import shutil
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import polars as pl

from palpate.curve_files import unpack
from palpate.domain import Job, Response, Simulation, Status
from palpate.errors import LedgerError

VERSION = 1
"""Version of the tables; a ledger of another one is refused."""

APPLICATION = 0x70616C70
"""Marks a SQLite file as a ledger: «palp»."""

LEDGER, CURVES = "ledger.sqlite", "curves"

TABLES = f"""
CREATE TABLE simulations (
    key TEXT PRIMARY KEY, state TEXT NOT NULL, spot TEXT NOT NULL, set_id INTEGER NOT NULL,
    message TEXT NOT NULL, seconds REAL NOT NULL, n_attempts INTEGER NOT NULL,
    quarantined INTEGER NOT NULL, rung INTEGER NOT NULL, diagnostics TEXT NOT NULL, curves TEXT,
    finished_at TEXT NOT NULL, digest TEXT NOT NULL);
CREATE TABLE attempts (
    key TEXT NOT NULL, attempt INTEGER NOT NULL, state TEXT NOT NULL, message TEXT NOT NULL,
    seconds REAL NOT NULL, settings TEXT NOT NULL, PRIMARY KEY (key, attempt)) WITHOUT ROWID;
CREATE TABLE jobs (
    spot TEXT NOT NULL, set_id INTEGER NOT NULL, key TEXT NOT NULL, PRIMARY KEY (spot, set_id)) WITHOUT ROWID;
CREATE TABLE curve_files (name TEXT PRIMARY KEY, size INTEGER NOT NULL, sha256 TEXT NOT NULL);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
"""


class Entry(NamedTuple):
    """What decides whether a job is to be done again.

    Parameters
    ----------
    quarantined : bool
        It ended its worker as often as it may.
    rung : int
        Which settings of the solver's ladder were tried last; 0: the study's own.
    """

    status: Status
    seconds: float
    quarantined: bool
    rung: int


class Ledger:
    """Reads a ledger, whether or not somebody writes to it meanwhile.

    Parameters
    ----------
    folder : Path
        The run directory. One without a ledger reads as one with nothing in it.
    take_old : bool
        Whether one that an earlier version wrote reads so too, since it is about to be taken over.

    Raises
    ------
    LedgerError
        Not a ledger, of another version, or damaged.
    """

    def __init__(self, folder: Path, *, take_old: bool = False) -> None:
        self.folder = folder
        self.path = folder / LEDGER
        self._connection = self._open(take_old=take_old)

    def __enter__(self) -> "Ledger":
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def _open(self, *, take_old: bool) -> sqlite3.Connection:
        if not self.path.exists():
            if not take_old:
                refuse_old(self.folder)
            return _empty()
        with told(self.path):
            connection = _read_only(self.path)
            if is_blank(connection):
                connection.close()
                return _empty()
            check_version(connection, self.path)
        return connection

    # -------------------------------------------------------------------- reading

    def entries(self) -> dict[str, Entry]:
        """How each finished simulation ended, by key."""
        statuses = {status.value: status for status in Status}
        rows = self._all("SELECT key, state, seconds, quarantined, rung FROM simulations")
        try:
            return {
                key: Entry(statuses[state], seconds, bool(quarantined), rung)
                for key, state, seconds, quarantined, rung in rows
            }
        except KeyError as error:
            raise _damaged(self.path, f"a row of 'simulations' has the state {error}") from None

    def finished_of_last_sweep(self) -> set[str]:
        """Keys of the sweep begun last that are finished."""
        return {key for (key,) in self._all("SELECT key FROM jobs JOIN simulations USING (key)")}

    def frame_of_last_sweep(self) -> pl.DataFrame:
        """One row for each job of the sweep begun last that is finished."""
        texts = ("spot", "key", "state", "message", "curves", "finished_at")
        names = [*texts, "set_id", "seconds", "n_attempts"]
        query = f"SELECT jobs.spot, {', '.join(names[1:]).replace('set_id', 'jobs.set_id')} FROM jobs "
        rows = self._all(f"{query} JOIN simulations USING (key) ORDER BY jobs.spot, jobs.set_id")
        schema = dict.fromkeys(texts, pl.String)
        return pl.DataFrame(rows, schema=names, schema_overrides=schema, orient="row")

    def copy_to(self, folder: Path) -> None:
        """Copy the ledger and its curves, as they stand at one moment, even while somebody writes.

        Parameters
        ----------
        folder : Path
            Made where it is missing; without a ledger.

        Raises
        ------
        LedgerError
        """
        if (folder / LEDGER).exists():
            raise LedgerError(f"{folder / LEDGER}: already there; name a folder without a run")
        with told(folder):
            (folder / CURVES).mkdir(parents=True, exist_ok=True)
            part = folder / f".{LEDGER}.part"
            part.unlink(missing_ok=True)
            with contextlib.closing(sqlite3.connect(part)) as copy:
                self._connection.backup(copy)
                names = [name for (name,) in copy.execute("SELECT name FROM curve_files")]
            for name in names:
                _link(self.folder / CURVES / name, folder / CURVES / name)
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

    def frame(self, table: str) -> pl.DataFrame:
        """One of the tables as a data frame."""
        with told(self.path):
            return pl.read_database(f"SELECT * FROM {table}", self._connection, infer_schema_length=None)

    def simulations(self, jobs: Mapping[str, Job]) -> dict[str, Simulation]:
        """Finished simulations of jobs by key; those whose curves are gone are left out.

        Raises
        ------
        LedgerError
            A row or a file of curves holds something else than what was written.
        """
        rows = {row["key"]: row for row in self._rows(list(jobs))}
        responses = self._responses(rows.values())
        return {
            key: Simulation(
                job=jobs[key],
                status=Status(row["state"]),
                response=responses.get(key),
                message=row["message"],
                seconds=row["seconds"],
                diagnostics=json.loads(row["diagnostics"]),
            )
            for key, row in rows.items()
            if row["curves"] is None or key in responses
        }

    def without_curves(self) -> set[str]:
        """Keys whose file of curves is missing or cut short; their simulations have to be done again."""
        gone = {
            name
            for name, size in self._all("SELECT name, size FROM curve_files")
            if _size(self.folder / CURVES / name) < size
        }
        if not gone:
            return set()
        keys = self._all("SELECT key, curves FROM simulations WHERE curves IS NOT NULL")
        return {key for key, name in keys if name in gone}

    def _rows(self, keys: Sequence[str]) -> Iterator[sqlite3.Row]:
        for begin in range(0, len(keys), 500):
            some = keys[begin : begin + 500]
            marks = ",".join("?" * len(some))
            for row in self._all(f"SELECT * FROM simulations WHERE key IN ({marks})", some, named=True):
                if row["digest"] != digest(tuple(row)[:-1]):
                    raise _damaged(self.path, f"the row of simulation {row['key']} is not as it was written")
                yield row

    def _responses(self, rows: Iterable[sqlite3.Row]) -> dict[str, Response]:
        by_file: dict[str, list[str]] = {}
        for row in rows:
            if row["curves"] is not None:
                by_file.setdefault(row["curves"], []).append(row["key"])
        files = {name: rest for name, *rest in self._all("SELECT * FROM curve_files")}
        responses: dict[str, Response] = {}
        for name, keys in by_file.items():
            responses.update(self._read_curves(name, files.get(name), keys))
        return responses

    def _read_curves(self, name: str, expected: list[Any] | None, keys: Sequence[str]) -> dict[str, Response]:
        path = self.folder / CURVES / name
        if expected is None:
            raise _damaged(self.path, f"curve_files has no row '{name}'")
        content = path.read_bytes() if path.is_file() else b""
        size, sha256 = expected
        if len(content) < size:
            return {}
        if hashlib.sha256(content).hexdigest() != sha256:
            raise LedgerError(
                f"{path}: not as it was written; the disk may be failing. Restore a copy, or delete the file "
                f"to have its {len(keys)} simulations done again"
            )
        return unpack(content, keys)

    def _all(self, query: str, values: Sequence[object] = (), *, named: bool = False) -> list[Any]:
        with told(self.path):
            cursor = self._connection.cursor()
            if named:
                cursor.row_factory = sqlite3.Row
            return cursor.execute(query, values).fetchall()


# ------------------------------------------------------------------- connections


def _empty() -> sqlite3.Connection:
    connection = sqlite3.connect(":memory:")
    connection.executescript(TABLES)
    return connection


def _read_only(path: Path) -> sqlite3.Connection:
    """Open a ledger that somebody may be writing to, or that lies where nothing can be written."""
    location = f"file:{quote(str(path.resolve()))}?mode=ro"
    connection = sqlite3.connect(location, uri=True, isolation_level=None)
    try:
        connection.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.OperationalError:
        connection.close()
        # A reader needs to write beside the file, unless the last writer has closed it.
        if _size(path.with_name(f"{path.name}-wal")) > 0:
            raise
        connection = sqlite3.connect(f"{location}&immutable=1", uri=True, isolation_level=None)
    return connection


def is_blank(connection: sqlite3.Connection) -> bool:
    """Whether a file is one whose writer was killed before its first table was there."""
    (n_tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    return bool(n_tables == 0 and application == 0)


def check_version(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is no ledger, or one of another version.

    Raises
    ------
    LedgerError
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION:
        raise LedgerError(f"{path}: not a ledger of palpate; move it away, or name another folder")
    if version != VERSION:
        raise LedgerError(
            f"{path}: of version {version}, while this palpate reads version {VERSION}; "
            "install the palpate that wrote it, or name another folder"
        )


def refuse_old(folder: Path) -> None:
    """Refuse to read what an earlier version wrote and nobody has taken over yet.

    Raises
    ------
    LedgerError
    """
    if (folder / "simulations.jsonl").exists():
        raise LedgerError(
            f"{folder / 'simulations.jsonl'}: written by an earlier version; "
            "`palpate simulate` takes it over into a ledger"
        )


@contextlib.contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn what SQLite and the file system raise into a LedgerError with what to do.

    Raises
    ------
    LedgerError
    """
    try:
        yield
    except sqlite3.Error as error:
        raise LedgerError(_explained(path, error)) from error
    except OSError as error:
        where = error.filename or path
        raise LedgerError(f"{where}: {_of_system(error)}; {_KEPT}") from error


_KEPT = "everything finished before is kept, and `palpate resume` goes on from there"


def _of_system(error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "no space is left on the disk; make room"
    if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
        return f"cannot be written ({error.strerror}); give write permission or name another folder"
    return f"cannot be written or read ({error.strerror}); check the disk"


def _explained(path: Path, error: sqlite3.Error) -> str:
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith(("SQLITE_CORRUPT", "SQLITE_NOTADB")):
        return str(_damaged(path, str(error)))
    if name.startswith("SQLITE_FULL"):
        return f"{path}: no space is left on the disk; make room; {_KEPT}"
    if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
        return f"{path}: cannot be written ({error}); copy the folder to where it can be, or name another"
    return f"{path}: {error} ({name or 'SQLite'}); check the disk; {_KEPT}"


def _damaged(path: Path, place: str) -> LedgerError:
    return LedgerError(
        f"{path}: damaged: {place}. Restore a copy, or move it and {CURVES}/ away: the simulations are "
        "then done again"
    )


def check_sound(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a ledger whose structure is damaged.

    Raises
    ------
    LedgerError
    """
    (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise _damaged(path, verdict)


def digest(row: Sequence[object]) -> str:
    """Short hash of the columns of ``simulations`` before ``digest``."""
    return hashlib.blake2b(json.dumps(row).encode(), digest_size=8).hexdigest()


def _link(source: Path, target: Path) -> None:
    """Let a second name stand for a file that nobody ever changes; copy it where that cannot be."""
    if not source.exists():
        return  # done again in the copy, as it would be here
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1
