"""Element kinds: shape functions, quadrature and faces on the reference element.

Node orders are VTK's: corners first, then for tet10 the edges 01 12 02 03 13 23.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from palpate.domain import FloatArray

_TET_EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
_TRI_EDGES = ((0, 1), (1, 2), (2, 0))


def _barycentric(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Barycentric coordinates (q, d + 1) of simplex points and their constant gradient (d + 1, d)."""
    dimension = points.shape[1]
    values = np.column_stack([1.0 - points.sum(axis=1), points])
    return values, np.vstack([-np.ones(dimension), np.eye(dimension)])


def _linear_simplex(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    values, slopes = _barycentric(points)
    return values, np.broadcast_to(slopes, (len(points), *slopes.shape))


def _quadratic_simplex(
    points: FloatArray, edges: tuple[tuple[int, int], ...]
) -> tuple[FloatArray, FloatArray]:
    """N = l(2l − 1) at corners and 4 l_a l_b on edges."""
    bary, slopes = _barycentric(points)
    corner = bary * (2.0 * bary - 1.0)
    corner_slope = (4.0 * bary - 1.0)[:, :, None] * slopes
    edge = np.stack([4.0 * bary[:, a] * bary[:, b] for a, b in edges], axis=1)
    edge_slope = np.stack(
        [4.0 * (bary[:, a, None] * slopes[b] + bary[:, b, None] * slopes[a]) for a, b in edges], axis=1
    )
    return np.hstack([corner, edge]), np.concatenate([corner_slope, edge_slope], axis=1)


def _multilinear(points: FloatArray, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """N = Π (1 + ξ_c ξ) / 2 on [−1, 1]^d."""
    factors = 0.5 * (1.0 + corners[None] * points[:, None])  # (q, n, d)
    values = factors.prod(axis=2)
    dimension = points.shape[1]
    slopes = np.stack(
        [0.5 * corners[:, k] * np.delete(factors, k, axis=2).prod(axis=2) for k in range(dimension)], axis=2
    )
    return values, slopes


_HEX_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    dtype=np.float64,
)
_QUAD_CORNERS = _HEX_CORNERS[:4, :2]


def _gauss_box(n: int, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Tensor-product Gauss points and weights on [−1, 1]^d."""
    x, w = np.polynomial.legendre.leggauss(n)
    points = np.stack(np.meshgrid(*[x] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    weights = np.stack(np.meshgrid(*[w] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    return points, weights.prod(axis=1)


def _tet_points() -> tuple[FloatArray, FloatArray]:
    """Four points, exact to degree 2 (Keast 1986)."""
    a, b = (5.0 - np.sqrt(5.0)) / 20.0, (5.0 + 3.0 * np.sqrt(5.0)) / 20.0
    points = np.full((4, 3), a)
    points[1:][np.eye(3, dtype=bool)] = b
    return points, np.full(4, 1.0 / 24.0)


def _tet_points_plain() -> tuple[FloatArray, FloatArray]:
    """Eight points, exact to degree 3 (Jinyun 1984), as FEBio integrates a plain tet10."""
    points, weights = [], []
    for a, weight in ((0.328054696711427, 0.138527966511862), (0.106952273932930, 0.111472033488138)):
        points += [[a, a, a]] + [[1.0 - 3.0 * a if i == k else a for i in range(3)] for k in range(3)]
        weights += [weight / 6.0] * 4
    return np.array(points), np.array(weights)


def _triangle_points() -> tuple[FloatArray, FloatArray]:
    """Three points, exact to degree 2 (Strang & Fix 1973)."""
    points = np.full((3, 2), 1.0 / 6.0)
    points[1:][np.eye(2, dtype=bool)] = 2.0 / 3.0
    return points, np.full(3, 1.0 / 6.0)


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A face kind: shape values (q, n), slopes (q, n, 2) and weights (q,) at its quadrature points.

    Contact lives at these points. Few of them, because each is a constraint: with 3 × 3 on a
    four-node face a stiff contact leaves too little freedom, and overstates force by 3 %.
    """

    values: FloatArray
    slopes: FloatArray
    weights: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """An element kind.

    ``slopes`` (q, n, 3) and ``weights`` (q,) are at the quadrature points of the
    reference element; ``faces`` lists the nodes of each face, corners first, and
    ``n_face_corners`` says how many of them are corners.
    """

    slopes: FloatArray
    weights: FloatArray
    faces: tuple[tuple[int, ...], ...]
    n_face_corners: int
    face: Face


def _face(
    shape: Callable[[FloatArray], tuple[FloatArray, FloatArray]], rule: tuple[FloatArray, FloatArray]
) -> Face:
    values, slopes = shape(rule[0])
    return Face(values, slopes, rule[1])


def _tet10(rule: tuple[FloatArray, FloatArray]) -> Element:
    points, weights = rule
    return Element(
        slopes=_quadratic_simplex(points, _TET_EDGES)[1],
        weights=weights,
        faces=((0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 3, 2, 7, 9, 6)),
        n_face_corners=3,
        face=_face(lambda p: _quadratic_simplex(p, _TRI_EDGES), _triangle_points()),
    )


def _tet4() -> Element:
    points, weights = np.full((1, 3), 0.25), np.full(1, 1.0 / 6.0)
    return Element(
        slopes=_linear_simplex(points)[1],
        weights=weights,
        faces=((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
        n_face_corners=3,
        face=_face(_linear_simplex, _triangle_points()),
    )


def _hex8() -> Element:
    points, weights = _gauss_box(2, 3)
    return Element(
        slopes=_multilinear(points, _HEX_CORNERS)[1],
        weights=weights,
        faces=((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
        n_face_corners=4,
        face=_face(lambda p: _multilinear(p, _QUAD_CORNERS), _gauss_box(2, 2)),
    )


ELEMENTS: Mapping[str, Element] = MappingProxyType(
    {"tet4": _tet4(), "tet10": _tet10(_tet_points()), "hex8": _hex8()}
)
"""Element kinds of a mesh, by the names of :data:`palpate.domain.CELL_NODES`."""

PLAIN_ELEMENTS: Mapping[str, Element] = MappingProxyType({**ELEMENTS, "tet10": _tet10(_tet_points_plain())})
"""The same without mean dilatation, where tet10 needs more points."""
