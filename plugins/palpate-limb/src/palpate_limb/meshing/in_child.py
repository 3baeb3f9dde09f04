"""Work in a process of its own, bounded in time: arrays in, arrays out.

A mesher may loop for ever or end its process on surfaces that it cannot take;
in a child neither harms the caller.
"""

import os
import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import MeshError, PluginError

Arrays = Mapping[str, NDArray[Any]]
NOT_INSTALLED = 3


class ChildWork(ABC):
    """Work that is done in a child, by a class without arguments."""

    @abstractmethod
    def work(self, given: Arrays) -> Arrays:
        """Arrays made of the arrays given."""


def work_in_child(what: str, target: str, given: Mapping[str, object], time_limit_s: float) -> Arrays:
    """Let a class do its work in a process of its own, in an empty folder.

    Parameters
    ----------
    what : str
        As messages call it.
    target : str
        The class, as ``module:class``.
    given : mapping of name to array
    time_limit_s : float

    Raises
    ------
    PluginError
        What it needs is not installed.
    MeshError
        It failed, or took too long.
    """
    with tempfile.TemporaryDirectory(prefix="palpate-mesh-") as folder:
        task, made = Path(folder) / "task.npz", Path(folder) / "mesh.npz"
        save_arrays(task, {name: np.asarray(value) for name, value in given.items()})
        command = [sys.executable, "-m", "palpate_limb.meshing.child", target, str(task), str(made)]
        # Modules are found where the caller finds them, though the child works elsewhere.
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=time_limit_s,
                check=False,
                cwd=folder,  # fTetWild leaves files where it runs
                env={**os.environ, "PYTHONPATH": paths},
            )
        except subprocess.TimeoutExpired:
            raise MeshError(
                f"{what} was stopped after {time_limit_s:g} s; coarsen the mesh, or raise the time limit"
            ) from None
        if done.returncode == NOT_INSTALLED:
            raise PluginError(done.stderr.strip().splitlines()[-1])
        if done.returncode or not made.is_file():
            reason = (done.stderr.strip().splitlines() or ["it ended without a word"])[-1][:300]
            raise MeshError(
                f"{what} failed with exit code {done.returncode} ({reason}); check the surfaces, or use "
                "another mesher"
            )
        with np.load(made) as arrays:
            return dict(arrays)


def save_arrays(path: Path, arrays: Arrays) -> None:
    """Write arrays for the other side."""
    with path.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **arrays)
