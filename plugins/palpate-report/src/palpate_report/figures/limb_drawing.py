"""A limb drawn for print: parallel projection, glass in front, and behind it bones and the far side."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from palpate.api import FloatArray, Limb
from palpate.api.mesh import spot_axes
from palpate_report.data.marks import in_words
from palpate_report.figures.limb_view import LOOKS, Role, ViewPart

ABOVE = np.eye(3)
"""Camera on the normal of a spot: right, up and towards the viewer in the frame of the spot."""

ELEVATION_DEG, TURN_DEG = 22.0, 25.0
"""Camera from the side: above the tangent plane of the spot, and away from square to the limb."""

AMBIENT = 0.65
"""Share of the light that comes from everywhere."""

PIXELS, DPI = 700, 100
"""Pixels of the longer side of a picture, and their number for an inch of its lines."""

LABELS: Mapping[Role, str] = MappingProxyType(
    {"contact": "surface in contact", "free": "free surface", "fixed": "fixed surface"}
)

Layer = tuple[FloatArray, FloatArray]
"""Corners (n, 3, 3) of triangles as right, up and depth, and their colours (n, 3)."""


def from_the_side(limb: Limb) -> FloatArray:
    """Camera (3, 3) that sees the normal of the spot upwards, and the limb from its side."""
    points = (limb.mesh.points_mm - limb.spot.position_mm) @ spot_axes(limb.spot.normal, limb.spot.along)
    along = np.linalg.eigh(np.cov(points[:, :2].T))[1][:, -1]
    turn, rise = np.arctan2(along[1], along[0]) + np.radians(TURN_DEG), np.radians(ELEVATION_DEG)
    right = np.array([np.cos(turn), np.sin(turn), 0.0])
    viewer = np.cos(rise) * np.cross(right, [0.0, 0.0, 1.0]) + [0.0, 0.0, np.sin(rise)]
    return np.stack([right, np.cross(viewer, right), viewer])


def draw_limb(
    axis: Axes, limb: Limb, parts: Sequence[ViewPart], camera: FloatArray, *, glass: float = 0.4
) -> None:
    """Draw parts of a limb around its spot as one picture.

    Triangles that look away come first: the far side and, as it encloses no tissue, the near side of a
    bone. Triangles that look at the viewer are glass over them, and the indenter is in front.
    """
    axes = spot_axes(limb.spot.normal, limb.spot.along) @ camera.T
    outer = [part for part in parts if part.role not in ("interface", "indenter")]
    tool = [part for part in parts if part.role == "indenter"]
    layers = [
        (_layer(outer, limb, axes, is_front=False), 1.0),
        (_layer(outer, limb, axes, is_front=True), glass),
        (_layer(tool, limb, axes, is_front=True), 1.0),
    ]
    corners = np.concatenate([layer[0] for layer, _ in layers])[..., :2].reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    low, high = low - 0.01 * (high - low).max(), high + 0.01 * (high - low).max()
    picture = np.zeros((1, 1, 4))
    for layer, opacity in layers:
        over = _picture(layer, low, high)
        share = opacity * over[..., 3:]
        covered = share + picture[..., 3:] * (1.0 - share)
        colour = share * over[..., :3] + picture[..., :3] * picture[..., 3:] * (1.0 - share)
        picture = np.concatenate([colour / np.maximum(covered, 1e-6), covered], axis=-1)
    axis.imshow(np.clip(picture, 0.0, 1.0), extent=(low[0], high[0], low[1], high[1]))
    axis.set_axis_off()


def legend_of(parts: Sequence[ViewPart]) -> list[Patch]:
    """One entry for each part that is drawn; the indenter and bones have their names."""
    shown: dict[str, Role] = {}
    for part in parts:
        if part.role != "interface":
            own = part.role == "indenter" or part.name not in ("contact", "fixed", part.region)
            shown.setdefault(in_words(part.name) if own else LABELS[part.role], part.role)
    return [Patch(color=LOOKS[role][0], label=name) for name, role in shown.items()]


def _layer(parts: Sequence[ViewPart], limb: Limb, axes: FloatArray, *, is_front: bool) -> Layer:
    """Triangles that look at the viewer or do not, the farthest first."""
    if not parts:
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    corners = np.concatenate([part.points_mm[part.triangles] for part in parts])
    corners = (corners - limb.spot.position_mm) @ axes
    colours = np.repeat([to_rgb(LOOKS[p.role][0]) for p in parts], [len(p.triangles) for p in parts], axis=0)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    # Direction of the rest of the light, as right, up and towards the viewer.
    lit = np.clip((1.0 if is_front else -1.0) * normals @ np.array([-0.35, 0.65, 0.67]), 0.0, 1.0)
    colours = np.minimum((AMBIENT + (1.0 - AMBIENT) * lit)[:, None] * colours, 1.0)
    seen = np.flatnonzero((normals[:, 2] > 0.0) == is_front)
    order = seen[np.argsort(corners[seen, :, 2].mean(axis=1))]
    return corners[order], colours[order]


def _picture(layer: Layer, low: FloatArray, high: FloatArray) -> FloatArray:
    """Pixels (height, width, 4) of triangles between two corners of the picture."""
    corners, colours = layer
    size = PIXELS * (high - low) / (high - low).max() / DPI
    figure = Figure(figsize=tuple(size), dpi=DPI, frameon=False)
    figure.set_layout_engine("none")
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axis.set_axis_off()
    faces = PolyCollection(list(corners[..., :2]), facecolors=colours, edgecolors="face", linewidths=0.4)
    axis.add_collection(faces)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()) / 255.0
