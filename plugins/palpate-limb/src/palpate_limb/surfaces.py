"""Triangulated surfaces, and the only door to the libraries that compute with them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A triangulated surface, outward by the right-hand rule where it is closed.

    Messages call it by its name, a file's or a bone's. Points are (n, 3), faces (m, 3), and colours (n, 3)
    the sRGB of each point, 0 to 1. ``repairs`` says what was wrong and has been repaired, and ``caps`` (k,)
    are faces that close an opening and are no skin.
    """

    name: str
    points_mm: FloatArray
    faces: IntArray
    colours: FloatArray | None = None
    repairs: str = ""
    caps: IntArray | None = None

    def moved(self, motion: FloatArray) -> "Surface":
        """The surface after a rigid motion (4, 4)."""
        points = self.points_mm @ motion[:3, :3].T + motion[:3, 3]
        return replace(self, points_mm=points)

    @property
    def trimesh(self) -> "trimesh.Trimesh":
        """The surface for trimesh, its points in the same order."""
        import trimesh

        return trimesh.Trimesh(self.points_mm, self.faces, process=False)

    @property
    def volume_mm3(self) -> float:
        """Volume by the divergence theorem; meaningful where the surface is closed."""
        a, b, c = np.moveaxis(self.points_mm[self.faces], 1, 0)
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)

    @property
    def face_areas_mm2(self) -> FloatArray:
        """Area of each face times its unit normal: (m, 3)."""
        a, b, c = np.moveaxis(self.points_mm[self.faces], 1, 0)
        areas: FloatArray = 0.5 * np.cross(b - a, c - a)
        return areas

    @property
    def point_areas_mm2(self) -> FloatArray:
        """Area (n,) that belongs to each point: a third of its faces'."""
        areas = np.linalg.norm(self.face_areas_mm2, axis=1)
        total = np.bincount(self.faces.ravel(), np.repeat(areas / 3.0, 3), minlength=len(self.points_mm))
        return np.asarray(total, dtype=np.float64)

    def contains(self, points_mm: FloatArray) -> BoolArray:
        """Which of the points (n, 3) lie inside of the closed surface: (n,)."""
        return np.asarray(self.trimesh.contains(points_mm), dtype=np.bool_)

    def nearest(self, points_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Closest points (n, 3) of the surface, and their distances (n,)."""
        if not len(points_mm):
            return np.empty((0, 3)), np.empty(0)
        corners = _like_sized(self.points_mm[self.faces])
        if corners is None:
            from trimesh.proximity import closest_point

            closest, distances, _ = closest_point(self.trimesh, points_mm)  # type: ignore[no-untyped-call]
        else:
            closest, distances = _among_likely(corners, points_mm)
        return np.asarray(closest, dtype=np.float64), np.asarray(distances, dtype=np.float64)


def outwards(surface: Surface) -> Surface:
    """The closed surface with its faces outward."""
    if surface.volume_mm3 >= 0.0:
        return surface
    return replace(surface, faces=surface.faces[:, ::-1])


def smoothed(surface: Surface, n_rounds: int) -> Surface:
    """The surface without a scanner's noise, by Taubin's filter, which neither shrinks nor swells it.

    A sphere rests on the highest of the bumps below it: noise of 0.05 mm let one phantom's spot
    begin 0.11 mm too early, which took 1.9 % off its force.
    """
    from scipy.sparse import diags
    from trimesh.smoothing import filter_taubin, laplacian_calculation

    if n_rounds < 1:
        return surface
    body = surface.trimesh
    # Rims of flat ends stay where they are: the filter would flare them.
    free = np.ones(len(surface.points_mm))
    free[body.face_adjacency_edges[body.face_adjacency_angles > RIM_RAD]] = 0.0
    mean = diags(free) @ laplacian_calculation(body) + diags(1.0 - free)
    body = filter_taubin(  # type: ignore[no-untyped-call]
        body, lamb=0.5, nu=0.53, iterations=n_rounds, laplacian_operator=mean
    )
    return replace(surface, points_mm=np.asarray(body.vertices, dtype=np.float64))


RIM_RAD = float(np.deg2rad(40.0))
LIKE_SIZED = 2.0
"""Longest edge over the mean one up to which the closest triangle is among those of the closest middles."""
N_LIKELY = 24
MOST_PIECES = 400_000


def _like_sized(corners: FloatArray) -> FloatArray | None:
    """The triangles (n, 3, 3), long ones cut into pieces; None where that would be too many."""
    from trimesh.remesh import subdivide_to_size

    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    most = LIKE_SIZED * float(lengths.mean())
    longest = lengths.max(axis=1)
    large = longest > most
    if not large.any():
        return corners
    halvings = np.ceil(np.log2(longest[large] / most))
    if (4.0**halvings).sum() > MOST_PIECES:
        return None
    points, faces = subdivide_to_size(  # type: ignore[no-untyped-call]
        corners[large].reshape(-1, 3), np.arange(3 * large.sum()).reshape(-1, 3), max_edge=most, max_iter=30
    )
    return np.concatenate([corners[~large], np.asarray(points, dtype=np.float64)[faces]])


def _among_likely(corners: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closest points of the triangles whose middles are closest: a search tree instead of boxes."""
    from scipy.spatial import cKDTree
    from trimesh.triangles import closest_point

    n_likely = min(N_LIKELY, len(corners))
    _, likely = cKDTree(corners.mean(axis=1)).query(points, k=n_likely)
    likely = likely.reshape(len(points), n_likely)
    on = closest_point(  # type: ignore[no-untyped-call]
        corners[likely.ravel()], np.repeat(points, n_likely, axis=0)
    ).reshape(-1, n_likely, 3)
    distances = np.linalg.norm(on - points[:, None], axis=2)
    best = distances.argmin(axis=1)
    row = np.arange(len(points))
    return on[row, best], distances[row, best]


def solid(surface: Surface) -> Any:  # noqa: ANN401 - manifold3d has no types
    """The closed surface as a solid for Boolean operations.

    Raises
    ------
    MeshError
        It is not closed, or not manifold.
    """
    import manifold3d

    # Copies, since it takes no array that is read-only.
    points = np.array(surface.points_mm, dtype=np.float64, order="C")
    body = manifold3d.Manifold(manifold3d.Mesh64(points, np.array(surface.faces, dtype=np.uint64, order="C")))
    if body.status() != manifold3d.Error.NoError:
        raise MeshError(
            f"{surface.name}: not a closed surface ({body.status().name}); repair it, or let palpate "
            "do so where it asks for repair"
        )
    return body


def surface_of(body: Any, name: str) -> Surface:  # noqa: ANN401 - manifold3d has no types
    """The surface of a solid."""
    mesh = body.to_mesh64()
    points = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
    return Surface(name=name, points_mm=points, faces=np.asarray(mesh.tri_verts).astype(np.int64))


def edge_uses(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (k, 2) by ascending nodes, and how many faces use each: (k,)."""
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges, counts = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
    return edges, counts


def joined(surfaces: Sequence[Surface]) -> tuple[FloatArray, IntArray]:
    """Points and faces of several surfaces, one after the other."""
    starts = np.cumsum([0, *(len(surface.points_mm) for surface in surfaces)])
    faces = [surface.faces + at for surface, at in zip(surfaces, starts[:-1], strict=True)]
    return np.concatenate([surface.points_mm for surface in surfaces]), np.concatenate(faces)


def parts_of(n: int, pairs: IntArray) -> IntArray:
    """Number (n,) of the connected part that each of ``n`` items belongs to, linked by pairs (k, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def adjacency(n_points: int, faces: IntArray) -> Any:  # noqa: ANN401 - a sparse array
    """Symmetric 0/1 matrix (n, n) of points that share an edge."""
    from scipy.sparse import coo_array

    edges, _ = edge_uses(faces)
    both = np.concatenate([edges, edges[:, ::-1]])
    return coo_array((np.ones(len(both)), (both[:, 0], both[:, 1])), shape=(n_points, n_points)).tocsr()
