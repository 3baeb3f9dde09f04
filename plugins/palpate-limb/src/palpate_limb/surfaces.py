"""Triangulated surfaces, read from files, and the only door to the libraries that compute with them."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, MeshError, convert
from palpate_limb.colours import other_columns, point_colours

if TYPE_CHECKING:
    import trimesh

SUFFIXES = frozenset({".ply", ".obj", ".glb", ".stl", ".off"})
MOST_BYTES = 2_000_000_000
MOST_FACES = 5_000_000
LIMB_MM = (60.0, 1500.0)
"""The longest side of the box around a limb, between a child's wrist and an adult's leg."""
THICK_MM = (15.0, 260.0)
"""Diameter of a cylinder of the limb's length and volume, between a child's wrist and a thigh."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A triangulated surface, outward by the right-hand rule where it is closed.

    Messages call it by its name, a file's or a bone's. Points are (n, 3), faces (m, 3), and colours (n, 3)
    the sRGB of each point, 0 to 1; ``columns`` are other properties of its points. ``repairs`` states what
    was wrong and has been repaired, and ``caps`` (k,) are faces that close an opening and are no skin.
    """

    name: str
    points_mm: FloatArray
    faces: IntArray
    colours: FloatArray | None = None
    repairs: str = ""
    columns: tuple[str, ...] = ()
    caps: IntArray | None = None

    def moved(self, motion: FloatArray) -> "Surface":
        """The surface after a rigid motion (4, 4)."""
        return replace(self, points_mm=self.points_mm @ motion[:3, :3].T + motion[:3, 3])

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
        return np.asarray(0.5 * np.cross(b - a, c - a))

    @property
    def point_areas_mm2(self) -> FloatArray:
        """Area (n,) that belongs to each point: a third of its faces'."""
        areas = np.linalg.norm(self.face_areas_mm2, axis=1)
        total = np.bincount(self.faces.ravel(), np.repeat(areas / 3.0, 3), minlength=len(self.points_mm))
        return np.asarray(total, dtype=np.float64)

    def contains(self, points_mm: FloatArray) -> BoolArray:
        """Mask (n,) of the points (n, 3) that lie inside of the closed surface."""
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
    free[body.face_adjacency_edges[body.face_adjacency_angles > np.deg2rad(40.0)]] = 0.0
    mean = diags(free) @ laplacian_calculation(body) + diags(1.0 - free)
    body = filter_taubin(  # type: ignore[no-untyped-call]
        body, lamb=0.5, nu=0.53, iterations=n_rounds, laplacian_operator=mean
    )
    return replace(surface, points_mm=np.asarray(body.vertices, dtype=np.float64))


AT_ONCE = 2_000
"""Points whose closest triangles are in memory together: 8 kB for each."""


def _like_sized(corners: FloatArray) -> FloatArray | None:
    """The triangles (n, 3, 3), long ones cut into pieces; None where that would be too many."""
    from trimesh.remesh import subdivide_to_size

    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    # Up to twice the mean edge the closest triangle is among the triangles with the closest middles.
    most = 2.0 * float(lengths.mean())
    longest = lengths.max(axis=1)
    large = longest > most
    if not large.any():
        return corners
    halvings = np.ceil(np.log2(longest[large] / most))
    if (4.0**halvings).sum() > 400_000:
        return None
    points, faces = subdivide_to_size(  # type: ignore[no-untyped-call]
        corners[large].reshape(-1, 3), np.arange(3 * large.sum()).reshape(-1, 3), max_edge=most, max_iter=30
    )
    return np.concatenate([corners[~large], np.asarray(points, dtype=np.float64)[faces]])


