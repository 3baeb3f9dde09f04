"""A rigid tool from a file of its surface: the smooth distance to its rounded solid."""

import functools
import hashlib
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from palpate.api import Array, FloatArray, Indenter, InputFile, MeshError, Quantity, Settings
from palpate_limb.rounded_solid import RoundedSolid, rounded_solid
from palpate_limb.surface_files import read_surface


class StlSettings(Settings):
    """Settings of the indenter ``stl``."""

    file: InputFile = Field(
        description="Closed surface of the tool (.stl, .ply, .obj, .glb, .off), relative to the study file; "
        "its z axis points away from the limb; its x and y are those of the tool, with the spot at 0, 0."
    )
    unit: str = Field(default="mm", description="Unit of the file's coordinates.")
    edge: Annotated[float, Quantity("mm")] = Field(
        gt=0.0,
        description="Radius by which edges are rounded; less than that of every rounding in the file.",
    )
    turn: Annotated[float, Quantity("deg")] = Field(
        default=0.0,
        description="Angle about the normal from the x axis of the spot's frame to the tool's.",
    )


class StlIndenter(Indenter[StlSettings]):
    """A rigid tool whose closed surface is in a file.

    Flat faces keep their place, edges are rounded. The lowest point touches the skin at depth 0.
    """

    name = "stl"
    summary = "a tool from a file of its surface, with edges rounded"

    def __init__(self, settings: StlSettings) -> None:
        super().__init__(settings)
        self.edge_mm = settings.edge
        # The copy of a study in a run directory may be read where the tool's file is not.
        self.radius_mm, self.bounds_mm = np.nan, np.full((2, 3), np.nan)
        if settings.file.is_file():
            lower, upper = self._solid.bounds_mm
            self.radius_mm = 0.5 * float((upper - lower)[:2].min())
            half = float(np.hypot(*np.maximum(np.abs(lower), np.abs(upper))[:2]))
            self.bounds_mm = np.array([[-half, -half, 0.0], [half, half, upper[2]]])

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_solid"}

    @functools.cached_property
    def _solid(self) -> RoundedSolid:
        """Shared by equal tools of a process, however they are turned, and in no pickle."""
        return _solid_of(self.settings.file, self.settings.unit, self.settings.edge, self.fingerprint())

    def fingerprint(self) -> str:
        """Code, and content of the file."""
        try:
            content = self.settings.file.read_bytes()
        except OSError as error:
            raise MeshError(
                f"{self.settings.file}: the tool cannot be read ({error.strerror}); give its file"
            ) from None
        return f"{super().fingerprint()}, file {hashlib.sha256(content).hexdigest()[:16]}"

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        turned = np.asarray(points, dtype=np.float64).reshape(-1, 3) @ self._axes
        return self._solid.distance(turned).reshape(points.shape[:-1])

    def normals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normals (n, 3) and their derivative (n, 3, 3), of the same spline."""
        axes = self._axes
        normals, curvature = self._solid.normals(points @ axes)
        return normals @ axes.T, axes @ curvature @ axes.T

    @property
    def _axes(self) -> FloatArray:
        """Axes of the file as columns, in the frame of the spot."""
        cos, sin = np.cos(np.deg2rad(self.settings.turn)), np.sin(np.deg2rad(self.settings.turn))
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@functools.lru_cache(maxsize=4)
def _solid_of(file: Path, unit: str, edge_mm: float, fingerprint: str) -> RoundedSolid:
    """Solid of a file, once per process and content."""
    return rounded_solid(read_surface(file, unit), edge_mm)
