"""The spot at a point of the skin: position and normal from a smooth patch, with their uncertainty."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, MeshError, Spot
from palpate_limb.marks import Mark
from palpate_limb.surfaces import Surface

N_COEFFICIENTS = 6
PATCH_RADIUS_MM = 8.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundSpot:
    """A spot in the frame of the scan, and how well it is known.

    Standard deviations are those of the position along the surface, from the mark's edge between points,
    and along the normal, from the scan's noise, and of the normal's direction, from both. Remarks say what
    makes them uncertain themselves.
    """

    spot: Spot
    across_mm: float
    along_normal_mm: float
    normal_deg: float
    remarks: tuple[str, ...] = ()


def locate(name: str, mark: Mark, surface: Surface) -> FoundSpot:
    """The spot under the centre of a mark; see :func:`locate_at`."""
    return locate_at(name, mark.centre_mm, surface, _across(mark))


def locate_at(name: str, centre: FloatArray, surface: Surface, across_mm: float = 0.0) -> FoundSpot:
    """Fit z = c₀ + c₁x + c₂y + c₃x² + c₄xy + c₅y² to the scan around a point, by least squares.

    The position is the patch's point over the given one and the normal the patch's
    there; z is the mean normal of the faces around. Large faces count by points within them for the
    patch, and by their corners for its uncertainty: points of one face share its error.

    ``centre`` (3,) is near the surface, and ``across_mm`` its standard deviation along it.

    Raises
    ------
    MeshError
        The scan has too few points there, or its edge runs through the spot.
    """
    scan, surface = surface, _around(surface, centre)
    near = np.flatnonzero(np.linalg.norm(surface.points_mm - centre, axis=1) <= PATCH_RADIUS_MM)
    up = _mean_normal(surface, near)
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


def _across(mark: Mark) -> float:
    """Standard deviation of a disc's centre when its n points are cut out of a grid.

    Each of the about 2√(πn) points of the rim is in or out by chance; a rim point of area A/n
    moved at radius r shifts the centre by r/n.
    """
    n = len(mark.points)
    radius = np.sqrt(mark.area_mm2 / np.pi)
    return float(radius / n * np.sqrt(0.25 * 2.0 * np.sqrt(np.pi * n)))


def _mean_normal(surface: Surface, points: np.ndarray) -> FloatArray:
    near = np.zeros(len(surface.points_mm), dtype=np.bool_)
    near[points] = True
    total = surface.face_areas_mm2[near[surface.faces].any(axis=1)].sum(axis=0)
    length = float(np.linalg.norm(total))
    if not length > 0.0:
        raise MeshError(f"{surface.name}: no surface at a mark; export the scan with its triangles")
    normal: FloatArray = total / length
    return normal
