"""Limbs from mesh files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from palpate.api import IntArray, Limb, LimbSource, Mesh, MeshError, Settings, Spot, convert
from palpate.api.files import Inspection
from palpate.api.mesh import CELLS, SOLIDS, FixedNodes, curved, cut, fixed_nodes
from palpate_indentation.mesh_content import MeshFile, of_rows
from palpate_indentation.mesh_files import SUFFIXES, read_mesh_file
from palpate_indentation.mesh_inspection import inspect_mesh
from palpate_indentation.node_choices import Choice, check_whole, chosen, known_as

LONGEST_MM = 3000.0

KINDS: Mapping[str, str] = MappingProxyType({cell.meshio: kind for kind, cell in CELLS.items()})
"""Volume elements: meshio's cell type to the kind of :class:`palpate.api.Mesh`."""

IGNORED = frozenset(
    {
        *("vertex", "line", "line3", "triangle", "triangle6", "triangle7"),
        *("quad", "quad8", "quad9", "polygon"),
    }
)
"""Points, edges and faces, which a mesh generator writes next to the volume."""


class MeshioSettings(Settings):
    """Settings of :class:`MeshioSource`."""

    unit: Literal["mm", "cm", "m", "um", "inch"] = Field(
        default="mm", description="Unit of the file's coordinates."
    )
    region_data: str = Field(
        default="region",
        description="Cell data with a whole number per element; empty: the whole mesh is one region.",
    )
    regions: dict[str, int | str | list[int] | list[str]] = Field(
        default={"soft_tissue": 0},
        min_length=1,
        description="Number of each region in that data, or several, by the region's name; or its group of "
        "elements (physical group of Gmsh, element set of Abaqus), or several.",
    )
    leave_out: list[int] | list[str] = Field(
        default=[], description="Numbers or groups of elements that are no limb, such as a second body."
    )
    node_sets: dict[str, Choice | list[Choice]] = Field(
        default={"fixed": "fixed", "contact": "contact"},
        min_length=1,
        description="Nodes of each node set: point data (not zero: in the set), a point set or a group of "
        "elements by name; { normal, at, within } for a plane; { surface, within } for nodes near a "
        "bone; or a list of these. Without `fixed`: all nodes that the file itself holds in x, y and z.",
    )

    @field_validator("regions")
    @classmethod
    def _distinct_numbers(
        cls, regions: dict[str, int | str | list[int] | list[str]]
    ) -> dict[str, int | str | list[int] | list[str]]:
        every = [source for _, source in _sources(regions)]
        if len(set(every)) < len(every):
            raise ValueError("two regions have one number or group; give each region another")
        if len(set(map(type, every))) > 1:
            raise ValueError("regions by number and by group; name all of them in one way")
        if not all(regions[name] != [] for name in regions):
            raise ValueError("a region of no number or group; name its numbers or groups, or leave it out")
        return regions


def _sources(regions: Mapping[str, int | str | list[int] | list[str]]) -> list[tuple[int, int | str]]:
    """Index of a region and a number or group of it, for each of them."""
    return [
        (index, source)
        for index, named in enumerate(regions.values())
        for source in (named if isinstance(named, list) else [named])
    ]


class MeshioSource(LimbSource[MeshioSettings]):
    """Limbs from any mesh file that meshio reads: VTU, VTK, Gmsh, Abaqus, XDMF and more.

    Elements ``tetra``, ``tetra10`` and ``hexahedron`` become ``tet4``, ``tet10``
    and ``hex8`` with their nodes in the order of meshio, as in :mod:`palpate.api.mesh`.
    Edges may be curved. A mesh with quadratic hexahedra, wedges or pyramids is cut
    into tetrahedra. Points, lines and faces are ignored; any other element is refused. Cell data of one
    number or one vector for each element, such as the direction of fibres, are passed to the materials that
    name them.
    """

    suffixes = SUFFIXES
    name = "meshio"
    summary = "mesh files (VTU, Gmsh, Abaqus …) with regions in cell data and node sets in point data"

    @classmethod
    def inspect(cls, path: Path, other: Path | None = None) -> Inspection:
        """Look into a mesh file; it has no second one.

        Raises
        ------
        MeshError
            The file cannot be read.
        """
        return inspect_mesh(path, read_mesh_file(path), cls)

    def load(self, path: Path, spot: Spot) -> Limb:
        """Read the mesh of one spot.

        Raises
        ------
        MeshError
            The file cannot be read, or an array in it is missing or malformed;
            the message names what the file has.
        """
        settings = self.settings
        content, absent = _limb_alone(read_mesh_file(path), settings)
        points = _points_mm(path, content, settings.unit)
        volume, ids = _volume(path, content, settings)
        other = sorted({content.blocks[k][0] for k in volume} - set(KINDS))
        made = cut(points, tuple(content.blocks[k] for k in volume)) if other else None
        kinds = ["tet4" if made else KINDS[content.blocks[k][0]] for k in volume]
        origins = made.origin if made else [np.arange(len(of)) for of in ids]
        cells = {"tet4": made.tets} if made else _by_kind(kinds, [content.blocks[k][1] for k in volume])
        sets = _node_sets(path, content, points, settings)
        fixed = _fixed(path, content, cells, sets.get("fixed"))
        mesh = Mesh(
            points_mm=points,
            cells=cells,
            cell_regions=_by_kind(kinds, [of[rows] for of, rows in zip(ids, origins, strict=True)]),
            regions=tuple(settings.regions),
            node_sets={**sets, "fixed": fixed.nodes},
            cell_fields=_fields(content, settings.region_data, volume, kinds, origins),
        )
        remarks = list(content.remarks)
        if made:
            remarks.append(f"elements of type {', '.join(other)} are cut into {len(made.tets)} tetrahedra")
            if made.ends.size:
                mesh = curved(mesh, made.ends, made.middles)
        return Limb(
            spot=spot,
            mesh=mesh,
            remarks=(*remarks, *fixed.remarks),
            warnings=(*content.warnings, *fixed.warnings),
            absent=absent,
        )


