"""Outer surface of a limb: its shares that are fixed, in contact and free, and sides fixed in part."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from palpate.domain import FloatArray, IntArray, Mesh
from palpate.mesh.topology import surface_faces, triangles_of


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceShares:
    """Shares of the area of the outer surface, 0 to 1; a face is fixed, or in contact, if all its nodes are.

    A face of both node sets is fixed.
    """

    fixed: float
    contact: float
    free: float

    def __str__(self) -> str:
        return f"{100 * self.fixed:.0f} %, {100 * self.contact:.0f} %, {100 * self.free:.0f} %"


def surface_shares(mesh: Mesh) -> SurfaceShares:
    """Shares of a mesh's outer surface that are fixed and in contact."""
    areas = np.zeros(3)
    for faces, _ in surface_faces(mesh):
        corners = mesh.points_mm[triangles_of(faces)]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        area = area.reshape(-1, len(faces)).sum(axis=0)
        fixed, contact = (np.isin(faces, mesh.node_sets[name]).all(axis=1) for name in ("fixed", "contact"))
        areas += [area[of].sum() for of in (fixed, contact & ~fixed, ~contact & ~fixed)]
    fixed_share, contact_share, free = (areas / (areas.sum() or 1.0)).tolist()
    return SurfaceShares(fixed=fixed_share, contact=contact_share, free=free)


def partly_fixed(mesh: Mesh) -> Iterator[str]:
    """Warnings of sides of the limb, such as a cut or a bone, of which a part is fixed and the rest free.

    A side ends at sharp edges. A midside node between fixed nodes is no part alone: its edge may end in two
    other sides. On a side in contact, only fixed nodes that make no whole face are named.
    """
    fixed, contact = (np.isin(np.arange(mesh.n_nodes), mesh.node_sets[name]) for name in ("fixed", "contact"))
    whole, between = np.zeros((2, mesh.n_nodes), dtype=np.bool_)
    for faces, n in surface_faces(mesh):
        whole[faces[fixed[faces].all(axis=1)]] = True
        ends = fixed[faces[:, :n]]
        between[faces[:, n:][(ends & np.roll(ends, -1, axis=1))[:, : faces.shape[1] - n]]] = True
    single = 0
    for nodes in _sides(mesh):
        held = fixed[nodes]
        if not (held & ~between[nodes]).any():
            continue
        if contact[nodes].any():
            single += int(np.count_nonzero(held & ~whole[nodes]))
        elif not held.all():
            where = (np.round(mesh.points_mm[nodes].mean(axis=0), 1) + 0.0).tolist()
            yield (
                f"a cut or bone around {where} mm is fixed in part: {np.count_nonzero(held)} of "
                f"{nodes.size} nodes; the others are free, so the limb is too soft; fix all of them, or "
                "look at the picture of `palpate limb inspect MESH`"
            )
    if single:
        yield (
            f"{single} fixed nodes on the skin make no whole face of an element, so a support is fixed in "
            "part; fix all nodes of its faces, or look at the picture of `palpate limb inspect MESH`"
        )


def _sides(mesh: Mesh) -> Iterator[IntArray]:
    """Nodes inside of each side: those that no other side has."""
    nodes, owner, normals, edges, edge_owner = _faces(mesh)
    order = np.argsort(edges, kind="stable")
    first, second = order[:-1], order[1:]
    joined = edges[first] == edges[second]
    pairs = np.stack([edge_owner[first[joined]], edge_owner[second[joined]]])
    # Angle between the normals of two faces from which their edge ends a side of the limb.
    smooth = (normals[pairs[0]] * normals[pairs[1]]).sum(axis=1) > np.cos(np.deg2rad(30.0))
    n = len(normals)
    links = scipy.sparse.coo_array((np.ones(np.count_nonzero(smooth)), tuple(pairs[:, smooth])), shape=(n, n))
    side = scipy.sparse.csgraph.connected_components(links, directed=False)[1][owner]
    listed = np.unique(np.stack([nodes, side]), axis=1)
    once = np.bincount(listed[0], minlength=mesh.n_nodes)[listed[0]] == 1
    listed = listed[:, once]
    order = np.argsort(listed[1], kind="stable")
    cuts = np.flatnonzero(np.diff(listed[1][order])) + 1
    yield from (each for each in np.split(listed[0][order], cuts) if each.size)


def _faces(mesh: Mesh) -> tuple[IntArray, IntArray, FloatArray, IntArray, IntArray]:
    """Nodes of all outer faces and their face; normals by face; edges by number and their face."""
    nodes, owner, normals, edges, edge_owner, start = [], [], [], [], [], 0
    for faces, n in surface_faces(mesh):
        here = start + np.arange(len(faces))
        start += len(faces)
        corners = faces[:, :n]
        points = mesh.points_mm[corners]
        normal = np.cross(points[:, 1] - points[:, 0], points[:, -1] - points[:, 0])
        if n == 4:
            normal = np.cross(points[:, 2] - points[:, 0], points[:, 3] - points[:, 1])
        normals.append(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])
        nodes.append(faces.ravel())
        owner.append(np.repeat(here, faces.shape[1]))
        pairs = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2)
        edges.append((pairs @ [mesh.n_nodes, 1]).ravel())
        edge_owner.append(np.repeat(here, n))
    return (
        np.concatenate(nodes),
        np.concatenate(owner),
        np.concatenate(normals),
        np.concatenate(edges),
        np.concatenate(edge_owner),
    )
