"""Layers of a mesh: regions between the skin and the deepest region, and their thickness."""

from collections.abc import Iterable

import numpy as np
import scipy

from palpate.domain import FloatArray, IntArray, Limb, Mesh
from palpate.mesh.topology import CELLS, outer_faces


def layer_of(mesh: Mesh, region: str) -> tuple[IntArray, FloatArray] | None:
    """Nodes (n,) of a layer's lower surface, and vectors (n, 3) to them from its upper one along the normal.

    None for the deepest region, and where the region is no layer.
    """
    levels = _levels(mesh)
    if (level := levels.get(region)) is None:
        return None
    own = nodes_of_regions(mesh, [region])
    above = mesh.node_sets["contact"]
    if level > 0:
        above = nodes_of_regions(mesh, [name for name, other in levels.items() if other < level])
    below = nodes_of_regions(mesh, [name for name, other in levels.items() if other > level])
    top = np.intersect1d(own, above)
    bottom = np.setdiff1d(np.intersect1d(own, below), above)
    if not top.size or not bottom.size:
        return None
    normals = surface_normals(mesh, [region], top)
    _, nearest = scipy.spatial.KDTree(mesh.points_mm[top]).query(mesh.points_mm[bottom])
    away = mesh.points_mm[bottom] - mesh.points_mm[top[nearest]]
    # Along the normal alone: the nearest node is not straight above.
    thickness_mm = np.sum(away * normals[nearest], axis=1, keepdims=True)
    return bottom, thickness_mm * normals[nearest]


def thickness_mm(limb: Limb, region: str, near_mm: float) -> float | None:
    """Mean thickness of a layer within ``near_mm`` of the spot's normal; None where there is no layer."""
    if (layer := layer_of(limb.mesh, region)) is None:
        return None
    bottom, inwards_mm = layer
    normal, from_spot = limb.spot.normal, limb.mesh.points_mm[bottom] - limb.spot.position_mm
    across = np.linalg.norm(np.cross(from_spot, normal), axis=1)
    under = (inwards_mm @ normal < 0.0) & (across <= near_mm)
    return float(np.linalg.norm(inwards_mm[under], axis=1).mean()) if under.any() else None


def outer_layer(mesh: Mesh) -> tuple[str, float] | None:
    """Only region with faces in contact, and its median thickness [mm]; None where it is no layer."""
    top = [region for region, level in _levels(mesh).items() if level == 0]
    if len(top) != 1 or (layer := layer_of(mesh, top[0])) is None:
        return None
    return top[0], float(np.median(np.linalg.norm(layer[1], axis=1)))


def _levels(mesh: Mesh) -> dict[str, int]:
    """Number of regions between each region and the skin."""
    levels: dict[str, int] = {}
    reached, level = np.unique(mesh.node_sets["contact"]), 0
    nodes = {region: nodes_of_regions(mesh, [region]) for region in mesh.used_regions}
    while found := [r for r in nodes if r not in levels and _has_face(mesh, r, reached)]:
        levels |= dict.fromkeys(found, level)
        reached, level = np.unique(np.concatenate([reached, *(nodes[r] for r in found)])), level + 1
    return levels


def _has_face(mesh: Mesh, region: str, nodes: IntArray) -> bool:
    """Whether an element of a region has a face of these nodes (n,)."""
    every = (cells[:, np.array(CELLS[kind].faces)] for kind, cells in _cells_of(mesh, [region]).items())
    return any(bool(np.isin(faces, nodes).all(axis=2).any()) for faces in every)


def _cells_of(mesh: Mesh, regions: Iterable[str]) -> dict[str, IntArray]:
    ids = [mesh.regions.index(region) for region in regions]
    return {kind: cells[np.isin(mesh.cell_regions[kind], ids)] for kind, cells in mesh.cells.items()}


def nodes_of_regions(mesh: Mesh, regions: Iterable[str]) -> IntArray:
    """Nodes of the elements of some regions, in ascending order."""
    return np.unique(np.concatenate([cells.ravel() for cells in _cells_of(mesh, regions).values()]))


def surface_normals(mesh: Mesh, regions: Iterable[str], at: IntArray) -> FloatArray:
    """Unit outward normals (n, 3) of the surface around regions, at nodes (n,) of it."""
    normals = np.zeros_like(mesh.points_mm)
    for kind, cells in _cells_of(mesh, regions).items():
        faces = outer_faces(kind, cells)
        faces = faces[np.isin(faces, at).all(axis=1)]
        a, b, c = (mesh.points_mm[faces[:, k]] for k in range(3))
        for node in faces.T:
            np.add.at(normals, node, np.cross(b - a, c - a))
    found = normals[at]
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))
