"""Surfaces from files, which trimesh reads for this module alone, and the unit of their numbers."""

import logging
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import FloatArray, MeshError, convert
from palpate_limb.repair import LIMB_MM
from palpate_limb.surfaces import Surface

SUFFIXES = frozenset({".ply", ".obj", ".glb", ".stl", ".off"})
MOST_BYTES = 2_000_000_000
MOST_FACES = 5_000_000
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
THICK_MM = (15.0, 260.0)
"""Diameter of a cylinder of the limb's length and volume, between a child's wrist and a thigh."""


def read_surface(path: Path, unit: str = "mm") -> Surface:
    """Read a surface; equal points are merged, colours of vertices or of a texture are kept.

    Parameters
    ----------
    path : Path
        .ply, .obj, .glb, .stl or .off. Nothing but this file (and its own
        material and texture next to it) is read.
    unit : str
        Of the file's coordinates, or how long it is ("365 mm").

    Raises
    ------
    MeshError
        Missing, too large, broken, without triangles, with coordinates that are not finite, or in a
        unit that is not one of length.
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
    if not hasattr(mesh, "faces"):
        raise MeshError(f"{path}: no triangles; export the surface, not the points alone")
    points, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    _check(path, points, faces)
    colours = _colours(mesh)
    return _merged(Surface(name=path.name, points_mm=points * factor, faces=faces, colours=colours))


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


def _colours(mesh: Any) -> FloatArray | None:  # noqa: ANN401 - a Trimesh
    """SRGB of each point, from the vertices or from the texture; None where the file has neither."""
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
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[inverse.ravel()][surface.faces]
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    faces = faces[distinct]
    used = np.unique(faces)
    kept = first[order][used]
    return Surface(
        name=surface.name,
        points_mm=surface.points_mm[kept],
        faces=np.searchsorted(used, faces),
        colours=None if surface.colours is None else surface.colours[kept],
    )


def mm_per_unit(unit: str) -> float:
    """Millimetres of a unit, which may be a length such as "365 mm" for a normalised model.

    Raises
    ------
    ValueError
        It is none of length.
    """
    return convert(unit if unit.strip()[:1].isdigit() else f"1 {unit}", "mm")


def guessed_unit(surface: Surface) -> tuple[str, str]:
    """Unit of a closed surface whose coordinates are as in the file, and why.

    Raises
    ------
    MeshError
        No unit makes it a limb, or more than one does.
    """
    long = float(np.ptp(surface.points_mm, axis=0).max())
    thick = float(np.sqrt(4.0 * abs(surface.volume_mm3) / (np.pi * max(long, 1e-300))))
    fits = [
        unit
        for unit, factor in UNITS.items()
        if LIMB_MM[0] <= long * factor <= LIMB_MM[1] and THICK_MM[0] <= thick * factor <= THICK_MM[1]
    ]
    size = f"it is {long:.4g} long and about {thick:.3g} thick"
    if len(fits) != 1:
        plausible = " and ".join(fits) or "no unit"
        raise MeshError(
            f"{surface.name}: {size}, which is a limb in {plausible}; give the unit with --unit, such as mm, "
            'or "365 mm" for a model whose unit is that long'
        )
    return fits[0], size
