"""A flat skin that a sphere presses a dimple into."""

import numpy as np

from palpate.domain import SurfaceStates


def dimple(n_across=12, n_states=9, turned=0, size_mm=30.0):
    """States of a square skin: pressed to 8 mm, the last ``turned`` of them twisted at that depth."""
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(-size_mm, size_mm, n_across)]))
    points = np.column_stack([x, y, 0.0 * x])
    cells = np.arange(n_across * n_across).reshape(n_across, n_across)
    a, b, c, d = (part.ravel() for part in (cells[:-1, :-1], cells[:-1, 1:], cells[1:, 1:], cells[1:, :-1]))
    pressed = max(n_states - turned, 1)
    depth = np.append(np.linspace(0.5, 8.0, pressed), np.full(n_states - pressed, 8.0))
    rotation = np.append(np.zeros(pressed), np.linspace(2.0, 20.0, n_states - pressed))
    near = np.exp(-(x**2 + y**2) / 80.0)
    moved = np.zeros((n_states, points.shape[0], 3))
    moved[..., 2] = -depth[:, None] * near
    pressure = 0.01 * np.maximum(near - 0.5, 0.0) * depth[:, None]
    # The spot is not at the origin, and its normal is the x axis of the mesh.
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    place = np.array([100.0, 20.0, -5.0])
    k, n = depth.size, len(points)
    return SurfaceStates(
        points_mm=place + points @ turn.T,
        triangles=np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]),
        depth_mm=depth,
        rotation_deg=rotation,
        positions_mm=place - (depth - depth[0])[:, None] * turn[:, 2],
        rotations=np.tile(turn, (k, 1, 1)),
        displacements_mm=moved @ turn.T,
        areas_mm2=np.full((k, n), 4.0),
        touching=(pressure > 0.0).astype(float),
        pressures_MPa=pressure,
        shears_MPa=np.zeros((k, n, 3)),
        tractions_MPa=-pressure[..., None] * turn[:, 2],
    )
