"""A rigid tool from a file of its surface: the smooth distance to a solid whose edges are rounded.

The solid's faces are moved inwards by the radius of the rounding; what is left is its core. The distance to
the rounded solid is the distance to the core less that radius: flat faces return to their place, and edges
are round. The square of the distance to the core's surface, which is quadratic on both sides of a face and
next to each edge and corner, is sampled on a grid and interpolated by cubic splines.
"""

import functools
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, PrivateAttr

from palpate.api import BoolArray, FloatArray, Indenter, InputFile, MeshError, Quantity, Settings
from palpate.api.mechanics import Array
from palpate_limb.repair import defects
from palpate_limb.surfaces import Surface, read_surface

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

MARGIN_MM = 1.5
"""Of the grid around the solid; beyond it a distance is up to MARGIN_MM too small."""
RIM_CELLS = 6
"""Cells at the end of the grid that are not used: the splines end there with another slope."""
MOST_NODES = 4_000_000


@dataclass(frozen=True, slots=True, eq=False)
class RoundedSolid:
    """The square of a distance on a grid: lengths in mm, places (3,).

    ``origin`` is the first node and ``square`` cubic splines of the square [mm²] of points (n, 3).
    ``in_core`` are nodes (n_x, n_y, n_z) inside of the core and not next to its surface, for the sign of a
    distance there, and ``at_nodes`` is the signed distance at each. ``edge_mm`` is the radius of the
    rounding, and ``bounds_mm`` (2, 3) are the bounds of the solid, whose lowest point is at z = 0.
    """

    origin: FloatArray
    cell_mm: float
    square: "NdBSpline"
    in_core: BoolArray
    at_nodes: FloatArray
    edge_mm: float
    bounds_mm: FloatArray

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,) [mm] of points (n, 3)."""
        from scipy.ndimage import map_coordinates

        inside, beyond = self._clamped(points)
        # Linear between the nodes: where no tissue touches, this is near enough.
        distance: FloatArray = map_coordinates(
            self.at_nodes, ((inside - self.origin) / self.cell_mm).T, order=1
        )
        # Distance from the surface beyond which the nodes are interpolated linearly.
        near = np.flatnonzero(np.abs(distance) < 0.8)
        square = self.square(inside[near])
        distance[near] = self._sign(inside[near]) * np.sqrt(np.maximum(square, 0.0)) - self.edge_mm
        far = beyond.any(axis=1)
        distance[far] = np.hypot(distance[far], np.linalg.norm(beyond[far], axis=1))
        return distance

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First (n, 3) and second (n, 3, 3) derivatives of the distance."""
        inside, _ = self._clamped(points)
        # Less than a tenth of the edge from the core, the derivatives are of no use.
        square = np.maximum(self.square(inside), (0.1 * self.edge_mm) ** 2)
        length = (self._sign(inside) * np.sqrt(square))[:, None]
        once = np.eye(3, dtype=np.int64)
        gradient = np.stack([self.square(inside, nu=nu) for nu in once], axis=1)
        hessian = np.empty((len(points), 3, 3))
        for a in range(3):
            for b in range(a, 3):
                hessian[:, a, b] = hessian[:, b, a] = self.square(inside, nu=once[a] + once[b])
        normals = gradient / (2.0 * length)
        curvature = 0.5 * hessian - normals[:, :, None] * normals[:, None, :]
        return normals, curvature / length[:, :, None]

    def _sign(self, points: FloatArray) -> FloatArray:
        """−1 (n,) where the nearest node is in the core, 1 elsewhere."""
        i, j, k = np.rint((points - self.origin) / self.cell_mm).astype(np.int64).T
        return np.where(self.in_core[i, j, k], -1.0, 1.0)

    def _clamped(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest points of the grid's inner part, and the way from there."""
        rim = RIM_CELLS * self.cell_mm
        high = self.origin + (np.array(self.at_nodes.shape) - 1.0) * self.cell_mm - rim
        inside = np.clip(points, self.origin + rim, high)
        return inside, points - inside


def rounded_solid(surface: Surface, edge_mm: float) -> RoundedSolid:
    """Round the edges of a closed surface; a MeshError where it is open, inside out, thin or large."""
    from scipy.interpolate import NdBSpline
    from scipy.ndimage import label, spline_filter

    _check(surface)
    core = _inset(surface, edge_mm)
    lower, upper = core.points_mm.min(axis=0) - edge_mm, core.points_mm.max(axis=0) + edge_mm
    core = replace(core, points_mm=core.points_mm - [0.0, 0.0, lower[2]])
    upper, lower = upper - [0.0, 0.0, lower[2]], lower * [1.0, 1.0, 0.0]
    # Cells of the grid along the radius of the rounding.
    cell = edge_mm / 3.0
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
    knots = [origin[k] + cell * np.arange(-2, counts[k] + 2) for k in range(3)]
    spline = NdBSpline(tuple(knots), spline_filter(square, order=3, mode="mirror"), 3)
    # Two neighbouring nodes on different sides of the core's surface are not both this far from it.
    parts, _ = label(square > (0.6 * cell) ** 2)
    in_core = (parts > 0) & (parts != parts[0, 0, 0])
    at_nodes = np.where(in_core, -1.0, 1.0) * np.sqrt(square) - edge_mm
    return RoundedSolid(origin, cell, spline, in_core, at_nodes, edge_mm, np.array([lower, upper]))


def _check(surface: Surface) -> None:
    found = [defect for defect in defects(surface) if " parts besides" not in defect]
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

    A point moves so that it stays on its faces, by least squares: along the normal of one face, or of
    a smooth surface.
    """
    corners = surface.points_mm[surface.faces]
    angles = surface.trimesh.face_angles
    areas = surface.face_areas_mm2
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1, keepdims=True), 1e-300)
    mean, square = np.zeros((len(surface.points_mm), 3)), np.zeros((len(surface.points_mm), 3, 3))
    for k in range(3):
        at, weight = surface.faces[:, k], angles[:, k]
        np.add.at(mean, at, weight[:, None] * normals)
        np.add.at(square, at, weight[:, None, None] * normals[:, :, None] * normals[:, None, :])
    values, vectors = np.linalg.eigh(square)
    # Spread of the normals around a point (eigenvalue of their mean square) below which they are one
    # face's.
    kept = values > 0.02 * values[:, -1:]
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


class StlSettings(Settings):
    """Settings of the indenter ``stl``."""

    file: InputFile = Field(
        description="Closed surface of the tool (.stl, .ply, .obj, .glb, .off), relative to the study file; "
        "its z axis points away from the limb; the tool's x and y are kept, with the spot at 0, 0."
    )
    unit: str = Field(default="mm", description="Unit of the file's coordinates.")
    edge: Annotated[float, Quantity("mm")] = Field(
        gt=0.0, description="Radius by which edges are rounded; less than every rounding in the file."
    )
    turn: Annotated[float, Quantity("deg")] = Field(
        default=0.0, description="Angle about the normal from the x axis of the spot's frame to the tool's."
    )

    _sha256: str = PrivateAttr("")
    """Of the file as it was first read: it goes with the settings to workers, and is in no key of theirs."""


class StlIndenter(Indenter[StlSettings]):
    """A rigid tool whose closed surface is in a file.

    Flat faces keep their place, edges are rounded. The lowest point touches the skin at depth 0.
    """

    name = "stl"
    summary = "a tool from a file of its surface, with edges rounded"

    def __init__(self, settings: StlSettings) -> None:
        super().__init__(settings)
        self.edge_mm = settings.edge
        # The copy of a study in a run directory may be read where the tool's file is not.
        self.radius_mm, self.bounds_mm = np.nan, np.full((2, 3), np.nan)
        if settings.file.is_file():
            settings._sha256 = settings._sha256 or _sha256(settings.file)
            if _sha256(settings.file) != settings._sha256:
                return  # the shape reports it when it is used
            lower, upper = self._solid.bounds_mm
            self.radius_mm = 0.5 * float((upper - lower)[:2].min())
            half = float(np.hypot(*np.maximum(np.abs(lower), np.abs(upper))[:2]))
            self.bounds_mm = np.array([[-half, -half, 0.0], [half, half, upper[2]]])

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_solid"}

    @functools.cached_property
    def _solid(self) -> RoundedSolid:
        """Shared by equal tools of a process, however they are turned, and in no pickle."""
        return _solid_of(self.settings.file, self.settings.unit, self.settings.edge, self.settings._sha256)

    def fingerprint(self) -> str:
        """Code, and content of the file as it was first read."""
        sha256 = self.settings._sha256 or _sha256(self.settings.file)
        return f"{super().fingerprint()}, file {sha256[:16]}"

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        turned = np.asarray(points, dtype=np.float64).reshape(-1, 3) @ self._axes
        return self._solid.distance(turned).reshape(points.shape[:-1])

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normals (n, 3) and their derivative (n, 3, 3), of the same spline."""
        axes = self._axes
        normals, curvature = self._solid.normals(points @ axes)
        return normals @ axes.T, axes @ curvature @ axes.T

    @property
    def _axes(self) -> FloatArray:
        """Axes of the file as columns, in the frame of the spot."""
        cos, sin = np.cos(np.deg2rad(self.settings.turn)), np.sin(np.deg2rad(self.settings.turn))
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _sha256(file: Path) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise MeshError(f"{file}: the tool cannot be read ({error.strerror}); give its file") from None


@functools.lru_cache(maxsize=4)
def _solid_of(file: Path, unit: str, edge_mm: float, sha256: str) -> RoundedSolid:
    """Solid of a file, once per process and content."""
    if _sha256(file) != sha256:
        raise MeshError(f"{file}: the tool's file has changed since this command read it; run it again")
    return rounded_solid(read_surface(file, unit), edge_mm)
