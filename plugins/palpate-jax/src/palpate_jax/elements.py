"""Quadrature of the element kinds and of their faces, and the shape functions there."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray
from palpate.api.mesh import CELLS, HEX_CORNERS, barycentric, linear_simplex, multilinear, quadratic_simplex

Rule = tuple[FloatArray, FloatArray]
"""Points (q, d) and weights (q,) of a quadrature."""


def _gauss_box(n: int, dimension: int) -> Rule:
    """Tensor-product Gauss points and weights on [−1, 1]^d."""
    x, w = np.polynomial.legendre.leggauss(n)
    points = np.stack(np.meshgrid(*[x] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    weights = np.stack(np.meshgrid(*[w] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    return points, weights.prod(axis=1)


def _tet_points() -> Rule:
    """Four points, exact to degree 2 (Keast 1986)."""
    a, b = (5.0 - np.sqrt(5.0)) / 20.0, (5.0 + 3.0 * np.sqrt(5.0)) / 20.0
    points = np.full((4, 3), a)
    points[1:][np.eye(3, dtype=bool)] = b
    return points, np.full(4, 1.0 / 24.0)


def _tet_points_plain() -> Rule:
    """Eight points, exact to degree 3 (Jinyun 1984), as FEBio integrates a plain tet10."""
    points, weights = [], []
    for a, weight in ((0.328054696711427, 0.138527966511862), (0.106952273932930, 0.111472033488138)):
        points += [[a, a, a]] + [[1.0 - 3.0 * a if i == k else a for i in range(3)] for k in range(3)]
        weights += [weight / 6.0] * 4
    return np.array(points), np.array(weights)


def _triangle_points() -> Rule:
    """Three points, exact to degree 2 (Strang & Fix 1973)."""
    points = np.full((3, 2), 1.0 / 6.0)
    points[1:][np.eye(2, dtype=bool)] = 2.0 / 3.0
    return points, np.full(3, 1.0 / 6.0)


def _quarter_points() -> Rule:
    """Three points in each quarter of the triangle: 12, exact to degree 2."""
    points, weights = _triangle_points()
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    quarters = [*(0.5 * (corner + points) for corner in corners), 0.5 * (1.0 - points)]
    return np.concatenate(quarters), np.tile(weights / 4.0, 4)


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A face kind: shape values (q, n), slopes (q, n, 2) and weights (q,) of its quadrature points.

    Contact is evaluated at these points, and its edge is where they touch or do not. Straight faces have
    few, since each is a constraint: with 3 × 3 on a four-node face a stiff contact locks, and overstates
    force by 3 %. Six-node faces do not lock with 12, which follow the edge of the contact more closely.
    """

    values: FloatArray
    slopes: FloatArray
    quadrature_weights: FloatArray

    def areas(self, nodes_mm: FloatArray) -> FloatArray:
        """Area (f, q) [mm²] of each quadrature point of faces with nodes (f, n, 3)."""
        slopes = np.einsum("qak,fai->fqki", self.slopes, nodes_mm)
        areas: FloatArray = np.linalg.norm(np.cross(slopes[:, :, 0], slopes[:, :, 1]), axis=2)
        return areas * self.quadrature_weights


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """An element kind: slopes (q, n, 3) and weights (q,) at its quadrature points, and its faces."""

    slopes: FloatArray
    quadrature_weights: FloatArray
    face: Face


