"""Ink marks on a coloured scan, found by hue in CIELAB whatever light fell on them, and the spots at points.

Light multiplies a colour's linear intensities, which leaves the direction of (a*, b*) and,
nearly, the ratio of chroma to lightness. So a point is described by

    q = (a*, b*) / max(L*, L₀),

skin is the median of q, and ink is what is further from it than the noise can explain.
Points of ink that touch and have one hue are one mark.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError, Spot
from palpate_limb.surfaces import Surface, edge_uses, parts_of

Colour = Literal["red", "orange", "yellow", "green", "cyan", "blue", "purple", "magenta"]
N_COEFFICIENTS = 6
PATCH_RADIUS_MM = 8.0
HUES: dict[Colour, tuple[float, float, float]] = {
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
    def colour(self) -> Colour:
        """The nearest name of a colour."""
        return min(HUES, key=lambda name: _apart(self.hue_deg, hue_of(HUES[name])))

    def __str__(self) -> str:
        x, y, z = self.centre_mm
        return f"{self.colour} of {self.area_mm2:.3g} mm² at ({x:.1f}, {y:.1f}, {z:.1f}) mm"


def find_marks(
    surface: Surface, least_radius_mm: float = 1.2, largest_radius_mm: float = 10.0
) -> tuple[Mark, ...]:
    """Find every patch of ink, largest first.

    Patches with the area of a disc smaller or larger than the radii are no marks. A MeshError where the
    scan has no colours, or one.
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
    marks: tuple[Mark, ...], wanted: dict[str, Colour | None], along: FloatArray, where: str
) -> dict[str, Mark]:
    """Give the marks their names.

    With colours of ``HUES``, each name that is ``wanted`` gets the mark of its hue; marks of other hues may
    be left out. Without, every mark has a name, and names go ``along`` (3,) the limb. Messages call the scan
    ``where``; a MeshError lists every mark where these are fewer than names, or other hues.
    """
    from scipy.optimize import linear_sum_assignment

    found = "; ".join(map(str, marks)) or "none"
    if len(marks) < len(wanted) or (len(marks) > len(wanted) and None in wanted.values()):
        raise MeshError(
            f"{where}: {len(marks)} marks found where {len(wanted)} were named ({', '.join(wanted)}). Found: "
            f"{found}. Name them all, or change the radii between which ink is a mark (mark_radii)"
        )
    colours = [colour for colour in wanted.values() if colour is not None]
    if not colours:
        order = np.argsort([mark.centre_mm @ along for mark in marks])
        return {name: marks[i] for name, i in zip(wanted, order, strict=True)}
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
                "between which ink is a mark (mark_radii)"
            )
    return {name: marks[column] for name, column in zip(wanted, columns, strict=True)}


def _apart(a: FloatArray | float, b: FloatArray | float) -> Any:  # noqa: ANN401 - as the hues are
    """Angle [degrees] between two hues."""
    return np.abs((a - b + 180.0) % 360.0 - 180.0)


