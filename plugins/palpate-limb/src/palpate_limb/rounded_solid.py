"""The signed distance to a solid whose edges are rounded, as a smooth function.

The solid's faces are moved inwards by the radius of the rounding; what is left is its core. The distance to
the rounded solid is the distance to the core less that radius: flat faces return to their place, and edges
are round. The square of the distance to the core's surface, which is quadratic on both sides of a face and
next to each edge and corner, is sampled on a grid and interpolated by cubic splines.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError
from palpate_limb.repair import defects
from palpate_limb.surfaces import Surface

CELLS_PER_EDGE = 3.0
"""Cells of the grid along the radius of the rounding."""

MARGIN_MM = 1.5
"""Of the grid around the solid; beyond it a distance is up to MARGIN_MM too small."""

NEAR_MM = 0.8
"""Distance from the surface beyond which the nodes are interpolated linearly."""

RIM_CELLS = 6
"""Cells at the end of the grid that are not used: the splines end there with another slope."""

MOST_NODES = 4_000_000

FLAT = 0.02
"""Spread of the normals around a point (eigenvalue of their mean square) below which they are one face's."""


@dataclass(frozen=True, slots=True, eq=False)
class RoundedSolid:
    """The square of a distance on a grid.

    Parameters
    ----------
    origin : (3,) array
        First node [mm].
    cell_mm : float
    coefficients : (n_x, n_y, n_z) array
        Of cubic B-splines [mm²].
    in_core : (n_x, n_y, n_z) array
        Which nodes are inside of the core and not next to its surface, for the sign of a distance there.
    at_nodes : (n_x, n_y, n_z) array
        Signed distance at the nodes [mm].
    edge_mm : float
        Radius of the rounding.
    bounds_mm : (2, 3) array
        Of the solid; its lowest point is at z = 0.
    """

    origin: FloatArray
    cell_mm: float
    coefficients: FloatArray
    in_core: BoolArray
    at_nodes: FloatArray
    edge_mm: float
    bounds_mm: FloatArray

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,) [mm] of points (n, 3)."""
        inside, beyond = self._clamped(points)
        distance = self._linear(inside)
        near = np.flatnonzero(np.abs(distance) < NEAR_MM)
        first, share = self._cells(inside[near])
        x, y, z = (_weights(share[:, k])[0] for k in range(3))
        square = np.einsum("nijk,nk,nj,ni->n", self._around(first), z, y, x, optimize=True)
        distance[near] = self._sign(inside[near]) * np.sqrt(np.maximum(square, 0.0)) - self.edge_mm
        far = beyond.any(axis=1)
        distance[far] = np.hypot(distance[far], np.linalg.norm(beyond[far], axis=1))
        return distance

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First (n, 3) and second (n, 3, 3) derivatives of the distance."""
        inside, _ = self._clamped(points)
        first, share = self._cells(inside)
        weights = [_weights(share[:, k]) for k in range(3)]
        around = self._around(first)
        gradient, hessian = np.empty((len(points), 3)), np.empty((len(points), 3, 3))
        x, y, z = (each[0] for each in weights)
        square = np.einsum("nijk,nk,nj,ni->n", around, z, y, x, optimize=True)
        # Less than a tenth of the edge from the core, the derivatives are of no use.
        length = self._sign(inside) * np.sqrt(np.maximum(square, (0.1 * self.edge_mm) ** 2))
        length = length[:, None]
        for a in range(3):
            for b in range(a, 3):
                orders = [(k == a) + (k == b) for k in range(3)]
                x, y, z = (weights[k][order] for k, order in enumerate(orders))
                value = np.einsum("nijk,nk,nj,ni->n", around, z, y, x, optimize=True)
                hessian[:, a, b] = hessian[:, b, a] = value / self.cell_mm**2
            x, y, z = (weights[k][int(k == a)] for k in range(3))
            gradient[:, a] = np.einsum("nijk,nk,nj,ni->n", around, z, y, x, optimize=True) / self.cell_mm
        normals = gradient / (2.0 * length)
        curvature = 0.5 * hessian - normals[:, :, None] * normals[:, None, :]
        return normals, curvature / length[:, :, None]

    def _linear(self, points: FloatArray) -> FloatArray:
        """Distance (n,) between the nodes, linear: where no tissue touches, this is near enough."""
        place = (points - self.origin) / self.cell_mm
        node = np.floor(place).astype(np.int64)
        x, y, z = (place - node).T
        i, j, k = node.T
        found = np.zeros(len(points))
        for a, u in ((0, 1.0 - x), (1, x)):
            for b, v in ((0, 1.0 - y), (1, y)):
                for c, w in ((0, 1.0 - z), (1, z)):
                    found += u * v * w * self.at_nodes[i + a, j + b, k + c]
        return found

    def _sign(self, points: FloatArray) -> FloatArray:
        """−1 (n,) where the nearest node is in the core, 1 elsewhere."""
        i, j, k = np.rint((points - self.origin) / self.cell_mm).astype(np.int64).T
        return np.where(self.in_core[i, j, k], -1.0, 1.0)

    def _clamped(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest points of the grid's inner part, and the way from there."""
        counts = np.array(self.coefficients.shape)
        rim = RIM_CELLS * self.cell_mm
        low, high = self.origin + rim, self.origin + (counts - 1.0) * self.cell_mm - rim
        inside = np.clip(points, low, high)
        return inside, points - inside

    def _cells(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """First node (n, 3) of the 4 × 4 × 4 around each point, and its place (n, 3) in the middle cell."""
        place = (points - self.origin) / self.cell_mm
        node = np.minimum(np.floor(place), np.array(self.coefficients.shape) - 3.0)
        return node.astype(np.int64) - 1, place - node

    def _around(self, first: IntArray) -> FloatArray:
        """Coefficients (n, 4, 4, 4) from a first node on."""
        _, n_y, n_z = self.coefficients.shape
        step = np.arange(4)
        offsets = (step[:, None, None] * n_y + step[:, None]) * n_z + step
        start = (first[:, 0] * n_y + first[:, 1]) * n_z + first[:, 2]
        found: FloatArray = self.coefficients.ravel()[start[:, None, None, None] + offsets]
        return found


def _weights(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights (n, 4) of cubic B-splines at t in [0, 1], and their first two derivatives."""
    s = 1.0 - t
    value = np.stack([s**3, 3 * t**3 - 6 * t**2 + 4, 3 * s**3 - 6 * s**2 + 4, t**3], axis=1) / 6.0
    slope = np.stack([-(s**2), 3 * t**2 - 4 * t, -(3 * s**2) + 4 * s, t**2], axis=1) / 2.0
    bend = np.stack([s, 3 * t - 2, 3 * s - 2, t], axis=1)
    return value, slope, bend


def rounded_solid(surface: Surface, edge_mm: float) -> RoundedSolid:
    """Round the edges of a closed surface.

    Raises
    ------
    MeshError
        It is not closed, inside out, thinner than twice the rounding somewhere, or too large for it.
    """
    from scipy.ndimage import label, spline_filter

    _check(surface)
    core = _inset(surface, edge_mm)
    lower, upper = core.points_mm.min(axis=0) - edge_mm, core.points_mm.max(axis=0) + edge_mm
    core = replace(core, points_mm=core.points_mm - [0.0, 0.0, lower[2]])
    upper, lower = upper - [0.0, 0.0, lower[2]], lower * [1.0, 1.0, 0.0]
    cell = edge_mm / CELLS_PER_EDGE
    margin = max(MARGIN_MM, 2.0 * cell) + RIM_CELLS * cell
    counts = np.ceil((upper - lower + 2.0 * margin) / cell).astype(np.int64) + 1
    if counts.prod() > MOST_NODES:
        fits = edge_mm * float(counts.prod() / MOST_NODES) ** (1.0 / 3.0)
        raise MeshError(
            f"{surface.name}: an edge rounded by {edge_mm:g} mm is too fine for a tool of "
            f"{float((upper - lower).max()):.3g} mm; give an edge of {1.1 * fits:.2g} mm or more"
        )
    origin = lower - margin
    axes = [origin[k] + cell * np.arange(counts[k]) for k in range(3)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    square = (core.nearest(nodes)[1] ** 2).reshape(counts)
    coefficients = np.ascontiguousarray(spline_filter(square, order=3, mode="mirror"))
    # Two neighbouring nodes on different sides of the core's surface are not both this far from it.
    parts, _ = label(square > (0.6 * cell) ** 2)
    in_core = (parts > 0) & (parts != parts[0, 0, 0])
    at_nodes = np.where(in_core, -1.0, 1.0) * np.sqrt(square) - edge_mm
    return RoundedSolid(origin, cell, coefficients, in_core, at_nodes, edge_mm, np.array([lower, upper]))


def _check(surface: Surface) -> None:
    found = [defect for defect in defects(surface) if not defect.what.startswith("parts")]
    if found:
        raise MeshError(
            f"{surface.name}: not a closed surface ({found[0]}); close it, or export the solid again"
        )
    directed = surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, first, counts = np.unique(directed, axis=0, return_index=True, return_counts=True)
    if (counts > 1).any():
        place = surface.points_mm[directed[first[counts > 1][0]]].mean(axis=0)
        raise MeshError(
            f"{surface.name}: neighbouring triangles are turned to different sides near "
            f"{np.round(place, 2)} mm; unify their normals"
        )
    if surface.volume_mm3 <= 0.0:
        raise MeshError(f"{surface.name}: inside out, its normals point inwards; turn its triangles round")


def _inset(surface: Surface, edge_mm: float) -> Surface:
    """The surface with every face moved inwards.

    A point moves so that it stays on its faces, by least squares: along the normal of one face, and
    along that of a smooth surface.
    """
    corners = surface.points_mm[surface.faces]
    arms = np.roll(corners, -1, axis=1) - corners
    arms /= np.linalg.norm(arms, axis=2, keepdims=True)
    angles = np.arccos(np.clip(-(arms * np.roll(arms, 1, axis=1)).sum(axis=2), -1.0, 1.0))
    areas = surface.face_areas_mm2
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    mean, square = np.zeros((len(surface.points_mm), 3)), np.zeros((len(surface.points_mm), 3, 3))
    for k in range(3):
        at, weight = surface.faces[:, k], angles[:, k]
        np.add.at(mean, at, weight[:, None] * normals)
        np.add.at(square, at, weight[:, None, None] * normals[:, :, None] * normals[:, None, :])
    values, vectors = np.linalg.eigh(square)
    kept = values > FLAT * values[:, -1:]
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    along = (vectors.transpose(0, 2, 1) @ mean[:, :, None])[:, :, 0] * inverse
    ways = -edge_mm * (vectors @ along[:, :, None])[:, :, 0]
    core = replace(surface, points_mm=surface.points_mm + ways)
    turned = (core.face_areas_mm2 * areas).sum(axis=1) <= 0.0
    if turned.any():
        place = corners[int(np.flatnonzero(turned)[0])].mean(axis=0)
        raise MeshError(
            f"{surface.name}: an edge rounded by {edge_mm:g} mm does not fit near {np.round(place, 2)} mm, "
            "where the tool is thinner or sharper curved; give a smaller edge"
        )
    return core
