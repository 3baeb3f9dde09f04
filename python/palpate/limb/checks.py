"""Checks of limbs: refused where they cannot be simulated, or where two meshes are not of one limb."""

import difflib
from collections.abc import Iterator, Sequence

import numpy as np

from palpate.domain import FloatArray, Indentation, IntArray, Limb, Mesh
from palpate.errors import MeshError
from palpate.limb.mesh_joints import check_joints
from palpate.mesh.spot_frame import contact_edge_mm
from palpate.mesh.topology import CELLS, SLOPES, Cell

FINER = 0.9
"""Mean edge of a finer mesh under the indenter over the mesh's, at most."""


def check_fine(coarse: Limb, fine: Limb, near_mm: float, place: str) -> None:
    """Refuse a finer mesh that is not finer at the contact, or not of the same limb in the same frame.

    Parameters
    ----------
    coarse, fine : Limb
        Each passes :func:`check_limb`.
    near_mm : float
        Distance from the spot up to which elements are compared.
    place : str
        Where the study file names the finer mesh.

    Raises
    ------
    MeshError
        Naming the region, or the part whose bounding boxes differ.
    """
    one, other = coarse.mesh, fine.mesh
    if one.used_regions != other.used_regions:
        raise MeshError(
            f"{place}: a fine mesh of another region set ({', '.join(sorted(other.used_regions))}, where the "
            f"mesh has {', '.join(sorted(one.used_regions))}); give both the same regions"
        )
    size = float(np.median(np.concatenate([_extents(one.points_mm[c]) for c in one.cells.values()])))
    there, here = _boxes(one), _boxes(other)
    # Difference of the boxes around two meshes of one limb, over the element size, up to which frames agree.
    apart = {part: (float(np.abs(there[part] - here[part]).max()), 0.25 * size) for part in there}
    heights = [
        (at.mesh.points_mm[_nearest(at)] - at.spot.position_mm) @ at.spot.normal for at in (coarse, fine)
    ]
    # Difference of their height at the spot, over the element size there, up to which two skins are one.
    apart["the skin at the spot"] = (abs(heights[0] - heights[1]), 0.1 * _reach(coarse))
    for part, (distance, allowed) in apart.items():
        if distance > allowed:
            raise MeshError(
                f"{place}: a fine mesh of another limb or frame: {part} ends {distance:.3g} mm from where it "
                f"ends in the mesh, and {allowed:.2g} mm are allowed; mesh the same limb in the same frame"
            )
    if not is_finer(coarse, fine, near_mm):
        sizes = [contact_edge_mm(limb, near_mm) for limb in (coarse, fine)]
        raise MeshError(
            f"{place}: not finer under the indenter: edges of {sizes[1]:.2f} mm, where the mesh has "
            f"{sizes[0]:.2f} mm; at most {FINER * sizes[0]:.2f} mm correct it. Set [fit] fine_edge to refine "
            "the mesh itself, or name a finer one, such as `palpate limb SCAN --fine` makes"
        )


def _boxes(mesh: Mesh) -> dict[str, FloatArray]:
    """Least and largest coordinates (2, 3) of the fixed nodes, the skin and each region."""
    nodes = {f"node set '{name}'": mesh.node_sets[name] for name in ("fixed", "contact")}
    for region in sorted(mesh.used_regions):
        cells = [
            cells[mesh.cell_regions[kind] == mesh.regions.index(region)] for kind, cells in mesh.cells.items()
        ]
        nodes[f"region '{region}'"] = np.concatenate([each.ravel() for each in cells])
    return {
        part: np.stack([mesh.points_mm[each].min(axis=0), mesh.points_mm[each].max(axis=0)])
        for part, each in nodes.items()
    }


def is_finer(coarse: Limb, fine: Limb, near_mm: float) -> bool:
    """True if edges under the indenter are short enough that a finer mesh corrects the other."""
    return contact_edge_mm(fine, near_mm) <= FINER * contact_edge_mm(coarse, near_mm)


