"""What a mesher is, and its run in a process of its own, bounded in time.

A mesher may loop for ever or end its process on surfaces that it cannot take;
in a child neither harms the caller.
"""

import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from palpate.domain import FloatArray, IntArray
from palpate.errors import MeshError, PluginError

MESHERS: Mapping[str, str] = MappingProxyType(
    {
        "ftetwild": "palpate_limb.meshing.ftetwild:FTetWild",
        "tetgen": "palpate_limb.meshing.tetgen_mesher:TetGen",
        "gmsh": "palpate_limb.meshing.gmsh_mesher:Gmsh",
    }
)
"""Class of each mesher as module:class; a mesher from elsewhere is named in the same way."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeshingTask:
    """Surfaces to fill and sizes to respect.

    Parameters
    ----------
    points_mm : (n, 3) array
    faces : (m, 3) integer array
        Of all surfaces: the body's, and those that elements must follow inside of it.
    nested : bool
        There are surfaces inside of the body. Then everything within the box may
        be filled: the caller keeps what lies in the body.
    size_points_mm, size_cells, sizes_mm
        Edge lengths (k,) at the points (k, 3) of a grid of tetrahedra (l, 4).
    tolerance_mm : float
        How far the mesh's surface may stray.
    """

    points_mm: FloatArray
    faces: IntArray
    nested: bool
    size_points_mm: FloatArray
    size_cells: IntArray
    sizes_mm: FloatArray
    tolerance_mm: float


class Mesher(ABC):
    """Fills surfaces with tetrahedra."""

    name: ClassVar[str]
    needs: ClassVar[str]
    """The distribution that does the work."""

    @abstractmethod
    def fill(self, task: MeshingTask) -> tuple[FloatArray, IntArray]:
        """Points (n, 3) and tetrahedra (m, 4), of positive volume."""


def mesh_in_child(mesher: str, task: MeshingTask, time_limit_s: float) -> tuple[FloatArray, IntArray]:
    """Let a mesher work in a process of its own.

    Parameters
    ----------
    mesher : str
        A key of ``MESHERS``, or ``module:class``.
    task : MeshingTask
    time_limit_s : float

    Raises
    ------
    PluginError
        No such mesher, or what it needs is not installed.
    MeshError
        It failed, took too long, or filled nothing.
    """
    target = MESHERS.get(mesher, mesher)
    if ":" not in target:
        raise PluginError(
            f"no mesher '{mesher}' (there: {', '.join(MESHERS)}); choose one, or name module:class"
        )
    with tempfile.TemporaryDirectory(prefix="palpate-mesh-") as folder:
        given, made = Path(folder) / "task.npz", Path(folder) / "mesh.npz"
        np.savez(given, **{name: getattr(task, name) for name in MeshingTask.__slots__})
        command = [sys.executable, "-m", "palpate_limb.meshing.child", target, str(given), str(made)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=time_limit_s, check=False)
        except subprocess.TimeoutExpired:
            raise MeshError(
                f"mesher '{mesher}' was stopped after {time_limit_s:g} s; coarsen the mesh, or raise the "
                "time limit"
            ) from None
        if done.returncode == 3:
            raise PluginError(done.stderr.strip().splitlines()[-1])
        if done.returncode or not made.is_file():
            reason = (done.stderr.strip().splitlines() or ["it ended without a word"])[-1][:300]
            raise MeshError(
                f"mesher '{mesher}' failed with exit code {done.returncode} ({reason}); check the "
                "surfaces, or use another mesher"
            )
        with np.load(made) as arrays:
            points, tets = arrays["points_mm"], arrays["tets"].astype(np.int64)
    if not len(tets):
        raise MeshError(f"mesher '{mesher}' filled nothing; check that the surfaces are closed and outward")
    return points, tets