def _among_likely(corners: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Closest points of the triangles whose middles are closest: a search tree instead of boxes."""
    from scipy.spatial import cKDTree
    from trimesh.triangles import closest_point

    n_likely = min(24, len(corners))
    tree = cKDTree(corners.mean(axis=1))
    closest, distances = np.empty((len(points), 3)), np.empty(len(points))
    for start in range(0, len(points), AT_ONCE):
        some = points[start : start + AT_ONCE]
        likely = tree.query(some, k=n_likely)[1].reshape(len(some), n_likely)
        on = closest_point(  # type: ignore[no-untyped-call]
            corners[likely.ravel()], np.repeat(some, n_likely, axis=0)
        ).reshape(-1, n_likely, 3)
        away = np.linalg.norm(on - some[:, None], axis=2)
        best, row = away.argmin(axis=1), np.arange(len(some))
        closest[start : start + AT_ONCE], distances[start : start + AT_ONCE] = on[row, best], away[row, best]
    return closest, distances


def solid(surface: Surface) -> Any:  # noqa: ANN401 - manifold3d has no types
    """The surface as a solid for Boolean operations; a MeshError where it is not closed and manifold."""
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


def read_surface(path: Path, unit: str = "mm") -> Surface:
    """Read a surface; equal points are merged, colours of vertices or of a texture are kept.

    Nothing but this file (and its own material and texture next to it) is read. ``unit`` is the unit of
    its coordinates, or how long it is ("365 mm").
    A file that is missing, too large, broken, without triangles or not finite is a MeshError.
    """
    if not path.is_file():
        raise MeshError(f"{path}: no such file; check the path")
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path}: palpate reads surfaces from {', '.join(sorted(SUFFIXES))}; convert it")
    if path.stat().st_size > MOST_BYTES:
        raise MeshError(f"{path}: larger than {MOST_BYTES / 1e9:g} GB; reduce the scan")
    try:
        factor = mm_per_unit(unit)
    except ValueError as error:
        raise MeshError(f"{path}: its unit: {error}") from error
    mesh = _loaded(path)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(getattr(mesh, "faces", ()), dtype=np.int64)
    _check(path, points, faces)
    surface = Surface(
        name=path.name,
        points_mm=points * factor,
        faces=faces,
        colours=_colours(path, mesh),
        columns=other_columns(mesh),
    )
    return _merged(surface)


def _loaded(path: Path) -> Any:  # noqa: ANN401 - a Trimesh
    """A mesh as trimesh reads it; whatever a broken file trips over becomes one error."""
    import trimesh

    complaints = logging.getLogger("trimesh")
    was_disabled, complaints.disabled = complaints.disabled, True
    try:
        resolver = trimesh.resolvers.FilePathResolver(str(path)) if path.suffix.lower() == ".obj" else None
        if resolver is not None:
            _refuse_outside(path)
        with path.open("rb") as stream:
            loaded = trimesh.load(
                stream,
                file_type=path.suffix.lower()[1:],
                process=False,
                resolver=resolver,
                maintain_order=True,
            )
        return loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
    except MeshError:
        raise
    except Exception as error:  # its readers raise anything on a corrupt file
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise MeshError(
            f"{path}: cannot be read ({reason}); export it again, as binary PLY for example"
        ) from error
    finally:
        complaints.disabled = was_disabled


def _refuse_outside(path: Path) -> None:
    """Refuse an OBJ that names a material file elsewhere."""
    with path.open("rb") as stream:
        for line in stream:
            if line.startswith(b"mtllib"):
                named = Path(line[6:].strip().decode(errors="replace"))
                if named.is_absolute() or ".." in named.parts:
                    raise MeshError(
                        f"{path}: its material file '{named}' is outside of its folder; move it there"
                    )


def _check(path: Path, points: FloatArray, faces: Any) -> None:  # noqa: ANN401 - whatever was read
    if points.ndim != 2 or not len(faces) or not len(points):
        raise MeshError(f"{path}: no triangles; export the surface, not the points alone")
    if len(faces) > MOST_FACES:
        raise MeshError(f"{path}: {len(faces)} triangles, and palpate takes {MOST_FACES}; reduce the scan")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise MeshError(f"{path}: point {bad[0]} is at {points[bad[0]].tolist()}; export it again")
    if faces.min() < 0 or faces.max() >= len(points):
        row = int(np.flatnonzero((faces < 0).any(axis=1) | (faces >= len(points)).any(axis=1))[0])
        raise MeshError(
            f"{path}: triangle {row} names points {faces[row].tolist()}, but there are {len(points)}; "
            "export it again"
        )


def _colours(path: Path, mesh: Any) -> FloatArray | None:  # noqa: ANN401 - a Trimesh
    """SRGB of each point, from the vertices or from the texture; None where the file has neither."""
    if mesh.visual.kind != "texture" and (written := point_colours(path, mesh)) is not None:
        return written
    if mesh.visual.kind is None:
        return None
    try:
        visual = mesh.visual.to_color() if mesh.visual.kind == "texture" else mesh.visual
        colours = np.asarray(visual.vertex_colors, dtype=np.float64)[:, :3] / 255.0
    except Exception:  # a texture that cannot be read is no texture
        return None
    return colours if colours.shape == (len(mesh.vertices), 3) else None


def _merged(surface: Surface) -> Surface:
    """Equal points made one (an STL repeats them, a texture splits them), empty triangles dropped."""
    digits = max(0, 7 - int(np.ceil(np.log10(max(float(np.abs(surface.points_mm).max()), 1.0)))))
    _, first, inverse = np.unique(
        np.round(surface.points_mm, digits), axis=0, return_index=True, return_inverse=True
    )
    faces = first[inverse.ravel()][surface.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    kept = np.unique(faces)
    return Surface(
        name=surface.name,
        points_mm=surface.points_mm[kept],
        faces=np.searchsorted(kept, faces),
        colours=None if surface.colours is None else surface.colours[kept],
        columns=surface.columns,
    )


def mm_per_unit(unit: str) -> float:
    """Millimetres of a unit, or of a length such as "365 mm" for a normalised model; else a ValueError."""
    return convert(unit if unit.strip()[:1].isdigit() else f"1 {unit}", "mm")


def guessed_unit(surface: Surface) -> tuple[str, str]:
    """The only unit in which a closed surface is a limb, and why; else a MeshError."""
    long = float(np.ptp(surface.points_mm, axis=0).max())
    thick = float(np.sqrt(4.0 * abs(surface.volume_mm3) / (np.pi * max(long, 1e-300))))
    fits = [
        unit
        for unit, factor in {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}.items()
        if LIMB_MM[0] <= long * factor <= LIMB_MM[1] and THICK_MM[0] <= thick * factor <= THICK_MM[1]
    ]
    size = f"it is {long:.4g} long and about {thick:.3g} thick"
    if len(fits) != 1:
        plausible = " and ".join(fits) or "no unit"
        raise MeshError(
            f"{surface.name}: {size}, which is a limb in {plausible}; say so under unit, such as mm, "
            'or "365 mm" for a model whose unit is that long'
        )
    return fits[0], size
