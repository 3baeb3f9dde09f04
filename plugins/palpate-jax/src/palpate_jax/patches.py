"""Patches of linear tetrahedra that share one volume change.

A single tetrahedron of constant strain locks if it is nearly incompressible.
Averaged over about eight neighbours the constraint is
as weak as that of a hexahedron (F-bar patch, de Souza Neto, Andrade Pires &
Owen 2005). Patches grow by pairing neighbours three times, first those that
share most of their surface, so that they become compact.
"""

from dataclasses import dataclass

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray
from palpate.api.mesh import CELLS

ROUNDS = 3
"""Pairings; each doubles the patches, to 8 tetrahedra after three."""

FEW = 5
"""Patches of fewer tetrahedra are joined to a neighbour: a small patch locks."""

MOST = 12
"""Tetrahedra of a patch after the small ones are joined to it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Dual:
    """Patches that share faces: pairs (p, 2), their common area, and each patch's surface."""

    pairs: IntArray
    common: FloatArray
    surface: FloatArray

    def closeness(self) -> FloatArray:
        """Share of a pair's surface that becomes internal when it is joined, (p,)."""
        joint: FloatArray = self.common / self.surface[self.pairs].sum(axis=1)
        return joint

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
    for _ in range(ROUNDS):
        merged = _paired(dual, np.ones(len(dual.pairs), dtype=bool))
        dual, labels = dual.joined(merged), merged[labels]
    while True:
        sizes = np.bincount(labels)[dual.pairs]
        merged = _paired(dual, (sizes.min(axis=1) < FEW) & (sizes.sum(axis=1) <= MOST))
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
    # Rounded, so that ties are decided by number and not by the last bit of an area.
    order = np.lexsort((pairs[:, 1], pairs[:, 0], -np.round(dual.closeness()[allowed], 9)))
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
