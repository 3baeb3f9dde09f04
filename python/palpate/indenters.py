"""The indenter of the paper; others come from plugins."""

from typing import Annotated

import numpy as np
from pydantic import Field

from palpate.domain import FloatArray, IntArray
from palpate.errors import MeshError
from palpate.plugins.indenter import Indenter
from palpate.plugins.interfaces import Array, Settings
from palpate.units import Quantity


class SphereSettings(Settings):
    """Settings of the indenter ``sphere``."""

    radius: Annotated[float, Quantity("mm")] = Field(gt=0.0, description="Radius of the sphere.")


class Sphere(Indenter[SphereSettings]):
    """A sphere whose lowest point is the origin.

    Parameters
    ----------
    settings : SphereSettings
    radius_mm : float
        In place of ``settings``.

    Examples
    --------
    >>> import numpy as np
    >>> Sphere(radius_mm=7.5).distance(np.array([[0.0, 0.0, 5.0]]))
    array([-5.])
    """

    name = "sphere"
    summary = "a sphere, touched at its lowest point"

    def __init__(self, settings: SphereSettings | None = None, *, radius_mm: float = 0.0) -> None:
        if settings is not None and radius_mm:
            raise MeshError("indenter: a sphere of settings and of radius_mm; give one of them")
        super().__init__(settings or SphereSettings.model_construct(radius=float(radius_mm)))
        self.radius_mm = self.edge_mm = self.settings.radius
        if not 0.0 < self.radius_mm < np.inf:
            raise MeshError(f"indenter: a sphere of radius {self.radius_mm} mm; give a radius > 0 mm")
        r = self.radius_mm
        self.bounds_mm = np.array([[-r, -r, 0.0], [r, r, 2.0 * r]])

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        xp = points.__array_namespace__()
        arms = points - xp.asarray([0.0, 0.0, self.radius_mm])
        return xp.sqrt(xp.sum(arms * arms, axis=-1)) - self.radius_mm

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normals (n, 3) and their derivative (I − n nᵀ)/r."""
        arms = points - np.array([0.0, 0.0, self.radius_mm])
        r = np.sqrt((arms * arms).sum(axis=1))[:, None]
        n = arms / r
        return n, (np.eye(3) - n[:, :, None] * n[:, None, :]) / r[:, :, None]

    def contact_radius_mm(self, depth_mm: float) -> float:
        """Hertz's √(R d)."""
        return float(np.sqrt(self.radius_mm * depth_mm))

    def reach_mm(self, depth_mm: float) -> float:
        """Hertz's √(R d), and never more than R."""
        return min(self.contact_radius_mm(depth_mm), self.radius_mm)

    def reaches_mm(self, depth_mm: float, directions: FloatArray) -> FloatArray:
        """The same to every side."""
        return np.full(len(directions), self.reach_mm(depth_mm))

    def surface(self, n_across: int = 32) -> tuple[FloatArray, IntArray]:
        """Rings of ``n_across`` points, the poles being rings of no width."""
        n_rings = n_across // 2 + 1
        polar, around = np.meshgrid(
            np.linspace(0.0, np.pi, n_rings),
            np.linspace(0.0, 2.0 * np.pi, n_across, endpoint=False),
            indexing="ij",
        )
        unit = np.stack(
            [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1
        )
        i, j = (
            grid.ravel() for grid in np.meshgrid(np.arange(n_rings - 1), np.arange(n_across), indexing="ij")
        )
        a, b = i * n_across + j, i * n_across + (j + 1) % n_across
        c, d = a + n_across, b + n_across
        upper = np.stack([a, c, d], axis=1)[i < n_rings - 2]
        lower = np.stack([a, d, b], axis=1)[i > 0]
        points = self.radius_mm * (unit.reshape(-1, 3) + np.array([0.0, 0.0, 1.0]))
        return points, np.concatenate([upper, lower])
