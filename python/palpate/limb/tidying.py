"""Limbs as a source read them, made ready to simulate: what is harmless is changed, with a remark."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate.domain import BoolArray, Limb, Mesh
from palpate.mesh.midside_nodes import can_be_quadratic, quadratic
from palpate.mesh.topology import CELLS

MIRRORED = {"tet4": (1, 0, 2, 3), "tet10": (1, 0, 2, 3, 4, 6, 5, 8, 7, 9), "hex8": (4, 5, 6, 7, 0, 1, 2, 3)}
"""Nodes of a mirrored element in the order that makes its volume positive."""


def tidied(limb: Limb, *, linear: bool = False, rigid: Sequence[str] = ()) -> Limb:
    """Limb without rigid regions and unused nodes, its elements turned and its tetrahedra quadratic.

    Parameters
    ----------
    linear : bool
        Four-node tetrahedra stay as they are.
    rigid : sequence of str
        Regions that do not deform: their nodes are fixed, and their elements left out. A mesh may lack some.
    """
    mesh = limb.mesh
    if not _is_sound(mesh):
        return limb  # the checks name what is wrong
    remarks, warnings = list(limb.remarks), list(limb.warnings)
    if held := [name for name in rigid if name in mesh.used_regions]:
        mesh = _without(mesh, held)
        remarks.append(f"{', '.join(held)} rigid: their nodes are fixed, and their elements left out")
    if absent := [name for name in rigid if name not in held]:
        remarks.append(f"no region {', '.join(absent)} in this mesh: nothing is fixed by rigid there")
    used = np.zeros(mesh.n_nodes, dtype=np.bool_)
    for cells in mesh.cells.values():
        used[cells] = True
    if mesh.n_cells and not used.all():
        mesh = _kept(mesh, used)
        remarks.append(f"{np.count_nonzero(~used)} nodes belong to no volume element and are left out")
    mesh, n_turned = _turned(mesh)
    if n_turned:
        remarks.append(f"{n_turned} elements are numbered the other way round (mirrored) and are turned")
    if "tet4" in mesh.cells and len(mesh.cells["tet4"]):
        if linear or not can_be_quadratic(mesh):
            why = "linear = true" if linear else "other elements share their edges"
            warnings.append(
                f"{len(mesh.cells['tet4'])} tetrahedra keep four nodes ({why}): they lock in nearly "
                "incompressible tissue, so moduli come out too low; use ten-node tetrahedra"
            )
        else:
            made = quadratic(mesh)
            remarks.append(
                f"{len(mesh.cells['tet4'])} four-node tetrahedra got a node in the middle of each edge "
                f"({mesh.n_nodes} nodes, now {made.n_nodes}), since four-node ones lock in nearly "
                "incompressible tissue; linear = true under [limb] keeps them"
            )
            mesh = made
    return replace(limb, mesh=mesh, remarks=tuple(remarks), warnings=tuple(warnings))


def _is_sound(mesh: Mesh) -> bool:
    """True if elements, regions and node sets have the shapes and indices of a mesh."""
    indices = [*mesh.cells.values(), *mesh.node_sets.values()]
    return (
        mesh.points_mm.ndim == 2
        and all(
            kind in CELLS
            and cells.ndim == 2
            and cells.shape[1] == CELLS[kind].n_nodes
            and kind in mesh.cell_regions
            and mesh.cell_regions[kind].shape == (len(cells),)
            for kind, cells in mesh.cells.items()
        )
        and all(not each.size or (each.min() >= 0 and each.max() < mesh.n_nodes) for each in indices)
    )


def _without(mesh: Mesh, rigid: Sequence[str]) -> Mesh:
    """Mesh without the elements of some regions, all nodes of which are fixed."""
    is_rigid = np.isin(mesh.regions, rigid)
    soft = {kind: ~is_rigid[regions] for kind, regions in mesh.cell_regions.items()}
    held = [cells[~soft[kind]].ravel() for kind, cells in mesh.cells.items()]
    number, fixed = np.cumsum(~is_rigid) - 1, mesh.node_sets.get("fixed", np.empty(0, np.int64))
    return replace(
        mesh,
        cells={kind: cells[soft[kind]] for kind, cells in mesh.cells.items()},
        cell_regions={kind: number[regions[soft[kind]]] for kind, regions in mesh.cell_regions.items()},
        regions=tuple(name for name in mesh.regions if name not in rigid),
        node_sets={**mesh.node_sets, "fixed": np.union1d(fixed, np.concatenate(held))},
        cell_fields={name: {k: v[soft[k]] for k, v in of.items()} for name, of in mesh.cell_fields.items()},
    )


def _kept(mesh: Mesh, used: BoolArray) -> Mesh:
    """Mesh of the nodes that elements use."""
    number = np.cumsum(used) - 1
    return replace(
        mesh,
        points_mm=mesh.points_mm[used],
        cells={kind: number[cells] for kind, cells in mesh.cells.items()},
        node_sets={name: number[nodes[used[nodes]]] for name, nodes in mesh.node_sets.items()},
    )


def _turned(mesh: Mesh) -> tuple[Mesh, int]:
    """Mesh whose mirrored elements are turned where all of a region and kind are, and how many were."""
    cells, n_turned = {}, 0
    for kind, of in mesh.cells.items():
        turned = of.copy()
        corners = mesh.points_mm[of[:, : CELLS[kind].n_corners]]
        third = corners[:, 3] if CELLS[kind].n_corners == 4 else corners[:, 4:].mean(axis=1)
        ends = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], third - corners[:, 0]
        negative = np.linalg.det(np.stack(ends, axis=1)) < 0.0
        regions = mesh.cell_regions[kind]
        for region in np.unique(regions):
            here = regions == region
            if negative[here].all():
                turned[here] = of[here][:, MIRRORED[kind]]
                n_turned += int(np.count_nonzero(here))
        cells[kind] = turned
    return (replace(mesh, cells=cells), n_turned) if n_turned else (mesh, 0)
