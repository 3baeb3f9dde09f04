"""Limbs from mesh files."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from palpate.domain import IntArray, Limb, Mesh, Spot
from palpate.errors import MeshError
from palpate.interfaces import LimbSource, Settings
from palpate.units import convert
from palpate_forearm.mesh_files import MeshFile, read_mesh_file

KINDS: Mapping[str, str] = MappingProxyType({"tetra": "tet4", "tetra10": "tet10", "hexahedron": "hex8"})
"""Volume elements: meshio's cell type to the kind of :class:`palpate.domain.Mesh`."""

IGNORED = frozenset(
    {
        *("vertex", "line", "line3", "triangle", "triangle6", "triangle7"),
        *("quad", "quad8", "quad9", "polygon"),
    }
)
"""Points, edges and faces: a mesh generator leaves them in the file, no volume among them."""


class MeshioSettings(Settings):
    """Settings of :class:`MeshioSource`."""

    unit: Literal["mm", "cm", "m", "um", "inch"] = Field(
        default="mm", description="Unit of the file's coordinates."
    )
    region_data: str = Field(
        default="region",
        description="Cell data with a whole number per element; empty: the whole mesh is one region.",
    )
    regions: dict[str, int] = Field(
        default_factory=lambda: {"soft_tissue": 0},
        min_length=1,
        description="Number of each region in that data, by the region's name.",
    )
    node_sets: dict[str, str] = Field(
        default_factory=lambda: {"fixed": "fixed", "contact": "contact"},
        min_length=1,
        description="Point data (not zero: in the set) or point set of the file, by node set.",
    )

    @field_validator("regions")
    @classmethod
    def _distinct_numbers(cls, regions: dict[str, int]) -> dict[str, int]:
        if len(set(regions.values())) < len(regions):
            raise ValueError("two regions have one number; give each region its own")
        return regions


class MeshioSource(LimbSource):
    """Limbs from any mesh file that meshio reads: VTU, VTK, Gmsh, Abaqus, XDMF and more.

    Elements ``tetra``, ``tetra10`` and ``hexahedron`` become ``tet4``, ``tet10``
    and ``hex8`` with their nodes in the file's order as meshio gives it, which is VTK's: a
    ``tet10`` has its four corners, then the middles of the edges 01, 12, 02, 03,
    13, 23. Edges may be curved. Points, lines and faces are passed over; any
    other element is refused.
    """

    name = "meshio"
    summary = "mesh files (VTU, Gmsh, Abaqus …) with regions in cell data and node sets in point data"
    Settings = MeshioSettings

    def load(self, path: Path, spot: Spot) -> Limb:
        """Read the mesh of one spot.

        Raises
        ------
        MeshError
            The file cannot be read, or an array in it is missing or malformed;
            the message names what the file has.
        """
        settings: MeshioSettings = self.settings
        content = read_mesh_file(path)
        cells, numbers = _volume(path, content, settings.region_data)
        names = tuple(settings.regions)
        mesh = Mesh(
            points_mm=_points(path, content) * convert(f"1 {settings.unit}", "mm"),
            cells=cells,
            cell_regions={kind: _region_ids(path, ids, settings) for kind, ids in numbers.items()},
            regions=names,
            node_sets={name: _node_set(path, content, source) for name, source in settings.node_sets.items()},
        )
        return Limb(spot=spot, mesh=mesh)


def _points(path: Path, content: MeshFile) -> NDArray[np.float64]:
    points = content.points
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path}: points of shape {points.shape}; a limb's mesh has three coordinates each")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise MeshError(
            f"{path}: node {bad[0]} lies at {points[bad[0]].tolist()}; every coordinate must be finite, "
            "write the mesh anew"
        )
    return points


def _volume(
    path: Path, content: MeshFile, region_data: str
) -> tuple[dict[str, IntArray], dict[str, NDArray[np.generic]]]:
    """Cells and region numbers by element kind, blocks of one kind joined."""
    found = [cell_type for cell_type, _ in content.blocks]
    other = sorted(set(found) - set(KINDS) - IGNORED)
    if other:
        raise MeshError(
            f"{path}: elements of type {', '.join(other)}; palpate simulates {', '.join(KINDS)}, "
            "so mesh the limb with those"
        )
    volume = [i for i, cell_type in enumerate(found) if cell_type in KINDS]
    if not volume:
        raise MeshError(
            f"{path}: no volume elements (found: {', '.join(found) or 'none'}); "
            f"export the volume mesh, of {', '.join(KINDS)}"
        )
    numbers = _region_numbers(path, content, region_data)
    cells: dict[str, list[IntArray]] = {}
    ids: dict[str, list[NDArray[np.generic]]] = {}
    for i in volume:
        cells.setdefault(KINDS[found[i]], []).append(content.blocks[i][1])
        ids.setdefault(KINDS[found[i]], []).append(numbers[i])
    return (
        {kind: np.concatenate(blocks) for kind, blocks in cells.items()},
        {kind: np.concatenate(blocks) for kind, blocks in ids.items()},
    )


def _region_numbers(path: Path, content: MeshFile, region_data: str) -> tuple[NDArray[np.generic], ...]:
    if not region_data:
        return tuple(np.zeros(len(cells)) for _, cells in content.blocks)
    if region_data not in content.cell_data:
        raise MeshError(
            f"{path}: no cell data '{region_data}' (there: {', '.join(content.cell_data) or 'none'}); "
            'set region_data to one of them, or to "" when the mesh is one region'
        )
    return content.cell_data[region_data]


def _region_ids(path: Path, numbers: NDArray[np.generic], settings: MeshioSettings) -> IntArray:
    """Index into the names of the settings, for each element."""
    names = list(settings.regions)
    if not settings.region_data:
        if len(names) != 1:
            raise MeshError(
                f'{path}: region_data = "" makes the mesh one region, but regions names {len(names)} '
                f"({', '.join(names)}); name the cell data that tells them apart"
            )
        return np.zeros(len(numbers), dtype=np.int64)
    _check_numbers(path, f"cell data '{settings.region_data}'", numbers)
    ids = np.full(len(numbers), -1)
    for index, number in enumerate(settings.regions.values()):
        ids[numbers == number] = index
    if (ids < 0).any():
        unknown = sorted({int(n) for n in numbers[ids < 0].astype(np.float64)})
        raise MeshError(
            f"{path}: cell data '{settings.region_data}' holds {', '.join(map(str, unknown))} "
            f"(first in element {int(np.flatnonzero(ids < 0)[0])}), which regions does not name; "
            "add them to regions in the limb's settings"
        )
    return ids.astype(np.int64)


def _check_numbers(path: Path, what: str, values: NDArray[np.generic]) -> None:
    if values.ndim != 1 or values.dtype.kind not in "biuf":
        raise MeshError(
            f"{path}: {what} has shape {values.shape} and type {values.dtype}; give one number each"
        )
    numbers = values.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(numbers) | (numbers != np.round(numbers)))
    if bad.size:
        raise MeshError(f"{path}: {what}[{bad[0]}] is {numbers[bad[0]]}; give whole numbers")


def _node_set(path: Path, content: MeshFile, source: str) -> IntArray:
    if source in content.point_data:
        marks = content.point_data[source]
        _check_numbers(path, f"point data '{source}'", marks)
        return np.flatnonzero(marks)
    if source in content.point_sets:
        return content.point_sets[source]
    there = [*content.point_data, *content.point_sets]
    raise MeshError(
        f"{path}: no point data or point set '{source}' (there: {', '.join(there) or 'none'}); "
        "mark its nodes, or name what marks them under node_sets in the limb's settings"
    )
