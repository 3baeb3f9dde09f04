"""Nodes in the middle of the edges of four-node tetrahedra, which lock in nearly incompressible tissue."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.domain import Mesh
from palpate.mesh.topology import CELLS, outer_faces, surface_faces, with_midpoints


def can_be_quadratic(mesh: Mesh) -> bool:
    """True if the mesh has four-node tetrahedra, and none shares an edge with another kind of element."""
    edges = {
        kind: np.unique(np.sort(cells[:, np.array(CELLS[kind].edges)], axis=2) @ [mesh.n_nodes, 1])
        for kind, cells in mesh.cells.items()
    }
    straight = edges.pop("tet4", np.empty(0, dtype=np.int64))
    return bool(straight.size) and not any(np.isin(straight, other).any() for other in edges.values())


def quadratic(mesh: Mesh) -> Mesh:
    """Mesh whose four-node tetrahedra have a node in the middle of each edge.

    A new node is in a node set if both ends of its edge are; if the set is of the surface alone, the
    edge must be on the surface too.
    """
    if "tet4" not in mesh.cells:
        return mesh
    points, tets, ends = with_midpoints(mesh.points_mm, mesh.cells["tet4"])
    on_surface = np.isin(np.arange(mesh.n_nodes, len(points)), outer_faces("tet10", tets))
    sets, of_surface = {}, surface_sets(mesh)
    for name, nodes in mesh.node_sets.items():
        middles = np.isin(ends, nodes).all(axis=1)
        if name in of_surface:
            middles &= on_surface
        sets[name] = np.concatenate([nodes, mesh.n_nodes + np.flatnonzero(middles)])
    return replace(
        mesh,
        points_mm=points,
        cells={**{kind: of for kind, of in mesh.cells.items() if kind != "tet4"}, "tet10": tets},
        cell_regions=_renamed(mesh.cell_regions),
        node_sets=sets,
        cell_fields={name: _renamed(of) for name, of in mesh.cell_fields.items()},
    )


def _renamed(of_kinds: Mapping[str, Any]) -> dict[str, Any]:
    return {"tet10" if kind == "tet4" else kind: of for kind, of in of_kinds.items()}


def surface_sets(mesh: Mesh) -> frozenset[str]:
    """Names of the node sets that have nodes on the outer surface alone."""
    outer = np.concatenate([faces.ravel() for faces, _ in surface_faces(mesh)])
    return frozenset(name for name, nodes in mesh.node_sets.items() if np.isin(nodes, outer).all())
