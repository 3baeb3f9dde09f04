"""Surfaces that enclose a volume: stray parts left out, openings closed, defects found and repaired.

A scan is open where it was cut off, and a model is where it was cut out. A cap there changes nothing as
long as it lies beyond the cuts of a segment, which :func:`palpate_limb.segment.cut` sees to.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.api import FloatArray, IntArray, MeshError
from palpate_limb.surfaces import Surface, edge_uses, joined, parts_of

BONE_MM = (10.0, 1500.0)
MOST_CROSSING, MOST_ROUNDS = 40, 4
"""Faces that are cut out where they cross, at a time, and how often."""


def parts(surface: Surface) -> list[Surface]:
    """The connected parts of a surface in its own order, without stray ones.

    ``repairs`` of the largest states how many were left out.
    """
    edges, _ = edge_uses(surface.faces)
    labels = parts_of(len(surface.points_mm), edges)[surface.faces[:, 0]]
    areas = np.bincount(labels, np.linalg.norm(surface.face_areas_mm2, axis=1))
    kept, first = np.unique(labels, return_index=True)
    kept = kept[np.argsort(first)]
    # Share of a surface's area below which a part is left out.
    large = kept[areas[kept] >= 0.005 * areas.sum()]
    n_stray, made = len(kept) - len(large), []
    for k in large:
        used, faces = np.unique(surface.faces[labels == k], return_inverse=True)
        done = f"left out {n_stray} stray {'part' if n_stray == 1 else 'parts'}"
        made.append(
            replace(
                surface,
                points_mm=surface.points_mm[used],
                faces=faces.reshape(-1, 3),
                colours=None if surface.colours is None else surface.colours[used],
                repairs=with_repair(surface.repairs, done if n_stray and k == areas.argmax() else ""),
            )
        )
    return made


def largest(pieces: Sequence[Surface]) -> Surface:
    """The part of the largest area."""
    return max(pieces, key=lambda piece: float(np.linalg.norm(piece.face_areas_mm2, axis=1).sum()))


def joined_parts(pieces: Sequence[Surface]) -> Surface:
    """Several parts of one surface as one again."""
    points, faces = joined(pieces)
    colours = [piece.colours for piece in pieces if piece.colours is not None]
    return replace(
        pieces[0], points_mm=points, faces=faces, colours=np.concatenate(colours) if colours else None
    )


def closed(surface: Surface) -> Surface:
    """The surface with a cap over each simple opening; ``caps`` are the faces of the larger ones.

    All stay open where an edge has more than two faces.
    """
    if (edge_uses(surface.faces)[1] > 2).any():
        return surface
    points, faces, colours = surface.points_mm, surface.faces, surface.colours
    caps: list[IntArray] = []
    done = []
    for rim in _rims(faces):
        if len(rim) == 3:
            new = rim[None]
        else:
            new = np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), len(points))])
            if colours is not None:
                colours = np.vstack([colours, colours[rim].mean(axis=0)])
            points = np.vstack([points, points[rim].mean(axis=0)])
        # An opening of fewer edges is closed wherever it is: some triangles are missing.
        if len(rim) > 12:
            caps.append(np.arange(len(faces), len(faces) + len(new)))
        x, y, z = points[rim].mean(axis=0)
        done.append(f"closed an opening of {len(rim)} edges about ({x:.4g}, {y:.4g}, {z:.4g})")
        faces = np.concatenate([faces, new])
    if not done:
        return surface
    return replace(
        surface,
        points_mm=points,
        faces=faces,
        colours=colours,
        repairs=with_repair(surface.repairs, "; ".join(done)),
        caps=np.concatenate(caps) if caps else None,
    )


def with_repair(repairs: str, done: str) -> str:
    """Repairs of a surface and what was done more; either may be empty."""
    return "; ".join(filter(None, (repairs, done)))


def _rims(faces: IntArray) -> list[IntArray]:
    """Points of each closed rim, in the order in which a cap has to run; rims that touch come apart."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, inverse, counts = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    # A cap runs against the face at its edge, so its edge a, b is the face's b, a.
    after: dict[int, list[int]] = {}
    for end, start in directed[counts[inverse.ravel()] == 1].tolist():
        after.setdefault(start, []).append(end)
    loops = []
    while after:
        path = [next(iter(after))]
        while path and (ends := after.get(path[-1])):
            if len(ends) == 1:
                del after[path[-1]]
            here = ends.pop()
            if here in path:
                at = path.index(here)
                if len(path) - at > 2:
                    loops.append(np.array(path[at:]))
                path = path[:at]
            path.append(here)
        if path and path[-1] not in after and len(path) > 1:
            break  # faces that do not agree on a side: no cap
    return sorted(loops, key=lambda loop: int(loop.min()))


