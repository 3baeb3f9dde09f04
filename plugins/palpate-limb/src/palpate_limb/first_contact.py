"""Moves a mesh to where the indenter first touches it, so that depth 0 is first contact."""

from dataclasses import replace

import numpy as np

from palpate.api import FloatArray, Limb
from palpate.mesh.topology import CELLS


def moved_to_contact(limb: Limb, radius_mm: float) -> tuple[Limb, float]:
    """The limb, moved along the spot's normal until a sphere there just touches it, and how far [mm].

    Parameters
    ----------
    limb : Limb
        In the frame of its spot.
    radius_mm : float
        Of the sphere, whose lowest point is at the spot.
    """
    points = _surface_points(limb, radius_mm)
    # The sphere about (0, 0, R + h) touches the point (x, y, z) from above at h = z + √(R² − x² − y²) − R.
    rise = float((points[:, 2] + np.sqrt(radius_mm**2 - (points[:, :2] ** 2).sum(axis=1)) - radius_mm).max())
    mesh = replace(limb.mesh, points_mm=limb.mesh.points_mm - np.array([0.0, 0.0, rise]))
    return replace(limb, mesh=mesh), rise


def _surface_points(limb: Limb, radius_mm: float) -> FloatArray:
    """Points of the contact faces near the spot, on curved faces too."""
    mesh = limb.mesh
    ((kind, cells),) = mesh.cells.items()
    on = np.zeros(mesh.n_nodes, dtype=np.bool_)
    on[mesh.node_sets["contact"]] = True
    faces = cells[:, np.array(CELLS[kind].faces)].reshape(-1, len(CELLS[kind].faces[0]))
    faces = faces[on[faces[:, :3]].all(axis=1)]
    near = np.linalg.norm(mesh.points_mm[faces[:, :3]].mean(axis=1), axis=1) < 2.0 * radius_mm
    shares = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, 9),) * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    shares = shares[shares.sum(axis=1) <= 1.0 + 1e-12]
    b = np.column_stack([1.0 - shares.sum(axis=1), shares])
    values = (
        b if faces.shape[1] == 3 else np.column_stack([b * (2.0 * b - 1.0), 4.0 * b * np.roll(b, -1, axis=1)])
    )
    points = (values @ mesh.points_mm[faces[near]]).reshape(-1, 3)
    inside: FloatArray = points[np.linalg.norm(points[:, :2], axis=1) < 0.9 * radius_mm]
    return inside[inside[:, 2] > -radius_mm]
