"""Hexahedra, wedges and pyramids cut into tetrahedra that meet, so that any of them can be simulated.

Every face is cut from its corner of the least number, and every element is cut from its own: two
elements that share a face cut it alike.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from palpate.domain import FloatArray, IntArray, Mesh
from palpate.mesh.midside_nodes import quadratic
from palpate.mesh.topology import CELLS


@dataclass(frozen=True)
class _Solid:
    """Corners of each face, counter-clockwise from outside, and ends of the edges as their nodes follow."""

    n_corners: int
    faces: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]


_HEX = _Solid(8, CELLS["hex8"].corner_faces, CELLS["hex8"].edges)
_TET = _Solid(4, CELLS["tet4"].corner_faces, CELLS["tet4"].edges)
_WEDGE = _Solid(
    6,
    ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
)
_PYRAMID = _Solid(
    5,
    ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
)
SOLIDS: Mapping[str, tuple[_Solid, int]] = MappingProxyType(
    {
        "tetra": (_TET, 4),
        "tetra10": (_TET, 10),
        "hexahedron": (_HEX, 8),
        "hexahedron20": (_HEX, 20),
        "hexahedron27": (_HEX, 27),
        "wedge": (_WEDGE, 6),
        "wedge15": (_WEDGE, 15),
        "pyramid": (_PYRAMID, 5),
        "pyramid13": (_PYRAMID, 13),
    }
)
"""Solids that can be cut, by meshio's name, with their number of nodes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cut:
    """Tetrahedra in place of other elements.

    Parameters
    ----------
    tets : (n, 4) integer array
    origin : tuple of (n_of_block,) integer arrays
        Element of its block that each tetrahedron is a part of.
    ends, middles : (m, 2) integer array, (m, 3) array
        Edges whose middle is known, and where it is.
    """

    tets: IntArray
    origin: tuple[IntArray, ...]
    ends: IntArray
    middles: FloatArray


def cut(points: FloatArray, blocks: tuple[tuple[str, IntArray], ...]) -> Cut:
    """Tetrahedra of blocks of the kinds of :data:`SOLIDS`, with the middles of curved edges and faces."""
    tets, origins, ends, middles = [], [], [np.empty((0, 2), np.int64)], [np.empty((0, 3))]
    for kind, cells in blocks:
        solid, n_nodes = SOLIDS[kind]
        made, origin = _tetrahedra(solid, cells[:, : solid.n_corners])
        sides = points[made[:, 1:]] - points[made[:, :1]]
        if len(made) and (np.linalg.det(sides) < 0.0).all():
            made = made[:, [1, 0, 2, 3]]
        tets.append(made)
        origins.append(origin)
        if n_nodes > solid.n_corners:
            for pairs, places in _middles(solid, points, cells):
                ends.append(pairs)
                middles.append(places)
    pairs = np.sort(np.concatenate(ends), axis=1)
    _, first = np.unique(pairs, axis=0, return_index=True)
    return Cut(
        tets=np.concatenate(tets),
        origin=tuple(origins),
        ends=pairs[first],
        middles=np.concatenate(middles)[first],
    )


def curved(mesh: Mesh, ends: IntArray, middles: FloatArray) -> Mesh:
    """Mesh whose four-node tetrahedra are quadratic, with the middles of edges where they are known."""
    made = quadratic(mesh)
    tets = made.cells["tet10"]
    pairs = np.sort(tets[:, np.array(CELLS["tet10"].edges)], axis=2).reshape(-1, 2)
    known = {(a, b): place for (a, b), place in zip(ends.tolist(), middles, strict=True)}
    points = np.array(made.points_mm)
    for (a, b), node in zip(pairs.tolist(), tets[:, 4:].ravel().tolist(), strict=True):
        if (place := known.get((a, b))) is not None:
            points[node] = place
    return replace(made, points_mm=points)


def _tetrahedra(solid: _Solid, corners: IntArray) -> tuple[IntArray, IntArray]:
    """Tetrahedra (n, 4) of elements by their corners, and the element of each."""
    found, origins = [np.empty((0, 4), np.int64)], [np.empty(0, np.int64)]
    least = corners.argmin(axis=1)
    for apex in range(solid.n_corners):
        rows = np.flatnonzero(least == apex)
        for face in solid.faces:
            if apex in face or not rows.size:
                continue
            nodes = corners[rows][:, list(face)]
            turn = (nodes.argmin(axis=1)[:, None] + np.arange(len(face))) % len(face)
            nodes = np.take_along_axis(nodes, turn, axis=1)
            for k in range(1, len(face) - 1):
                found.append(np.column_stack([nodes[:, [0, k + 1, k]], corners[rows, apex]]))
                origins.append(rows)
    return np.concatenate(found), np.concatenate(origins)


def _middles(solid: _Solid, points: FloatArray, cells: IntArray) -> list[tuple[IntArray, FloatArray]]:
    """Ends and middles of the edges, of the diagonals of faces and of the elements themselves."""
    n, edge_of = solid.n_corners, {frozenset(edge): k for k, edge in enumerate(solid.edges)}
    places = points[cells]
    found = [(cells[:, list(edge)], places[:, n + k]) for k, edge in enumerate(solid.edges)]
    for face in solid.faces:
        if len(face) != 4:
            continue
        ring = [n + edge_of[frozenset(pair)] for pair in zip(face, (*face[1:], face[0]), strict=True)]
        centre = 0.5 * places[:, ring].sum(axis=1) - 0.25 * places[:, list(face)].sum(axis=1)
        found += [(cells[:, [face[0], face[2]]], centre), (cells[:, [face[1], face[3]]], centre)]
    if n == 8:
        centre = 0.25 * (places[:, 8:20].sum(axis=1) - places[:, :8].sum(axis=1))
        found += [(cells[:, list(pair)], centre) for pair in ((0, 6), (1, 7), (2, 4), (3, 5))]
    return found
