"""Refuses a press that would cross the edge of the contact surface."""

import numpy as np

from palpate.api import Indentation, IntArray, Limb, Mesh, MeshError
from palpate.mesh.spot_frame import in_spot_frame
from palpate_jax.contact_surface import contact_surfaces


def check_footprint(limb: Limb, protocol: Indentation) -> None:
    """Refuse a contact surface that ends within reach of the sphere.

    A sphere of radius R pressed d deep touches flat tissue up to about √(R d) from
    its axis (Hertz), and never further than R.

    Raises
    ------
    MeshError
        No face can be touched, or the surface ends too near; with the node.
    """
    mesh = in_spot_frame(limb)
    radius, depth = protocol.indenter.radius_mm, float(protocol.path[:, 0].max())
    reach = min(np.sqrt(radius * max(depth, 0.0)), radius)
    rim = _rim(mesh)
    rim = rim[mesh.points_mm[rim, 2] > -(depth + radius)]  # the edge on the limb's other side does not matter
    if not rim.size:
        return
    distances = np.hypot(mesh.points_mm[rim, 0], mesh.points_mm[rim, 1])
    nearest = int(np.argmin(distances))
    if distances[nearest] < reach:
        raise MeshError(
            f"spot '{limb.spot.name}': the contact surface ends {distances[nearest]:.3g} mm from the "
            f"sphere's axis, near node {rim[nearest]}, and a sphere of radius {radius:g} mm pressed "
            f"{depth:g} mm deep touches up to about {reach:.3g} mm; mark more of the surface as contact, "
            "extend the mesh, or press less deep"
        )


def _rim(mesh: Mesh) -> IntArray:
    """End nodes (2 n,) of the edges that belong to one contact face only, pair after pair."""
    edges = []
    for surface in contact_surfaces(mesh):
        corners = surface.nodes[:, : 4 if surface.nodes.shape[1] == 4 else 3]
        edges.append(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
    if not edges:
        return np.empty(0, dtype=np.int64)
    unique, counts = np.unique(np.sort(np.concatenate(edges), axis=1), axis=0, return_counts=True)
    rim: IntArray = unique[counts == 1].ravel()
    return rim