def _limb_alone(content: MeshFile, settings: MeshioSettings) -> tuple[MeshFile, tuple[str, ...]]:
    """Content without the elements of the setting ``leave_out``, and its names that have no element here."""
    kept = [np.ones(len(cells), dtype=np.bool_) for _, cells in content.blocks]
    numbers, absent = content.cell_data.get(settings.region_data, ()), list[str]()
    for what in settings.leave_out:
        if isinstance(what, int):
            left = tuple(np.flatnonzero(block == what) for block in numbers)
        else:
            left = content.cell_sets.get(known_as(what, content.cell_sets) or "", ())
        absent += [] if any(map(len, left)) else [str(what)]
        for block, rows in zip(kept, left, strict=bool(left)):
            block[rows] = False
    alone = of_rows(content, [np.flatnonzero(block) for block in kept]) if settings.leave_out else content
    return alone, tuple(absent)


def _fixed(
    path: Path, content: MeshFile, cells: Mapping[str, IntArray], named: IntArray | None
) -> FixedNodes:
    in_limb = np.zeros(len(content.points), dtype=np.bool_)
    in_limb[np.concatenate([of_kind.ravel() for of_kind in cells.values()])] = True
    return fixed_nodes(
        path,
        content.supports,
        in_limb,
        named,
        setting="`fixed` under node_sets",
        there=_names(content),
        unused=content.warnings,
    )


def _node_sets(
    path: Path, content: MeshFile, points: NDArray[np.float64], settings: MeshioSettings
) -> dict[str, IntArray]:
    """Nodes of each set of the settings; ``fixed`` is left out where the file itself holds nodes."""
    held = content.supports and known_as("fixed", _names(content)) is None
    return {
        name: chosen(path, content, points, choice if isinstance(choice, list) else [choice])
        for name, choice in settings.node_sets.items()
        if not (held and choice == name == "fixed")
    }


def _names(content: MeshFile) -> list[str]:
    return [*content.point_data, *content.point_sets, *content.cell_sets]


def _points_mm(path: Path, content: MeshFile, unit: str) -> NDArray[np.float64]:
    points = content.points
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path}: points of shape {points.shape}; a limb's mesh has three coordinates each")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise MeshError(
            f"{path}: node {bad[0]} is at {points[bad[0]].tolist()}; every coordinate must be finite, "
            "write the mesh again"
        )
    points = points * convert(f"1 {unit}", "mm")
    longest = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if longest > LONGEST_MM:
        raise MeshError(
            f"{path}: {longest:.4g} mm long when read in {unit}, longer than any limb ({LONGEST_MM:g} mm); "
            "set the unit of the file in the limb's settings"
        )
    return points


