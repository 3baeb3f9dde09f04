"""Surfaces filled with tetrahedra of given sizes: fTetWild fills them, and Mmg adapts the edges.

fTetWild keeps to the surfaces and never fails, but sizes it meets loosely. Mmg (Dapogny, Dobrzynski and
Frey 2014) takes its mesh and splits, collapses, swaps and moves until edges have the length asked for; how
far a straight face may leave the smooth surface bounds its edges too. Each works in a process of its own,
for a mesher may loop for ever or end its process on surfaces that it cannot take.
"""

import importlib.machinery
import importlib.util
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.api import FloatArray, IntArray, MeshError, PluginError
from palpate.api.files import ProcessLimits, run_function
from palpate.api.mesh import CUBE, SIX_TETS

P = ParamSpec("P")
T = TypeVar("T")
Arrays = Mapping[str, NDArray[Any]]

GROWTH = 0.7
"""By how much longer an edge may be for each mm from the contact's edge."""
MIDDLE = 1.5
"""Longest edge under the indenter over that at the edge of its contact."""
SKIN_FALLS = 0.17
"""Distance by which a limb's skin falls from the spot to the contact's edge, over that between the two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeField:
    """Edge length wanted at a point: ``fine_mm`` where the edge of the contact moves, and longer elsewhere.

    The torque's error by the mesh comes from the edge of the contact, so edges are ``fine_mm`` long on the
    ring of the skin between ``inner_mm`` and ``radius_mm`` from the spot's normal. Away from it they grow by
    ``growth`` for each mm, but within the ring they are at most :data:`MIDDLE` times as long; ``coarse_mm``
    is the longest. As far as ``deep_mm`` below the skin sizes stay as on the skin, for layers.
    """

    fine_mm: float
    coarse_mm: float
    radius_mm: float
    inner_mm: float = 0.0
    growth: float = GROWTH
    deep_mm: float = 0.0

    def at(self, points_mm: FloatArray) -> FloatArray:
        """Edge length [mm] wanted at points (n, 3) in the spot's frame."""
        from_normal = np.hypot(points_mm[:, 0], points_mm[:, 1])
        beyond = np.maximum(from_normal - self.radius_mm, 0.0)
        below = np.maximum(-points_mm[:, 2] - self.deep_mm - SKIN_FALLS * self.radius_mm, 0.0)
        of_ring = self.growth * np.hypot(np.maximum(beyond, self.inner_mm - from_normal), below)
        of_disc = (MIDDLE - 1.0) * self.fine_mm + self.growth * np.hypot(beyond, below)
        return np.asarray(np.minimum(self.fine_mm + np.minimum(of_ring, of_disc), self.coarse_mm))

    def background(
        self, low_mm: FloatArray, high_mm: FloatArray, spacing_mm: float = 4.0
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Points (n, 3), cells (m, 4) and sizes (n,) of a grid of tetrahedra around a box."""
        low, high = low_mm - 3.0, high_mm + 3.0
        n = np.maximum(np.ceil((high - low) / spacing_mm).astype(int), 1)
        axes = [np.linspace(low[i], high[i], n[i] + 1) for i in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        cell = np.stack(np.meshgrid(*(np.arange(k) for k in n), indexing="ij"), axis=-1).reshape(-1, 1, 3)
        corner = cell + CUBE
        hexes = (corner[..., 0] * (n[1] + 1) + corner[..., 1]) * (n[2] + 1) + corner[..., 2]
        return points, hexes[:, SIX_TETS].reshape(-1, 4), self.at(points)


def run_ftetwild(
    points_mm: FloatArray, faces: IntArray, size: SizeField, tolerance_mm: float, time_limit_s: float
) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and tetrahedra (m, 4) of positive volume that fill surfaces.

    A PluginError where fTetWild is not installed; a MeshError where it fails, takes longer than
    ``time_limit_s`` or fills nothing.

    Parameters
    ----------
    points_mm, faces : (n, 3), (m, 3) array
        Closed surface of the body, outwards.
    tolerance_mm : float
        Distance by which the mesh may leave the surfaces.
    """
    what = "filling the surfaces by fTetWild"
    points, tets = _run_tool(what, time_limit_s, _ftetwild, points_mm, faces, size, tolerance_mm)
    if not len(tets):
        raise MeshError("fTetWild filled nothing; check that the surfaces are closed and outward")
    return points, tets


def run_mmg(
    mesh: Arrays, size: SizeField, largest_mm: FloatArray, deviation_mm: float, time_limit_s: float
) -> Arrays:
    """A mesh of straight tetrahedra with edges of the sizes asked for; errors as of :func:`run_ftetwild`.

    Parameters
    ----------
    mesh : mapping of str to array
        As is returned: ``points_mm`` (n, 3), ``tets`` (m, 4), boundary ``faces`` (k, 3) and the ``surfaces``
        (k,) that they are on, from 1; faces of two surfaces meet in an edge that stays.
    largest_mm : (n,) array
        Longest edge at each point; edges under the indenter may be longer.
    deviation_mm : float
        Distance by which a straight face may leave the smooth surface.
    """
    return _run_tool("adapting the mesh by Mmg", time_limit_s, _adapted, mesh, size, largest_mm, deviation_mm)


def _run_tool(
    what: str, time_limit_s: float, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    try:
        return run_function(ProcessLimits(time_s=time_limit_s), function, *args, **kwargs)
    except ImportError as error:
        raise PluginError(f"{what}: {error}; install it: pip install palpate-limb") from None
    except (ChildProcessError, MemoryError) as error:
        raise MeshError(f"{what} failed ({error}); check the surfaces, or coarsen the mesh") from None


def _ftetwild(
    points: FloatArray, faces: IntArray, size: SizeField, tolerance_mm: float
) -> tuple[FloatArray, IntArray]:
    """Points and tetrahedra by Hu et al. 2020, who take any triangles and keep to them within a tolerance."""
    os.chdir(tempfile.gettempdir())  # fTetWild leaves files where it runs
    grid, cells, sizes = size.background(points.min(axis=0), points.max(axis=0))
    # fTetWild improves elements until the worst has this AMIPS energy; a regular one has 3.
    filled, tets = _pytetwild().tetrahedralize_mesh(
        np.ascontiguousarray(points, dtype=np.float64),
        np.ascontiguousarray(faces, dtype=np.uint32),
        True,  # optimise
        True,  # skip the simplification: the surfaces come simplified
        0.05,
        float(sizes.max()),
        tolerance_mm / float(np.linalg.norm(np.ptp(points, axis=0))),
        10.0,
        False,  # coarsen
        1,  # threads
        60,
        6,  # log level
        True,  # quiet
        True,  # VTK's order: positive volumes
        False,  # keep the elements inside alone
        np.ascontiguousarray(grid, dtype=np.float64),
        np.ascontiguousarray(cells, dtype=np.int32),
        np.ascontiguousarray(sizes, dtype=np.float64),
    )
    return np.asarray(filled, dtype=np.float64), np.asarray(tets, dtype=np.int64)


def _pytetwild() -> ModuleType:
    """The compiled part of pytetwild alone: the package imports PyVista, with half a gigabyte of VTK."""
    package = importlib.util.find_spec("pytetwild")
    folders = package and package.submodule_search_locations
    spec = importlib.machinery.PathFinder.find_spec("PyfTetWildWrapper", folders or [])
    if spec is None or spec.loader is None:
        raise ImportError("pytetwild is missing")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _adapted(now: Arrays, size: SizeField, largest_mm: FloatArray, deviation_mm: float) -> Arrays:
    from mmgpy import MmgMesh3D
    from scipy.spatial import cKDTree

    given = cKDTree(now["points_mm"])

    # Mmg is asked for sizes at nodes, so its second pass knows them better than the first.
    for _ in range(2):
        points, tets, faces = now["points_mm"], now["tets"], now["faces"]
        mesh = MmgMesh3D()
        mesh.set_mesh_size(vertices=len(points), tetrahedra=len(tets), triangles=len(faces))
        mesh.set_vertices(points)
        mesh.set_tetrahedra(tets.astype(np.int32))
        mesh.set_triangles(faces.astype(np.int32), now["surfaces"].astype(np.int64))
        largest = np.maximum(largest_mm[given.query(points)[1]], size.fine_mm)
        mesh["metric"] = np.minimum(size.at(points), largest)[:, None]
        # An edge's neighbour may be this much longer: h grows by `growth` over a length of h, and a bit more.
        # Faces that meet at a larger angle meet in an edge that stays.
        mesh.remesh(hausd=deviation_mm, hgrad=1.4 + size.growth, ar=40.0, verbose=-1)
        new_faces, surfaces = mesh.get_triangles_with_refs()
        now = {
            "points_mm": np.asarray(mesh.get_vertices(), dtype=np.float64),
            "tets": np.asarray(mesh.get_tetrahedra(), dtype=np.int64),
            "faces": np.asarray(new_faces, dtype=np.int64),
            "surfaces": np.asarray(surfaces, dtype=np.int64),
        }
    return now
