"""A parametric forearm phantom whose surface, bones and spots are known exactly.

The limb's axis is x. At station s the section is an ellipse with half-width a(s) along y and
half-height b(s) along z, so that

    r(s, θ) = (s, a(s) cos θ, b(s) sin θ),     n ∝ ∂r/∂θ × ∂r/∂s,

with a and b monotone cubics (PCHIP) through the given sections: of a tapered limb, or as
measured with a calliper. Bones are straight and round, and taper.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.api import FloatArray, IntArray, MeshError, Spot


@dataclass(frozen=True, slots=True, kw_only=True)
class CrossSection:
    """Half-axes of the limb at a station along its axis."""

    station_mm: float
    half_width_mm: float
    half_height_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PhantomBone:
    """A round bone from one point to another; its radius changes linearly between them."""

    name: str
    start_mm: tuple[float, float, float]
    end_mm: tuple[float, float, float]
    start_radius_mm: float
    end_radius_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class InkMark:
    """A spot's round mark: its place on the surface and its colour (sRGB, 0 to 1)."""

    name: str
    station_mm: float
    angle_deg: float
    colour: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A triangulated surface, outward by the right-hand rule.

    Parameters
    ----------
    points_mm : (n, 3) array
    faces : (m, 3) integer array
    colours : (n, 3) array, optional
        sRGB of each point, 0 to 1.
    """

    points_mm: FloatArray
    faces: IntArray
    colours: FloatArray | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Phantom:
    """A forearm with bones and marks; the defaults are of an adult's size.

    Parameters
    ----------
    sections : tuple of CrossSection
        At least two, by rising station. The limb ends at the first and the last.
    marks : tuple of InkMark
        Between the first section and the last.
    """

    sections: tuple[CrossSection, ...] = (
        CrossSection(station_mm=0.0, half_width_mm=27.0, half_height_mm=20.0),
        CrossSection(station_mm=110.0, half_width_mm=34.0, half_height_mm=27.0),
        CrossSection(station_mm=220.0, half_width_mm=40.0, half_height_mm=34.0),
    )
    bones: tuple[PhantomBone, ...] = (
        PhantomBone(
            name="radius",
            start_mm=(-4.0, 12.0, -1.0),
            end_mm=(224.0, 15.0, -5.0),
            start_radius_mm=7.5,
            end_radius_mm=5.5,
        ),
        PhantomBone(
            name="ulna",
            start_mm=(-4.0, -12.0, -2.0),
            end_mm=(224.0, -15.0, -7.0),
            start_radius_mm=5.0,
            end_radius_mm=7.5,
        ),
    )
    marks: tuple[InkMark, ...] = (
        InkMark(name="p1", station_mm=60.0, angle_deg=75.0, colour=(0.80, 0.08, 0.10)),
        InkMark(name="p2", station_mm=90.0, angle_deg=110.0, colour=(0.05, 0.55, 0.15)),
        InkMark(name="p3", station_mm=125.0, angle_deg=70.0, colour=(0.08, 0.20, 0.75)),
        InkMark(name="p4", station_mm=155.0, angle_deg=95.0, colour=(0.90, 0.78, 0.05)),
    )

    def __post_init__(self) -> None:
        stations = np.array([s.station_mm for s in self.sections])
        axes = np.array([(s.half_width_mm, s.half_height_mm) for s in self.sections])
        if len(stations) < 2 or not (np.diff(stations) > 0.0).all() or not (axes > 0.0).all():
            raise MeshError(
                f"phantom: sections at {stations.tolist()} mm with half-axes {axes.tolist()} mm; give two or "
                "more by rising station, with half-axes > 0"
            )
        for mark in self.marks:
            if not stations[0] < mark.station_mm < stations[-1]:
                raise MeshError(
                    f"phantom: mark '{mark.name}' at {mark.station_mm:g} mm, and the limb reaches from "
                    f"{stations[0]:g} to {stations[-1]:g} mm; move the mark"
                )

    @property
    def span_mm(self) -> tuple[float, float]:
        """Stations of both ends."""
        return self.sections[0].station_mm, self.sections[-1].station_mm

    @property
    def spots(self) -> tuple[Spot, ...]:
        """The marks' exact positions and outward normals."""
        return tuple(
            Spot(
                name=mark.name,
                position_mm=self.position_mm(mark.station_mm, np.deg2rad(mark.angle_deg)),
                normal=self.normal(mark.station_mm, np.deg2rad(mark.angle_deg)),
            )
            for mark in self.marks
        )

    def half_axes_mm(self, station_mm: FloatArray | float, derivative: int = 0) -> FloatArray:
        """Half-width and half-height (…, 2) at stations, or their derivative along the axis."""
        from scipy.interpolate import PchipInterpolator  # here: whoever needs no phantom does not wait

        stations = [s.station_mm for s in self.sections]
        axes = [(s.half_width_mm, s.half_height_mm) for s in self.sections]
        return np.asarray(PchipInterpolator(stations, axes)(station_mm, derivative), dtype=np.float64)

    def position_mm(self, station_mm: FloatArray | float, angle_rad: FloatArray | float) -> FloatArray:
        """Points (…, 3) of the surface; the angle is measured from y towards z."""
        a, b = np.moveaxis(self.half_axes_mm(station_mm), -1, 0)
        s, y, z = np.broadcast_arrays(station_mm, a * np.cos(angle_rad), b * np.sin(angle_rad))
        return np.stack([s, y, z], axis=-1).astype(np.float64)

    def normal(self, station_mm: FloatArray | float, angle_rad: FloatArray | float) -> FloatArray:
        """Unit outward normals (…, 3)."""
        a, b = np.moveaxis(self.half_axes_mm(station_mm), -1, 0)
        da, db = np.moveaxis(self.half_axes_mm(station_mm, 1), -1, 0)
        cos, sin = np.cos(angle_rad), np.sin(angle_rad)
        along = -(da * b * cos**2 + a * db * sin**2)
        n = np.stack(np.broadcast_arrays(along, b * cos, a * sin), axis=-1).astype(np.float64)
        return n / np.linalg.norm(n, axis=-1, keepdims=True)

    def skin_surface(self, spacing_mm: float = 1.5) -> Surface:
        """The outer surface, closed by a flat face at each end.

        Parameters
        ----------
        spacing_mm : float
            Approximate distance of the points.
        """
        first, last = self.span_mm
        n_along = max(2, round((last - first) / spacing_mm) + 1)
        girth = 2.0 * np.pi * max(max(s.half_width_mm, s.half_height_mm) for s in self.sections)
        n_around = max(8, round(girth / spacing_mm))
        s, t = np.meshgrid(
            np.linspace(first, last, n_along),
            np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False),
            indexing="ij",
        )
        return _tube(self.position_mm(s, t), np.array([[first, 0.0, 0.0], [last, 0.0, 0.0]]))

    def bone_surface(self, name: str, spacing_mm: float = 1.2) -> Surface:
        """The closed surface of a bone."""
        bone = {b.name: b for b in self.bones}[name]
        start, end = np.array(bone.start_mm), np.array(bone.end_mm)
        axis = (end - start) / np.linalg.norm(end - start)
        u = np.cross([0.0, 0.0, 1.0], axis)
        u /= np.linalg.norm(u)
        v = np.cross(axis, u)
        n_along = max(2, round(float(np.linalg.norm(end - start)) / spacing_mm) + 1)
        n_around = max(12, round(2.0 * np.pi * max(bone.start_radius_mm, bone.end_radius_mm) / spacing_mm))
        share, t = np.meshgrid(
            np.linspace(0.0, 1.0, n_along),
            np.linspace(0.0, 2.0 * np.pi, n_around, endpoint=False),
            indexing="ij",
        )
        share, t = share[..., None], t[..., None]
        radius = (1.0 - share) * bone.start_radius_mm + share * bone.end_radius_mm
        rings = (1.0 - share) * start + share * end + radius * (np.cos(t) * u + np.sin(t) * v)
        return _tube(rings, np.stack([start, end]))