def extent(surface: Surface, axis: FloatArray) -> tuple[float, float]:
    """Least and largest coordinate along an axis."""
    along = surface.points_mm @ axis
    return float(along.min()), float(along.max())


def check_size(surface: Surface, between_mm: tuple[float, float], unit: str) -> None:
    """Refuse a surface in another unit, by a MeshError with the size found and the unit that would fit."""
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


def defects(surface: Surface) -> list[str]:
    """Holes, edges of more than two faces, several components, faces that intersect: how many, and where."""
    points, found = surface.points_mm, []

    def note(what: str, count: int, place: FloatArray) -> None:
        x, y, z = place
        found.append(f"{count} {what}, first near ({x:.4g}, {y:.4g}, {z:.4g}) mm")

    edges, counts = edge_uses(surface.faces)
    if (counts == 1).any():
        rim = edges[counts == 1]
        loops = np.unique(parts_of(len(points), rim)[rim[:, 0]]).size
        note("holes", loops, points[rim[0]].mean(axis=0))
    if (counts > 2).any():
        worst = edges[counts > 2]
        note("edges of more than two faces", len(worst), points[worst[0]].mean(axis=0))
    labels = parts_of(len(points), edges)
    if labels.max() > 0:
        sizes = np.bincount(labels)
        other = int(np.flatnonzero(labels != sizes.argmax())[0])
        note("parts besides the largest", len(sizes) - 1, points[other])
    if (counts <= 2).all():
        crossing = _intersecting(surface)
        if crossing.size:
            note("faces that intersect", len(crossing), points[surface.faces[crossing[0]]].mean(axis=0))
    return found


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
    it keeps the largest part and loses the colours. ``repairs`` states what was wrong and how far
    points moved or fell away. A surface without defects comes back as it is.
    What cannot be repaired, or not without MeshFix where that is not installed, is a MeshError.
    """
    if not (found := defects(surface)):
        return surface
    if (whole := _without_crossings(surface)) is not None:
        return replace(whole, repairs=_repairs(surface, found, whole))
    try:
        import pymeshfix
    except ModuleNotFoundError:
        raise MeshError(
            f"{surface.name}: {'; '.join(found)}; fix it in a mesh editor, or let MeshFix (AGPL) "
            'do it: pip install "palpate-limb[repair]"'
        ) from None
    fixer = pymeshfix.MeshFix(surface.points_mm, surface.faces.astype(np.int32))
    fixer.repair()
    points, faces = np.asarray(fixer.points, dtype=np.float64), np.asarray(fixer.faces, dtype=np.int64)
    fixed = Surface(name=surface.name, points_mm=points, faces=faces)
    left = defects(fixed) if len(faces) else found
    if left or fixed.volume_mm3 <= 0.0:
        raise MeshError(
            f"{surface.name}: cannot be repaired ({'; '.join(left) or 'it is inside out'}); "
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
        # With every face that shares a point: the remaining surface then folds nowhere.
        out = np.isin(now.faces, now.faces[crossing]).any(axis=1)
        now = closed(largest(parts(replace(now, faces=now.faces[~out], caps=None))))
    return None


def _repairs(surface: Surface, found: list[str], fixed: Surface) -> str:
    """Repairs that were made, and the place of the old surface that is furthest from the new one."""
    corners = surface.points_mm[np.unique(surface.faces)]
    _, gaps = fixed.nearest(corners)
    x, y, z = corners[gaps.argmax()]
    return with_repair(
        surface.repairs,
        f"{'; '.join(found)}; repaired, and changed by {gaps.max():.2g} mm at most, near "
        f"({x:.4g}, {y:.4g}, {z:.4g}) mm",
    )
