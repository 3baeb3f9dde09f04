"""Ink marks on a coloured scan: found by hue in CIELAB, whatever light fell on them.

Light multiplies a colour's linear intensities, which leaves the direction of (a*, b*) and,
nearly, the ratio of chroma to lightness. So a point is described by

    q = (a*, b*) / max(L*, L₀),

skin is the median of q, and ink is what is further from it than the noise can explain.
Points of ink that touch and have one hue are one mark.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError
from palpate_limb.surfaces import Surface, adjacency, edge_uses, parts_of

DARKEST = 15.0
"""L₀: below this lightness a scanner's colours are noise."""
HUES = {
    "red": (0.80, 0.08, 0.10),
    "orange": (0.95, 0.50, 0.05),
    "yellow": (0.90, 0.80, 0.05),
    "green": (0.05, 0.55, 0.15),
    "cyan": (0.05, 0.65, 0.70),
    "blue": (0.08, 0.20, 0.75),
    "purple": (0.45, 0.10, 0.65),
    "magenta": (0.85, 0.10, 0.60),
}
"""sRGB of pens as they come; what is asked for by a name is the nearest in hue."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mark:
    """A patch of ink: its points (n,) of the scan, its middle (3,) by area, and its angle of (a*, b*)."""

    points: IntArray
    centre_mm: FloatArray
    area_mm2: float
    hue_deg: float

    @property
    def colour(self) -> str:
        """The nearest name of a colour."""
        return min(HUES, key=lambda name: _apart(self.hue_deg, hue_of(HUES[name])))

    def __str__(self) -> str:
        x, y, z = self.centre_mm
        return f"{self.colour} of {self.area_mm2:.3g} mm² at ({x:.1f}, {y:.1f}, {z:.1f}) mm"


def find_marks(
    surface: Surface, *, least_radius_mm: float = 1.2, largest_radius_mm: float = 10.0
) -> tuple[Mark, ...]:
    """Find every patch of ink, largest first.

    Patches whose area is that of a disc smaller or larger than the radii are no marks.

    Raises
    ------
    MeshError
        The scan has no colours, or one colour.
    """
    chroma = _chroma(surface)
    off = np.linalg.norm(chroma - np.median(chroma, axis=0), axis=1)
    # Further from the skin's than noise and uneven skin explain.
    ink = off > max(5.0 * 1.4826 * float(np.median(off)), 0.25)
    areas = surface.point_areas_mm2
    marks = []
    for points in _patches(surface, chroma, ink):
        area = float(areas[points].sum())
        if not np.pi * least_radius_mm**2 <= area <= np.pi * largest_radius_mm**2:
            continue
        weights = areas[points, None]
        # The rim is a blend of ink and skin, so the hue is that of the half that is least like skin.
        a, b = chroma[points[off[points] >= np.median(off[points])]].mean(axis=0)
        marks.append(
            Mark(
                points=points,
                centre_mm=(surface.points_mm[points] * weights).sum(axis=0) / area,
                area_mm2=area,
                hue_deg=float(np.rad2deg(np.arctan2(b, a)) % 360.0),
            )
        )
    return tuple(sorted(marks, key=lambda mark: -mark.area_mm2))


def hue_of(srgb: tuple[float, float, float]) -> float:
    """Hue angle [degrees] of a colour in CIELAB."""
    from skimage.color import rgb2lab

    _, a, b = rgb2lab(np.array(srgb)[None])[0]
    return float(np.rad2deg(np.arctan2(b, a)) % 360.0)


def name_marks(
    marks: tuple[Mark, ...], wanted: dict[str, str | None], along: FloatArray, where: str
) -> dict[str, Mark]:
    """Give the marks their names.

    With colours of ``HUES``, each name that is ``wanted`` gets the mark of its hue; marks of other hues may
    be left out. Without, every mark has a name, and names go ``along`` (3,) the limb. Messages call the scan
    ``where``.

    Raises
    ------
    MeshError
        Fewer marks than names, more of one hue than named, or a hue that no mark has; with every mark found.
    """
    found = "; ".join(map(str, marks)) or "none"
    colours = list(wanted.values())
    if len(marks) < len(wanted) or (len(marks) > len(wanted) and None in colours):
        raise MeshError(
            f"{where}: {len(marks)} marks found where {len(wanted)} were named ({', '.join(wanted)}). Found: "
            f"{found}. Name them all, or change the radii between which ink is a mark (--mark-radii)"
        )
    if any(colour is None for colour in colours):
        order = np.argsort([mark.centre_mm @ along for mark in marks])
        return {name: marks[i] for name, i in zip(wanted, order, strict=True)}
    columns = _by_colour(marks, wanted, where, found)
    return {name: marks[column] for name, column in zip(wanted, columns, strict=True)}


def _by_colour(marks: tuple[Mark, ...], wanted: dict[str, str | None], where: str, found: str) -> list[int]:
    """Number of the mark of each name, by hue."""
    from scipy.optimize import linear_sum_assignment

    colours = [colour for colour in wanted.values() if colour is not None]
    for colour in colours:
        if colour not in HUES:
            raise MeshError(f"{where}: mark colour '{colour}'; use {', '.join(HUES)}")
    cost = np.array([[_apart(m.hue_deg, hue_of(HUES[c])) for m in marks] for c in colours])
    rows, columns = linear_sum_assignment(cost)
    for row, column in zip(rows, columns, strict=True):
        if cost[row, column] > 45.0:
            raise MeshError(
                f"{where}: no mark is {colours[row]} ('{list(wanted)[row]}'). Found: {found}. "
                "Correct the colour"
            )
    for colour in colours:
        if sum(mark.colour == colour for mark in marks) > colours.count(colour):
            raise MeshError(
                f"{where}: several marks are {colour}. Found: {found}. Name them all, or change the radii "
                "between which ink is a mark (--mark-radii)"
            )
    return [int(column) for column in columns]


def _apart(a: FloatArray | float, b: FloatArray | float) -> Any:  # noqa: ANN401 - as the hues are
    """Angle [degrees] between two hues."""
    return np.abs((a - b + 180.0) % 360.0 - 180.0)


def _chroma(surface: Surface) -> FloatArray:
    """Q of every point (n, 2), averaged over its neighbours and theirs."""
    from skimage.color import rgb2lab

    colours = surface.colours
    if colours is None:
        raise MeshError(
            f"{surface.name}: no colours; export the scan with vertex colours or with its texture, or give "
            "the spots by place (--spot)"
        )
    if float(np.ptp(colours, axis=0).max()) < 1.0 / 255.0:
        raise MeshError(f"{surface.name}: the scan has a single colour; no marks found. Export its colours")
    lab = rgb2lab(colours[None])[0]
    links = adjacency(len(colours), surface.faces)
    degree = np.asarray(links.sum(axis=1)).ravel() + 1.0
    for _ in range(2):  # an edge of ink moves by less than a point, noise falls by about 4
        lab = (links @ lab + lab) / degree[:, None]
    chroma: FloatArray = lab[:, 1:] / np.maximum(lab[:, :1], DARKEST)
    return chroma


def _patches(surface: Surface, chroma: FloatArray, ink: BoolArray) -> list[IntArray]:
    """Points of ink that touch and look alike."""
    edges, _ = edge_uses(surface.faces)
    edges = edges[ink[edges].all(axis=1)]
    hue = np.rad2deg(np.arctan2(chroma[:, 1], chroma[:, 0]))
    turn = _apart(hue[edges[:, 0]], hue[edges[:, 1]])
    labels = parts_of(len(chroma), edges[turn < 40.0])
    points = np.flatnonzero(ink)
    order = np.argsort(labels[points], kind="stable")
    cuts = np.flatnonzero(np.diff(labels[points][order])) + 1
    return [patch for patch in np.split(points[order], cuts) if patch.size]
