"""Quality of the elements of a limb's mesh, and whether a solver would choke on them.

The scaled Jacobian of a tetrahedron's corner is √2 det(e₁, e₂, e₃) / (|e₁||e₂||e₃|), one for
a regular tetrahedron; an element has the least of its corners'. A curved element
counts with its corners' own edges and with its Jacobian at the corners and in the middle.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from palpate.api import FloatArray, IntArray, Limb, MeshError
from palpate.api.mesh import CELLS, SLOPES, contact_edge_mm
from palpate_limb.segment import Segment

LEAST_SCALED_JACOBIAN = 0.02
LEAST_NEAR = 0.1
"""Quality of elements under the indenter: a sliver there changes the curves, elsewhere it costs steps."""
_CORNERS = np.array([(0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 0, 2, 1)])
_CORNERS.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """Figures of one mesh.

    Dihedral angles are of the straight-edged elements, ``contact_edge_mm`` is the mean edge of contact
    faces within ``near_mm`` of the spot, ``near_scaled_jacobian`` the least of elements with their middle
    there, ``layers_mm`` mean and standard deviation of each layer's thickness there, the outermost first,
    ``volume_error`` the difference from the volume between scan, bones and cuts as a share of it, and
    ``regions`` the share of the volume of each.
    """

    n_nodes: int
    n_cells: int
    least_scaled_jacobian: float
    near_scaled_jacobian: float
    least_dihedral_deg: float
    largest_dihedral_deg: float
    contact_edge_mm: float
    near_mm: float
    volume_error: float
    regions: dict[str, float]
    layers_mm: dict[str, tuple[float, float]]


def assess(limb: Limb, segment: Segment, near_mm: float, rise_mm: float = 0.0) -> Quality:
    """Figures of a limb's mesh against the segment that it fills, ``rise_mm`` above it along the normal."""
    mesh = limb.mesh
    ((kind, cells),) = mesh.cells.items()
    points = mesh.points_mm
    scaled = scaled_jacobians(points, cells)
    angles = dihedral_angles_deg(points, cells)
    volumes = cell_volumes(points, cells)
    whole = segment.tissue.volume_mm3
    ids = mesh.cell_regions[kind]
    near = np.linalg.norm(points[cells[:, :4]].mean(axis=1), axis=1) < near_mm
    return Quality(
        n_nodes=mesh.n_nodes,
        n_cells=mesh.n_cells,
        least_scaled_jacobian=float(scaled.min()),
        near_scaled_jacobian=float(scaled[near].min(initial=1.0)),
        least_dihedral_deg=float(angles.min()),
        largest_dihedral_deg=float(angles.max()),
        contact_edge_mm=contact_edge_mm(limb, near_mm),
        near_mm=near_mm,
        volume_error=float(volumes.sum() / whole - 1.0),
        regions={name: float(volumes[ids == i].sum() / volumes.sum()) for i, name in enumerate(mesh.regions)},
        layers_mm=dict(_layers(limb, segment, near_mm, rise_mm)),
    )


def _layers(
    limb: Limb, segment: Segment, near_mm: float, rise_mm: float
) -> Iterator[tuple[str, tuple[float, float]]]:
    """Mean and standard deviation of each layer's thickness [mm] within ``near_mm`` of the normal."""
    mesh = limb.mesh
    ((kind, cells),) = mesh.cells.items()
    regions = mesh.cell_regions[kind]
    above, depth_above = np.zeros((1, 3)), np.zeros(1)
    for i, name in enumerate(mesh.regions[:-1]):
        shared = np.intersect1d(cells[regions <= i], cells[regions > i])
        points = mesh.points_mm[shared]
        under = (np.hypot(points[:, 0], points[:, 1]) < near_mm) & (points[:, 2] > -3.0 * near_mm)
        if not under.any():
            return
        points = points[under]
        depth = segment.skin.nearest(points + np.array([0.0, 0.0, rise_mm]))[1]
        thickness = depth - depth_above[cKDTree(above).query(points)[1]]
        yield name, (float(thickness.mean()), float(thickness.std()))
        above, depth_above = points, depth