def _tube(rings: FloatArray, centres: FloatArray) -> Surface:
    """Closed surface of rings (n_along, n_around, 3) that turn about the way from ring to ring."""
    n_along, n_around, _ = rings.shape
    i, j = np.meshgrid(np.arange(n_along - 1), np.arange(n_around), indexing="ij")
    a, b = i * n_around + j, i * n_around + (j + 1) % n_around
    c, d = a + n_around, b + n_around
    # Diagonals alternate, so that no direction is favoured.
    even = ((i + j) % 2 == 0)[..., None]
    first = np.where(even, np.stack([a, b, d], axis=-1), np.stack([a, b, c], axis=-1))
    second = np.where(even, np.stack([a, d, c], axis=-1), np.stack([b, d, c], axis=-1))
    n = n_along * n_around
    ring = np.arange(n_around)
    after = (ring + 1) % n_around
    caps = [
        np.stack([np.full(n_around, n), after, ring], axis=-1),
        np.stack([np.full(n_around, n + 1), n - n_around + ring, n - n_around + after], axis=-1),
    ]
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3), *caps])
    return Surface(points_mm=np.concatenate([rings.reshape(-1, 3), centres]), faces=faces)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanner:
    """Differences of a scan from the limb: noise, light from one side, ink of finite size.

    Parameters
    ----------
    spacing_mm : float
        Distance of neighbouring points.
    noise_mm : float
        Standard deviation of a point along the surface's normal.
    colour_noise : float
        Standard deviation of each colour channel.
    shading : float
        Share of the light that comes from one side: 0 is flat light, 1 leaves the far side black.
    mark_radius_mm : float
        Of the ink.
    skin_colour : tuple of float
        sRGB, 0 to 1.
    """

    spacing_mm: float = 1.2
    noise_mm: float = 0.05
    colour_noise: float = 0.03
    shading: float = 0.5
    mark_radius_mm: float = 4.0
    skin_colour: tuple[float, float, float] = (0.87, 0.71, 0.60)
    seed: int = 1
    light: tuple[float, float, float] = field(default=(0.3, -0.5, 0.8))


