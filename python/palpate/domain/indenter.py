"""Indenters: rigid bodies that touch the limb, given by their signed distance; and the paper's sphere."""

from abc import abstractmethod
from typing import Annotated, Self

import numpy as np
from pydantic import Field

from palpate.domain.component import Array, Component, Settings, SettingsT
from palpate.domain.curves import FloatArray, IntArray
from palpate.domain.level_set import level_set_surface
from palpate.errors import MeshError
from palpate.units import Quantity

RAY_STEPS = 100
"""Places along a ray at which a tool's reach is looked for."""


class Indenter(Component[SettingsT]):
    """A rigid body that is pressed into the limb.

    It is given by its signed distance in a frame of its own: z points away from the limb, and x and y are
    the axes of the spot's frame (:func:`palpate.mesh.spot_frame.spot_axes`) at rotation 0. At depth 0
    the frame's origin is at the spot, where a body with one lowest point has that point. Normals and
    curvature follow from the distance. ``__init__`` sets the three sizes from the settings.
    """

    radius_mm: float
    """Half of the shorter width of what touches [mm]: the scale of the contact."""

    edge_mm: float
    """Smallest radius of curvature of what may touch [mm], for the mesh to resolve."""

    bounds_mm: FloatArray
    """Lowest and highest corner (2, 3) of a box around it [mm]; what is above need not be inside."""

    def __eq__(self, other: object) -> bool:
        """Whether both have one class and equal settings, and so one shape."""
        if self is other or not isinstance(other, Indenter):
            return self is other
        return type(self) is type(other) and bool(self.settings == other.settings)

    def __hash__(self) -> int:
        return hash((type(self), self.settings))

    @abstractmethod
    def distance(self, points: Array) -> Array:
        """Signed distance to the surface [mm], negative inside.

        Parameters
        ----------
        points : (..., 3) array
            In the indenter's frame [mm].

        Returns
        -------
        (...,) array
            Continuous with its first derivatives where tissue touches. Write it with the array's own
            namespace (``xp = points.__array_namespace__()``), so that JAX can differentiate it; a body
            that cannot overrides ``normals`` too.
        """

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Outward normals and their derivative: first and second derivatives of the distance.

        By itself from ``distance``, by JAX. Override it where a closed form is faster.

        Parameters
        ----------
        points : (n, 3) array

        Returns
        -------
        normals : (n, 3) array
        curvature : (n, 3, 3) array
            In 1/mm.
        """
        from palpate.domain.distances import distance_derivatives

        return distance_derivatives(self, points)

    def contact_radius_mm(self, depth_mm: float) -> float:
        """Radius [mm] of the circle that has the area of the contact with flat, elastic tissue, about.

        By itself from the section at half of the depth, which for a sphere gives Hertz's √(R d).
        """
        points, cell = self._section(depth_mm)
        return float(np.sqrt(len(points) * cell / np.pi))

    def reach_mm(self, depth_mm: float) -> float:
        """Distance [mm] from the axis up to which flat tissue is touched, about."""
        points, _ = self._section(depth_mm)
        return float(np.hypot(*points.T).max(initial=0.0))

    def reaches_mm(self, depth_mm: float, directions: FloatArray) -> FloatArray:
        """Distance (n,) [mm] from the axis up to which flat tissue is touched along unit vectors (n, 2).

        By itself from the section at half of the depth; never more than :meth:`reach_mm`.
        """
        most = self.reach_mm(depth_mm)
        steps = most * np.arange(1, RAY_STEPS + 1) / RAY_STEPS
        height = 0.5 * min(max(depth_mm, 0.0), float(self.bounds_mm[1, 2]))
        flat = steps[:, None] * directions[:, None, :]
        points = np.concatenate([flat, np.full((*flat.shape[:2], 1), height)], axis=2)
        inside = np.asarray(self.distance(points.reshape(-1, 3))).reshape(points.shape[:2]) < 0.0
        return np.asarray((steps * inside).max(axis=1))

    def surface(self, n_across: int = 40) -> tuple[FloatArray, IntArray]:
        """Triangles of the surface, to be looked at: points (n, 3) [mm] and triangles (f, 3).

        ``n_across`` is the number of cells along the longest side of ``bounds_mm``.
        """
        return level_set_surface(self.distance, self.bounds_mm, n_across)

    def grown(self, by_mm: float) -> Self:
        """The same with a larger setting ``radius``, whose uncertainty a study may state.

        Raises
        ------
        MeshError
            It has no such setting, or cannot have this radius.
        """
        if "radius" not in type(self.settings).model_fields:
            raise MeshError(
                f"indenter '{self.name}' has no setting 'radius' that could be uncertain; "
                "leave radius out of [budget]"
            )
        radius = getattr(self.settings, "radius") + by_mm  # noqa: B009 -- of the settings of a subclass
        if not radius > 0.0:
            raise MeshError(
                f"indenter '{self.name}': a radius of {radius:g} mm; give a smaller radius in [budget]"
            )
        return type(self)(self.settings.model_copy(update={"radius": radius}))

    def _section(self, depth_mm: float, n: int = 97) -> tuple[FloatArray, float]:
        """Points (m, 2) inside at half of a depth, at most of the body's height, and the area of each."""
        lower, upper = self.bounds_mm[:, :2]
        height = 0.5 * min(max(depth_mm, 0.0), float(self.bounds_mm[1, 2]))
        for _ in range(2):  # over the whole body, then over what is inside
            size = (upper - lower) / n
            x, y = (lower[k] + size[k] * (np.arange(n) + 0.5) for k in range(2))
            grid = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((n, n), height)], axis=-1)
            inside = np.asarray(self.distance(grid.reshape(-1, 3))) < 0.0
            found = grid.reshape(-1, 3)[inside, :2]
            if not found.size:
                break
            lower, upper = found.min(axis=0) - size, found.max(axis=0) + size
        return found, float(np.prod(size))


class SphereSettings(Settings):
    """Settings of the indenter ``sphere``."""

    radius: Annotated[float, Quantity("mm")] = Field(gt=0.0, description="Radius of the sphere.")


class Sphere(Indenter[SphereSettings]):
    """A sphere whose lowest point is the origin.

    Parameters
    ----------
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
