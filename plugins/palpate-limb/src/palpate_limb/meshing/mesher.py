"""What a mesher is: it fills surfaces with tetrahedra, in a process of its own."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from palpate.domain import FloatArray, IntArray
from palpate.errors import MeshError, PluginError
from palpate_limb.meshing.in_child import Arrays, ChildWork, work_in_child

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


class Mesher(ChildWork):
    """Fills surfaces with tetrahedra."""

    name: ClassVar[str]
    needs: ClassVar[str]
    """The distribution that does the work."""

    @abstractmethod
    def fill(self, task: MeshingTask) -> tuple[FloatArray, IntArray]:
        """Points (n, 3) and tetrahedra (m, 4), of positive volume."""

    def work(self, given: Arrays) -> Arrays:
        """Fill the task that the arrays describe."""
        task = MeshingTask(
            points_mm=given["points_mm"],
            faces=given["faces"],
            nested=bool(given["nested"]),
            size_points_mm=given["size_points_mm"],
            size_cells=given["size_cells"],
            sizes_mm=given["sizes_mm"],
            tolerance_mm=float(given["tolerance_mm"]),
        )
        points, tets = self.fill(task)
        return {"points_mm": points, "tets": np.asarray(tets, dtype=np.int64)}


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
    given = {name: getattr(task, name) for name in MeshingTask.__slots__}
    made = work_in_child(f"mesher '{mesher}'", target, given, time_limit_s)
    if not len(made["tets"]):
        raise MeshError(f"mesher '{mesher}' filled nothing; check that the surfaces are closed and outward")
    return made["points_mm"], made["tets"]
