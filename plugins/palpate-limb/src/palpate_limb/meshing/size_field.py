"""How large elements may be where: fine under the indenter, coarse away from it."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray, MeshError

_SIX_TETS = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])
_SIX_TETS.setflags(write=False)
_HEX = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
_HEX.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeField:
    """Edge length h(r) = min(fine + growth · max(0, r − radius), coarse), r from the spot.

    Parameters
    ----------
    fine_mm : float
        Under the indenter.
    coarse_mm : float
        Far away.
    radius_mm : float
        As far as edges are fine.
    growth : float
        Of an edge for each mm further out.
    """

    fine_mm: float
    coarse_mm: float
    radius_mm: float
    growth: float = 0.8

    def __post_init__(self) -> None:
        if not (0.0 < self.fine_mm <= self.coarse_mm and self.radius_mm > 0.0 and self.growth > 0.0):
            raise MeshError(
                f"mesh size: fine {self.fine_mm:g} mm, coarse {self.coarse_mm:g} mm within "
                f"{self.radius_mm:g} mm, growth {self.growth:g}; give 0 < fine <= coarse, a radius and a "
                "growth > 0"
            )

    def at(self, points_mm: FloatArray) -> FloatArray:
        """Edge length [mm] wanted at points (n, 3) in the spot's frame."""
        away = np.linalg.norm(points_mm, axis=1) - self.radius_mm
        size: FloatArray = np.minimum(self.fine_mm + self.growth * np.maximum(away, 0.0), self.coarse_mm)
        return size

    def background(
        self, low_mm: FloatArray, high_mm: FloatArray, spacing_mm: float = 4.0
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """The field on a grid of tetrahedra around a box: points (n, 3), cells (m, 4), sizes (n,)."""
        low, high = low_mm - 3.0, high_mm + 3.0
        n = np.maximum(np.ceil((high - low) / spacing_mm).astype(int), 1)
        axes = [np.linspace(low[i], high[i], n[i] + 1) for i in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        cell = np.stack(np.meshgrid(*(np.arange(k) for k in n), indexing="ij"), axis=-1).reshape(-1, 1, 3)
        corner = cell + _HEX
        hexes = (corner[..., 0] * (n[1] + 1) + corner[..., 1]) * (n[2] + 1) + corner[..., 2]
        return points, hexes[:, _SIX_TETS].reshape(-1, 4), self.at(points)
