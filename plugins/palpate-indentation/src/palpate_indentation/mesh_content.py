"""Contents of a mesh file in its own names and units, whatever its format."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from palpate.api.mesh import Support

MOST_GROUPS = 100
"""Distinct numbers or words of cells, at most, that are groups: more of them number each cell."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeshFile:
    """Contents of a mesh file, in its names and units.

    Parameters
    ----------
    points : (n_nodes, 3) array
    blocks : tuple of (meshio's cell type, (n_cells, n_nodes_of_type) array)
    point_data : mapping of name to array with one row per node
    cell_data : mapping of name to one array per block
    point_sets : mapping of name to array of node numbers
    cell_sets : mapping of name to one array of element numbers per block
        Element sets of Abaqus, physical groups of Gmsh.
    supports : tuple of Support
        Conditions of the file that hold nodes.
    remarks, warnings : tuple of str
        Sentences on what is left out, and on what may be wrong.
    """

    points: NDArray[np.float64]
    blocks: tuple[tuple[str, NDArray[np.int64]], ...]
    point_data: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    cell_data: Mapping[str, tuple[NDArray[np.generic], ...]] = field(default_factory=dict)
    point_sets: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    cell_sets: Mapping[str, tuple[NDArray[np.int64], ...]] = field(default_factory=dict)
    supports: tuple[Support, ...] = ()
    remarks: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def numbered_faces(content: MeshFile) -> dict[str, tuple[NDArray[np.int64], ...]]:
    """Groups such as ``gmsh:physical 3``: the faces of each number of cell data."""
    groups: dict[str, tuple[NDArray[np.int64], ...]] = {}
    is_face = [kind.startswith(("triangle", "quad")) for kind, _ in content.blocks]
    for name, blocks in content.cell_data.items():
        of_faces = [block for block, is_one in zip(blocks, is_face, strict=True) if is_one]
        if name.startswith("gmsh:geom") or any(b.ndim > 1 or b.dtype.kind not in "iu" for b in of_faces):
            continue
        numbers = np.unique(np.concatenate(of_faces)) if of_faces else np.empty(0)
        for number in numbers if len(numbers) <= MOST_GROUPS else ():
            groups[f"{name} {number}"] = tuple(
                np.flatnonzero((block == number) & is_one)
                for block, is_one in zip(blocks, is_face, strict=True)
            )
    return groups


def ordered(kind: str, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Elements in meshio's order, from a format that has upright edges before upper ones: Exodus, Nastran."""
    n = {"hexahedron20": 4, "wedge15": 3}.get(kind)
    return cells if n is None else cells[:, [*range(3 * n), *range(4 * n, 5 * n), *range(3 * n, 4 * n)]]


def of_rows(content: MeshFile, rows: Sequence[NDArray[np.int64]]) -> MeshFile:
    """Content with these elements (rising rows of each block) alone; groups keep their other members."""
    return replace(
        content,
        blocks=tuple((kind, cells[kept]) for (kind, cells), kept in zip(content.blocks, rows, strict=True)),
        cell_data={
            name: tuple(values[kept] for values, kept in zip(of, rows, strict=True))
            for name, of in content.cell_data.items()
        },
        cell_sets={
            name: tuple(np.flatnonzero(np.isin(kept, of)) for kept, of in zip(rows, members, strict=True))
            for name, members in content.cell_sets.items()
        },
    )


def once(content: MeshFile) -> MeshFile:
    """Content in which each element is there once, in all groups of its copies.

    A binary file of Gmsh 2 has an element once for each of its physical groups.
    """
    rows_of: dict[tuple[str, tuple[int, ...]], tuple[int, int]] = {}
    first = [
        [rows_of.setdefault((kind, tuple(nodes)), (block, row)) for row, nodes in enumerate(cells.tolist())]
        for block, (kind, cells) in enumerate(content.blocks)
    ]
    own = [[row for row, of in enumerate(rows) if of == (block, row)] for block, rows in enumerate(first)]
    if all(len(kept) == len(rows) for kept, rows in zip(own, first, strict=True)):
        return content
    groups = {}
    for name, members in content.cell_sets.items():
        found = {first[block][row] for block, rows in enumerate(members) for row in rows.tolist()}
        groups[name] = tuple(
            np.array(sorted(row for at, row in found if at == block), dtype=np.int64)
            for block in range(len(first))
        )
    return of_rows(replace(content, cell_sets=groups), [np.array(kept, dtype=np.int64) for kept in own])