def _chroma(surface: Surface) -> FloatArray:
    """Q of every point (n, 2), averaged over its neighbours and theirs."""
    from scipy.sparse import coo_array
    from skimage.color import rgb2lab

    colours = surface.colours
    if colours is None:
        there = f" (its points have {', '.join(surface.columns)})" if surface.columns else ""
        raise MeshError(
            f"{surface.name}: no colours{there}; export the scan with vertex colours or with its texture, or "
            "give the spots by place (spot)"
        )
    if float(np.ptp(colours, axis=0).max()) < 1.0 / 255.0:
        raise MeshError(f"{surface.name}: the scan has a single colour; no marks found. Export its colours")
    lab = rgb2lab(colours[None])[0]
    edges, _ = edge_uses(surface.faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    links = coo_array((np.ones(len(both)), both.T), shape=(len(colours), len(colours))).tocsr()
    degree = np.asarray(links.sum(axis=1)).ravel() + 1.0
    for _ in range(2):  # an edge of ink moves by less than a point, noise falls by about 4
        lab = (links @ lab + lab) / degree[:, None]
    # L₀: below this lightness a scanner's colours are noise.
    return np.asarray(lab[:, 1:] / np.maximum(lab[:, :1], 15.0))


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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundSpot:
    """A spot in the frame of the scan, and how well it is known.

    Standard deviations are for the position along the surface, from the mark's edge between points,
    and along the normal, from the scan's noise, and for the normal's direction, from both. Remarks say what
    makes them uncertain themselves.
    """

    spot: Spot
    across_mm: float
    along_normal_mm: float
    normal_deg: float
    remarks: tuple[str, ...] = ()


def locate(name: str, mark: Mark, surface: Surface) -> FoundSpot:
    """The spot under the centre of a mark; see :func:`locate_at`.

    Its standard deviation follows for the centre of a disc whose n points are cut out of a grid: each of the
    about 2√(πn) points of the rim is in or out by chance, and one of area A/n at radius r shifts it by r/n.
    """
    n = len(mark.points)
    across = np.sqrt(mark.area_mm2 / np.pi) / n * np.sqrt(0.25 * 2.0 * np.sqrt(np.pi * n))
    return locate_at(name, mark.centre_mm, surface, float(across))


def locate_at(name: str, centre: FloatArray, surface: Surface, across_mm: float = 0.0) -> FoundSpot:
    """Fit z = c₀ + c₁x + c₂y + c₃x² + c₄xy + c₅y² to the scan around a point, by least squares.

    The position is the patch's point over the given one and the normal the patch's
    there; z is the mean normal of the faces around. Large faces count by points within them for the
    patch, and by their corners for its uncertainty: points of one face share its error.

    ``centre`` (3,) is near the surface, and ``across_mm`` its standard deviation along it. A MeshError
    where the scan has too few points there, or ends.
    """
    scan, surface = surface, _around(surface, centre)
    near = np.flatnonzero(np.linalg.norm(surface.points_mm - centre, axis=1) <= PATCH_RADIUS_MM)
    total = surface.face_areas_mm2[np.isin(surface.faces, near).any(axis=1)].sum(axis=0)
    if not total.any():
        raise MeshError(f"{surface.name}: no surface at a mark; export the scan with its triangles")
    up = total / np.linalg.norm(total)
    near = near[(surface.points_mm[near] - centre) @ up > -0.5 * PATCH_RADIUS_MM]
    if len(near) < 3 * N_COEFFICIENTS:
        raise MeshError(
            f"{surface.name}: {len(near)} points within {PATCH_RADIUS_MM:g} mm of spot '{name}' at "
            f"{np.round(centre, 1).tolist()} mm; scan finer"
        )
    u = np.linalg.svd(up[None])[2][1]
    frame = np.stack([u, np.cross(up, u), up])
    local = (surface.points_mm[near] - centre) @ frame.T
    # By area, for the points of a model are not spread evenly.
    middle = np.average(local[:, :2], axis=0, weights=surface.point_areas_mm2[near])
    if (np.abs(middle) > 0.25 * PATCH_RADIUS_MM).any():
        raise MeshError(
            f"{surface.name}: spot '{name}' at {np.round(centre, 1).tolist()} mm is at an edge of the "
            "scan; scan further around it"
        )
    off = scan.points_mm - centre
    own = (np.linalg.norm(off, axis=1) <= PATCH_RADIUS_MM) & (off @ up > -0.5 * PATCH_RADIUS_MM)
    return _fitted(name, across_mm, centre, frame, local, int(np.count_nonzero(own)))


def _around(surface: Surface, centre: FloatArray) -> Surface:
    """The faces around a point, in pieces where they are too large for a patch."""
    from trimesh.remesh import subdivide_to_size

    corners = surface.points_mm[surface.faces]
    # Faces whose box comes near: a large one may hold the point and have its corners far away.
    gaps = np.maximum(np.maximum(corners.min(axis=1) - centre, centre - corners.max(axis=1)), 0.0)
    near = np.linalg.norm(gaps, axis=1) <= PATCH_RADIUS_MM
    edges = corners[near] - np.roll(corners[near], 1, axis=1)
    if np.linalg.norm(edges, axis=2).max(initial=0.0) <= 0.5 * PATCH_RADIUS_MM:
        return surface
    points, pieces = subdivide_to_size(  # type: ignore[no-untyped-call]
        surface.points_mm, surface.faces[near], max_edge=0.3 * PATCH_RADIUS_MM, max_iter=20
    )
    return Surface(name=surface.name, points_mm=np.asarray(points), faces=np.asarray(pieces))


def _fitted(
    name: str, across: float, centre: FloatArray, frame: FloatArray, local: FloatArray, n_own: int
) -> FoundSpot:
    """The spot from points in the frame of the patch, of which ``n_own`` are the scan's own."""
    x, y, z = local.T
    columns = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    solution, *_ = np.linalg.lstsq(columns, z, rcond=None)
    residual = z - columns @ solution
    variance = float(residual @ residual) / (len(z) - N_COEFFICIENTS)
    covariance = variance * len(z) / max(n_own, 1) * np.linalg.inv(columns.T @ columns)
    normal = frame.T @ np.array([-solution[1], -solution[2], 1.0])
    bend = 2.0 * float(
        np.abs(np.linalg.eigvalsh([[solution[3], solution[4] / 2], [solution[4] / 2, solution[5]]])).max()
    )
    few = (
        f"{n_own} points of the scan within {PATCH_RADIUS_MM:g} mm of the spot, where {3 * N_COEFFICIENTS} "
        "make its uncertainty a good estimate; scan finer"
    )
    tilt = np.sqrt(covariance[1, 1] + covariance[2, 2] + (bend * across) ** 2)
    return FoundSpot(
        spot=Spot(name=name, position_mm=centre + solution[0] * frame[2], normal=normal),
        across_mm=across,
        along_normal_mm=float(np.sqrt(covariance[0, 0])),
        normal_deg=float(np.rad2deg(tilt)),
        remarks=() if n_own >= 3 * N_COEFFICIENTS else (few,),
    )
