"""Rigid tools in closed form: each is a core (a disc, segment, box, ring, strip) rounded by a radius.

The distance to the tool is the distance to its core less the radius of the rounding, so that it has
continuous first derivatives outside of the core.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from palpate.api import FloatArray, Indenter, MeshError, Quantity, Settings
from palpate.api.mechanics import Array

Length = Annotated[float, Quantity("mm")]
Angle = Annotated[float, Quantity("deg")]

TURN = "Angle about the normal from the x axis of the spot's frame to the x axis of the tool."


class PunchSettings(Settings):
    """Settings of the indenter ``punch``."""

    radius: Length = Field(gt=0.0, description="Radius of the cylinder.")
    edge: Length = Field(gt=0.0, description="Radius of the rounded edge, less than the radius.")


class Punch(Indenter[PunchSettings]):
    """A cylinder whose axis is the normal, flat below, with a rounded edge."""

    name = "punch"
    summary = "a flat-ended cylinder with a rounded edge"

    def __init__(self, settings: PunchSettings) -> None:
        super().__init__(settings)
        self.radius_mm, self.edge_mm = settings.radius, settings.edge
        _check_edge(self.name, self.edge_mm, self.radius_mm, is_less=True)
        r = self.radius_mm
        self.bounds_mm = np.array([[-r, -r, 0.0], [r, r, 2.0 * r]])

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]; the cylinder has no upper end."""
        xp = points.__array_namespace__()
        x, y, z = _axes(points)
        out = _norm(xp, x, y) - (self.radius_mm - self.edge_mm)
        return _to_box(xp, out, self.edge_mm - z) - self.edge_mm


class CapsuleSettings(Settings):
    """Settings of the indenter ``capsule``."""

    radius: Length = Field(gt=0.0, description="Radius of the cylinder and of its round ends.")
    length: Length = Field(ge=0.0, description="Length of the cylinder between its round ends.")
    turn: Angle = Field(default=0.0, description=TURN)


class Capsule(Indenter[CapsuleSettings]):
    """A cylinder that lies on the skin along x, with round ends."""

    name = "capsule"
    summary = "a lying cylinder with round ends"

    def __init__(self, settings: CapsuleSettings) -> None:
        super().__init__(settings)
        self.radius_mm = self.edge_mm = settings.radius
        half = 0.5 * settings.length + settings.radius
        self.bounds_mm = np.array([[-half, -half, 0.0], [half, half, 2.0 * settings.radius]])

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        xp = points.__array_namespace__()
        x, y, z = _turned(xp, points, self.settings.turn)
        along = _beyond(xp, x, 0.5 * self.settings.length)
        return _norm(xp, along, y, z - self.radius_mm) - self.radius_mm


class BoxSettings(Settings):
    """Settings of the indenter ``box``."""

    length: Length = Field(gt=0.0, description="Side along x.")
    width: Length = Field(gt=0.0, description="Side along y.")
    height: Length = Field(gt=0.0, description="Side along the normal.")
    edge: Length = Field(gt=0.0, description="Radius of the rounded edges, at most half of each side.")
    turn: Angle = Field(default=0.0, description=TURN)


class Box(Indenter[BoxSettings]):
    """A box, flat on the skin, all of whose edges are rounded."""

    name = "box"
    summary = "a box with rounded edges, such as a plate"

    def __init__(self, settings: BoxSettings) -> None:
        super().__init__(settings)
        sides = np.array([settings.length, settings.width, settings.height])
        _check_edge(self.name, settings.edge, 0.5 * float(sides.min()))
        self.radius_mm, self.edge_mm = 0.5 * float(sides[:2].min()), settings.edge
        self._core = tuple((0.5 * sides - settings.edge).tolist())
        half = 0.5 * float(np.hypot(*sides[:2]))
        self.bounds_mm = np.array([[-half, -half, 0.0], [half, half, settings.height]])

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        xp = points.__array_namespace__()
        x, y, z = _turned(xp, points, self.settings.turn)
        offsets = (x, y, z - 0.5 * self.settings.height)
        beyond = [xp.abs(at) - half for at, half in zip(offsets, self._core, strict=True)]
        return _to_box(xp, *beyond) - self.edge_mm


class RingSettings(Settings):
    """Settings of the indenter ``ring``."""

    radius: Length = Field(gt=0.0, description="Radius of the circle along which it touches.")
    edge: Length = Field(gt=0.0, description="Radius of the round rim, less than the radius.")


class Ring(Indenter[RingSettings]):
    """A torus that lies on the skin, such as the rim of a cup; it touches all round the spot."""

    name = "ring"
    summary = "a round rim, touched along a circle around the spot"

    def __init__(self, settings: RingSettings) -> None:
        super().__init__(settings)
        _check_edge(self.name, settings.edge, settings.radius, is_less=True)
        self.radius_mm = self.edge_mm = settings.edge
        half = settings.radius + settings.edge
        self.bounds_mm = np.array([[-half, -half, 0.0], [half, half, 2.0 * settings.edge]])

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        xp = points.__array_namespace__()
        x, y, z = _axes(points)
        return _norm(xp, _norm(xp, x, y) - self.settings.radius, z - self.edge_mm) - self.edge_mm


