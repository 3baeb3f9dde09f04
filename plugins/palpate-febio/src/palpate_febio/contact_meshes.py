"""Surfaces in contact as FEBio needs them: the faces of the limb, and a rigid sphere of flat facets."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray, Mesh, MeshError
from palpate.api.mesh import outer_faces


def contact_faces(mesh: Mesh) -> dict[str, IntArray]:
    """Outer faces whose nodes all belong to the node set ``contact``, by FEBio's name of their kind.

    Returns
    -------
    dict of str to (n_faces, n_nodes) array
        ``quad4``, ``tri3``, ``tri6``; in the order of the elements.

    Raises
    ------
    MeshError
        There is none.
    """
    found: dict[str, IntArray] = {}
    for kind in sorted(mesh.cells):
        faces = outer_faces(kind, mesh.cells[kind], febio=True)
        faces = faces[np.isin(faces, mesh.node_sets["contact"]).all(axis=1)]
        if len(faces):
            # Kinds of faces by their number of nodes.
            found[{3: "tri3", 4: "quad4", 6: "tri6"}[faces.shape[1]]] = faces
    if not found:
        raise MeshError(
            "mesh: no outer face has all its nodes in the node set 'contact', so FEBio would have nothing "
            "to touch; mark every node of the outer surface"
        )
    return found


@dataclass(frozen=True, slots=True, eq=False)
class IndenterMesh:
    """A ball of tetrahedra that share its centre.

    Parameters
    ----------
    points_mm : (n, 3) array
        The centre comes last.
    faces : (f, 3) array
        Triangles of the surface, counter-clockwise seen from outside.
    """

    points_mm: FloatArray
    faces: IntArray

    @property
    def tets(self) -> IntArray:
        """Tetrahedra (f, 4) from the centre to each face."""
        centre = np.full((len(self.faces), 1), len(self.points_mm) - 1)
        return np.hstack([self.faces[:, [0, 2, 1]], centre])


def sphere_mesh(radius_mm: float, edge_mm: float) -> IndenterMesh:
    """A geodesic sphere round the origin, a node at each pole.

    Facets inscribed in a sphere lie inside of it by edge²/(8 R) on average, and
    that much depth is missing from every press. Here the polyhedron has the
    sphere's volume instead, so that the mean of the radius is right and the
    error of the force is of higher order.

    Parameters
    ----------
    edge_mm : float
        Longest edge wanted; the mesh has at least 20 · 8² faces.

    Examples
    --------
    >>> ball = sphere_mesh(7.5, 0.6)
    >>> len(ball.faces), len(ball.points_mm)
    (5780, 2893)
    """
    n = max(8, int(np.ceil(1.35 * radius_mm / edge_mm)))
    points, faces = _geodesic(n)
    a, b, c = points[faces].transpose(1, 0, 2)
    volume = float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum()) / 6.0
    points = points * radius_mm * (4.0 * np.pi / 3.0 / volume) ** (1.0 / 3.0)
    return IndenterMesh(np.vstack([points, np.zeros((1, 3))]), faces)


def _geodesic(n: int) -> tuple[FloatArray, IntArray]:
    """Unit points and triangles of an icosahedron whose edges are cut into ``n``."""
    corners, sides = _icosahedron()
    i, j = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T
    weights = np.stack([n - i - j, i, j], axis=1) / n
    points = np.einsum("pk,skx->spx", weights, corners[sides]).reshape(-1, 3)
    points /= np.sqrt((points * points).sum(axis=1))[:, None]
    number = {pair: k for k, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    small = [(number[i, j], number[i + 1, j], number[i, j + 1]) for i in range(n) for j in range(n - i)] + [
        (number[i + 1, j], number[i + 1, j + 1], number[i, j + 1])
        for i in range(n - 1)
        for j in range(n - 1 - i)
    ]
    faces = (np.array(small)[None] + len(weights) * np.arange(len(sides))[:, None, None]).reshape(-1, 3)
    _, first, merged = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    return points[first], merged.reshape(-1)[faces]


def _icosahedron() -> tuple[FloatArray, IntArray]:
    """Corners (12, 3) with one at each pole, and sides (20, 3) counter-clockwise from outside."""
    turn = 2.0 * np.pi * np.arange(5) / 5.0
    z, r = 1.0 / np.sqrt(5.0), 2.0 / np.sqrt(5.0)
    upper = np.stack([r * np.cos(turn), r * np.sin(turn), np.full(5, z)], axis=1)
    half = turn + np.pi / 5.0
    lower = np.stack([r * np.cos(half), r * np.sin(half), np.full(5, -z)], axis=1)
    corners = np.vstack([[[0.0, 0.0, 1.0]], upper, lower, [[0.0, 0.0, -1.0]]])
    sides = []
    for k in range(5):
        u, v = 1 + k, 1 + (k + 1) % 5
        p, q = 6 + k, 6 + (k + 1) % 5
        sides += [(0, u, v), (u, p, v), (v, p, q), (p, 11, q)]
    return corners, np.array(sides)
