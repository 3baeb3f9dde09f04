"""A rigid tool from a file of its surface: the smooth distance to its rounded solid."""

import functools
import hashlib
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PrivateAttr

from palpate.api import FloatArray, Indenter, InputFile, MeshError, Quantity, Settings
from palpate.api.mechanics import Array
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

    _sha256: str = PrivateAttr("")
    """Of the file as it was first read: it goes with the settings to workers, and is in no key of theirs."""


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
            settings._sha256 = settings._sha256 or _sha256(settings.file)
            if _sha256(settings.file) != settings._sha256:
                return  # whoever asks for the shape is told so
            lower, upper = self._solid.bounds_mm
            self.radius_mm = 0.5 * float((upper - lower)[:2].min())
            half = float(np.hypot(*np.maximum(np.abs(lower), np.abs(upper))[:2]))
            self.bounds_mm = np.array([[-half, -half, 0.0], [half, half, upper[2]]])

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_solid"}

    @functools.cached_property
    def _solid(self) -> RoundedSolid:
        """Shared by equal tools of a process, however they are turned, and in no pickle."""
        return _solid_of(self.settings.file, self.settings.unit, self.settings.edge, self.settings._sha256)

    def fingerprint(self) -> str:
        """Code, and content of the file as it was first read."""
        sha256 = self.settings._sha256 or _sha256(self.settings.file)
        return f"{super().fingerprint()}, file {sha256[:16]}"

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


def _sha256(file: Path) -> str:
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise MeshError(f"{file}: the tool cannot be read ({error.strerror}); give its file") from None


@functools.lru_cache(maxsize=4)
def _solid_of(file: Path, unit: str, edge_mm: float, sha256: str) -> RoundedSolid:
    """Solid of a file, once per process and content."""
    if _sha256(file) != sha256:
        raise MeshError(f"{file}: the tool's file has changed since this command read it; run it again")
    return rounded_solid(read_surface(file, unit), edge_mm)
