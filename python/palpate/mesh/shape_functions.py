"""Shape functions of simplices, and of squares and cubes, on their reference elements.

Nodes are numbered as in :mod:`palpate.mesh.topology`.
"""

from collections.abc import Sequence

import numpy as np

from palpate.domain import FloatArray

HEX_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]],
    dtype=np.float64,
)
HEX_CORNERS.setflags(write=False)
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
