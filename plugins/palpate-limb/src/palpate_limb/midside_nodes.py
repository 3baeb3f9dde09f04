"""Puts the boundary nodes of a mesh onto the true surfaces, and bends edges with them.

A mesher keeps to the surfaces within a tolerance, and the chord of an edge of length l
leaves a surface of radius ρ by l²/8ρ. Both errors go where nodes, those on
edges included, are moved onto the surface; where that would fold an element, its
edges stay straight.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray
from palpate.api.mesh import CELLS
from palpate_limb.quality import scaled_jacobians
from palpate_limb.segment import Segment
from palpate_limb.surfaces import Surface

LEAST_SCALED_JACOBIAN = 0.05


def curved(
    points: FloatArray,
    cells: IntArray,
    on: Mapping[str, IntArray],
    segment: Segment,
    inner: Mapping[str, tuple[IntArray, Surface]],
    between: Sequence[tuple[IntArray, Surface, Surface]] = (),
) -> FloatArray:
    """Points (n, 3) with those on a surface moved onto it.

    ``cells`` are (m, 4) or (m, 10). ``on`` has the nodes on ``skin``, ``cut`` and bones, ``inner`` nodes
    and lower surface of each layer, and ``between`` nodes of edges from one surface to another, which belong
    half-way.
    """
    corner = np.zeros(len(points), dtype=np.bool_)
    corner[cells[:, :4]] = True
    moved = _accepted(points, _targets(points, on, segment, inner, (), corner), cells[:, :4])
    if cells.shape[1] == 4:
        return moved
    moved = moved.copy()
    moved[cells[:, 4:]] = moved[cells[:, np.array(CELLS["tet10"].edges)]].mean(axis=2)
    return _accepted(moved, _targets(moved, on, segment, inner, between, ~corner), cells)


def _targets(
    points: FloatArray,
    on: Mapping[str, IntArray],
    segment: Segment,
    inner: Mapping[str, tuple[IntArray, Surface]],
    between: Sequence[tuple[IntArray, Surface, Surface]],
    allowed: BoolArray,
) -> FloatArray:
    """Where the nodes that may move would lie on their surfaces."""
    target = points.copy()
    surfaces = {"skin": segment.skin, **{bone.name: bone for bone in segment.bones}}
    places = [(on[name], surface) for name, surface in surfaces.items() if name in on]
    places += list(inner.values())
    cut = np.zeros(len(points), dtype=np.bool_)
    cut[on["cut"]] = True
    half = 0.5 * segment.length_mm
    for _ in range(2):  # twice, for the nodes where a surface meets a cut
        for nodes, surface in places:
            chosen = nodes[allowed[nodes]]
            target[chosen], _ = surface.nearest(target[chosen])
        for nodes, upper, lower in between:
            chosen = nodes[allowed[nodes]]
            target[chosen] = 0.5 * (upper.nearest(target[chosen])[0] + lower.nearest(target[chosen])[0])
        chosen = np.flatnonzero(cut & allowed)
        along = target[chosen] @ segment.axis
        target[chosen] += (np.sign(along) * half - along)[:, None] * segment.axis
    return target


def _accepted(points: FloatArray, target: FloatArray, cells: IntArray) -> FloatArray:
    """The points moved to their targets, but half as far or not at all in elements that would suffer."""
    share = np.ones(len(points))
    least = np.minimum(scaled_jacobians(points, cells), LEAST_SCALED_JACOBIAN)
    for factor in (0.5, 0.0, 0.0):
        moved = points + share[:, None] * (target - points)
        bad = scaled_jacobians(moved, cells) < least
        if not bad.any():
            return moved
        share[np.unique(cells[bad])] *= factor
    moved = points + share[:, None] * (target - points)
    for _ in range(20):
        bad = scaled_jacobians(moved, cells) < least - 1e-12
        if not bad.any():
            break
        nodes = np.unique(cells[bad])
        moved[nodes] = points[nodes]
    return moved
