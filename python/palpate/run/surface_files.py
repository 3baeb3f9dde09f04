"""States of the skin as files: ``surface/<key>.npz`` of a simulation, which numpy reads.

An array of each name of :class:`palpate.domain.surface.SurfaceStates`. A file is written whole before the
ledger has the simulation's row, so a row without its file means that somebody removed it.
"""

import io
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from palpate.domain.surface import SurfaceStates
from palpate.errors import MeshError
from palpate.run.atomic_files import write_atomically

FOLDER = "surface"


def surface_path(folder: Path, key: str) -> Path:
    """File of a simulation in a run directory."""
    return folder / FOLDER / f"{key}.npz"


def write_surface(path: Path, states: SurfaceStates) -> None:
    """Write states of the skin; an OSError leaves nothing behind."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **states.compact())
    write_atomically(path, buffer.getvalue())


def read_surface(path: Path) -> SurfaceStates | None:
    """States of the skin as they were written; None where the file is missing or damaged."""
    try:
        with np.load(io.BytesIO(path.read_bytes())) as arrays:
            return SurfaceStates(**{each.name: arrays[each.name] for each in fields(SurfaceStates)})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, MeshError):
        return None
