"""Finished simulations that several studies share: a folder of files by key.

A file is written whole and never changed, so that any number of runs may read and write the
folder at once, on any file system. Only what would end the same way again is shared: a
time-out or a crash depends on the machine.
"""

import hashlib
import json
from pathlib import Path

import polars as pl

from palpate.domain import Job, Simulation, Status, SurfaceStates
from palpate.errors import CurveError, LedgerError
from palpate.executors.answers import plain, reject_nonphysical
from palpate.run.atomic_files import write_atomically
from palpate.run.ledger.curve_files import pack, unpack
from palpate.run.result_files import read_surface, write_surface

_SHARED = (Status.OK, Status.DIVERGED, Status.UNREADABLE)


class ResultCache:
    """Results by key, shared between studies; the folder is made on the first :meth:`store`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def store(self, key: str, simulation: Simulation) -> None:
        """Share a simulation, unless it is there already, and whole; a LedgerError if that fails."""
        path = self._path(key)
        if simulation.status not in _SHARED or self.load(key, simulation.job) is not None:
            return
        if simulation.surface is not None:
            self._store_surface(key, simulation.surface)
        curves = b"" if simulation.response is None else pack({key: simulation.response})
        about = {
            "status": simulation.status.value,
            "message": simulation.message,
            "seconds": simulation.seconds,
            "diagnostics": plain(simulation.diagnostics),
        }
        content = json.dumps(about, allow_nan=False).encode() + b"\n" + curves
        try:
            write_atomically(path, _checksum(key, content) + b"\n" + content)
        except OSError as error:
            raise _unwritten(path, error) from error

    def load(self, key: str, job: Job) -> Simulation | None:
        """Read the simulation of a job; None where nobody shared it, or the file does not hold it."""
        try:
            checksum, content = self._path(key).read_bytes().split(b"\n", 1)
            if checksum != _checksum(key, content):
                return None
            head, curves = content.split(b"\n", 1)
            response = unpack(curves, [key])[key] if curves else None
            if isinstance(response, CurveError):
                return None
            about = json.loads(head)
            status = Status(about["status"])
            surface = read_surface(self._surface(key)) if job.surface else None
            if job.surface and surface is None and status is Status.OK:
                return None
            found = Simulation(
                job=job,
                status=status,
                response=response,
                message=str(about["message"]),
                seconds=float(about["seconds"]),
                diagnostics=dict(about["diagnostics"]),
                surface=surface,
            )
            return found if reject_nonphysical(found) is found else None
        except (OSError, ValueError, KeyError, TypeError, RecursionError, pl.exceptions.PolarsError):
            return None

    def holds(self, key: str) -> bool:
        """Whether there is a file of this key, sound or not."""
        return self._path(key).is_file()

    def _store_surface(self, key: str, states: SurfaceStates) -> None:
        try:
            write_surface(self._surface(key), states)
        except OSError as error:
            raise _unwritten(self._surface(key), error) from error

    def _surface(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.npz"

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.simulation"


def _unwritten(path: Path, error: OSError) -> LedgerError:
    return LedgerError(
        f"{path}: cannot be written ({error.strerror}); fix it, or take executor.cache out of the study"
    )


def _checksum(key: str, content: bytes) -> bytes:
    """Of the content under this key, so that one file cannot take the place of another."""
    return hashlib.sha256(key.encode() + b"\n" + content).hexdigest().encode()
