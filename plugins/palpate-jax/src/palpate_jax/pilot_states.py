"""Displacements of pilots, kept on disk for the sets that start from them.

A file for each pilot, by the key of its simulation. A file that is missing or cut short costs that
simulation and nothing else, so the folder may be deleted at any time and used by any number of workers.
"""

import contextlib
import io
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import platformdirs
from numpy.typing import NDArray

from palpate.api import FloatArray
from palpate.api.files import write_atomically

MOST_BYTES = 8_000_000_000
"""Size of the folder beyond which the files that were used longest ago are deleted."""

MOST_OF_FREE = 0.2
"""The same as a share of what is free on the disk."""


class PilotStates:
    """Displacements of pilots by key: on disk, or in memory where that is impossible.

    Parameters
    ----------
    folder : Path, optional
        By default in the user's cache folder.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or platformdirs.user_cache_path("palpate") / "pilots"
        self._in_memory: dict[str, NDArray[np.float32]] = {}

    def load(self, key: str) -> NDArray[np.float32] | None:
        """Displacements (n, n_nodes, 3) [mm] of the n states reached, with that at rest; None if not kept."""
        if key in self._in_memory:
            return self._in_memory[key]
        path = self._path(key)
        try:
            stack = np.load(path, mmap_mode="r")
        except (OSError, ValueError, EOFError):
            return None
        with contextlib.suppress(OSError):  # a folder of someone else may be read too
            os.utime(path)
        return stack if stack.dtype == np.float32 and stack.ndim == 3 else None

    def store(self, key: str, displacements: Sequence[FloatArray]) -> None:
        """Keep the displacements, from rest, of every state that was reached."""
        stack = np.array(displacements, dtype=np.float32)
        content = io.BytesIO()
        np.save(content, stack)
        try:
            self._path(key).parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path(key), content.getvalue())
        except OSError:
            self._in_memory[key] = stack
        self._prune()

    def _path(self, key: str) -> Path:
        return self._folder / f"{key}.npy"

    def _prune(self) -> None:
        """Delete the oldest files of a folder that is too large."""
        with contextlib.suppress(OSError):  # another worker may delete too
            found = sorted((e.stat().st_mtime, e.stat().st_size, e.path) for e in os.scandir(self._folder))
            total = sum(size for _, size, _ in found)
            free = shutil.disk_usage(self._folder).free
            excess = total - min(MOST_BYTES, MOST_OF_FREE * (total + free))
            for _, size, path in found:
                if excess <= 0:
                    return
                os.unlink(path)
                excess -= size
