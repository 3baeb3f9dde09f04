"""Anatomy and placement that may be wrong: the limb with its spot, bones or layers elsewhere.

Nodes move and elements stay, so that a small change of the limb is a small change of the curves. The nodes
between what moves and what rests follow a graph's Laplace equation, Σ (uᵢ − uⱼ)/lᵢⱼ = 0 over the edges of
the elements; those in the middle of an edge stay there.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import scipy

from palpate.api import FloatArray, IntArray, Limb, Mesh
from palpate.api.mesh import CELLS, layer_of, nodes_of_regions, spot_axes, surface_faces, surface_normals
from palpate.api.runs import Study, mesh_note
from palpate_certainty.assumptions import ASSUMED

OF_LIMB = ("position", "bone", "layers")
"""Kinds of causes that change the limb."""


def noted_position_mm(study: Study, spot: str) -> float:
    """Standard deviation of a spot's position: as the note of its mesh has it, else the usual one."""
    mesh = next((each.mesh for each in study.spots if each.spot.name == spot), None)
    noted = (mesh_note(mesh) or {}).get("std_across_mm") if mesh is not None else None
    return float(noted) if isinstance(noted, float | int) and noted > 0.0 else ASSUMED.position_mm


def changed_limb(limb: Limb, kind: str, of: str, by: float) -> Limb:
    """Limb that one of :data:`OF_LIMB` has changed; the same one where there is nothing to change.

    It is ``of`` an axis of the spot's frame for a position, or a region for a layer, ``by`` a shift of the
    spot, or of the bones towards it, in mm, or a share of the layer's thickness.
    """
    if kind == "position":
        return at_another_spot(limb, (by, 0.0) if of == "x" else (0.0, by))
    moves = bone_displacements(limb) if kind == "bone" else layer_displacements(limb, of)
    if not moves.any():
        return limb
    return replace(limb, mesh=replace(limb.mesh, points_mm=limb.mesh.points_mm + by * moves))


def change_of(kind: str, of: str, by: float) -> str:
    """Phrase on a change of :func:`changed_limb`, such as ``move the bones by 1 mm``."""
    if kind == "layers":
        return f"make layer {of} thicker by {100.0 * by:.2g} %"
    what = "the bones" if kind == "bone" else f"the spot along {of.rpartition(' ')[2]}"
    return f"move {what} by {by:.2g} mm"


def at_another_spot(limb: Limb, by_mm: tuple[float, float]) -> Limb:
    """Limb whose spot is elsewhere on its skin, along x and y of the spot's frame; the normal stays.

    The height follows a quadratic surface through the nearest nodes of the skin.
    """
    spot = limb.spot
    axes = spot_axes(spot.normal, spot.along)
    skin = (limb.mesh.points_mm[limb.mesh.node_sets["contact"]] - spot.position_mm) @ axes
    # Nodes of the skin by which the surface at a spot is known.
    near = skin[np.argsort(np.linalg.norm(skin, axis=1))[:30]]
    heights, *_ = np.linalg.lstsq(_quadratic(near[:, :2]), near[:, 2], rcond=None)
    up_mm = (_quadratic(np.array([by_mm])) - _quadratic(np.zeros((1, 2)))) @ heights
    moved = spot.position_mm + axes @ np.array([*by_mm, up_mm.item()])
    return replace(limb, spot=replace(spot, position_mm=moved))


def _quadratic(at: FloatArray) -> FloatArray:
    x, y = at.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


@lru_cache(maxsize=32)
def bone_displacements(limb: Limb) -> FloatArray:
    """Displacements (n_nodes, 3) that bring the bones nearer by 1 mm; zero without any below the skin.

    They go along the spot's normal, and so much less as a bone faces away that its far side rests. Bones are
    the held surface below the skin, but for the ends at which a limb was cut, where the mesh names them.
    """
    mesh, normal = limb.mesh, limb.spot.normal
    bones = np.setdiff1d(_resting(mesh), mesh.node_sets["contact"])
    facing = 0.5 - 0.5 * surface_normals(mesh, mesh.used_regions, bones) @ normal
    return _with_the_rest(mesh, bones, facing[:, None] * normal)


def _resting(mesh: Mesh) -> IntArray:
    """Fixed nodes except on the ends at which a limb was cut, where the mesh names the ends.

    Nodes of such an end that are on another fixed face too, the rim of a bone, stay.
    """
    fixed, cut = mesh.node_sets["fixed"], mesh.node_sets.get("cut", np.empty(0, dtype=np.int64))
    others = [np.empty(0, dtype=np.int64)]
    for faces, _ in surface_faces(mesh) if cut.size else ():
        is_other = np.isin(faces, fixed).all(axis=1) & ~np.isin(faces, cut).all(axis=1)
        others.append(faces[is_other].ravel())
    return np.setdiff1d(fixed, np.setdiff1d(cut, np.concatenate(others)))


@lru_cache(maxsize=32)
def layer_displacements(limb: Limb, region: str) -> FloatArray:
    """Displacements (n_nodes, 3) that double a layer: zero for the deepest, or where there is none."""
    if (layer := layer_of(limb.mesh, region)) is None:
        return np.zeros_like(limb.mesh.points_mm)
    return _with_the_rest(limb.mesh, *layer)


def _with_the_rest(mesh: Mesh, moved: IntArray, by_mm: FloatArray) -> FloatArray:
    """Displacements (n_nodes, 3) where nodes (n,) move by (n, 3); skin, held nodes and other layers rest.

    Ends at which a limb was cut move as the tissue does, where the mesh names them.
    """
    found = np.zeros_like(mesh.points_mm)
    if not moved.size:
        return found
    edges, middles = _edges(mesh)
    known = np.zeros(mesh.n_nodes, dtype=np.bool_)
    for nodes in (mesh.node_sets["contact"], _resting(mesh), moved):
        known[nodes] = True
    n_regions = np.zeros(mesh.n_nodes, dtype=np.int64)
    for region in mesh.used_regions:
        n_regions[nodes_of_regions(mesh, [region])] += 1
    known |= n_regions > 1
    found[moved] = by_mm
    free = np.setdiff1d(edges, np.flatnonzero(known))
    if free.size:
        weights = 1.0 / np.linalg.norm(np.diff(mesh.points_mm[edges], axis=1)[:, 0], axis=1)
        i, j = edges.T
        coupling = scipy.sparse.coo_array((weights, (i, j)), shape=(mesh.n_nodes, mesh.n_nodes)).tocsr()
        coupling = coupling + coupling.T
        laplacian = (scipy.sparse.diags_array(coupling.sum(axis=1)) - coupling).tocsr()[free]
        ends = np.flatnonzero(known)
        found[free] = scipy.sparse.linalg.spsolve(
            laplacian[:, free].tocsc(), -(laplacian[:, ends] @ found[ends])
        ).reshape(-1, 3)
    if middles.size:
        middle, a, b = middles.T
        found[middle] = 0.5 * (found[a] + found[b])
    return found


def _edges(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Corners (n, 2) of each edge once; and (m, 3) of those with a node in the middle: that, and its ends."""
    ends, middles = [], [np.empty((0, 3), dtype=np.int64)]
    for kind, cells in mesh.cells.items():
        cell = CELLS[kind]
        pairs = np.sort(cells[:, np.array(cell.edges)], axis=2)
        ends.append(pairs.reshape(-1, 2))
        if cell.has_midside_nodes:
            middles.append(np.dstack([cells[:, cell.n_corners :], pairs]).reshape(-1, 3))
    return np.unique(np.concatenate(ends), axis=0), np.unique(np.concatenate(middles), axis=0)
