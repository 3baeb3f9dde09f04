"""Quadrature of the element kinds and of their faces, and the shape functions there."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from palpate.api import FloatArray
from palpate.api.mesh import CELLS, HEX_CORNERS, barycentric, linear_simplex, multilinear, quadratic_simplex

_TRI_EDGES = ((0, 1), (1, 2), (2, 0))


_QUAD_CORNERS = HEX_CORNERS[:4, :2]


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
    """A face kind: shape values (q, n), slopes (q, n, 2) and weights (q,) of its quadrature points.

    Contact is evaluated at these points. Each is a constraint, so there are few: with 3 × 3 on a
    four-node face a stiff contact locks, and overstates force by 3 %.
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


def _face(
    shape: Callable[[FloatArray], tuple[FloatArray, FloatArray]], rule: tuple[FloatArray, FloatArray]
) -> Face:
    values, slopes = shape(rule[0])
    return Face(values, slopes, rule[1])


def _tet10(rule: tuple[FloatArray, FloatArray]) -> Element:
    points, weights = rule
    return Element(
        slopes=quadratic_simplex(barycentric(points), CELLS["tet10"].edges)[1],
        quadrature_weights=weights,
        face=_face(lambda p: quadratic_simplex(barycentric(p), _TRI_EDGES), _triangle_points()),
    )


def _tet4() -> Element:
    points, weights = np.full((1, 3), 0.25), np.full(1, 1.0 / 6.0)
    return Element(
        slopes=linear_simplex(barycentric(points))[1],
        quadrature_weights=weights,
        face=_face(lambda p: linear_simplex(barycentric(p)), _triangle_points()),
    )


def _hex8() -> Element:
    points, weights = _gauss_box(2, 3)
    return Element(
        slopes=multilinear(points, HEX_CORNERS)[1],
        quadrature_weights=weights,
        face=_face(lambda p: multilinear(p, _QUAD_CORNERS), _gauss_box(2, 2)),
    )


ELEMENTS: Mapping[str, Element] = MappingProxyType(
    {"tet4": _tet4(), "tet10": _tet10(_tet_points()), "hex8": _hex8()}
)
"""Element kinds of a mesh, by the names of :data:`palpate.api.mesh.CELLS`."""

PLAIN_ELEMENTS: Mapping[str, Element] = MappingProxyType({**ELEMENTS, "tet10": _tet10(_tet_points_plain())})
"""The same without mean dilatation, where tet10 needs more points."""
