"""Layers below the skin: their order, the surface at a depth, and prisms from the core's mesh to the skin.

The surface at depth h is the level h of the distance from the skin, so that it neither folds over itself in
a hollow nor repeats the scan's noise. A layer far thinner than the elements away from the indenter has flat
elements there, in place of many small ones: prisms that are split into three tetrahedra each. One is through
its thickness, or several where one would be much higher than the edges under the indenter, a sliver.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError
from palpate_limb.segment import Segment
from palpate_limb.surfaces import Surface, outwards, solid, surface_of

OUTERMOST = "skin"
Extruded: TypeAlias = tuple[FloatArray, IntArray, IntArray, Mapping[str, IntArray], FloatArray]
THINNEST = 0.3
"""Share of its part of the room above a bone that an inner layer keeps, at least."""


def layer_order(together: Iterable[Sequence[str]]) -> tuple[str, ...]:
    """The only order of all layers, from the outside in, that agrees with every given one.

    Each of ``together`` has layers from the outside in. ``skin`` is the outermost wherever it is named.
    A MeshError names two layers where no order agrees with all of them, or several do.
    """
    graph: TopologicalSorter[str] = TopologicalSorter()
    outermost: tuple[str, ...] = ()
    for names in together:
        if OUTERMOST in names:
            outermost = (OUTERMOST,)
        inner = [name for name in names if name != OUTERMOST]
        for name in inner:
            graph.add(name)
        for above, below in pairwise(inner):
            graph.add(below, above)
    try:
        graph.prepare()
    except CycleError as error:
        first, second, *_ = error.args[1]
        raise MeshError(
            f"layers '{first}' and '{second}': each is named above the other, or above layers that are; name "
            "them in one order, from the outside in, at every spot"
        ) from None
    order: list[str] = []
    while graph.is_active():
        ready = sorted(graph.get_ready())
        if len(ready) > 1:
            raise MeshError(
                f"layers '{ready[0]}' and '{ready[1]}': which one is above the other is not said; name them "
                "together once, from the outside in: both for all spots, or both for one"
            )
        order += ready
        graph.done(*ready)
    return (*outermost, *order)


def below_skin(segment: Segment, depth_mm: float, cover_mm: float = 0.0, spacing_mm: float = 1.2) -> Surface:
    """The closed surface at a depth below the skin, a little longer than the segment.

    Bones nearer to the skin are below it too, with ``cover_mm`` around them. Distances are taken on a grid of
    ``spacing_mm``. A MeshError where nothing is left so deep.
    """
    from skimage.measure import marching_cubes

    half = 0.5 * segment.length_mm + 4.0 * spacing_mm
    along = segment.axis.tolist()
    piece = surface_of(
        solid(segment.skin)
        .trim_by_plane(along, -half - 3.0 * depth_mm)
        .trim_by_plane((-segment.axis).tolist(), -half - 3.0 * depth_mm),
        "skin",
    )
    origin = piece.points_mm.min(axis=0) - 2.0 * spacing_mm
    ends = piece.points_mm.max(axis=0) + 2.0 * spacing_mm
    counts = np.ceil((ends - origin) / spacing_mm).astype(int) + 1
    axes = [origin[i] + spacing_mm * np.arange(counts[i]) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def distance(surface: Surface, level_mm: float) -> FloatArray:
        sides = np.abs(surface.points_mm @ segment.axis) < half + 3.0 * level_mm + 10.0
        faces = surface.faces[sides[surface.faces].any(axis=1)]
        return _distances(replace(surface, faces=faces), grid, level_mm, spacing_mm)

    off = distance(segment.skin, depth_mm)
    depth = np.where(_inside(segment.skin, grid, off > 3.0 * spacing_mm), off, -off)
    # A lid past either cut, so that the level is a closed surface.
    depth = np.minimum(depth, depth_mm + half - np.abs(grid @ segment.axis))
    if depth.max() <= depth_mm:
        raise MeshError(f"a layer of {depth_mm:g} mm leaves nothing below it; make it thinner")
    for bone in segment.bones if cover_mm else ():
        around = depth_mm + cover_mm - distance(bone, cover_mm)
        depth = np.maximum(depth, np.minimum(around, depth_mm + half - np.abs(grid @ segment.axis)))
    points, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        depth, depth_mm, spacing=(spacing_mm,) * 3, gradient_direction="descent"
    )
    surface = Surface(
        name="below skin", points_mm=points.astype(np.float64) + origin, faces=faces.astype(np.int64)
    )
    return outwards(surface)


def _distances(surface: Surface, grid: FloatArray, level_mm: float, spacing_mm: float) -> FloatArray:
    """Distances (l, m, n) of a grid (l, m, n, 3) from a surface: exact near the level, rough elsewhere."""
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import cKDTree
    from trimesh.remesh import subdivide_to_size

    # So dense that the nearest sample is as good as the nearest point of a triangle, s²/8d farther at most.
    samples, _ = subdivide_to_size(  # type: ignore[no-untyped-call]
        surface.points_mm,
        surface.faces,
        max_edge=spacing_mm * max(0.5, float(np.sqrt(level_mm / 8.0))),
        max_iter=12,
    )
    # The distance between voxels is off by less than two spacings: it finds where the level may be.
    free = np.ones(grid.shape[:3], dtype=np.bool_)
    voxels = np.round((samples - grid[0, 0, 0]) / spacing_mm).astype(int)
    free[tuple(voxels[((voxels >= 0) & (voxels < free.shape)).all(axis=1)].T)] = False
    if free.all():
        return np.full(free.shape, np.inf)
    distance: FloatArray = spacing_mm * distance_transform_edt(free)
    near = np.abs(distance - level_mm) < 4.0 * spacing_mm
    distance[near] = cKDTree(samples).query(grid[near])[0]
    return distance


def _inside(skin: Surface, grid: FloatArray, away: BoolArray) -> BoolArray:
    """Mask (l, m, n) of the points (l, m, n, 3) of a grid that are inside of the skin.

    No face lies between neighbours that are both ``away`` from the skin by more than their spacing, so some
    points answer for all that hang together: rays for each of them would take most of the time. Where those
    points disagree, at the end of a scan for example, each of all has its own ray.
    """
    from scipy.ndimage import label

    parts, n_parts = label(away)
    inside = np.zeros(away.shape, dtype=np.bool_)
    inside[~away] = skin.contains(grid[~away])
    for number in range(1, n_parts + 1):
        part = parts == number
        points = grid[part]
        # Points of a part of a grid, about, that decide whether it is inside.
        some = points[:: max(1, len(points) // 50)]  # one ray may meet an edge
        share = skin.contains(some).mean()
        inside[part] = share > 0.5 if abs(share - 0.5) > 0.4 else skin.contains(points)
    return inside


def extruded(
    points: FloatArray,
    tets: IntArray,
    boundary: Mapping[str, IntArray],
    skin: Surface,
    depths_mm: Sequence[float],
    highest_mm: float = np.inf,
    room_mm: FloatArray | None = None,
) -> Extruded:
    """Layers added to the mesh of the core: points, tetrahedra, their layers, boundary, depths of nodes.

    The depth of a node is the distance from the skin at which it belongs, NaN in the core.

    The core has ``points`` (n, 3), ``tets`` (m, 4) and a ``boundary`` of triangles (k, 3): outwards ``skin``,
    to which layers are added as far as the limb's ``skin``, ``cut`` and bones. ``depths_mm`` are depths of
    the lower surface of each layer, from the outside in; all are thinner where there is less ``room_mm`` (n,)
    below the skin. A layer has several elements through its thickness where one would be higher than
    ``highest_mm``.
    """
    faces = boundary["skin"]
    nodes, local = np.unique(faces, return_inverse=True)
    room = np.full(len(nodes), np.inf) if room_mm is None else room_mm[nodes]
    rows, counts, layer_of = _rows(_levels(depths_mm, room), highest_mm)
    starts = len(points) + np.cumsum(counts[-1]) - counts[-1]
    ids = np.where(counts == counts[-1], nodes, starts + counts)  # from the skin down to the core's own
    placed, depths = _placed(points, nodes, skin.nearest(points[nodes])[0], ids, rows)
    triangles = np.sort(local.reshape(-1, 3), axis=1)  # one diagonal for the two prisms of a side
    prisms = [_whole(_split(below[triangles.T], above[triangles.T])) for above, below in pairwise(ids)]
    regions = [np.full(len(prism), layer) for prism, layer in zip(prisms, layer_of, strict=True)]
    return (
        placed,
        np.concatenate([tets, *prisms]),
        np.concatenate([np.full(len(tets), len(depths_mm)), *regions]),
        {
            **boundary,
            "skin": ids[0][local.reshape(-1, 3)],
            "cut": np.concatenate([boundary["cut"], *map(_whole, _sides(boundary["cut"], faces, ids))]),
        },
        depths,
    )


def _placed(
    points: FloatArray, nodes: IntArray, top: FloatArray, ids: IntArray, rows: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points with the layers' points, which divide the way from the core to the skin, and their depths."""
    placed = np.concatenate([points, np.empty((ids.max() + 1 - len(points), 3))])
    depths = np.full(len(placed), np.nan)
    for row_ids, depth in zip(ids, rows, strict=True):
        depths[row_ids] = depth
        placed[row_ids] = top + (depth / rows[-1])[:, None] * (points[nodes] - top)
    placed[nodes] = points[nodes]  # without rounding
    return placed, depths