def _volume(path: Path, content: MeshFile, settings: MeshioSettings) -> tuple[list[int], list[IntArray]]:
    """Blocks with volume elements, and the index of each element into the settings' regions."""
    found = [cell_type for cell_type, _ in content.blocks]
    other = sorted(set(found) - set(SOLIDS) - IGNORED)
    if other:
        raise MeshError(
            f"{path}: elements of type {', '.join(other)}; palpate reads {', '.join(SOLIDS)}, so mesh the "
            "limb with those"
        )
    volume = [i for i, cell_type in enumerate(found) if cell_type in SOLIDS and len(content.blocks[i][1])]
    if not volume:
        raise MeshError(
            f"{path}: no volume elements (found: {', '.join(found) or 'none'}); "
            f"export the volume mesh, of {', '.join(KINDS)}"
        )
    for i in volume:
        cells = content.blocks[i][1]
        if cells.min() < 0 or cells.max() >= len(content.points):
            raise MeshError(
                f"{path}: an element names node {int(cells.max())}, but there are {len(content.points)}; "
                "write the mesh again"
            )
    of_block = _by_group if isinstance(_sources(settings.regions)[0][1], str) else _by_number
    return volume, [of_block(path, content, i, settings) for i in volume]


def _by_kind(kinds: Sequence[str], arrays: Sequence[NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Arrays of blocks by the kind of their elements, joined."""
    return {
        kind: np.concatenate([array for k, array in zip(kinds, arrays, strict=True) if k == kind])
        for kind in dict.fromkeys(kinds)
    }


def _fields(
    content: MeshFile,
    region_data: str,
    volume: Sequence[int],
    kinds: Sequence[str],
    origins: Sequence[IntArray],
) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Cell data of one number or vector for each element, by name and kind."""
    found: dict[str, dict[str, NDArray[np.float64]]] = {}
    for name, blocks in content.cell_data.items():
        own = [blocks[i] for i in volume]
        if name == region_data or any(
            b.dtype.kind not in "biuf" or b.shape[1:] not in ((), (3,)) for b in own
        ):
            continue
        if len({block.shape[1:] for block in own}) == 1:
            values = [b[rows].astype(np.float64) for b, rows in zip(own, origins, strict=True)]
            found[name] = _by_kind(kinds, values)
    return found


def _by_group(path: Path, content: MeshFile, block: int, settings: MeshioSettings) -> IntArray:
    """Index of the region of each element of a block, by the group that it belongs to."""
    ids, absent = np.full(len(content.blocks[block][1]), -1), list[str]()
    for index, group in _sources(settings.regions):
        name = known_as(str(group), content.cell_sets)
        if name is None:  # another spot's limb may have it
            absent.append(str(group))
            continue
        members = content.cell_sets[name][block]
        twice = members[(ids[members] >= 0) & (ids[members] != index)]
        if twice.size:
            one, other = (list(settings.regions)[k] for k in (ids[twice[0]], index))
            raise MeshError(
                f"{path}: element {twice[0]} belongs to the groups of '{one}' and of '{other}'; let each "
                "element belong to one"
            )
        ids[members] = index
    there = ", ".join(content.cell_sets) or "none"
    if (ids < 0).any() and absent:
        raise MeshError(
            f"{path}: no group of elements '{absent[0]}' (there: {there}); name one of them, or give the "
            "regions by number"
        )
    if (ids < 0).any():
        raise MeshError(
            f"{path}: {np.count_nonzero(ids < 0)} elements are in none of the groups of regions, "
            f"first element {np.flatnonzero(ids < 0)[0]}; name their groups too (there: {there})"
        )
    return ids


def _by_number(path: Path, content: MeshFile, block: int, settings: MeshioSettings) -> IntArray:
    """Index of the region of each element of a block, by its number in the cell data."""
    region_data, names = settings.region_data, list(settings.regions)
    n_cells = len(content.blocks[block][1])
    if not region_data and len(names) != 1:
        raise MeshError(
            f'{path}: region_data = "" makes the mesh one region, but regions names {len(names)} '
            f"({', '.join(names)}); name the cell data that separates them"
        )
    if not region_data:
        return np.zeros(n_cells, dtype=np.int64)
    if region_data not in content.cell_data:
        groups = f", or name regions by group: {', '.join(content.cell_sets)}" if content.cell_sets else ""
        raise MeshError(
            f"{path}: no cell data '{region_data}' (there: {', '.join(content.cell_data) or 'none'}); "
            f'set region_data to one of them, or to "" when the mesh is one region{groups}'
        )
    numbers = content.cell_data[region_data][block]
    check_whole(path, f"cell data '{region_data}'", numbers)
    ids = np.full(n_cells, -1, dtype=np.int64)
    for index, number in _sources(settings.regions):
        ids[numbers == number] = index
    if (ids < 0).any():
        unknown = sorted({int(n) for n in numbers[ids < 0].astype(np.float64)})
        raise MeshError(
            f"{path}: cell data '{region_data}' holds {', '.join(map(str, unknown))} "
            f"(first in element {int(np.flatnonzero(ids < 0)[0])}), which regions does not name; "
            "add them to regions in the limb's settings"
        )
    return ids
