"""Refuses a motion that starts inside of the limb, never touches it, or leaves its surface."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from palpate.api import BoolArray, FloatArray, Indentation, IntArray, Limb, Mesh, MeshError, Waypoints
from palpate.api.mesh import NEAR, contact_edge_mm, in_spot_frame
from palpate_jax.contact_surface import contact_surfaces
from palpate_jax.schedule import pose


def check_touch(limb: Limb, protocol: Indentation) -> None:
    """Refuse a surface that overlaps the indenter at depth 0, is not at the spot, or is never touched.

    Raises
    ------
    MeshError
        With the node.
    """
    mesh, indenter = in_spot_frame(limb), protocol.indenter
    surface = mesh.points_mm[mesh.node_sets["contact"]]
    gaps = indenter.distance(surface)
    from_axis = np.linalg.norm(surface[:, :2], axis=1)
    deepest, nearest = int(np.argmin(gaps)), int(np.argmin(from_axis + np.abs(surface[:, 2])))
    # A limb may curve away from the spot, but less than the indenter does.
    fall = surface[nearest, 2] + from_axis[nearest] ** 2 / (2.0 * indenter.radius_mm)
    for where, node, distance in (("inside", deepest, -gaps[deepest]), ("off", nearest, -fall)):
        # Largest gap or overlap of the surface and the indenter at depth 0.
        if distance > 0.05:
            raise MeshError(
                f"spot '{limb.spot.name}': at depth 0 the {indenter.name} is {where} the surface by "
                f"{distance:.2f} mm near {np.round(surface[node], 2)} mm (spot frame); "
                "move the spot onto the surface or correct its normal"
            )
    depth = float(protocol.path[:, 0].max())
    # Nodes may all be next to a tool that is smaller than a face, but not further away than the edges.
    gap = min(float(indenter.distance(pose(at).into(surface)).min()) for at in protocol.waypoints.pose)
    if depth > 0.0 and gap > contact_edge_mm(limb, NEAR * indenter.radius_mm):
        raise MeshError(
            f"spot '{limb.spot.name}': the {indenter.name} is still {gap:.2f} mm away from the surface at "
            f"depth {depth:g} mm, and never touches it; press deeper, or correct its shape"
        )


def check_footprint(limb: Limb, protocol: Indentation) -> None:
    """Refuse a contact surface that ends within reach of the indenter.

    A sphere of radius R pressed d deep touches flat tissue up to about √(R d) from
    its axis (Hertz), and never further than R. Other tools reach further along one side than along
    another; see :meth:`palpate.api.Indenter.reaches_mm`. A tilt moves that place by at most the body's
    size times its angle.

    Raises
    ------
    MeshError
        No face can be touched, or the surface ends too near; with the node.
    """
    mesh = in_spot_frame(limb)
    radius, depth = protocol.indenter.radius_mm, float(protocol.path[:, 0].max())
    lateral_mm = _lateral_mm(protocol)
    most = protocol.indenter.reach_mm(depth) + lateral_mm
    rim = _rim(mesh)
    # The edge on the limb's other side does not matter.
    lowest = depth + max(radius, -float(protocol.indenter.bounds_mm[0, 2]))
    rim = rim[mesh.points_mm[rim, 2] > -lowest]
    if not rim.size:
        return
    way = np.where(_is_pushed(protocol.waypoints), 0.0, protocol.waypoints.pose[:, 1:3])
    for offsets in _from_way(mesh.points_mm[rim, :2], way):
        distances = np.hypot(*offsets.T)
        near = np.flatnonzero(distances < most)
        directions = offsets[near] / np.maximum(distances[near], 1e-12)[:, None]
        reach = _reach(protocol, depth, directions) + lateral_mm
        if (within := reach - distances[near]).size and within.max() > 0.0:
            worst = int(np.argmax(within))
            raise MeshError(
                f"spot '{limb.spot.name}': the contact surface ends {distances[near[worst]]:.3g} mm from the "
                f"{protocol.indenter.name}'s axis, near node {rim[near[worst]]}, and pressed "
                f"{depth:g} mm deep touches up to about {reach[worst]:.3g} mm there; mark more of the "
                "surface as contact, extend the mesh, or press and move less far"
            )


def _lateral_mm(protocol: Indentation) -> float:
    """Distance by which tilts, and shifts by loads, may move the contact from the prescribed way."""
    waypoints, indenter = protocol.waypoints, protocol.indenter
    tilt = np.radians(np.hypot(waypoints.pose[:, 3], waypoints.pose[:, 4]).max())
    lateral_mm = 2.0 * indenter.radius_mm * float(np.sin(tilt))
    pushed = np.where(_is_pushed(waypoints), waypoints.pose[:, 1:3], 0.0)
    return lateral_mm + float(np.linalg.norm(pushed, axis=1).max())


def _is_pushed(waypoints: Waypoints) -> BoolArray:
    """Whether a load moves each shift (n, 2), so that its row has the limit."""
    loads = waypoints.loads
    return np.zeros((len(waypoints.pose), 2), np.bool_) if loads is None else ~np.isnan(loads[:, 1:3])


def _from_way(points: FloatArray, way: FloatArray) -> Iterator[FloatArray]:
    """Offsets (n, 2) of points (n, 2) from the nearest place on each part of the way through rows (k, 2)."""
    parts = [(start, end - start) for start, end in pairwise(way) if (end != start).any()]
    for start, along in parts or [(way[0], np.ones(2))]:
        share = np.clip((points - start) @ along / (along @ along), 0.0, 1.0 if parts else 0.0)
        yield points - start - share[:, None] * along


def _rim(mesh: Mesh) -> IntArray:
    """End nodes (2 n,) of the edges that belong to one contact face only, pair after pair."""
    edges = []
    for surface in contact_surfaces(mesh):
        corners = surface.nodes[:, : 4 if surface.nodes.shape[1] == 4 else 3]
        edges.append(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2))
    if not edges:
        return np.empty(0, dtype=np.int64)
    unique, counts = np.unique(np.sort(np.concatenate(edges), axis=1), axis=0, return_counts=True)
    return unique[counts == 1].ravel()


def _reach(protocol: Indentation, depth_mm: float, directions: FloatArray) -> FloatArray:
    """Reach (n,) [mm] along unit vectors (n, 2), over all rotations of the path."""
    turns = protocol.path[:, 1]
    reach = np.zeros(len(directions))
    # Rotations between the ends of a twist at which a tool that is not round is looked at.
    for angle in np.deg2rad(np.linspace(turns.min(), turns.max(), 9 if np.ptp(turns) else 1)):
        turned = directions @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        reach = np.maximum(reach, protocol.indenter.reaches_mm(depth_mm, turned))
    return reach
