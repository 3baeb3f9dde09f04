"""What is wrong with a surface, with coordinates, and its repair by MeshFix."""

import contextlib
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray, MeshError
from palpate_limb.openings import closed, largest, parts
from palpate_limb.surfaces import Surface, edge_uses, parts_of

LIMB_MM = (60.0, 1500.0)
"""The longest side of the box around a limb, between a child's wrist and an adult's leg."""
BONE_MM = (10.0, 1500.0)
MOST_CROSSING, MOST_ROUNDS = 40, 4
"""Faces that are cut out where they cross, at a time, and how often."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Defect:
    """One kind of defect: what it is, how many, and where the first one is."""

    what: str
    count: int
    place_mm: tuple[float, float, float]

    def __str__(self) -> str:
        x, y, z = self.place_mm
        return f"{self.count} {self.what}, first near ({x:.4g}, {y:.4g}, {z:.4g}) mm"


def check_size(surface: Surface, between_mm: tuple[float, float], unit: str) -> None:
    """Refuse a surface in another unit.

    Raises
    ------
    MeshError
        With the size found, and the unit that would make it plausible.
    """
    longest = float(np.ptp(surface.points_mm, axis=0).max())
    low, high = between_mm
    if low <= longest <= high:
        return
    factors = {"m": 1000.0, "cm": 10.0, "inch": 25.4, "um": 1e-3}
    fits = [other for other, factor in factors.items() if low <= longest * factor <= high]
    hint = f"its unit is perhaps {' or '.join(fits)}: say so" if fits and unit == "mm" else "check its unit"
    raise MeshError(
        f"{surface.name}: {longest:.4g} mm long when read in {unit}, and {low:g} to {high:g} mm is "
        f"plausible; {hint}"
    )


def defects(surface: Surface) -> list[Defect]:
    """Holes, edges of more than two faces, several components, faces that intersect."""
    return list(_defects(surface))


def _defects(surface: Surface) -> Iterator[Defect]:
    points = surface.points_mm
    edges, counts = edge_uses(surface.faces)
    if (counts == 1).any():
        rim = edges[counts == 1]
        loops = np.unique(parts_of(len(points), rim)[rim[:, 0]]).size
        yield _defect("holes", loops, points[rim[0]].mean(axis=0))
    if (counts > 2).any():
        worst = edges[counts > 2]
        yield _defect("edges of more than two faces", len(worst), points[worst[0]].mean(axis=0))
    labels = parts_of(len(points), edges)
    if labels.max() > 0:
        sizes = np.bincount(labels)
        other = int(np.flatnonzero(labels != sizes.argmax())[0])
        yield _defect("parts besides the largest", len(sizes) - 1, points[other])
    if (counts <= 2).all():
        crossing = _intersecting(surface)
        if crossing.size:
            yield _defect(
                "faces that intersect", len(crossing), points[surface.faces[crossing[0]]].mean(axis=0)
            )


def _defect(what: str, count: int, place: FloatArray) -> Defect:
    return Defect(what=what, count=count, place_mm=(float(place[0]), float(place[1]), float(place[2])))


def _intersecting(surface: Surface) -> IntArray:
    """Faces that an edge of another face passes through, by casting a ray along every edge."""
    points, body = surface.points_mm, surface.trimesh
    edges, _ = edge_uses(surface.faces)
    start = points[edges[:, 0]]
    along = points[edges[:, 1]] - start
    length = np.linalg.norm(along, axis=1)
    direction = along / length[:, None]
    # A little inwards of both ends, where the edge's own neighbours are.
    faces, rays, places = body.ray.intersects_id(
        start + 0.02 * along, direction, multiple_hits=True, max_hits=2, return_locations=True
    )
    faces, rays = np.asarray(faces, dtype=np.int64), np.asarray(rays, dtype=np.int64)
    travelled = np.linalg.norm(np.asarray(places).reshape(-1, 3) - start[rays], axis=1)
    touching = (surface.faces[faces][:, :, None] == edges[rays][:, None, :]).any(axis=(1, 2))
    crossing = (travelled < 0.98 * length[rays]) & ~touching
    return np.unique(faces[crossing])


def repaired(surface: Surface) -> Surface:
    """The surface, closed and without crossing faces.

    A few crossing faces are cut out and the gaps closed; what that does not repair, MeshFix does:
    it keeps the largest part and loses the colours. ``repairs`` says what was wrong and how far
    points moved or fell away. A surface without defects comes back as it is.

    Raises
    ------
    MeshError
        Nothing is left, it cannot be closed, or MeshFix is not installed.
    """
    if not (found := defects(surface)):
        return surface
    if (whole := _without_crossings(surface)) is not None:
        return replace(whole, repairs=_repairs(surface, found, whole))
    try:
        import pymeshfix
    except ModuleNotFoundError:
        raise MeshError(
            f"{surface.name}: {'; '.join(map(str, found))}; fix it in a mesh editor, or let MeshFix (AGPL) "
            'do it: pip install "palpate-limb[repair]"'
        ) from None
    fixer = pymeshfix.MeshFix(surface.points_mm, surface.faces.astype(np.int32))
    with _silenced():
        fixer.repair()
    points, faces = np.asarray(fixer.points, dtype=np.float64), np.asarray(fixer.faces, dtype=np.int64)
    fixed = Surface(name=surface.name, points_mm=points, faces=faces)
    left = defects(fixed) if len(faces) else found
    if left or fixed.volume_mm3 <= 0.0:
        raise MeshError(
            f"{surface.name}: cannot be repaired ({'; '.join(map(str, left)) or 'it is inside out'}); "
            "fix it in a mesh editor"
        )
    return replace(fixed, repairs=_repairs(surface, found, fixed))


def _without_crossings(surface: Surface) -> Surface | None:
    """The surface with few crossing faces cut out and closed again; None where that does not help."""
    now = surface
    for _ in range(MOST_ROUNDS):
        if (edge_uses(now.faces)[1] != 2).any():
            return None
        crossing = _intersecting(now)
        if not crossing.size:
            return None if defects(now) else now
        if crossing.size > MOST_CROSSING:
            return None
        # With every face that shares a point: what is left then folds nowhere.
        out = np.isin(now.faces, now.faces[crossing]).any(axis=1)
        now = closed(largest(parts(replace(now, faces=now.faces[~out], caps=None))))
    return None


def _repairs(surface: Surface, found: list[Defect], fixed: Surface) -> str:
    """What was repaired, and the place of the old surface that is furthest from the new one."""
    corners = surface.points_mm[np.unique(surface.faces)]
    _, gaps = fixed.nearest(corners)
    x, y, z = corners[gaps.argmax()]
    before = f"{surface.repairs}; " if surface.repairs else ""
    return (
        f"{before}{'; '.join(map(str, found))}; repaired, and changed by {gaps.max():.2g} mm at most, near "
        f"({x:.4g}, {y:.4g}, {z:.4g}) mm"
    )


@contextlib.contextmanager
def _silenced() -> Iterator[None]:
    """Keep MeshFix, which writes to the process's own output, from the terminal."""
    with contextlib.redirect_stdout(io.StringIO()), open(os.devnull, "w") as sink:
        kept = [os.dup(1), os.dup(2)]
        try:
            os.dup2(sink.fileno(), 1)
            os.dup2(sink.fileno(), 2)
            yield
        finally:
            for number, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, number)
                os.close(copy)
