"""Layers as prisms between the mesh of the core and the skin, each split into three tetrahedra.

A layer far thinner than the elements away from the indenter then has flat elements there, in
place of many small ones: one element through its thickness everywhere.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_limb.surfaces import Surface


def extruded(
    points: FloatArray,
    tets: IntArray,
    boundary: Mapping[str, IntArray],
    skin: Surface,
    depths_mm: Sequence[float],
) -> tuple[FloatArray, IntArray, IntArray, dict[str, IntArray]]:
    """Layers added to the mesh of the core.

    Parameters
    ----------
    points : (n, 3) array
    tets : (m, 4) integer array
        Of the core.
    boundary : mapping of surface to triangles (k, 3)
        ``skin`` of the core, outwards, to which the layers are added, ``cut`` and bones.
    skin : Surface
        Of the limb.
    depths_mm : sequence of float
        Of the lower surface of each layer, from the outside in.

    Returns
    -------
    points (n', 3), tetrahedra (m', 4), their layers (m',) and the boundary
    """
    faces, n_layers = boundary["skin"], len(depths_mm)
    nodes, local = np.unique(faces, return_inverse=True)
    bottom = points[nodes]
    top, _ = skin.nearest(bottom)
    shares = np.array([0.0, *depths_mm[:-1]]) / depths_mm[-1]
    levels = [top + share * (bottom - top) for share in shares]
    # Row i has the nodes of level i, from the skin down to the core's own.
    ids = np.vstack([len(points) + np.arange(n_layers * len(nodes)).reshape(n_layers, -1), nodes])
    triangles = np.sort(local.reshape(-1, 3), axis=1)  # one diagonal for the two prisms of a side
    prisms = [_split(ids[i + 1][triangles], ids[i][triangles]) for i in range(n_layers)]
    sides = _sides(boundary["cut"], faces, ids)
    found = {
        **boundary,
        "skin": ids[0][local.reshape(-1, 3)],
        "cut": np.concatenate([boundary["cut"], *sides]),
    }
    regions = [np.full(len(prism), i) for i, prism in enumerate(prisms)]
    return (
        np.concatenate([points, *levels]),
        np.concatenate([tets, *prisms]),
        np.concatenate([np.full(len(tets), n_layers), *regions]),
        found,
    )


def _split(lower: IntArray, upper: IntArray) -> IntArray:
    """Three tetrahedra for each prism between triangles (n, 3), corners in ascending order."""
    (a, b, c), (d, e, f) = lower.T, upper.T
    return np.concatenate([np.stack(tet, axis=1) for tet in ((a, b, c, f), (a, b, e, f), (a, d, e, f))])


def _sides(cut: IntArray, faces: IntArray, ids: IntArray) -> list[IntArray]:
    """Triangles (n, 3) of each layer on the cuts: the sides of prisms over edges of the cut's rim."""
    edges = [np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) for f in (cut, faces)]
    n = int(max(e.max() for e in edges)) + 1
    keys = np.intersect1d(*(e @ np.array([n, 1]) for e in edges))
    rim = np.searchsorted(ids[-1], np.stack([keys // n, keys % n], axis=1))
    found = []
    for upper, lower in pairwise(ids):
        (a, b), (d, e) = lower[rim].T, upper[rim].T
        found.append(np.concatenate([np.stack(face, axis=1) for face in ((a, b, e), (a, d, e))]))
    return found
