"""A limb for the page, few enough triangles to turn it on any machine; and the skin under the press."""

import base64
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.api import (
    FloatArray,
    Indentation,
    Indenter,
    IntArray,
    Limb,
    MeshError,
    Protocol,
    SurfaceStates,
    convert,
)
from palpate.api.mesh import spot_axes
from palpate_report.data.report_data import ReportData
from palpate_report.figures.limb_view import ViewPart, limb_view, traces

MOST_BYTES = 300_000
"""Most bytes of displacements and pressures of all spots together: they are a part of one page."""

MOST_STATES = 15
"""Most states of a path."""


def skins(data: ReportData) -> list[dict[str, Any] | None]:
    """Data from which the page's script draws the skin at each spot; None where it was not simulated."""
    most = MOST_BYTES // max(1, len(data.surfaces))
    factor = 1.0 / convert(f"1 {data.modulus_unit}", "MPa")
    return [
        _skin(data, spot, data.surfaces[spot], most, factor) if spot in data.surfaces else None
        for spot in data.spots
    ]


def deepest(states: SurfaceStates) -> int:
    """The first of the states at the greatest depth."""
    return int(np.argmax(states.depth_mm >= states.depth_mm.max() - 1e-6))


def shown_states(states: SurfaceStates) -> IntArray:
    """States that are shown: at most so many, both ends of the path and the deepest among them."""
    even = np.linspace(0, states.depth_mm.size - 1, min(states.depth_mm.size, MOST_STATES - 1))
    return np.unique([*even.round().astype(np.int64), deepest(states)])


def _skin(
    data: ReportData, spot: str, states: SurfaceStates, most: int, factor: float
) -> dict[str, Any] | None:
    if not states.depth_mm.size or not states.triangles.size:
        return None
    chosen = shown_states(states)
    axes, origin = states.rotations[0], states.positions_mm[0]
    # A number has two bytes.
    nodes, triangles = _nearest(states, most // (4 * 2 * chosen.size))
    pressures = factor * states.pressures_MPa[np.ix_(chosen, nodes)]
    poses = np.einsum("ji,kjl->kil", axes, states.rotations[chosen])
    indenter = _indenter(data.study.protocol_at(spot))
    outline = np.zeros((0, 3)) if indenter is None else indenter.surface()[0]
    return {
        "n": int(nodes.size),
        "unit": data.modulus_unit,
        "first": int(np.searchsorted(chosen, deepest(states))),
        "triangles": triangles.ravel().tolist(),
        "points": _packed((states.points_mm[nodes] - origin) @ axes),
        "displacements": _packed(states.displacements_mm[np.ix_(chosen, nodes)] @ axes),
        "pressures": _packed(pressures),
        "labels": [
            f"depth {depth:.3g} mm, rotation {turn:.3g}°"
            for depth, turn in zip(states.depth_mm[chosen], states.rotation_deg[chosen], strict=True)
        ],
        "positions": np.round((states.positions_mm[chosen] - origin) @ axes, 3).tolist(),
        "rotations": np.round(poses, 5).tolist(),
        "indenter": np.round(outline[:: max(1, -(-len(outline) // 200))], 3).tolist(),
    }


def _nearest(states: SurfaceStates, most: int) -> tuple[IntArray, IntArray]:
    """Nodes next to the spot, at most so many, and the triangles (m, 3) between them by their new numbers."""
    apart = np.linalg.norm(states.points_mm - states.positions_mm[0], axis=1)
    is_near = np.zeros(apart.size, dtype=np.bool_)
    is_near[np.argsort(apart, kind="stable")[: max(most, 3)]] = True
    kept = states.triangles[is_near[states.triangles].all(axis=1)]
    nodes, numbers = np.unique(kept, return_inverse=True)
    return nodes, numbers.reshape(-1, 3)


def _packed(values: FloatArray) -> dict[str, Any]:
    """An array in integers of two bytes, and what each of them is worth."""
    scale = float(np.abs(values).max(initial=0.0)) / np.iinfo(np.int16).max or 1.0
    integers = np.round(values / scale).astype("<i2")
    return {"scale": float(f"{scale:.6g}"), "data": base64.b64encode(integers.tobytes()).decode()}


def scene(limb: Limb, protocol: Protocol | None, most: int) -> list[dict[str, Any]]:
    """Traces for Plotly of a limb, and of the indenter at rest on it and at its greatest depth.

    Parameters
    ----------
    protocol : Protocol, optional
        Whose indenter is shown; none without one, or where the file of its shape cannot be read.
    most : int
        Triangles beyond which parts are made coarser, all to the same size of detail.
    """
    indenter = _indenter(protocol)
    size = float(np.ptp(limb.mesh.points_mm, axis=0).max())
    arrow_mm = 0.25 * size if indenter is None else 3.0 * indenter.radius_mm
    shown = traces(limb, coarsened(limb_view(limb, indenter, most), most), arrow_mm)
    if indenter is None or not isinstance(protocol, Indentation):
        return shown
    name = indenter.name
    at_rest = next(trace for trace in reversed(shown) if trace["name"] == name)
    pose = protocol.waypoints.pose
    deepest = pose[int(np.argmax(pose[:, 0]))]
    depth = float(deepest[0])
    # The same where it presses deepest; hidden until it is asked for.
    moved = dict(zip("xyz", _moved(limb, np.stack([at_rest[a] for a in "xyz"], 1), deepest), strict=True))
    return [*shown, at_rest | moved | {"name": f"{name} at {depth:g} mm", "visible": "legendonly"}]


def _indenter(protocol: Protocol | None) -> Indenter | None:
    """Indenter of the protocol; None where nothing presses, or where the file of its shape cannot be read."""
    if not isinstance(protocol, Indentation):
        return None
    try:
        protocol.indenter.distance(np.zeros((1, 3)))
    except MeshError:
        return None
    return protocol.indenter


def _moved(limb: Limb, points: FloatArray, pose: FloatArray) -> list[list[float]]:
    """Coordinates of points (n, 3) of the indenter at rest, in a pose (6,) of equilibrium states."""
    from scipy.spatial.transform import Rotation

    depth, shift_x, shift_y, *tilt, turn = pose.tolist()
    rotation = Rotation.from_rotvec([*tilt, 0.0], degrees=True)
    rotation *= Rotation.from_rotvec([0.0, 0.0, turn], degrees=True)
    axes = spot_axes(limb.spot.normal, limb.spot.along)
    inside = rotation.apply((points - limb.spot.position_mm) @ axes) + np.array([shift_x, shift_y, -depth])
    return np.round(limb.spot.position_mm + inside @ axes.T, 2).T.tolist()


def coarsened(parts: tuple[ViewPart, ...], most: int) -> tuple[ViewPart, ...]:
    """Merge the points of each part within cells of one size, just as large as is needed.

    The indenter, whose triangles are few and do not count, stays what it is.
    """
    size, coarse = 0.0, parts
    while sum(len(part.triangles) for part in coarse if part.role != "indenter") > max(most, 0):
        size = 1.3 * size or 0.5 * _mean_edge(parts)
        coarse = tuple(_coarser(part, size) for part in parts)
    return coarse


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
