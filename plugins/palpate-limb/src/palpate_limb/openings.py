"""Stray parts left out and openings closed, so that a surface encloses a volume.

A scan is open where it was cut off, and a model is where it was cut out. A cap there changes nothing as
long as it lies beyond the cuts of a segment, which :func:`palpate_limb.segment.cut` sees to.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray
from palpate_limb.surfaces import Surface, edge_uses, parts_of

STRAY = 0.005
"""Share of a surface's area below which a part is left out."""
FEW_EDGES = 12
"""Of an opening that is closed wherever it is: some triangles are missing."""


def parts(surface: Surface) -> list[Surface]:
    """The connected parts of a surface in its own order, without stray ones.

    ``repairs`` of the largest says how many were left out.
    """
    edges, _ = edge_uses(surface.faces)
    labels = parts_of(len(surface.points_mm), edges)[surface.faces[:, 0]]
    areas = np.bincount(labels, np.linalg.norm(surface.face_areas_mm2, axis=1))
    kept, first = np.unique(labels, return_index=True)
    kept = kept[np.argsort(first)]
    large = kept[areas[kept] >= STRAY * areas.sum()]
    made = [_part(surface, labels == k) for k in large]
    if n_stray := len(kept) - len(large):
        k = int(areas[large].argmax())
        said = f"left out {n_stray} stray {'part' if n_stray == 1 else 'parts'}"
        made[k] = replace(made[k], repairs=_with(made[k].repairs, said))
    return made


def largest(pieces: Sequence[Surface]) -> Surface:
    """The part of the largest area."""
    return max(pieces, key=lambda piece: float(np.linalg.norm(piece.face_areas_mm2, axis=1).sum()))


def joined_parts(pieces: Sequence[Surface]) -> Surface:
    """Several parts as one surface again."""
    first, *others = pieces
    for other in others:
        n = len(first.points_mm)
        colours = None
        if first.colours is not None and other.colours is not None:
            colours = np.concatenate([first.colours, other.colours])
        first = replace(
            first,
            points_mm=np.concatenate([first.points_mm, other.points_mm]),
            faces=np.concatenate([first.faces, other.faces + n]),
            colours=colours,
        )
    return first


def closed(surface: Surface) -> Surface:
    """The surface with a cap over each simple opening; ``caps`` are the faces of the larger ones.

    All stay open where an edge has more than two faces.
    """
    if (edge_uses(surface.faces)[1] > 2).any():
        return surface
    points, faces, colours = surface.points_mm, surface.faces, surface.colours
    caps: list[IntArray] = []
    said = []
    for rim in _rims(faces):
        if len(rim) == 3:
            new = rim[None]
        else:
            new = np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), len(points))])
            if colours is not None:
                colours = np.vstack([colours, colours[rim].mean(axis=0)])
            points = np.vstack([points, points[rim].mean(axis=0)])
        if len(rim) > FEW_EDGES:
            caps.append(np.arange(len(faces), len(faces) + len(new)))
        x, y, z = points[rim].mean(axis=0)
        said.append(f"closed an opening of {len(rim)} edges about ({x:.4g}, {y:.4g}, {z:.4g})")
        faces = np.concatenate([faces, new])
    if not said:
        return surface
    return replace(
        surface,
        points_mm=points,
        faces=faces,
        colours=colours,
        repairs=_with(surface.repairs, "; ".join(said)),
        caps=np.concatenate(caps) if caps else None,
    )


def _with(repairs: str, said: str) -> str:
    return f"{repairs}; {said}" if repairs else said


def _part(surface: Surface, kept: BoolArray) -> Surface:
    used, faces = np.unique(surface.faces[kept], return_inverse=True)
    return replace(
        surface,
        points_mm=surface.points_mm[used],
        faces=faces.reshape(-1, 3),
        colours=None if surface.colours is None else surface.colours[used],
    )


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
