"""Numbering of the nodes of an element: the only table of it.

The numbering is the same as in VTK, meshio and FEBio: corners first, then the nodes in the middle of
the edges. A mesh in any of these formats needs no permutation.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from palpate.domain import FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class Cell:
    """One kind of element.

    Parameters
    ----------
    meshio : str
        Its name in meshio.
    corner_faces : tuple of tuple of int
        Corners of each face, counter-clockwise seen from outside.
    edges : tuple of (int, int)
        Ends of each edge.
    has_midside_nodes : bool
        Whether node ``n_corners + k`` is in the middle of edge k.
    """

    meshio: str
    n_corners: int
    corner_faces: tuple[tuple[int, ...], ...]
    edges: tuple[tuple[int, int], ...]
    has_midside_nodes: bool = False

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return self.n_corners + self.has_midside_nodes * len(self.edges)

    @property
    def n_face_corners(self) -> int:
        """Number of corners of a face."""
        return len(self.corner_faces[0])

    @cached_property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Nodes of each face: its corners, then the middles of its edges from the first corner on."""
        if not self.has_midside_nodes:
            return self.corner_faces
        middle = {frozenset(edge): self.n_corners + k for k, edge in enumerate(self.edges)}
        return tuple(
            (*face, *(middle[frozenset((a, b))] for a, b in zip(face, (*face[1:], face[0]), strict=True)))
            for face in self.corner_faces
        )


_TET_FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
_TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))

CELLS: Mapping[str, Cell] = MappingProxyType(
    {
        "tet4": Cell("tetra", 4, _TET_FACES, _TET_EDGES),
        "tet10": Cell("tetra10", 4, _TET_FACES, _TET_EDGES, has_midside_nodes=True),
        "hex8": Cell(
            "hexahedron",
            8,
            ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
            ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
        ),
    }
)
"""The kinds of elements that palpate simulates, by the names that FEBio uses too."""


def outer_faces(kind: str, cells: IntArray, *, febio: bool = False) -> IntArray:
    """Faces (n, n_face_nodes) of exactly one element, in the order of their sorted corners.

    Parameters
    ----------
    cells : (n_cells, n_nodes) integer array
    febio : bool
        As FEBio lists them instead: in the order of the elements, the last face of a tetrahedron
        from its third corner on.
    """
    cell = CELLS[kind]
    n, faces = cell.n_face_corners, cells[:, np.array(cell.faces)]
    if febio and n == 3:
        faces[:, 3] = np.roll(faces[:, 3].reshape(len(cells), -1, n), 1, axis=2).reshape(len(cells), -1)
    faces = faces.reshape(-1, len(cell.faces[0]))
    corners = np.sort(faces[:, :n], axis=1)
    _, first, counts = np.unique(corners, axis=0, return_index=True, return_counts=True)
    outer = first[counts == 1]
    return np.asarray(faces[np.sort(outer) if febio else outer])


def surface_faces(mesh: Mesh) -> Iterator[tuple[IntArray, int]]:
    """Outer faces of each kind of element, and how many of their nodes are corners."""
    for kind, cells in mesh.cells.items():
        if len(faces := outer_faces(kind, cells)):
            yield faces, CELLS[kind].n_face_corners


def triangles_of(faces: IntArray) -> IntArray:
    """Triangles (m, 3) that cover faces (n, 3), (n, 4) or (n, 6), over all of their nodes."""
    corners = {3: ((0, 1, 2),), 4: ((0, 1, 2), (0, 2, 3)), 6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))}[
        faces.shape[1]
    ]
    return np.concatenate([faces[:, list(three)] for three in corners])


def with_midpoints(points: FloatArray, tets: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Points (n + m, 3), quadratic tetrahedra (k, 10) and the ends (m, 2) of the edges that gained a node."""
    edges = np.sort(tets[:, np.array(CELLS["tet10"].edges)], axis=2)
    ends, inverse = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    middle = points[ends].mean(axis=1)
    return np.vstack([points, middle]), np.hstack([tets, len(points) + inverse.reshape(-1, 6)]), ends


HEX_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    dtype=np.float64,
)
HEX_CORNERS.setflags(write=False)

CUBE: IntArray = ((HEX_CORNERS + 1.0) / 2.0).astype(np.int64)
"""The same corners of a cube from 0 to 1."""

SIX_TETS = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])
"""Tetrahedra of a hexahedron around its diagonal 0–6; neighbouring cells match."""
"""Corners of the reference cube [−1, 1]³."""


def barycentric(points: FloatArray) -> FloatArray:
    """Barycentric coordinates (q, d + 1) of points (q, d) of the reference simplex."""
    return np.column_stack([1.0 - points.sum(axis=1), points])


def linear_simplex(bary: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (q, d + 1) and slopes (q, d + 1, d) at barycentric coordinates (q, d + 1)."""
    d = bary.shape[1] - 1
    slopes = np.vstack([-np.ones(d), np.eye(d)])
    return bary, np.broadcast_to(slopes, (len(bary), *slopes.shape))


def quadratic_simplex(bary: FloatArray, edges: Sequence[tuple[int, int]]) -> tuple[FloatArray, FloatArray]:
    """Values (q, n) and slopes (q, n, d): N = l(2l − 1) at corners and 4 l_a l_b in the middle of edges."""
    slopes = linear_simplex(bary)[1]
    corner = bary * (2.0 * bary - 1.0)
    corner_slope = (4.0 * bary - 1.0)[:, :, None] * slopes
    edge = np.stack([4.0 * bary[:, a] * bary[:, b] for a, b in edges], axis=1)
    edge_slope = np.stack(
        [4.0 * (bary[:, a, None] * slopes[:, b] + bary[:, b, None] * slopes[:, a]) for a, b in edges], axis=1
    )
    return np.hstack([corner, edge]), np.concatenate([corner_slope, edge_slope], axis=1)


def multilinear(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (q, n) and slopes (q, n, d) at points (q, d): N = Π (1 + ξ_c ξ) / 2 on [−1, 1]^d."""
    factors = 0.5 * (1.0 + corners[None] * points[:, None])  # (q, n, d)
    dimension = points.shape[1]
    slopes = np.stack(
        [0.5 * corners[:, k] * np.delete(factors, k, axis=2).prod(axis=2) for k in range(dimension)], axis=2
    )
    return factors.prod(axis=2), slopes


SLOPES: Mapping[str, FloatArray] = MappingProxyType(
    {
        "tet4": linear_simplex(np.eye(4)[:1])[1],
        "tet10": quadratic_simplex(
            np.vstack([np.eye(4), 0.1381966011250105 + 0.4472135954999579 * np.eye(4)]), CELLS["tet10"].edges
        )[1],
        "hex8": multilinear(np.vstack([HEX_CORNERS, HEX_CORNERS / np.sqrt(3.0)]), HEX_CORNERS)[1],
    }
)
"""Slopes of the shape functions of each kind at its corners, then at its quadrature points."""
