"""Nodes of a node set: by name, in a plane, or near a surface such as a bone's."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from palpate.api import FloatArray, IntArray, MeshError, Quantity, Settings
from palpate_indentation.mesh_content import MeshFile, numbered_faces

Length = Annotated[float, Quantity("mm")]


class InPlane(Settings):
    """Nodes in a plane n · x = at, such as a cut."""

    normal: tuple[float, float, float] = Field(description="Normal of the plane, of any length.")
    at: Length = Field(description="Position of the plane along its normal, from the origin.")
    within: Length = Field(default=0.05, gt=0.0, description="Largest distance of a node from the plane.")


class NearSurface(Settings):
    """Nodes near a surface, such as a bone's."""

    surface: str = Field(description="File of the surface (.stl, .ply, .obj) in the mesh's folder and frame.")
    unit: str = Field(default="mm", description="Unit of that file's coordinates.")
    within: Length = Field(default=0.5, gt=0.0, description="Largest distance of a node from the surface.")


Choice = str | InPlane | NearSurface


def chosen(path: Path, content: MeshFile, points_mm: FloatArray, choices: list[Choice]) -> IntArray:
    """Nodes of any of the choices, in rising order.

    Parameters
    ----------
    path : Path
        Of the mesh file.
    points_mm : (n_nodes, 3) array

    Raises
    ------
    MeshError
        A choice has no node, or names something that the file does not have.
    """
    nodes = [_nodes(path, content, points_mm, choice) for choice in choices]
    return np.unique(np.concatenate(nodes)).astype(np.int64)


def _nodes(path: Path, content: MeshFile, points_mm: FloatArray, choice: Choice) -> IntArray:
    match choice:
        case str():
            return _named(path, content, choice)
        case InPlane():
            return _in_plane(path, points_mm, choice)
        case NearSurface():
            return _near(path, points_mm, choice)


def _in_plane(path: Path, points_mm: FloatArray, plane: InPlane) -> IntArray:
    normal = np.array(plane.normal)
    length = float(np.linalg.norm(normal))
    if not length > 0.0:
        raise MeshError(
            f"{path}: a plane with the normal {list(plane.normal)}; give a vector that is not zero"
        )
    along = points_mm @ (normal / length)
    found = np.flatnonzero(np.abs(along - plane.at) <= plane.within)
    if not found.size:
        raise MeshError(
            f"{path}: no node within {plane.within:g} mm of the plane {list(plane.normal)} · x = "
            f"{plane.at:g} mm; the nodes reach from {along.min():.4g} to {along.max():.4g} mm along it"
        )
    return found


def _near(path: Path, points_mm: FloatArray, choice: NearSurface) -> IntArray:
    try:
        from palpate_limb.api import read_surface
    except ImportError as error:
        raise MeshError(
            f"{path}: nodes near '{choice.surface}' need palpate-limb; pip install palpate-limb"
        ) from error
    named = Path(choice.surface)
    if named.is_absolute() or ".." in named.parts:
        raise MeshError(
            f"{path}: the surface '{named}' is outside of the mesh's folder; move it next to the mesh"
        )
    _, distances = read_surface(path.parent / named, choice.unit).nearest(points_mm)
    found = np.flatnonzero(distances <= choice.within)
    if not found.size:
        raise MeshError(
            f"{path}: no node within {choice.within:g} mm of '{named}', the nearest is "
            f"{distances.min():.4g} mm away; check its unit and frame, or raise within"
        )
    return found


def _named(path: Path, content: MeshFile, source: str) -> IntArray:
    if (name := known_as(source, content.point_data)) is not None:
        marks = content.point_data[name]
        check_whole(path, f"point data '{name}'", marks)
        found = np.flatnonzero(marks)
    elif (name := known_as(source, content.point_sets)) is not None:
        found = content.point_sets[name]
    elif (name := known_as(source, groups := content.cell_sets)) is not None or (
        name := known_as(source, groups := numbered_faces(content))
    ) is not None:
        members = zip(content.blocks, groups[name], strict=True)
        found = np.unique(np.concatenate([cells[rows].ravel() for (_, cells), rows in members]))
    else:
        there = [*content.point_data, *content.point_sets, *content.cell_sets]
        raise MeshError(
            f"{path}: no point data, point set or group of elements '{source}' "
            f"(there: {', '.join(there) or 'none'}); add it to the file, or name other data under node_sets "
            "in the limb's settings"
        )
    if not found.size:
        raise MeshError(f"{path}: '{name}' has no node; name other data under node_sets, or fill this set")
    return found


def known_as(name: str, names: Iterable[str]) -> str | None:
    """The name as it is among names; where it is not, the only one that differs by case alone."""
    there = list(names)
    alike = [name] if name in there else [each for each in there if each.casefold() == name.casefold()]
    return alike[0] if len(alike) == 1 else None


def check_whole(path: Path, what: str, values: np.ndarray) -> None:
    """Refuse anything but one whole number each."""
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise MeshError(
            f"{path}: {what} has shape {values.shape} and type {values.dtype}; give one number each"
        )
    numbers = values.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(numbers) | (numbers != np.round(numbers)))
    if bad.size:
        raise MeshError(f"{path}: {what}[{bad[0]}] is {numbers[bad[0]]}; give whole numbers")