Shape = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Shape functions and their slopes at points."""


def _element(shape: Shape, rule: Rule, face_shape: Shape, face_rule: Rule) -> Element:
    values, slopes = face_shape(face_rule[0])
    return Element(shape(rule[0])[1], rule[1], Face(values, slopes, face_rule[1]))


def _tet10(rule: Rule) -> Element:
    return _element(
        lambda p: quadratic_simplex(barycentric(p), CELLS["tet10"].edges),
        rule,
        lambda p: quadratic_simplex(barycentric(p), ((0, 1), (1, 2), (2, 0))),
        _quarter_points(),
    )


def _linear(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    return linear_simplex(barycentric(points))


ELEMENTS: Mapping[str, Element] = MappingProxyType(
    {
        # One point, exact to degree 1.
        "tet4": _element(
            _linear, (np.full((1, 3), 0.25), np.full(1, 1.0 / 6.0)), _linear, _triangle_points()
        ),
        "tet10": _tet10(_tet_points()),
        "hex8": _element(
            lambda p: multilinear(p, HEX_CORNERS),
            _gauss_box(2, 3),
            lambda p: multilinear(p, HEX_CORNERS[:4, :2]),
            _gauss_box(2, 2),
        ),
    }
)
"""Element kinds of a mesh, by the names of :data:`palpate.api.mesh.CELLS`."""

PLAIN_ELEMENTS: Mapping[str, Element] = MappingProxyType({**ELEMENTS, "tet10": _tet10(_tet_points_plain())})
"""The same without mean dilatation, where tet10 needs more points."""


MOST = 12
"""Tetrahedra of a patch after the small ones are joined to it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Dual:
    """Patches that share faces: pairs (p, 2), their common area, and each patch's surface."""

    pairs: IntArray
    common: FloatArray
    surface: FloatArray

    def joined(self, labels: IntArray) -> "_Dual":
        """The patches after a relabelling to 0, 1, ... by patch."""
        ends = np.sort(labels[self.pairs], axis=1)
        inside = ends[:, 0] == ends[:, 1]
        whole = np.bincount(labels, self.surface)
        hidden = np.bincount(ends[inside, 0], self.common[inside], minlength=len(whole))
        surface = np.asarray(whole - 2.0 * hidden, dtype=np.float64)
        pairs, place = np.unique(ends[~inside], axis=0, return_inverse=True)
        common = np.bincount(place.ravel(), self.common[~inside], minlength=len(pairs))
        return _Dual(pairs, np.asarray(common, dtype=np.float64), surface)


def tetrahedron_patches(points_mm: FloatArray, tets: IntArray) -> IntArray:
    """Group tetrahedra into patches that are connected by faces.

    Parameters
    ----------
    points_mm : (n_nodes, 3) array
    tets : (n_tets, 4) array
        Of one region.

    Returns
    -------
    (n_tets,) array
        Patch of each tetrahedron, 0 to n_patches − 1. A patch has 5 to 12
        tetrahedra, unless all its neighbours are full or it has none.
    """
    dual, labels = _dual(points_mm, tets), np.arange(len(tets))
    # Each pairing doubles the patches, to 8 tetrahedra after three.
    for _ in range(3):
        merged = _paired(dual, np.ones(len(dual.pairs), dtype=bool))
        dual, labels = dual.joined(merged), merged[labels]
    while True:
        sizes = np.bincount(labels)[dual.pairs]
        # Patches of fewer tetrahedra are joined to a neighbour: a small patch locks.
        merged = _paired(dual, (sizes.min(axis=1) < 5) & (sizes.sum(axis=1) <= MOST))
        if merged.max(initial=-1) + 1 == len(dual.surface):
            return labels
        dual, labels = dual.joined(merged), merged[labels]


def _dual(points_mm: FloatArray, tets: IntArray) -> _Dual:
    faces = np.sort(tets[:, np.array(CELLS["tet4"].corner_faces)], axis=2).reshape(-1, 3)
    a, b, c = (points_mm[faces[:, k]] for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    order = np.lexsort(faces.T)
    twins = (faces[order[1:]] == faces[order[:-1]]).all(axis=1)
    first, second = order[:-1][twins], order[1:][twins]
    pairs = np.sort(np.stack([first, second], axis=1) // 4, axis=1)
    return _Dual(pairs, areas[first], areas.reshape(-1, 4).sum(axis=1))


def _paired(dual: _Dual, allowed: BoolArray) -> IntArray:
    """Labels after joining pairs, the closest first, each patch at most once."""
    pairs = dual.pairs[allowed]
    # Share of a pair's surface that becomes internal, rounded: the last bit of an area decides no tie.
    closeness = np.round(dual.common[allowed] / dual.surface[pairs].sum(axis=1), 9)
    order = np.lexsort((pairs[:, 1], pairs[:, 0], -closeness))
    rank = np.empty(len(pairs), dtype=np.int64)
    rank[order] = np.arange(len(pairs))
    partner = np.arange(len(dual.surface))
    while len(pairs):
        best = np.full(len(partner), len(order))
        np.minimum.at(best, pairs, rank[:, None])
        mutual = (best[pairs] == rank[:, None]).all(axis=1)
        one, other = pairs[mutual].T
        partner[other] = one
        taken = np.zeros(len(partner), dtype=bool)
        taken[pairs[mutual]] = True
        open_still = ~taken[pairs].any(axis=1)
        pairs, rank = pairs[open_still], rank[open_still]
    return np.unique(partner, return_inverse=True)[1]