def check_limb(limb: Limb, regions: Sequence[str]) -> None:
    """Refuse a limb that cannot be simulated.

    Parameters
    ----------
    regions : sequence of str
        Regions that have a material; a limb may lack some.

    Raises
    ------
    MeshError
        Naming the element, node or region.
    """
    mesh = limb.mesh
    for problem in _array_problems(mesh):
        raise MeshError(problem)
    for region in sorted(mesh.used_regions - set(regions)):
        what = f"mesh: region '{region}' has no material (given: {', '.join(regions)})"
        ask = f'give it one, or for bone write rigid = ["{region}"] under [limb]'
        for near in difflib.get_close_matches(region, {*regions} - mesh.used_regions, n=1):
            ask = f"give the region of the mesh and the material of '{near}' one name"
        raise MeshError(f"{what}; {ask}")
    _check_node_sets(mesh)
    _check_elements(mesh)
    _check_edges(mesh)
    check_joints(limb)
    _check_held(mesh)
    _check_spot(limb)


def check_depth(limb: Limb, protocol: Indentation) -> None:
    """Refuse an indentation that passes through the limb, such as of a mesh in another unit.

    Raises
    ------
    MeshError
        Naming the depth and how far the limb reaches below the spot.
    """
    reach = float(((limb.spot.position_mm - limb.mesh.points_mm) @ limb.spot.normal).max())
    deepest = float(protocol.path[:, 0].max())
    if deepest >= reach:
        raise MeshError(
            f"spot '{limb.spot.name}': the protocol presses {deepest:g} mm deep, but the limb reaches "
            f"{reach:.3g} mm below the spot; check the unit of the mesh, or press less deep"
        )


def _array_problems(mesh: Mesh) -> Iterator[str]:
    points = mesh.points_mm
    if points.ndim != 2 or points.shape[1] != 3:
        yield f"mesh: points of shape {points.shape}; give (n_nodes, 3) coordinates in mm"
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        yield f"mesh: node {bad[0]} is at {points[bad[0]].tolist()}; every coordinate must be finite"
    if mesh.n_cells == 0:
        yield f"mesh: no volume elements; give cells of {', '.join(CELLS)}"
    for kind, cells in mesh.cells.items():
        if kind not in CELLS:
            yield f"mesh: elements of kind '{kind}'; use {', '.join(CELLS)}"
        if cells.ndim != 2 or cells.shape[1] != CELLS[kind].n_nodes:
            yield f"mesh: {kind} cells of shape {cells.shape}; give (n_cells, {CELLS[kind].n_nodes})"
        yield from _index_problems(f"{kind} cells", cells, mesh.n_nodes)
        if kind not in mesh.cell_regions or mesh.cell_regions[kind].shape != (len(cells),):
            yield f"mesh: {kind} has {len(cells)} cells but not one region for each; give each cell a region"
        ids = mesh.cell_regions[kind]
        yield from _index_problems(f"regions of {kind}", ids, len(mesh.regions), "region")
    for name, nodes in mesh.node_sets.items():
        yield from _index_problems(f"node set '{name}'", nodes, mesh.n_nodes)


def _index_problems(what: str, indices: IntArray, n: int, noun: str = "node") -> Iterator[str]:
    bad = np.argwhere((indices < 0) | (indices >= n))
    if bad.size:
        place = tuple(int(i) for i in bad[0])
        row = ", ".join(map(str, place))
        yield f"mesh: {what}[{row}] names {noun} {indices[place]}, but there are {n}; export the mesh again"


def _check_node_sets(mesh: Mesh) -> None:
    purposes = {
        "fixed": "nodes with zero displacement, so that the limb cannot move away",
        "contact": "the skin that is pressed",
    }
    for name, purpose in purposes.items():
        if np.size(mesh.node_sets.get(name, ())) == 0:
            raise MeshError(
                f"mesh: node set '{name}' is missing or empty (it contains {purpose}); mark those nodes"
            )
    used = np.zeros(mesh.n_nodes, dtype=bool)
    for cells in mesh.cells.values():
        used[cells] = True
    if not used.all():
        raise MeshError(
            f"mesh: {np.count_nonzero(~used)} nodes belong to no element, first node "
            f"{np.flatnonzero(~used)[0]}; remove them"
        )


# ------------------------------------------------------------------- elements


def _check_elements(mesh: Mesh) -> None:
    for kind, cells in mesh.cells.items():
        if not len(cells):
            continue
        corners = mesh.points_mm[cells]
        least = np.linalg.det(np.einsum("qai,caj->cqij", SLOPES[kind], corners)).min(axis=1)
        # A sliver below this share of its size is flat up to round-off.
        bad = np.flatnonzero(least <= 1e-9 * _extents(corners) ** 3)
        if bad.size:
            centre = mesh.points_mm[cells[bad[0]]].mean(axis=0)
            raise MeshError(
                f"mesh: {bad.size} {kind} elements are inverted or flat, first element {bad[0]} near "
                f"{np.round(centre, 3).tolist()} mm with Jacobian determinant {least[bad[0]]:.3g} mm³; "
                "repair the mesh or its node order"
            )