def check_quality(quality: Quality, spot: str, wanted_mm: float) -> None:
    """Refuse, by a MeshError, a mesh on which a solver would choke, or that is not the scan's."""
    if quality.least_scaled_jacobian < LEAST_SCALED_JACOBIAN:
        raise MeshError(
            f"spot '{spot}': an element with scaled Jacobian {quality.least_scaled_jacobian:.3g} "
            f"(at least {LEAST_SCALED_JACOBIAN} is needed); use smaller elements (size)"
        )
    if quality.near_scaled_jacobian < LEAST_NEAR:
        raise MeshError(
            f"spot '{spot}': an element under the indenter with scaled Jacobian "
            f"{quality.near_scaled_jacobian:.3g} (at least {LEAST_NEAR} is needed there); use smaller "
            "elements (size)"
        )
    if abs(quality.volume_error) > 0.01:
        raise MeshError(
            f"spot '{spot}': the mesh has {100 * quality.volume_error:+.2g} % more volume than the scan; use "
            "smaller elements or a smaller tolerance"
        )
    # Mean edge under the indenter over the one asked for, at most.
    if quality.contact_edge_mm > 1.35 * wanted_mm:
        raise MeshError(
            f"spot '{spot}': edges under the indenter are {quality.contact_edge_mm:.3g} mm long where "
            f"{wanted_mm:g} mm were asked for (size); mesh it again, or ask for longer ones"
        )


def scaled_jacobians(points: FloatArray, cells: IntArray) -> FloatArray:
    """Least scaled Jacobian of each tetrahedron of 4 or 10 nodes: (n,), 1 at best, ≤ 0 where it is folded."""
    corners = points[cells[:, :4]]
    edges = corners[:, _CORNERS[:, 1:]] - corners[:, _CORNERS[:, :1]]
    det = np.einsum("ncj,ncj->nc", np.cross(edges[:, :, 0], edges[:, :, 1]), edges[:, :, 2])
    lengths = np.linalg.norm(edges, axis=3).prod(axis=2)
    scaled = (np.sqrt(2.0) * det / np.maximum(lengths, 1e-300)).min(axis=1)
    if cells.shape[1] == 4:
        return np.asarray(scaled)
    # The determinant of a curved element against that of its straight one: 1 where nothing is bent.
    straight = np.linalg.det(np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 2))
    ratio = (
        np.stack([_determinant(points[cells], slopes) for slopes in SLOPES["tet10"]], axis=1)
        / straight[:, None]
    )
    return np.asarray(np.where(straight > 0.0, scaled * np.minimum(ratio.min(axis=1), 1.0), -np.abs(scaled)))


def _determinant(nodes: FloatArray, slopes: FloatArray) -> FloatArray:
    """Jacobian determinant (n,) of quadratic tetrahedra (n, 10, 3) where the slopes (10, 3) are taken."""
    return np.asarray(np.linalg.det(np.einsum("ak,cai->cik", slopes, nodes)))


def cell_volumes(points: FloatArray, cells: IntArray) -> FloatArray:
    """Volumes [mm³] of tetrahedra of 4 or 10 nodes: (n,)."""
    if cells.shape[1] == 4:
        corners = points[cells]
        return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0)
    return np.asarray(sum(_determinant(points[cells], slopes) for slopes in SLOPES["tet10"][4:]) / 24.0)


def dihedral_angles_deg(points: FloatArray, cells: IntArray) -> FloatArray:
    """The six angles between faces (n, 6) of straight tetrahedra."""
    corners = points[cells[:, :4]]
    a, b, c = np.moveaxis(corners[:, np.array(CELLS["tet4"].corner_faces)], 2, 0)
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-300)
    cosines = [-np.einsum("ij,ij->i", normals[:, i], normals[:, j]) for i in range(4) for j in range(i)]
    return np.asarray(np.rad2deg(np.arccos(np.clip(np.stack(cosines, axis=1), -1.0, 1.0))))
