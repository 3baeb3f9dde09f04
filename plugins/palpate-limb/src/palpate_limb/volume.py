"""From a segment to a mesh that can be simulated: regions, node sets, elements on the true surfaces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, Limb, Mesh, MeshError, Spot
from palpate.api.mesh import CELLS, outer_faces, with_midpoints
from palpate_limb.layers import Extruded, below_skin, extruded
from palpate_limb.meshing import SizeField, run_ftetwild, run_mmg
from palpate_limb.quality import scaled_jacobians
from palpate_limb.segment import Segment, core_of, gap_of_bones
from palpate_limb.surfaces import Surface, parts_of, solid, surface_of

TISSUE = "soft_tissue"
KIND = "tet10"
"""Kind of the elements; those of four nodes lock."""
FINER = 0.6
"""Edges of a finer mesh over those of the first: about three times as many nodes."""
FLATTEST = 2.0
"""Edges over a layer's thickness, at most, under the indenter."""
COVER_MM = 1.5
"""Tissue of the core around a bone that the layers reach, and share of the bone's depth that it may be."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeshPlan:
    """Plan by which a segment is meshed.

    ``layers_mm`` has the thickness of each region from the skin inwards; below them everything is ``core``.
    ``tolerance_mm`` is how far the surfaces may be left before the mesh is adapted, and half of how far its
    flat faces may leave them before they are bent onto them.
    """

    size: SizeField
    layers_mm: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    core: str = TISSUE
    tolerance_mm: float = 0.4
    time_limit_s: float = 300.0

    def __post_init__(self) -> None:
        if any(not thickness > 0.0 for thickness in self.layers_mm.values()) or self.core in self.layers_mm:
            raise MeshError(
                f"layers {dict(self.layers_mm)}: give thicknesses > 0 mm; below them is '{self.core}'"
            )

    @property
    def finer(self) -> "MeshPlan":
        """The same with shorter edges everywhere, and flat faces as much nearer to the surfaces."""
        size = replace(self.size, fine_mm=FINER * self.size.fine_mm, coarse_mm=FINER * self.size.coarse_mm)
        return replace(self, size=size, tolerance_mm=FINER**2 * self.tolerance_mm)


Boundary: TypeAlias = Mapping[str, IntArray]  # triangles (n, 3) by what they are on: skin, cut and each bone


def mesh_segment(segment: Segment, plan: MeshPlan) -> Limb:
    """Mesh a segment in the frame of its spot; a MeshError where the mesher or a surface of it fails."""
    if depths := np.cumsum(list(plan.layers_mm.values())).tolist():
        points, tets, regions, boundary, node_depths = _layered(segment, plan, depths)
        tets = _positive(points, tets)
    else:
        points, tets, boundary = _filled(segment, plan)
        regions, node_depths = np.zeros(len(tets), dtype=np.int64), np.full(len(points), np.nan)
    points, tets, on, ends = _quadratic(points, tets, boundary)
    points = curved(points, tets, on, segment, _with_midsides(node_depths, ends, tets[regions < len(depths)]))
    bones = [on[bone.name] for bone in segment.bones]
    mesh = Mesh(
        points_mm=points,
        cells={KIND: tets},
        cell_regions={KIND: regions},
        regions=(*plan.layers_mm, plan.core),
        node_sets={
            "fixed": np.unique(np.concatenate([on["cut"], *bones])),
            "contact": on["skin"],
            "cut": on["cut"],
            **{bone.name: on[bone.name] for bone in segment.bones},
        },
        cell_fields={"axis": {KIND: np.tile(segment.axis, (len(tets), 1))}},
    )
    return Limb(spot=Spot(name=segment.name), mesh=mesh)


def _layered(segment: Segment, plan: MeshPlan, depths_mm: Sequence[float]) -> Extruded:
    """The core meshed alone, and layers extruded from it to the skin, thinner over bones near the skin."""
    gap = gap_of_bones(segment)
    cover = min(COVER_MM, 0.4 * gap) if gap < depths_mm[-1] + COVER_MM else 0.0
    below = below_skin(segment, depths_mm[-1], cover)
    fine = plan.size.fine_mm / _stretch(below, segment.skin, plan.size.radius_mm)
    alone = replace(plan, size=replace(plan.size, fine_mm=fine, deep_mm=depths_mm[-1]))
    core = core_of(segment, below)
    points, tets, boundary = _filled(core, alone)
    room = np.full(len(points), np.inf)
    if cover:
        near = np.unique(boundary["skin"])
        of_bones = [bone.nearest(points[near])[1] for bone in segment.bones]
        room[near] = segment.skin.nearest(points[near])[1] + np.min(of_bones, axis=0) - cover
    # Height of an element of a layer over its edge under the indenter, at most: higher ones are slivers.
    highest = 1.6 * plan.size.fine_mm
    return extruded(points, tets, boundary, segment.skin, depths_mm, highest, room)


def _stretch(below: Surface, skin: Surface, near_mm: float) -> float:
    """Edges of the skin under the indenter over the edges of the core from which they come."""
    middles = below.points_mm[below.faces].mean(axis=1)
    near = (np.hypot(middles[:, 0], middles[:, 1]) < near_mm) & (middles[:, 2] > middles[:, 2].mean())
    lower = replace(below, faces=below.faces[near])
    used, faces = np.unique(lower.faces, return_inverse=True)
    upper = replace(below, points_mm=skin.nearest(below.points_mm[used])[0], faces=faces.reshape(-1, 3))
    areas = [np.linalg.norm(each.face_areas_mm2, axis=1).sum() for each in (upper, lower)]
    return float(np.sqrt(max(areas[0] / areas[1], 1.0))) if near.any() else 1.0


def _filled(segment: Segment, plan: MeshPlan) -> tuple[FloatArray, IntArray, Boundary]:
    """Points, tetrahedra and boundary of one region with elements of the sizes asked for."""
    # Simplifying leaves fins as high as its tolerance, which the mesher flattens within its own.
    tissue = surface_of(solid(segment.tissue).simplify(0.25 * plan.tolerance_mm), "tissue")
    points, tets = run_ftetwild(
        tissue.points_mm, tissue.faces, plan.size, plan.tolerance_mm, plan.time_limit_s
    )
    points, tets = _largest(points, _positive(points, tets))
    boundary = classify(points, tets, segment)
    adapted = run_mmg(
        {
            "points_mm": points,
            "tets": tets,
            "faces": np.concatenate(list(boundary.values())),
            "surfaces": np.repeat(np.arange(len(boundary)) + 1, [len(faces) for faces in boundary.values()]),
        },
        plan.size,
        _largest_edges(points, segment),
        2.0 * plan.tolerance_mm,
        plan.time_limit_s,
    )
    points, surfaces = adapted["points_mm"], adapted["surfaces"]
    faces_on = {name: adapted["faces"][surfaces == i + 1] for i, name in enumerate(boundary)}
    return points, _positive(points, adapted["tets"]), faces_on


def _largest_edges(points: FloatArray, segment: Segment) -> FloatArray:
    """Longest edges (n,) at points, for the tissue between skin and bones is a film in places."""
    if not segment.bones:
        return np.full(len(points), np.inf)
    to_bone = np.min([bone.nearest(points)[1] for bone in segment.bones], axis=0)
    # Edges over the thickness of the tissue between the skin, or layers, and a bone, at most.
    return 4.0 * np.asarray(segment.skin.nearest(points)[1] + to_bone)


def _positive(points: FloatArray, tets: IntArray) -> IntArray:
    a, b, c, d = np.moveaxis(points[tets], 1, 0)
    negative = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0.0
    return np.where(negative[:, None], tets[:, [0, 2, 1, 3]], tets)


def _largest(points: FloatArray, tets: IntArray) -> tuple[FloatArray, IntArray]:
    """The largest part that hangs together by faces, and its nodes alone."""
    if not len(tets):
        raise MeshError("the mesher filled nothing inside of the tissue; use smaller elements")
    faces = np.sort(tets[:, np.array(CELLS["tet4"].corner_faces)], axis=2).reshape(-1, 3)
    _, inverse = np.unique(faces, axis=0, return_inverse=True)
    owners = np.repeat(np.arange(len(tets)), 4)
    labels = parts_of(len(tets) + len(faces), np.column_stack([owners, len(tets) + inverse.ravel()]))
    labels = labels[: len(tets)]
    kept = tets[labels == np.bincount(labels).argmax()]
    used, cells = np.unique(kept, return_inverse=True)
    return points[used], cells.reshape(-1, 4)


def classify(points: FloatArray, tets: IntArray, segment: Segment) -> Boundary:
    """Surfaces that the boundary faces are on; a MeshError where a surface of the segment has none."""
    faces = outer_faces("tet4", tets)
    vertices = points[faces]
    middles = vertices.mean(axis=1)
    normals = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    half = 0.5 * segment.length_mm
    flat = (np.abs(middles @ segment.axis) > half - 0.6) & (np.abs(normals @ segment.axis) > 0.9)
    surfaces = [segment.skin, *segment.bones]
    distances = np.stack([surface.nearest(middles)[1] for surface in surfaces], axis=1)
    nearest = np.where(flat, -1, distances.argmin(axis=1))
    found = {"cut": faces[nearest == -1], "skin": faces[nearest == 0]}
    found |= {bone.name: faces[nearest == i + 1] for i, bone in enumerate(segment.bones)}
    for name, faces_on in found.items():
        if not len(faces_on):
            raise MeshError(
                f"spot '{segment.name}': the mesh has no face on '{name}'; use smaller elements or a smaller "
                "tolerance"
            )
    return found


def _quadratic(
    points: FloatArray, tets: IntArray, boundary: Boundary
) -> tuple[FloatArray, IntArray, dict[str, IntArray], IntArray]:
    """Points and cells with a node on every edge, the nodes on each surface, and the ends of each edge."""
    n = len(points)
    points, cells, ends = with_midpoints(points, tets)
    key = ends[:, 0] * n + ends[:, 1]  # ascending, for ends are unique rows in order
    on = {}
    for name, faces in boundary.items():
        edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        middle = n + np.searchsorted(key, edges[:, 0] * n + edges[:, 1])
        on[name] = np.unique(np.concatenate([faces.ravel(), middle]))
    return points, cells, on, ends


def _with_midsides(depths_mm: FloatArray, ends: IntArray, of_layers: IntArray) -> FloatArray:
    """Depths (n,) of all nodes: midside nodes of the cells of layers are as deep as their ends on average."""
    middle = depths_mm[ends].mean(axis=1)
    within = np.zeros(len(depths_mm) + len(ends), dtype=np.bool_)
    within[of_layers] = True
    return np.concatenate([depths_mm, np.where(within[len(depths_mm) :], middle, np.nan)])


def moved_to_contact(limb: Limb, radius_mm: float) -> tuple[Limb, float]:
    """The limb, moved along the spot's normal until a sphere there just touches it, and how far [mm].

    The limb is in the frame of its spot, where the sphere's lowest point is. Depth 0 is first contact then.
    """
    mesh = limb.mesh
    ((kind, cells),) = mesh.cells.items()
    faces = cells[:, np.array(CELLS[kind].faces)].reshape(-1, len(CELLS[kind].faces[0]))
    faces = faces[np.isin(faces[:, :3], mesh.node_sets["contact"]).all(axis=1)]
    near = np.linalg.norm(mesh.points_mm[faces[:, :3]].mean(axis=1), axis=1) < 2.0 * radius_mm
    shares = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, 9),) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    shares = shares[shares.sum(axis=1) <= 1.0 + 1e-12]
    b = np.column_stack([1.0 - shares.sum(axis=1), shares])
    values = np.column_stack([b * (2.0 * b - 1.0), 4.0 * b * np.roll(b, -1, axis=1)])
    points = (values @ mesh.points_mm[faces[near]]).reshape(-1, 3)
    points = points[(np.linalg.norm(points[:, :2], axis=1) < 0.9 * radius_mm) & (points[:, 2] > -radius_mm)]
    # The sphere about (0, 0, R + h) touches the point (x, y, z) from above at h = z + √(R² − x² − y²) − R.
    rise = float((points[:, 2] + np.sqrt(radius_mm**2 - (points[:, :2] ** 2).sum(axis=1)) - radius_mm).max())
    moved = replace(mesh, points_mm=mesh.points_mm - np.array([0.0, 0.0, rise]))
    return replace(limb, mesh=moved), rise


def curved(
    points: FloatArray, cells: IntArray, on: Mapping[str, IntArray], segment: Segment, depths_mm: FloatArray
) -> FloatArray:
    """Points (n, 3) with those on a surface moved onto it, so that edges bend with them.

    A mesher keeps to the surfaces within a tolerance, and the chord of an edge of length l leaves a surface
    of radius ρ by l²/8ρ. Both errors go, except where moving a node would fold an element.

    ``cells`` are (m, 10). ``on`` has the nodes on ``skin``, ``cut`` and bones, and ``depths_mm`` (n,) is the
    distance from the skin at which a node of a layer belongs, NaN of other nodes.
    """
    surfaces = {"skin": segment.skin, **{bone.name: bone for bone in segment.bones}}
    half, corner = 0.5 * segment.length_mm, np.zeros(len(points), dtype=np.bool_)
    corner[cells[:, :4]] = True
    deep = np.flatnonzero(depths_mm > 0.0)

    def targets(points: FloatArray, allowed: BoolArray) -> FloatArray:
        """Places of the nodes that may move, on their surfaces."""
        target = points.copy()
        for _ in range(2):  # twice, for the nodes where a surface meets a cut
            for name, surface in surfaces.items():
                chosen = on[name][allowed[on[name]]]
                target[chosen], _ = surface.nearest(target[chosen])
            chosen = deep[allowed[deep]]
            top, depth = segment.skin.nearest(target[chosen])
            inwards = (target[chosen] - top) / np.maximum(depth, 1e-9)[:, None]
            target[chosen] = top + depths_mm[chosen, None] * inwards
            chosen = np.unique(on["cut"][allowed[on["cut"]]])
            along = target[chosen] @ segment.axis
            target[chosen] += (np.sign(along) * half - along)[:, None] * segment.axis
        return target

    moved = _accepted(points, targets(points, corner), cells[:, :4]).copy()
    moved[cells[:, 4:]] = moved[cells[:, np.array(CELLS["tet10"].edges)]].mean(axis=2)
    return _accepted(moved, targets(moved, ~corner), cells)


def _accepted(points: FloatArray, target: FloatArray, cells: IntArray) -> FloatArray:
    """The points moved to their targets, but half as far or not at all in elements that would suffer."""
    share = np.ones(len(points))
    before = scaled_jacobians(points, cells)
    # No element is bent further below this scaled Jacobian, nor to less than this share of its own.
    least = np.minimum(before, np.maximum(0.05, 0.3 * before))
    for factor in (0.5, 0.0, 0.0):
        moved = points + share[:, None] * (target - points)
        bad = scaled_jacobians(moved, cells) < least
        if not bad.any():
            return moved
        share[np.unique(cells[bad])] *= factor
    moved = points + share[:, None] * (target - points)
    for _ in range(20):
        bad = scaled_jacobians(moved, cells) < least - 1e-12
        if not bad.any():
            break
        nodes = np.unique(cells[bad])
        moved[nodes] = points[nodes]
    return moved