def _extents(corners: FloatArray) -> FloatArray:
    """Longest side of the box around each element's nodes (n_cells, n_nodes, 3)."""
    return np.asarray(np.ptp(corners, axis=1).max(axis=1))


def _check_edges(mesh: Mesh) -> None:
    """Refuse elements that share an edge but not its midside node: they would separate there."""
    found = [_edges(mesh.cells[kind], CELLS[kind]) for kind in sorted(mesh.cells)]
    rows = np.concatenate(found)
    order = np.lexsort((rows[:, 1], rows[:, 0]))
    rows = rows[order]
    same = (rows[1:, :2] == rows[:-1, :2]).all(axis=1) & (rows[1:, 2] != rows[:-1, 2])
    if same.any():
        k = int(np.flatnonzero(same)[0])
        a, b = rows[k, :2]
        middles = sorted(int(m) for m in rows[k : k + 2, 2])
        what = f"nodes {middles[0]} and {middles[1]}" if middles[0] >= 0 else f"node {middles[1]} and none"
        raise MeshError(
            f"mesh: the edge between nodes {a} and {b} has {what} in its middle, by two elements that "
            f"share it, at {np.round(mesh.points_mm[[a, b]].mean(axis=0), 3).tolist()} mm: they would "
            "separate there; use elements of one order, and merge equal nodes"
        )


def _edges(cells: IntArray, cell: Cell) -> IntArray:
    """Edges (n_edges, 3) of cells: end nodes in order and the middle node, −1 without one."""
    pairs = np.sort(cells[:, np.array(cell.edges)], axis=2)
    middles = cells[:, cell.n_corners :] if cell.has_midside_nodes else np.full(pairs.shape[:2], -1)
    return np.concatenate([pairs, middles[:, :, None]], axis=2).reshape(-1, 3)


# ---------------------------------------------------------- supports and spot


def _check_held(mesh: Mesh) -> None:
    """Refuse a limb that can rotate about its fixed nodes."""
    fixed = mesh.node_sets["fixed"]
    own = mesh.points_mm[fixed]
    spread = np.linalg.svd(own - own.mean(axis=0), compute_uv=False)
    if len(spread) < 2 or spread[1] <= 1e-9 * max(float(np.ptp(mesh.points_mm, axis=0).max()), spread[0]):
        raise MeshError(
            f"mesh: the fixed nodes are on one line ({len(own)} nodes, the first {fixed[0]}), so the limb "
            "can rotate freely; fix three that are not"
        )


def _check_spot(limb: Limb) -> None:
    """Refuse a spot that is not on the contact surface, or whose normal points inwards."""
    mesh, spot = limb.mesh, limb.spot
    nearest, around, reach = _nearest(limb), _around(limb), _reach(limb)
    distance = float(np.linalg.norm(mesh.points_mm[nearest] - spot.position_mm))
    if distance > reach:
        raise MeshError(
            f"spot '{spot.name}' at {spot.position_mm.tolist()} mm is {distance:.3g} mm from the "
            f"nearest contact node {nearest}, further than an element there ({reach:.3g} mm); "
            "correct the spot's position, or mark the surface around it as contact"
        )
    inwards = np.vstack([corners.mean(axis=1) for corners in around]).mean(axis=0) - mesh.points_mm[nearest]
    if float(inwards @ spot.normal) >= 0.0:
        raise MeshError(
            f"spot '{spot.name}': its normal {np.round(spot.normal, 6).tolist()} points into the limb at "
            f"contact node {nearest}; give the outward normal"
        )


def _nearest(limb: Limb) -> int:
    """Contact node nearest to the spot."""
    contact = limb.mesh.node_sets["contact"]
    distances = np.linalg.norm(limb.mesh.points_mm[contact] - limb.spot.position_mm, axis=1)
    return int(contact[distances.argmin()])


def _around(limb: Limb) -> list[FloatArray]:
    """Coordinates (n_cells, n_nodes, 3) of the elements at that node, by kind."""
    nearest = _nearest(limb)
    return [limb.mesh.points_mm[c[(c == nearest).any(axis=1)]] for c in limb.mesh.cells.values()]


def _reach(limb: Limb) -> float:
    """Longest extent of the elements at that node, in mm."""
    return max(float(_extents(corners).max()) for corners in _around(limb) if len(corners))
