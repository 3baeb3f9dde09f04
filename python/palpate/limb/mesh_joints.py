"""Connectivity of a mesh: no element listed twice, no crack, no separate part, no hole."""

from collections.abc import Iterable

import numpy as np
import scipy

from palpate.domain import FloatArray, IntArray, Limb, Mesh
from palpate.errors import MeshError
from palpate.mesh.topology import CELLS


def check_joints(limb: Limb) -> None:
    """Refuse a limb with an element listed twice, with two nodes at one place, or with a separate part.

    Raises
    ------
    MeshError
        Naming the elements or nodes, and where they are.
    """
    mesh = limb.mesh
    for kind, cells in mesh.cells.items():
        _check_listed_once(kind, np.sort(cells, axis=1), mesh.points_mm[cells].mean(axis=1))
    _check_doubled_nodes(limb)
    _check_one_part(limb)


def _check_listed_once(kind: str, nodes: IntArray, centres: FloatArray) -> None:
    order = np.lexsort(nodes.T)
    same = np.flatnonzero((nodes[order[1:]] == nodes[order[:-1]]).all(axis=1))
    if same.size:
        first, second = sorted(int(i) for i in order[same[0] : same[0] + 2])
        raise MeshError(
            f"mesh: {kind} elements {first} and {second} have the same nodes, near {_mm(centres[first])} "
            f"({same.size} such pairs); list each element once"
        )


def _check_doubled_nodes(limb: Limb) -> None:
    points = limb.mesh.points_mm
    # Distance of two nodes, over the length of the limb, below which they are at one place.
    pairs = scipy.spatial.cKDTree(points).query_pairs(
        1e-6 * float(np.ptp(points, axis=0).max()), output_type="ndarray"
    )
    if not len(pairs):
        return
    distances = np.linalg.norm(points[pairs[:, 0]] - limb.spot.position_mm, axis=1)
    nearest = pairs[distances.argmin()]
    raise MeshError(
        f"mesh: {len(pairs)} pairs of nodes are at one place, such as nodes {nearest.min()} and "
        f"{nearest.max()} at {_mm(points[nearest[0]])}, {distances.min():.3g} mm from spot "
        f"'{limb.spot.name}': the tissue would separate there, as along a crack; merge equal nodes"
    )


def _check_one_part(limb: Limb) -> None:
    mesh = limb.mesh
    n_parts, part = _connected(mesh.n_nodes, mesh.cells.values())
    if n_parts == 1:
        return
    contact = mesh.node_sets["contact"]
    distances = np.linalg.norm(mesh.points_mm[contact] - limb.spot.position_mm, axis=1)
    pressed = part[contact[distances.argmin()]]
    other = int(np.flatnonzero(part != pressed)[0])
    there, here = (
        np.concatenate([mesh.cell_regions[kind][part[c[:, 0]] == each] for kind, c in mesh.cells.items()])
        for each in (part[other], pressed)
    )
    names = [mesh.regions[i] for i in np.unique(there)]
    how = "remove it"
    if not np.isin(there, here).any():
        how += ", as leave_out under [limb.settings] does where the limb's source has it"
    raise MeshError(
        f"mesh: {n_parts} separate parts; the part of node {other} near {_mm(mesh.points_mm[other])} (region "
        f"{', '.join(names)}) shares no node with the part under spot '{limb.spot.name}'; merge their nodes, "
        f"or {how}"
    )


def _connected(n_nodes: int, groups: Iterable[IntArray]) -> tuple[int, IntArray]:
    pairs = [
        np.stack([np.repeat(nodes[:, :1], nodes.shape[1] - 1, axis=1).ravel(), nodes[:, 1:].ravel()])
        for nodes in groups
    ]
    first, other = np.concatenate(pairs, axis=1)
    links = scipy.sparse.coo_array((np.ones(first.size), (first, other)), shape=(n_nodes, n_nodes))
    n_parts, part = scipy.sparse.csgraph.connected_components(links, directed=False)
    return int(n_parts), np.asarray(part, dtype=np.int64)


def holes(mesh: Mesh) -> list[str]:
    """Closed inner surfaces that are neither fixed nor in contact, each in a sentence."""
    outer = _boundary(mesh)
    n_parts, part = _connected(mesh.n_nodes, outer)
    known = np.zeros(n_parts, dtype=bool)
    for name in ("fixed", "contact"):
        known[part[mesh.node_sets[name]]] = True
    nodes = np.unique(np.concatenate([faces.ravel() for faces in outer]))
    inner = [nodes[part[nodes] == k] for k in np.unique(part[nodes]) if not known[k]]
    return [
        f"a closed inner surface of {len(each)} nodes near {_mm(mesh.points_mm[each].mean(axis=0))} is free: "
        "a hole in the tissue, or a bone whose nodes are not in 'fixed'"
        for each in inner
    ]


def _boundary(mesh: Mesh) -> list[IntArray]:
    """Corner nodes of the faces of exactly one element, triangles apart from quadrilaterals."""
    faces: dict[int, list[IntArray]] = {}
    for kind, cells in mesh.cells.items():
        for face in CELLS[kind].corner_faces:
            faces.setdefault(len(face), []).append(np.sort(cells[:, list(face)], axis=1))
    found = [np.unique(np.concatenate(each), axis=0, return_counts=True) for each in faces.values()]
    return [unique[counts == 1] for unique, counts in found]


def _mm(point: FloatArray) -> str:
    return f"{np.round(point, 3).tolist()} mm"
