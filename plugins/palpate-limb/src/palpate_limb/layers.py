"""Layers below the skin: the surface at a given depth, by distance and not by moving points.

The surface at depth h is the level h of the distance from the skin, so that it
neither folds over itself in a hollow nor repeats the scan's noise.
"""

import numpy as np

from palpate.api import FloatArray, MeshError
from palpate_limb.segment import Segment
from palpate_limb.surfaces import Surface, outwards, solid, surface_of


def below_skin(segment: Segment, depth_mm: float, spacing_mm: float = 1.2) -> Surface:
    """The closed surface at a depth below the skin, a little longer than the segment.

    Parameters
    ----------
    segment : Segment
    depth_mm : float
    spacing_mm : float
        Of the grid on which the distance is taken.

    Raises
    ------
    MeshError
        Nothing is left so deep.
    """
    from scipy.spatial import cKDTree
    from skimage.measure import marching_cubes

    half = 0.5 * segment.length_mm + 4.0 * spacing_mm
    along = segment.axis.tolist()
    piece = surface_of(
        solid(segment.skin)
        .trim_by_plane(along, -half - 3.0 * depth_mm)
        .trim_by_plane((-segment.axis).tolist(), -half - 3.0 * depth_mm),
        "skin",
    )
    origin, shape, grid = _grid(piece, spacing_mm)
    sides = np.abs(segment.skin.points_mm @ segment.axis) < half + 3.0 * depth_mm + 10.0
    samples = _samples(segment.skin, sides, spacing_mm)
    distance, _ = cKDTree(samples).query(grid, distance_upper_bound=depth_mm + 3.0 * spacing_mm)
    distance = np.minimum(distance, depth_mm + 3.0 * spacing_mm)
    depth = np.where(segment.skin.contains(grid), distance, -distance)
    # A lid past either cut, so that the level is a closed surface.
    depth = np.minimum(depth, depth_mm + half - np.abs(grid @ segment.axis)).reshape(shape)
    if depth.max() <= depth_mm:
        raise MeshError(f"a layer of {depth_mm:g} mm leaves nothing below it; make it thinner")
    points, faces, _, _ = marching_cubes(  # type: ignore[no-untyped-call]
        depth, depth_mm, spacing=(spacing_mm,) * 3, gradient_direction="descent"
    )
    surface = Surface(
        name="below skin", points_mm=points.astype(np.float64) + origin, faces=faces.astype(np.int64)
    )
    return outwards(surface)


def _grid(piece: Surface, spacing: float) -> tuple[FloatArray, tuple[int, ...], FloatArray]:
    """Origin, shape and points (n, 3) of a grid around a surface."""
    low, high = piece.points_mm.min(axis=0) - 2.0 * spacing, piece.points_mm.max(axis=0) + 2.0 * spacing
    counts = np.ceil((high - low) / spacing).astype(int) + 1
    axes = [low[i] + spacing * np.arange(counts[i]) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return low, tuple(int(c) for c in counts), points


def _samples(skin: Surface, kept: np.ndarray, spacing: float) -> FloatArray:
    """Points of the skin so dense that the nearest is as good as the nearest point of a triangle."""
    from trimesh.remesh import subdivide_to_size

    faces = skin.faces[kept[skin.faces].any(axis=1)]
    points, _ = subdivide_to_size(  # type: ignore[no-untyped-call]
        skin.points_mm, faces, max_edge=0.5 * spacing, max_iter=12
    )
    return np.asarray(points, dtype=np.float64)