class CuffSettings(Settings):
    """Settings of the indenter ``cuff``."""

    radius: Length = Field(gt=0.0, description="Radius of the inner face, which the skin touches.")
    angle: Angle = Field(gt=0.0, le=360.0, description="Angle of the arc, half of it to each side.")
    width: Length = Field(gt=0.0, description="Width along the limb, with the rounded edges.")
    edge: Length = Field(
        gt=0.0, description="Radius of the rounded edges: half of the thickness, at most half of the width."
    )
    turn: Angle = Field(
        default=0.0,
        description="Angle about the normal from the x axis of the spot's frame to the plane of the arc.",
    )


class Cuff(Indenter[CuffSettings]):
    """A rigid arc over the limb, in the plane of x and the normal, which touches with its inner face."""

    name = "cuff"
    summary = "a rigid arc over the limb, touched inside"

    def __init__(self, settings: CuffSettings) -> None:
        super().__init__(settings)
        self.radius_mm, self.edge_mm = 0.5 * settings.width, settings.edge
        _check_edge(self.name, settings.edge, 0.5 * settings.width)
        outer = settings.radius + 2.0 * settings.edge
        half = float(np.hypot(outer, 0.5 * settings.width))  # however it is turned
        lowest = -settings.radius * (1.0 - np.cos(np.deg2rad(0.5 * settings.angle))) - 2.0 * settings.edge
        self.bounds_mm = np.array([[-half, -half, lowest], [half, half, 2.0 * settings.edge]])

    def distance(self, points: Array) -> Array:
        """Signed distance (...) [mm]."""
        xp = points.__array_namespace__()
        x, y, z = _turned(xp, points, self.settings.turn)
        middle, half = self.settings.radius + self.edge_mm, np.deg2rad(0.5 * self.settings.angle)
        x, z = xp.abs(x), z - (self.edge_mm - middle)  # from the centre of the arc
        # Along the arc, and beyond its end: both in the frame of the end's radius.
        out = _norm(xp, x, z) - middle
        past = x * np.cos(half) - z * np.sin(half)
        up = x * np.sin(half) + z * np.cos(half) - middle
        inside = xp.atan2(x, z) <= half
        plane = xp.where(inside, xp.abs(out), _norm(xp, past, up))
        return _norm(xp, plane, _beyond(xp, y, 0.5 * self.settings.width - self.edge_mm)) - self.edge_mm

    def contact_radius_mm(self, depth_mm: float) -> float:
        """Radius of a circle with the area of the inner face, seen from the limb: a limb fills the arc."""
        return float(np.sqrt(self.settings.width * 2.0 * self.reach_mm(depth_mm) / np.pi))

    def reach_mm(self, depth_mm: float) -> float:
        """Half of the arc's chord."""
        return self.settings.radius * float(np.sin(np.deg2rad(min(0.5 * self.settings.angle, 90.0))))

    def reaches_mm(self, depth_mm: float, directions: FloatArray) -> FloatArray:
        """Distances from the axis to the side of a rectangle of the chord and the width."""
        half = (self.reach_mm(depth_mm), 0.5 * self.settings.width)
        turn = np.deg2rad(self.settings.turn)
        along = np.abs(directions @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]))
        with np.errstate(divide="ignore"):
            return np.asarray(np.min(half / along, axis=1))


def _check_edge(name: str, edge_mm: float, most_mm: float, *, is_less: bool = False) -> None:
    if edge_mm > most_mm * (1.0 + 1e-9) or (is_less and edge_mm >= most_mm):
        limit = "less than" if is_less else "at most"
        raise MeshError(
            f"indenter '{name}': an edge rounded by {edge_mm:g} mm, where {limit} {most_mm:g} mm fit; "
            "give a smaller edge"
        )


def _axes(points: Array) -> tuple[Array, Array, Array]:
    return points[..., 0], points[..., 1], points[..., 2]


def _turned(xp: Array, points: Array, turn_deg: float) -> tuple[Array, Array, Array]:
    """Coordinates in a frame that is turned about z."""
    x, y, z = _axes(points)
    cos, sin = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    return cos * x + sin * y, cos * y - sin * x, z


def _norm(xp: Array, *parts: Array) -> Array:
    """Root of the sum of squares, with derivatives 0 at 0."""
    square = sum(part * part for part in parts)
    is_zero = square == 0.0
    return xp.where(is_zero, 0.0, xp.sqrt(xp.where(is_zero, 1.0, square)))


def _beyond(xp: Array, at: Array, half: float) -> Array:
    """Distance of a coordinate beyond ±half."""
    return xp.maximum(xp.abs(at) - half, xp.asarray(0.0))


def _to_box(xp: Array, *beyond: Array) -> Array:
    """Signed distance to a box, from how far a point is beyond each of its faces."""
    zero = xp.asarray(0.0)
    inside = beyond[0]
    for each in beyond[1:]:
        inside = xp.maximum(inside, each)
    return _norm(xp, *[xp.maximum(each, zero) for each in beyond]) + xp.minimum(inside, zero)
