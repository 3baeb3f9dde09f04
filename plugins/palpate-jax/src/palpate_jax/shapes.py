"""Shapes of rigid indenters, as signed distances in the indenter's frame.

The frame's origin is the indenter's lowest point and its z axis points away
from the limb, so that an indenter at rest just touches the spot.
"""

from typing import Protocol

import numpy as np

from palpate.api import FloatArray, Sphere


class Shape(Protocol):
    """A rigid indenter; smooth where tissue touches it."""

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,) [mm] of points (n, 3) to the surface, negative inside."""
        ...

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient (n, 3) of the distance, the outward normal, and its derivative (n, 3, 3) [1/mm]."""
        ...


class SphereShape:
    """A sphere whose lowest point is the origin.

    Parameters
    ----------
    radius_mm : float
    """

    def __init__(self, radius_mm: float) -> None:
        self._centre = np.array([0.0, 0.0, radius_mm])
        self._radius = radius_mm

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,) [mm]."""
        arms = points - self._centre
        distance: FloatArray = np.sqrt((arms * arms).sum(axis=1)) - self._radius
        return distance

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normals (n, 3) and their derivative (I − n nᵀ)/r."""
        arms = points - self._centre
        r = np.sqrt((arms * arms).sum(axis=1))[:, None]
        n = arms / r
        return n, (np.eye(3) - n[:, :, None] * n[:, None, :]) / r[:, :, None]


class RoundedPunch:
    """A flat-ended cylinder whose edge is rounded.

    Parameters
    ----------
    radius_mm : float
        Of the cylinder.
    edge_mm : float
        Radius of the rounded edge, at most ``radius_mm``.
    """

    def __init__(self, radius_mm: float, edge_mm: float) -> None:
        if not 0.0 < edge_mm <= radius_mm:
            raise ValueError(f"edge_mm is {edge_mm}; give a rounding in (0, {radius_mm}] mm")
        self._flat = radius_mm - edge_mm
        self._edge = edge_mm

    def _corner(self, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Radius from the axis (n,), and the offset (n,), (n,) from the middle line of the rounding."""
        radius = np.hypot(points[:, 0], points[:, 1])
        return radius, radius - self._flat, self._edge - points[:, 2]

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance (n,) [mm]."""
        _, out, below = self._corner(points)
        outside = np.hypot(np.maximum(out, 0.0), np.maximum(below, 0.0))
        inside = np.minimum(np.maximum(out, below), 0.0)
        return np.asarray(outside + inside - self._edge)

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normals (n, 3) and their derivative: 0 at the flat, of a torus and a cylinder next to it."""
        radius, out, below = self._corner(points)
        side = np.where((out <= 0.0) & (below <= 0.0), out > below, out > 0.0)
        end = np.where((out <= 0.0) & (below <= 0.0), out <= below, below > 0.0)
        away = np.where(side, np.where(end, out, 1.0), 0.0)
        down = np.where(end, np.where(side, below, 1.0), 0.0)
        size = np.hypot(away, down)
        radial = np.zeros_like(points)
        radial[:, :2] = points[:, :2] / np.maximum(radius, 1e-300)[:, None]
        around = np.cross([0.0, 0.0, 1.0], radial)
        n = (away / size)[:, None] * radial - (down / size)[:, None] * np.array([0.0, 0.0, 1.0])
        # Along the rounding the normal turns with 1/size, around the axis with its radial part / radius.
        along = (down / size)[:, None] * radial + (away / size)[:, None] * np.array([0.0, 0.0, 1.0])
        rounded = np.where(side & end, 1.0 / size, 0.0)
        turning = np.where(side, away / size / np.maximum(radius, 1e-300), 0.0)
        derivative = rounded[:, None, None] * along[:, :, None] * along[:, None, :]
        derivative += turning[:, None, None] * around[:, :, None] * around[:, None, :]
        return n, derivative


def shape_of(indenter: Sphere) -> Shape:
    """The shape of a protocol's indenter."""
    return SphereShape(indenter.radius_mm)
