"""Skin of one quadrilateral under a press."""

import numpy as np

from palpate.domain import (
    SurfaceStates,
)


def skin(pressures, depths=(5.0,), touching=None):
    """A square of 2 mm, of two triangles, under pressures (k, 4) along −z."""
    p = np.atleast_2d(np.array(pressures, dtype=float))
    k = len(p)
    share = np.ones((k, 4)) if touching is None else np.atleast_2d(touching)
    areas = np.tile([4 / 3, 2 / 3, 4 / 3, 2 / 3], (k, 1))  # a third of each triangle of 2 mm²
    return SurfaceStates(
        points_mm=[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)],
        triangles=[(0, 1, 2), (0, 2, 3)],
        depth_mm=depths,
        rotation_deg=np.zeros(k),
        positions_mm=np.zeros((k, 3)),
        rotations=np.tile(np.eye(3), (k, 1, 1)),
        displacements_mm=np.zeros((k, 4, 3)),
        areas_mm2=areas,
        touching=share,
        pressures_MPa=p,
        shears_MPa=0.3 * p[..., None] * np.array([1.0, 0.0, 0.0]),
        tractions_MPa=p[..., None] * np.array([0.3, 0.0, -1.0]),
    )
