"""The skin under the press for the page: in the frame of its spot, and in two bytes a number."""

import base64
from collections.abc import Iterator
from typing import Any

import numpy as np

from palpate.api import FloatArray, Indentation, IntArray, MeshError, SurfaceStates, convert
from palpate_report.report_data import ReportData

MOST_BYTES = 300_000
"""Most bytes of displacements and pressures of all spots together: they are a part of one page."""

MOST_STATES = 15
"""Most states of a path."""

MOST_OUTLINE = 200
"""Most points of the indenter."""

BYTES = 2
"""Of each number."""


def skins(data: ReportData) -> list[dict[str, Any] | None]:
    """What the page's script draws the skin at each spot from; None where it was not simulated."""
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
    nodes, triangles = _nearest(states, most // (4 * BYTES * chosen.size))
    pressures = factor * states.pressures_MPa[np.ix_(chosen, nodes)]
    poses = np.einsum("ji,kjl->kil", axes, states.rotations[chosen])
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
        "indenter": list(_outline(data, spot)),
    }


def _nearest(states: SurfaceStates, most: int) -> tuple[IntArray, IntArray]:
    """Nodes next to the spot, at most so many, and the triangles (m, 3) between them by their new numbers."""
    apart = np.linalg.norm(states.points_mm - states.positions_mm[0], axis=1)
    is_near = np.zeros(apart.size, dtype=np.bool_)
    is_near[np.argsort(apart, kind="stable")[: max(most, 3)]] = True
    kept = states.triangles[is_near[states.triangles].all(axis=1)]
    nodes, numbers = np.unique(kept, return_inverse=True)
    return nodes, numbers.reshape(-1, 3)


def _outline(data: ReportData, spot: str) -> Iterator[list[float]]:
    """Points of the indenter in its own frame; none where the file of its shape cannot be read."""
    protocol = data.study.protocol_at(spot)
    if not isinstance(protocol, Indentation):
        return
    try:
        points, _ = protocol.indenter.surface()
    except MeshError:
        return
    yield from np.round(points[:: -(-len(points) // MOST_OUTLINE)], 3).tolist()


def _packed(values: FloatArray) -> dict[str, Any]:
    """An array in integers of two bytes, and what each of them is worth."""
    scale = float(np.abs(values).max(initial=0.0)) / np.iinfo(np.int16).max or 1.0
    integers = np.round(values / scale).astype("<i2")
    return {"scale": float(f"{scale:.6g}"), "data": base64.b64encode(integers.tobytes()).decode()}
