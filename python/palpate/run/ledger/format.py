"""What a ledger is on the disk: its tables, its version, and what is reported where it cannot be used."""

import contextlib
import hashlib
import json
import os
import re
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path

from palpate.errors import LedgerError
from palpate.run.ownership import KEPT, reason

VERSION = 3
"""Version of the tables; a ledger of another one is refused."""

APPLICATION = 0x70616C70
"""Marks a SQLite file as a ledger: «palp»."""

LEDGER, CURVES = "ledger.sqlite", "curves"

TABLES = f"""
CREATE TABLE simulations (
    key TEXT PRIMARY KEY, state TEXT NOT NULL, spot TEXT NOT NULL, set_id INTEGER NOT NULL,
    message TEXT NOT NULL, seconds REAL NOT NULL, n_attempts INTEGER NOT NULL,
    quarantined INTEGER NOT NULL, diagnostics TEXT NOT NULL, curves TEXT,
    finished_at TEXT NOT NULL, digest TEXT NOT NULL);
CREATE TABLE attempts (
    key TEXT NOT NULL, attempt INTEGER NOT NULL, state TEXT NOT NULL, message TEXT NOT NULL,
    seconds REAL NOT NULL, PRIMARY KEY (key, attempt)) WITHOUT ROWID;
CREATE TABLE jobs (
    spot TEXT NOT NULL, set_id INTEGER NOT NULL, key TEXT NOT NULL, PRIMARY KEY (spot, set_id)) WITHOUT ROWID;
CREATE TABLE curve_files (
    name TEXT PRIMARY KEY, size INTEGER NOT NULL, sha256 TEXT NOT NULL, n_attempts INTEGER NOT NULL);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
"""


def is_blank(connection: sqlite3.Connection) -> bool:
    """Whether a file is one whose writer was killed before its first table was there."""
    (n_tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    return bool(n_tables == 0 and application == 0)


def check_sound(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is no ledger, is one of another version, or whose structure is damaged."""
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION:
        raise LedgerError(f"{path}: not a ledger of palpate; move it away, or name another folder")
    if version != VERSION:
        raise LedgerError(
            f"{path}: of version {version}, while this palpate reads version {VERSION}; "
            "install the palpate that wrote it, or name another folder"
        )
    (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise damaged(path, verdict)


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
        f"{path}: damaged: {place}. Restore a copy, or move it and {CURVES}/ away: the simulations are "
        "then done again"
    )


_CURVE_FILE = re.compile(r"[0-9]{6,9}\.parquet")


def curve_file(folder: Path, name: str) -> Path:
    """Path of a file of curves that the ledger in ``folder`` names; refused if it could lead elsewhere."""
    if not _CURVE_FILE.fullmatch(name):
        raise damaged(folder / LEDGER, f"{name!r} is not a name of a file of curves")
    return folder / CURVES / name


def last_curve_file(folder: Path) -> int:
    """Number of the last file of curves in a run directory; 0 where there is none."""
    try:
        names = os.listdir(folder / CURVES)
    except FileNotFoundError:
        return 0
    return max((int(name.split(".")[0]) for name in names if _CURVE_FILE.fullmatch(name)), default=0)


def check_complete(connection: sqlite3.Connection, path: Path, n_files: int) -> bool:
    """Refuse a ledger that has lost rows, which SQLite does not notice.

    A damaged or deleted log costs, without an error, every transaction from there on. But each
    transaction of results comes after a file of curves with the next number, so at most
    one file, that of a writer which was killed, is without its row. Returns whether one is.
    ``n_files`` is what :func:`last_curve_file` returned before this connection read anything.
    """
    (n_known,) = connection.execute("SELECT coalesce(max(rowid), 0) FROM curve_files").fetchone()
    if n_files > n_known + 1:
        raise LedgerError(
            f"{path}: damaged: it ends with {CURVES}/{n_known:06d}.parquet, but {CURVES}/ has files up to "
            f"{n_files:06d}.parquet; the disk may be failing, or {path.name}-wal was removed. Restore a copy "
            f"of {path.name}*, or delete the files of {CURVES}/ after {n_known:06d}.parquet: what they hold "
            "is then simulated again"
        )
    n_attempts, n_recorded, n_keys, n_rows = connection.execute(
        "SELECT (SELECT coalesce(sum(n_attempts), 0) FROM curve_files), (SELECT count(*) FROM attempts), "
        "(SELECT count(DISTINCT key) FROM attempts), (SELECT count(*) FROM simulations)"
    ).fetchone()
    if n_attempts != n_recorded or n_keys != n_rows:
        raise damaged(
            path,
            f"{n_attempts} attempts were written, {n_recorded} attempts and {n_rows} of {n_keys} "
            "simulations are there",
        )
    return bool(n_files == n_known + 1)


def digest(row: Sequence[object]) -> str:
    """Short hash of the columns of ``simulations`` before ``digest``."""
    return hashlib.blake2b(json.dumps(row).encode(), digest_size=8).hexdigest()
