"""Adapts a mesh to the size field by Mmg, which keeps its surfaces and the borders of its regions.

fTetWild keeps to the surfaces and never fails, but sizes it meets loosely. Mmg (Dapogny, Dobrzynski and
Frey 2014) takes its mesh and splits, collapses, swaps and moves until edges have the length
asked for; how far a straight face may leave the smooth surface bounds its edges too.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.api import FloatArray, IntArray
from palpate_limb.meshing.mesher import run_tool
from palpate_limb.meshing.size_field import SizeField

Arrays = Mapping[str, NDArray[Any]]

N_PASSES = 2
"""Sizes are asked for at nodes, so the second pass knows them better than the first."""
RIDGE_DEG = 40.0
"""Faces that meet at a larger angle meet in an edge that stays."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AdaptTask:
    """A mesh of straight tetrahedra, and the sizes that it should have.

    Parameters
    ----------
    points_mm : (n, 3) array
    tets : (m, 4) integer array
    regions : (m,) integer array
    faces : (k, 3) integer array
        On the boundary.
    surfaces : (k,) integer array
        Which surface each is on, from 1; faces of two surfaces meet in an edge that stays.
    size : SizeField
    largest_mm : (n_regions,) array
        Edge length that a region takes at most, ∞ where it may be coarse.
    deviation_mm : float
        How far a straight face may leave the smooth surface.
    """

    points_mm: FloatArray
    tets: IntArray
    regions: IntArray
    faces: IntArray
    surfaces: IntArray
    size: SizeField
    largest_mm: FloatArray
    deviation_mm: float


def run_mmg(task: AdaptTask, time_limit_s: float) -> Arrays:
    """Adapt a mesh by Mmg 5, as mmgpy ships it, in a process of its own.

    Returns
    -------
    mapping
        ``points_mm``, ``tets``, ``regions``, ``faces`` and ``surfaces`` of the new mesh.

    Raises
    ------
    PluginError
        mmgpy is not installed.
    MeshError
        It failed or took too long.
    """
    return run_tool("adapting the mesh by Mmg", time_limit_s, _adapted, task)


def _adapted(task: AdaptTask) -> Arrays:
    now: Arrays = {
        name: getattr(task, name) for name in ("points_mm", "tets", "regions", "faces", "surfaces")
    }
    for _ in range(N_PASSES):
        now = _remeshed(now, _sizes(now, task.size, task.largest_mm), task.deviation_mm, task.size.growth)
    return now


def _sizes(now: Arrays, field: SizeField, largest_mm: FloatArray) -> FloatArray:
    """Edge length wanted at each point."""
    sizes = field.at(now["points_mm"])
    for region, largest in enumerate(largest_mm):
        nodes = np.unique(now["tets"][now["regions"] == region])
        sizes[nodes] = np.minimum(sizes[nodes], max(float(largest), field.fine_mm))
    return sizes


def _remeshed(now: Arrays, sizes: FloatArray, deviation_mm: float, growth: float) -> Arrays:
    from mmgpy import MmgMesh3D

    points, tets, faces = now["points_mm"], now["tets"], now["faces"]
    mesh = MmgMesh3D()
    mesh.set_mesh_size(vertices=len(points), tetrahedra=len(tets), triangles=len(faces))
    mesh.set_vertices(points)
    mesh.set_tetrahedra(tets.astype(np.int32), now["regions"].astype(np.int64))
    mesh.set_triangles(faces.astype(np.int32), now["surfaces"].astype(np.int64))
    mesh["metric"] = sizes[:, None]
    # An edge's neighbour may be this much longer: h grows by `growth` over a length of h, and a little more.
    mesh.remesh(hausd=deviation_mm, hgrad=1.4 + growth, ar=RIDGE_DEG, verbose=-1)
    new_tets, regions = mesh.get_elements_with_refs()
    new_faces, surfaces = mesh.get_triangles_with_refs()
    outer = surfaces > 0  # the borders of regions come back as faces of no surface
    return {
        "points_mm": np.asarray(mesh.get_vertices(), dtype=np.float64),
        "tets": np.asarray(new_tets, dtype=np.int64),
        "regions": np.asarray(regions, dtype=np.int64),
        "faces": np.asarray(new_faces, dtype=np.int64)[outer],
        "surfaces": np.asarray(surfaces, dtype=np.int64)[outer],
    }
