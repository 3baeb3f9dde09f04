"""Triangles of a surface that is given by its signed distance: marching tetrahedra."""

from collections.abc import Callable

import numpy as np

from palpate.domain.curves import FloatArray, IntArray


def level_set_surface(
    distance: Callable[[FloatArray], FloatArray], bounds_mm: FloatArray, n_across: int
) -> tuple[FloatArray, IntArray]:
    """Triangulate where a distance is zero, counter-clockwise seen from where it is positive.

    Parameters
    ----------
    distance : callable
        Of points (n, 3), as (n,) values.
    bounds_mm : (2, 3) array
        Lowest and highest corner of the box that is searched.
    n_across : int
        Cells along the longest side.

    Returns
    -------
    points : (n, 3) array
    triangles : (f, 3) array
        Closed unless the surface leaves the box.
    """
    lower, upper = bounds_mm
    size = float((upper - lower).max()) / n_across
    # Half a cell off the bounds, so that no node is on a surface that touches them.
    counts = np.ceil((upper - lower) / size).astype(np.int64) + 2
    axes = [lower[k] + size * (np.arange(counts[k]) - 0.503) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = np.array(distance(nodes), dtype=np.float64)
    values[values == 0.0] = np.finfo(float).tiny
    tets = _tets(counts)
    tets = tets[(values[tets] < 0.0).any(axis=1) & (values[tets] > 0.0).any(axis=1)]
    # Inner corners first; an odd permutation turns the tetrahedron inside out.
    order = np.argsort(values[tets] > 0.0, axis=1, kind="stable")
    tets = np.take_along_axis(tets, order, axis=1)
    flipped = np.linalg.det(np.eye(4)[order]) < 0.0
    n_inside = (values[tets] < 0.0).sum(axis=1)
    ends = np.concatenate([_cut(tets[n_inside == n], flipped[n_inside == n], n) for n in (1, 2, 3)])
    pairs, triangles = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    a, b = values[pairs].T
    share = (a / (a - b))[:, None]
    points: FloatArray = (1.0 - share) * nodes[pairs[:, 0]] + share * nodes[pairs[:, 1]]
    return points, triangles.reshape(-1, 3)


def _tets(counts: IntArray) -> IntArray:
    """Tetrahedra (n, 4) of all cells of a grid with these numbers of nodes."""
    i, j, k = np.meshgrid(*[np.arange(n - 1) for n in counts], indexing="ij")
    first = ((i * counts[1] + j) * counts[2] + k).ravel()
    corner = np.array([(x * counts[1] + y) * counts[2] + z for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    cells = first[:, None] + corner
    # Six tetrahedra of a cube around its diagonal, of positive volume; corner 4 i + 2 j + k is at (i, j, k).
    around = [[0, 3, 1, 7], [0, 2, 3, 7], [0, 6, 2, 7], [0, 4, 6, 7], [0, 5, 4, 7], [0, 1, 5, 7]]
    return cells[:, around].reshape(-1, 4)


def _cut(tets: IntArray, flipped: IntArray, n_inside: int) -> IntArray:
    """Corners (m, 3, 2) of the triangles that cut tetrahedra, each between two nodes.

    The first ``n_inside`` nodes of a tetrahedron are inside.
    """
    a, b, c, d = tets.T
    triangles = {
        1: [((a, b), (a, c), (a, d))],
        2: [((a, c), (a, d), (b, d)), ((a, c), (b, d), (b, c))],
        3: [((a, d), (b, d), (c, d))],
    }[n_inside]
    found = np.concatenate(
        [np.stack([np.stack(pair, axis=1) for pair in triangle], axis=1) for triangle in triangles]
    )
    turned = np.tile(flipped, len(triangles))
    found[turned] = found[turned][:, ::-1]
    return found
