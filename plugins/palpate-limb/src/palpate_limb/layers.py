"""Layers below the skin: their order, the surface at a depth, and prisms from the core's mesh to the skin.

The surface at depth h is the level h of the distance from the skin, so that it neither folds over itself in
a hollow nor repeats the scan's noise. A layer far thinner than the elements away from the indenter has flat
elements there, in place of many small ones: prisms that are split into three tetrahedra each. One is through
its thickness, or several where one would be much higher than the edges under the indenter, a sliver.
"""

from collections.abc import Iterable, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError
from palpate_limb.segment import Segment
from palpate_limb.surfaces import Surface, outwards, solid, surface_of

OUTERMOST = "skin"
N_RAYS = 50
"""Points of a part of a grid, about, that decide whether it is inside."""


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


def below_skin(segment: Segment, depth_mm: float, spacing_mm: float = 1.2) -> Surface:
    """The closed surface at a depth below the skin, a little longer than the segment.

    The distance is taken on a grid of ``spacing_mm``. A MeshError where nothing is left so deep.
    """
    from scipy.ndimage import distance_transform_edt
    from scipy.spatial import cKDTree
    from skimage.measure import marching_cubes
    from trimesh.remesh import subdivide_to_size

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
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    sides = np.abs(segment.skin.points_mm @ segment.axis) < half + 3.0 * depth_mm + 10.0
    # So dense that the nearest sample is as good as the nearest point of a triangle, s²/8d farther at most.
    samples, _ = subdivide_to_size(  # type: ignore[no-untyped-call]
        segment.skin.points_mm,
        segment.skin.faces[sides[segment.skin.faces].any(axis=1)],
        max_edge=spacing_mm * max(0.5, float(np.sqrt(depth_mm / 8.0))),
        max_iter=12,
    )
    # The distance between voxels is off by less than two spacings: it finds where the level may be.
    free = np.ones(counts, dtype=np.bool_)
    voxels = np.round((samples - origin) / spacing_mm).astype(int)
    free[tuple(voxels[((voxels >= 0) & (voxels < counts)).all(axis=1)].T)] = False
    distance = spacing_mm * distance_transform_edt(free).ravel()
    near = np.abs(distance - depth_mm) < 4.0 * spacing_mm
    distance[near] = cKDTree(samples).query(grid[near])[0]
    inside = _inside(segment.skin, grid.reshape(*counts, 3), distance.reshape(counts) > 3.0 * spacing_mm)
    depth = np.where(inside.ravel(), distance, -distance)
    # A lid past either cut, so that the level is a closed surface.
    depth = np.minimum(depth, depth_mm + half - np.abs(grid @ segment.axis)).reshape(counts)
    if depth.max() <= depth_mm:
        raise MeshError(f"a layer of {depth_mm:g} mm leaves nothing below it; make it thinner")
    points, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        depth, depth_mm, spacing=(spacing_mm,) * 3, gradient_direction="descent"
    )
    surface = Surface(
        name="below skin", points_mm=points.astype(np.float64) + origin, faces=faces.astype(np.int64)
    )
    return outwards(surface)


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
        some = points[:: max(1, len(points) // N_RAYS)]  # one ray may meet an edge
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
) -> tuple[FloatArray, IntArray, IntArray, dict[str, IntArray]]:
    """Layers added to the mesh of the core: points (n', 3), tetrahedra (m', 4), their layers (m',), boundary.

    The core has ``points`` (n, 3), ``tets`` (m, 4) and a ``boundary`` of triangles (k, 3): outwards ``skin``,
    to which layers are added as far as the limb's ``skin``, ``cut`` and bones. ``depths_mm`` are those of the
    lower surface of each layer, from the outside in; a layer has several elements through its thickness where
    one would be higher than ``highest_mm``.
    """
    n_each = [int(np.ceil(thickness / highest_mm)) or 1 for thickness in np.diff([0.0, *depths_mm])]
    layer_of = np.repeat(np.arange(len(n_each)), n_each)
    rows = np.cumsum([0, *n_each])
    depths_mm = np.interp(np.arange(rows[-1] + 1), rows, [0.0, *depths_mm])[1:].tolist()
    faces, n_layers = boundary["skin"], len(depths_mm)
    nodes, local = np.unique(faces, return_inverse=True)
    bottom = points[nodes]
    top, _ = skin.nearest(bottom)
    shares = np.array([0.0, *depths_mm[:-1]]) / depths_mm[-1]
    levels = [top + share * (bottom - top) for share in shares]
    # Row i has the nodes of level i, from the skin down to the core's own.
    ids = np.vstack([len(points) + np.arange(n_layers * len(nodes)).reshape(n_layers, -1), nodes])
    triangles = np.sort(local.reshape(-1, 3), axis=1)  # one diagonal for the two prisms of a side
    prisms = [_split(ids[i + 1][triangles], ids[i][triangles]) for i in range(n_layers)]
    sides = _sides(boundary["cut"], faces, ids)
    found = {
        **boundary,
        "skin": ids[0][local.reshape(-1, 3)],
        "cut": np.concatenate([boundary["cut"], *sides]),
    }
    regions = [np.full(len(prism), i) for i, prism in zip(layer_of, prisms, strict=True)]
    return (
        np.concatenate([points, *levels]),
        np.concatenate([tets, *prisms]),
        np.concatenate([np.full(len(tets), len(n_each)), *regions]),
        found,
    )


def _split(lower: IntArray, upper: IntArray) -> IntArray:
    """Three tetrahedra for each prism between triangles (n, 3), corners in ascending order."""
    (a, b, c), (d, e, f) = lower.T, upper.T
    return np.concatenate([np.stack(tet, axis=1) for tet in ((a, b, c, f), (a, b, e, f), (a, d, e, f))])


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