def scan(phantom: Phantom, scanner: Scanner | None = None) -> Surface:
    """The phantom as a coloured scan, in the phantom's own frame."""
    scanner = scanner or Scanner()
    surface = phantom.skin_surface(scanner.spacing_mm)
    points = surface.points_mm
    rng = np.random.default_rng(scanner.seed)
    axes = phantom.half_axes_mm(points[:, 0])
    normals = phantom.normal(points[:, 0], np.arctan2(points[:, 2] / axes[:, 1], points[:, 1] / axes[:, 0]))
    colours = np.tile(np.asarray(scanner.skin_colour, dtype=np.float64), (len(points), 1))
    for mark, spot in zip(phantom.marks, phantom.spots, strict=True):
        inked = np.linalg.norm(points - spot.position_mm, axis=1) <= scanner.mark_radius_mm
        colours[inked] = mark.colour
    light = np.asarray(scanner.light) / np.linalg.norm(scanner.light)
    lit = 1.0 - scanner.shading * (0.5 - 0.5 * normals @ light)
    # Light multiplies linear intensities; 2.2 is the usual exponent of sRGB.
    colours *= lit[:, None] ** (1.0 / 2.2)
    colours += rng.normal(0.0, scanner.colour_noise, colours.shape)
    moved = points + rng.normal(0.0, scanner.noise_mm, len(points))[:, None] * normals
    moved[-2:] = points[-2:]  # the middle of either end, where no normal is defined
    return Surface(points_mm=moved, faces=surface.faces, colours=np.clip(colours, 0.0, 1.0))


def write_phantom(folder: Path, phantom: Phantom | None = None, scanner: Scanner | None = None) -> None:
    """Write ``scan.ply``, ``<bone>.stl`` and ``spots.json`` with the exact spots.

    Parameters
    ----------
    folder : Path
        Made if it is missing.
    """
    phantom = phantom or Phantom()
    folder.mkdir(parents=True, exist_ok=True)
    write_surface(folder / "scan.ply", scan(phantom, scanner))
    for bone in phantom.bones:
        write_surface(folder / f"{bone.name}.stl", phantom.bone_surface(bone.name))
    spots = {
        s.name: {"position_mm": s.position_mm.tolist(), "normal": s.normal.tolist()} for s in phantom.spots
    }
    (folder / "spots.json").write_text(json.dumps(spots, indent=1) + "\n")


def write_surface(path: Path, surface: Surface) -> None:
    """Write a binary PLY or STL file; a PLY file with the colours if there are any."""
    import meshio  # here: slow to import

    colours = {}
    if surface.colours is not None:
        levels = np.round(255.0 * surface.colours).astype(np.uint8)
        colours = dict(zip(("red", "green", "blue"), levels.T, strict=True))
    mesh = meshio.Mesh(
        surface.points_mm.astype(np.float32), [("triangle", surface.faces.astype(np.int32))], colours
    )
    mesh.write(path, binary=True)
