"""A limb for the page: few enough triangles to turn it on any machine."""

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.domain import Indentation, Limb, Protocol
from palpate.report.convergence import Contact
from palpate.report.limb_view import LimbView, ViewPart, limb_view, scatter_trace


def scene(limb: Limb, protocol: Protocol | None, most: int) -> list[dict[str, Any]]:
    """Traces for Plotly of a limb, and of the sphere at rest on it and at its greatest depth.

    Parameters
    ----------
    limb : Limb
    protocol : Protocol, optional
        Whose sphere is shown; none without one.
    most : int
        Triangles beyond which parts are made coarser, all to the same size of detail.
    """
    if not isinstance(protocol, Indentation):
        return coarsened(limb_view(limb), most).traces()
    traces = coarsened(limb_view(limb, protocol.indenter.radius_mm), most).traces()
    sphere = next(trace for trace in traces if trace["name"] == "sphere")
    depth = float(protocol.path[:, 0].max())
    # The same sphere where it presses deepest; hidden until it is asked for.
    moved = {
        axis: np.round(np.array(sphere[axis]) - depth * along, 2).tolist()
        for axis, along in zip("xyz", limb.spot.normal.tolist(), strict=True)
    }
    return [*traces, sphere | moved | {"name": f"sphere at {depth:g} mm", "visible": "legendonly"}]


def edge_of_contact(limb: Limb, protocol: Indentation, contact: Contact) -> dict[str, Any] | None:
    """Trace of the circle on the sphere, where it presses deepest, up to which it is touched."""
    depths, radii = contact["depth_mm"], contact.get("contact_radius_mm")
    if radii is None:
        return None
    k = int(np.argmax(depths))
    ball, radius = protocol.indenter.radius_mm, min(radii[k], protocol.indenter.radius_mm)
    normal = limb.spot.normal
    centre = limb.spot.position_mm + (ball - depths[k] - np.sqrt(ball**2 - radius**2)) * normal
    across = np.linalg.svd(normal[None])[2][1:]
    turns = np.linspace(0.0, 2.0 * np.pi, 49)
    points = centre + radius * np.column_stack([np.cos(turns), np.sin(turns)]) @ across
    name = f"edge of the contact at {depths[k]:g} mm: radius {radius:.3g} mm"
    return scatter_trace(name, points, "lines")


def coarsened(view: LimbView, most: int) -> LimbView:
    """Merge the points of each part within cells of one size, just as large as is needed.

    The sphere, whose triangles are few and do not count, stays what it is.
    """
    size = 0.0
    parts = view.parts
    while sum(len(part.triangles) for part in parts if part.role != "sphere") > max(most, 0):
        size = 1.3 * size or 0.5 * _mean_edge(view.parts)
        parts = tuple(_coarser(part, size) for part in view.parts)
    return replace(view, parts=parts)


def _mean_edge(parts: tuple[ViewPart, ...]) -> float:
    corners = np.concatenate([part.points_mm[part.triangles] for part in parts])
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def _coarser(part: ViewPart, size_mm: float) -> ViewPart:
    """One point per cell, the mean of those in it; what has become a line is left out."""
    if part.role == "sphere":
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
