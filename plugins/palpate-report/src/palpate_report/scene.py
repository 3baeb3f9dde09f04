"""A limb for the page: few enough triangles to turn it on any machine."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.api import FloatArray, Indentation, Indenter, Limb, MeshError, Protocol
from palpate.api.mesh import spot_axes
from palpate_report.convergence import Contact
from palpate_report.limb_view import LimbView, ViewPart, limb_view, scatter_trace


def scene(limb: Limb, protocol: Protocol | None, most: int) -> list[dict[str, Any]]:
    """Traces for Plotly of a limb, and of the indenter at rest on it and at its greatest depth.

    Parameters
    ----------
    limb : Limb
    protocol : Protocol, optional
        Whose indenter is shown; none without one, or where the file of its shape cannot be read.
    most : int
        Triangles beyond which parts are made coarser, all to the same size of detail.
    """
    if not isinstance(protocol, Indentation) or not _is_known(protocol.indenter):
        return coarsened(limb_view(limb), most).traces()
    traces = coarsened(limb_view(limb, protocol.indenter), most).traces()
    name = protocol.indenter.name
    at_rest = next(trace for trace in reversed(traces) if trace["name"] == name)
    pose = protocol.waypoints.pose
    deepest = pose[int(np.argmax(pose[:, 0]))]
    depth = float(deepest[0])
    # The same where it presses deepest; hidden until it is asked for.
    moved = dict(zip("xyz", _moved(limb, np.stack([at_rest[a] for a in "xyz"], 1), deepest), strict=True))
    return [*traces, at_rest | moved | {"name": f"{name} at {depth:g} mm", "visible": "legendonly"}]


def _moved(limb: Limb, points: FloatArray, pose: FloatArray) -> list[list[float]]:
    """Coordinates of points (n, 3) of the indenter at rest, in a pose (6,) of equilibrium states."""
    depth, shift_x, shift_y, *tilt, turn = pose.tolist()
    rotation = Rotation.from_rotvec([*tilt, 0.0], degrees=True)
    rotation *= Rotation.from_rotvec([0.0, 0.0, turn], degrees=True)
    axes = spot_axes(limb.spot.normal, limb.spot.along)
    inside = rotation.apply((points - limb.spot.position_mm) @ axes) + np.array([shift_x, shift_y, -depth])
    there: list[list[float]] = np.round(limb.spot.position_mm + inside @ axes.T, 2).T.tolist()
    return there


def edge_of_contact(limb: Limb, protocol: Indentation, contact: Contact) -> dict[str, Any] | None:
    """Trace of the circle on the indenter, where it presses deepest, up to which it is touched.

    None where the radius is not known, or the file of the indenter's shape cannot be read.
    """
    depths, radii = contact["depth_mm"], contact.get("contact_radius_mm")
    if radii is None or not _is_known(protocol.indenter):
        return None
    k = int(np.argmax(depths))
    indenter = protocol.indenter
    radius = min(radii[k], float(indenter.bounds_mm[1, :2].max()))
    turns = np.linspace(0.0, 2.0 * np.pi, 49)
    edge = radius * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(turns.size)])
    edge[:, 2] = _height(indenter, edge) - depths[k]
    points = limb.spot.position_mm + edge @ spot_axes(limb.spot.normal, limb.spot.along).T
    name = f"edge of the contact at {depths[k]:g} mm: radius {radius:.3g} mm"
    return scatter_trace(name, points, "lines")


def _is_known(indenter: Indenter) -> bool:
    """Whether the shape can be had: a run may be shown where the file of its tool is not."""
    try:
        indenter.distance(np.zeros((1, 3)))
    except MeshError:
        return False
    return True


def _height(indenter: Indenter, points: FloatArray) -> FloatArray:
    """Height (n,) [mm] of the underside above points (n, 3): as far up as one gets outside."""
    height = np.full(len(points), indenter.bounds_mm[0, 2])
    top = indenter.bounds_mm[1, 2]
    for _ in range(100):
        gap = indenter.distance(np.column_stack([points[:, :2], height]))
        height = np.clip(height + np.maximum(gap, 0.0), None, top)
    return height


def coarsened(view: LimbView, most: int) -> LimbView:
    """Merge the points of each part within cells of one size, just as large as is needed.

    The indenter, whose triangles are few and do not count, stays what it is.
    """
    size = 0.0
    parts = view.parts
    while sum(len(part.triangles) for part in parts if part.role != "indenter") > max(most, 0):
        size = 1.3 * size or 0.5 * _mean_edge(view.parts)
        parts = tuple(_coarser(part, size) for part in view.parts)
    return replace(view, parts=parts)


def _mean_edge(parts: tuple[ViewPart, ...]) -> float:
    corners = np.concatenate([part.points_mm[part.triangles] for part in parts])
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def _coarser(part: ViewPart, size_mm: float) -> ViewPart:
    """One point per cell, the mean of those in it; what has become a line is left out."""
    if part.role == "indenter":
        return part
    cells = np.floor(part.points_mm / size_mm).astype(np.int64)
    _, merged, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    merged = merged.ravel()
    points = np.zeros((counts.size, 3))
    np.add.at(points, merged, part.points_mm)
    a, b, c = (triangles := merged[part.triangles]).T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return replace(part, points_mm=points / counts[:, None], triangles=triangles[np.sort(first)])