def _levels(depths_mm: Sequence[float], room_mm: FloatArray) -> FloatArray:
    """Depths (n_layers + 1, n) of the surfaces of the layers at nodes with so much room below the skin.

    Where not all layers fit, the inner ones are thinner first, down to :data:`THINNEST` of their part.
    """
    depths = np.array([0.0, *depths_mm])[:, None]
    room = np.minimum(room_mm, depths[-1])
    found: FloatArray = np.minimum(depths, room * (1.0 - THINNEST * (1.0 - depths / depths[-1])))
    found[0] = 0.0
    return found


def _rows(levels: FloatArray, highest_mm: float) -> tuple[FloatArray, IntArray, list[int]]:
    """Depths (n_rows, n) of the nodes through the layers, their numbers at each place, layers between rows.

    A layer has fewer elements through it where it is thinner than elsewhere: rows share a node there.
    """
    rows, counts, layers = [levels[0]], [np.zeros(levels.shape[1], dtype=np.int64)], []
    for layer, (upper, lower) in enumerate(pairwise(levels)):
        n_here = np.maximum(np.ceil((lower - upper) / highest_mm - 1e-9), 1.0)
        n, start = int(n_here.max()), counts[-1]
        for step in np.round(np.arange(1, n + 1)[:, None] * n_here / n):
            rows.append(upper + step / n_here * (lower - upper))
            counts.append(start + step.astype(np.int64))
            layers.append(layer)
    return np.array(rows), np.array(counts), layers


