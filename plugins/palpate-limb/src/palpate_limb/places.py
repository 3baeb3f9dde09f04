"""Spots by place: coordinates, or how far along the limb or a bone and at which angle."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from palpate.api import FloatArray, MeshError, convert
from palpate.api.mesh import spot_axes
from palpate_limb.repair import extent
from palpate_limb.surfaces import Surface, solid


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """A share of the extent of the limb (``bone`` empty) or of a bone along the axis, 0 at the lower end.

    The angle is about the middle of the limb's section, right-handed about the axis. Without one the skin
    nearest to the bone is meant.
    """

    share: float
    angle_deg: float | None
    bone: str = ""


Place: TypeAlias = FloatArray | Station  # a point (3,) is in the scan's own coordinates and unit


def place_of(text: str) -> Place:
    """Place meant by ``"12,30,-4"``, ``"45%,120deg"`` or ``"ulna:95%"``; else a ValueError."""
    given = text.strip()
    share = r"(?:(?P<bone>[\w-]+):)?(?P<share>[+-]?\d+(?:\.\d*)?)\s*%(?:\s*,\s*(?P<angle>[^,]+))?"
    if match := re.fullmatch(share, given):
        angle, bone = match["angle"], match["bone"] or ""
        if angle is None and not bone:
            raise ValueError(f'{text}: around the limb is where? Add an angle, such as "{given},90deg"')
        degrees = None if angle is None else convert(angle, "deg")
        return Station(share=0.01 * float(match["share"]), angle_deg=degrees, bone=bone)
    if (at := _numbers(given.split(","))) is None:
        raise ValueError(
            f"{text}: give x,y,z in the scan's coordinates, a share of the limb and an angle "
            '("45%,120deg"), or a share of a bone ("ulna:40%")'
        )
    return at


def _numbers(cells: Sequence[str]) -> FloatArray | None:
    """Three finite numbers, if they are."""
    try:
        at = np.array([float(cell) for cell in cells])
    except ValueError:
        return None
    return at if at.shape == (3,) and np.isfinite(at).all() else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Around:
    """The closed skin, bones and directions that places refer to.

    ``axis`` (3,) is a unit vector along the limb, ``span_mm`` the coordinates along it of 0 and 100 %, and
    ``zero`` (3,) the direction of 0 degrees, of which what is along the axis does not count.
    ``mm_per_unit`` converts the scan's coordinates.
    """

    skin: Surface
    bones: Sequence[Surface]
    axis: FloatArray
    span_mm: tuple[float, float]
    zero: FloatArray
    mm_per_unit: float


def position_mm(name: str, place: Place, around: Around) -> FloatArray:
    """The point (3,) of the skin that a place means; a MeshError, naming the spot, where there is none."""
    if not isinstance(place, Station):
        point = place * around.mm_per_unit
        on, gaps = around.skin.nearest(point[None])
        # From a given point to the skin, at most.
        if gaps[0] > 10.0:
            raise MeshError(
                f"spot '{name}': ({', '.join(f'{x:.5g}' for x in point)}) mm is {gaps[0]:.3g} mm from "
                f"{around.skin.name}; give a point on it, in its coordinates and unit"
            )
        return np.asarray(on[0])
    if not place.bone:
        low, high = around.span_mm
        return _at_angle(name, low + place.share * (high - low), place.angle_deg or 0.0, around)
    bone = next((bone for bone in around.bones if bone.name == place.bone), None)
    if bone is None:
        raise MeshError(
            f"spot '{name}': no bone '{place.bone}' (there: "
            f"{', '.join(bone.name for bone in around.bones) or 'none'}); name one of them"
        )
    low, high = extent(bone, around.axis)
    station = low + place.share * (high - low)
    if place.angle_deg is not None:
        return _at_angle(name, station, place.angle_deg, around)
    if not low <= station <= high:
        raise MeshError(f"spot '{name}': beyond bone '{bone.name}'; give 0 to 100 %, or an angle too")
    away = np.abs(bone.points_mm @ around.axis - station)
    section = bone.points_mm[away <= max(0.02 * (high - low), float(away.min()) + 1e-9)]
    on, gaps = around.skin.nearest(section)
    return np.asarray(on[gaps.argmin()])


def _at_angle(name: str, station: float, angle_deg: float, around: Around) -> FloatArray:
    """The skin in a direction from the middle of the limb's section: its outermost point there."""
    if np.linalg.norm(np.cross(around.zero, around.axis)) < 0.1 * np.linalg.norm(around.zero):
        raise MeshError(
            f"spot '{name}': 0 degrees would be along the limb ({np.round(around.axis, 3).tolist()}); give a "
            "direction across it (zero)"
        )
    # Columns x and y across the limb, x towards 0 degrees; z along it.
    frame = spot_axes(around.axis, around.zero)
    turned = Surface(name="limb", points_mm=around.skin.points_mm @ frame, faces=around.skin.faces)
    contours = [np.asarray(c) for c in solid(turned).slice(station).to_polygons()]
    if not contours:
        low, high = extent(around.skin, around.axis)
        raise MeshError(
            f"spot '{name}': at {station:.4g} mm along the limb, which reaches from {low:.4g} to {high:.4g} "
            "mm; give a share within it"
        )
    contour = max(contours, key=lambda c: abs(_area_and_centre(c)[0]))
    _, centre = _area_and_centre(contour)
    angle = float(np.deg2rad(angle_deg))
    ray, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    start, end = contour - centre, np.roll(contour, -1, axis=0) - centre
    a, b = start @ across, end @ across
    crossed = (a <= 0.0) != (b <= 0.0)
    share = a[crossed] / (a[crossed] - b[crossed])
    out = ((1.0 - share)[:, None] * start[crossed] + share[:, None] * end[crossed]) @ ray
    if not (out.size and out.max() > 0.0):
        raise MeshError(f"spot '{name}': no skin at {angle_deg:g} degrees; give another angle")
    return np.asarray(frame @ np.array([*(centre + out.max() * ray), station]))


def _area_and_centre(contour: FloatArray) -> tuple[float, FloatArray]:
    """Area of a polygon (n, 2), signed, and its centroid."""
    x, y = contour.T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    area = 0.5 * float(cross.sum())
    middle = ((contour + np.roll(contour, -1, axis=0)) * cross[:, None]).sum(axis=0) / (6.0 * area)
    return area, middle
