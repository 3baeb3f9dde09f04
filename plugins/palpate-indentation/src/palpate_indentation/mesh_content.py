"""Contents of a mesh file in its own names and units, whatever its format."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from palpate.api.mesh import Support


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
        for number in np.unique(np.concatenate(of_faces)) if of_faces else ():
            groups[f"{name} {number}"] = tuple(
                np.flatnonzero((block == number) & is_one)
                for block, is_one in zip(blocks, is_face, strict=True)
            )
    return groups