def _split(lower: IntArray, upper: IntArray) -> IntArray:
    """Three tetrahedra for each prism between triangles (3, n), corners in ascending order."""
    (a, b, c), (d, e, f) = lower, upper
    return np.concatenate([np.stack(tet, axis=1) for tet in ((a, b, c, f), (a, b, e, f), (a, d, e, f))])


def _whole(cells: IntArray) -> IntArray:
    """The cells (n, k) without those that have a node twice."""
    ordered = np.sort(cells, axis=1)
    distinct: BoolArray = (ordered[:, 1:] != ordered[:, :-1]).all(axis=1)
    return cells[distinct]


def _sides(cut: IntArray, faces: IntArray, ids: IntArray) -> list[IntArray]:
    """Triangles (n, 3) of each layer on the cuts: the sides of prisms over edges of the cut's rim."""
    edges = [np.sort(f[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1) for f in (cut, faces)]
    n = int(max(e.max() for e in edges)) + 1
    keys = np.intersect1d(*(e @ np.array([n, 1]) for e in edges))
    rim = np.searchsorted(ids[-1], np.stack([keys // n, keys % n], axis=1))
    found = []
    for upper, lower in pairwise(ids):
        (a, b), (d, e) = lower[rim].T, upper[rim].T
        found.append(np.concatenate([np.stack(face, axis=1) for face in ((a, b, e), (a, d, e))]))
    return found
