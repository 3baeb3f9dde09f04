"""The piece of limb around a spot, in the spot's frame.

The x axis of the frame (:mod:`palpate.api.mesh`) is the limb's axis, as far as it is tangential.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.api import FloatArray, MeshError, Spot
from palpate.api.mesh import spot_axes
from palpate_limb.surfaces import Surface, joined, solid, surface_of

LEAST_GAP_MM = 0.3
LEAST_SHARE = 1e-6
"""Of a volume, below which it is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """A piece of limb in the frame of the spot that it is named after, cut at right angles to its axis.

    ``to_spot`` is the motion (4, 4) from the scan's frame, ``axis`` (3,) the limb's unit vector. The cuts lie
    half of ``length_mm`` on either side of the spot. ``skin`` is the whole closed scan, ``bones`` are those
    that reach between the cuts, whole and closed, ``tissue`` is the closed surface of what is between skin,
    bones and cuts, and ``remarks`` say what was done to get it.
    """

    name: str
    to_spot: FloatArray
    axis: FloatArray
    length_mm: float
    skin: Surface
    bones: tuple[Surface, ...]
    tissue: Surface
    remarks: tuple[str, ...] = ()


def limb_axis(scan: Surface) -> FloatArray:
    """Unit vector along the limb: the long principal axis of its surface, its largest component positive."""
    weights = np.linalg.norm(scan.face_areas_mm2, axis=1)
    middles = scan.points_mm[scan.faces].mean(axis=1)
    middles = middles - np.average(middles, axis=0, weights=weights)
    values, vectors = np.linalg.eigh((middles * weights[:, None]).T @ middles)
    if values[2] < 1.2 * values[1]:
        raise MeshError(
            f"{scan.name}: as wide as it is long, so it has no axis; scan more of the limb or give the axis"
        )
    return np.asarray(vectors[:, 2] * np.sign(vectors[np.abs(vectors[:, 2]).argmax(), 2]))


def cut(
    scan: Surface,
    bones: Sequence[Surface],
    spot: Spot,
    axis: FloatArray,
    length_mm: float = 80.0,
    *,
    stump: bool = False,
    deep_mm: float = 0.0,
) -> Segment:
    """Cut the segment of a spot.

    Scan and bones are closed and in one frame, ``axis`` (3,) is a unit vector along the limb. A ``stump``
    ends in skin: a segment may reach past its end. Layers ``deep_mm`` together would bend around an end
    nearer to a cut. A limb that ends within the segment, a hole there, a bone that touches or leaves the
    skin, and bones that overlap are MeshErrors.
    """
    motion = to_spot_frame(spot, axis)
    skin, placed = scan.moved(motion), tuple(bone.moved(motion) for bone in bones)
    along = motion[:3, :3] @ axis
    half = 0.5 * length_mm
    _check_reach(spot.name, skin, along, half, deep_mm, stump=stump)
    tissue, inside, remarks = _tissue(spot.name, skin, placed, along, half)
    return Segment(
        name=spot.name,
        to_spot=motion,
        axis=along,
        length_mm=length_mm,
        skin=skin,
        bones=inside,
        tissue=tissue,
        remarks=remarks,
    )


def core_of(segment: Segment, surface: Surface) -> Segment:
    """The segment without what is above a closed surface below its skin; bones lie within that."""
    whole = solid(surface)
    for bone in segment.bones:
        whole -= solid(bone)
    tissue = _in_one(_between(whole, segment.axis, 0.5 * segment.length_mm))
    return replace(segment, skin=surface, tissue=tissue)


def gap_of_bones(segment: Segment) -> float:
    """Least distance [mm] from a bone between the cuts to the skin; infinite without bones."""
    half = 0.5 * segment.length_mm
    points = [bone.points_mm[np.abs(bone.points_mm @ segment.axis) < half] for bone in segment.bones]
    gaps = [float(segment.skin.nearest(near)[1].min()) for near in points if len(near)]
    return min(gaps, default=np.inf)


def _check_reach(
    spot: str, skin: Surface, along: FloatArray, half: float, deep: float, *, stump: bool
) -> None:
    """Refuse a segment in which the limb ends, or that has a cap for skin."""
    reach = skin.points_mm @ along
    nearer, layers = float(min(-reach.min(), reach.max())), f" with layers of {deep:g} mm" if deep else ""
    deep += 1.5 if deep else 0.0  # there the surface below a layer is round where the skin has an edge
    short = (reach.min() > -half, reach.max() < half)
    if all(short) or (nearer < half + deep and not stump):
        fits = f" to {math.floor(2.0 * (nearer - deep))} mm (length)" if nearer > 2.0 * deep else ""
        raise MeshError(
            f"spot '{spot}': the scan reaches {-reach.min():.4g} mm and {reach.max():.4g} mm along the "
            f"limb from it, and a segment of {2.0 * half:g} mm{layers} needs {half + deep:g} mm on either "
            f"side; it is too near an end: shorten the segment{fits}, scan more of the limb, or say that the "
            "limb ends in skin (stump = true)"
        )
    if skin.caps is None:
        return
    of_caps = reach[skin.faces[skin.caps]]
    within = (of_caps.min(axis=1) < half + deep) & (of_caps.max(axis=1) > -half - deep)
    if within.any():
        away = float(np.abs(of_caps[within]).min())
        place = np.round(skin.points_mm[skin.faces[skin.caps[within]]].mean(axis=(0, 1)), 1).tolist()
        raise MeshError(
            f"spot '{spot}': the scan has a hole {away:.3g} mm along the limb from it, near {place} mm in "
            f"the spot's frame, and a segment of {2.0 * half:g} mm takes it in; shorten the segment, scan "
            "that part, or let palpate close it (repair = true)"
        )


def _tissue(
    spot: str, skin: Surface, bones: Sequence[Surface], along: FloatArray, half: float
) -> tuple[Surface, tuple[Surface, ...], tuple[str, ...]]:
    """Tissue of the limb between the cuts, the bones there, and remarks."""
    import manifold3d

    parts = _between(solid(skin), along, half).decompose()
    limb = _at_spot(parts)
    remarks = []
    if len(parts) > 1:
        away = sum(part.volume() for part in parts) - limb.volume()
        remarks.append(f"left out {away:.3g} mm³ of other parts of the limb between the cuts")
    inside: list[Surface] = []
    pieces: list[tuple[str, Any]] = []
    taken = whole = manifold3d.Manifold()
    for bone in bones:
        body = solid(bone)
        piece = _between(body, along, half)
        if piece.is_empty() or (len(parts) > 1 and (piece ^ limb).is_empty()):
            continue
        _check_bone(spot, surface_of(piece, bone.name), limb, skin)
        for other, before in pieces:
            remarks += _overlap(spot, (bone.name, other), piece, before)
        pieces.append((bone.name, piece))
        taken, whole = taken + piece, whole + body
        inside.append(bone)
    if bones and not inside:
        names = ", ".join(bone.name for bone in bones)
        remarks.append(
            f"no bone is between the cuts (given: {names}); check that all are in the scan's frame"
        )
    # Whole bones, and the cuts last: ends of bone and limb in one plane would leave a film between them.
    tissue = _in_one(_between(solid(skin) - whole, along, half))
    lost = 1.0 - tissue.volume_mm3 / (limb.volume() - taken.volume())
    # Share of the tissue that may be shut in between bones.
    if abs(lost) > 0.01:
        raise MeshError(
            f"spot '{spot}': {100.0 * lost:.3g} % of the tissue between skin and bones is not "
            "connected with the spot; check the axis, where the bones lie, and that they do not touch"
        )
    if lost > LEAST_SHARE:
        remarks.append(f"left out {100.0 * lost:.2g} % of the tissue, shut in between bones")
    return tissue, tuple(inside), tuple(remarks)


def _overlap(spot: str, names: tuple[str, str], one: Any, other: Any) -> list[str]:  # noqa: ANN401 - as above
    """A remark where two bones touch; refuse where they cross, or one is in the other."""
    shared = one ^ other
    share = shared.volume() / min(one.volume(), other.volume())
    if share <= LEAST_SHARE:
        return []
    place = np.round(surface_of(shared, "").points_mm.mean(axis=0), 1).tolist()
    # Share of the smaller of two bones up to which they touch; beyond it, they are misplaced.
    if share > 0.02:
        raise MeshError(
            f"spot '{spot}': bone '{names[0]}' crosses bone '{names[1]}': they share "
            f"{shared.volume():.3g} mm³ near {place} mm in the spot's frame; "
            "check how the bones are placed, and their unit"
        )
    return [
        f"bone '{names[0]}' touches bone '{names[1]}': they share {shared.volume():.3g} mm³ near {place} mm"
    ]


def _at_spot(parts: Sequence[Any]) -> Any:  # noqa: ANN401 - manifold3d has no types
    """The part whose surface is nearest to the spot."""
    if len(parts) == 1:
        return parts[0]
    gaps = [float(surface_of(part, "").nearest(np.zeros((1, 3)))[1][0]) for part in parts]
    return parts[int(np.argmin(gaps))]


def _in_one(body: Any) -> Surface:  # noqa: ANN401 - manifold3d has no types
    """The surface of the part with the spot, without crumbs; bones in it are shells of negative volume."""
    least = LEAST_SHARE * body.volume()
    shells = [shell for shell in body.decompose() if abs(shell.volume()) > least]
    outer = [shell for shell in shells if shell.volume() > 0.0]
    chosen = surface_of(_at_spot(outer), "tissue")
    inner = [surface_of(shell, "tissue") for shell in shells if shell.volume() < 0.0]
    if len(outer) > 1:
        inner = [shell for shell in inner if chosen.contains(shell.points_mm[:1])[0]]
    points, faces = joined([chosen, *inner])
    return Surface(name="tissue", points_mm=points, faces=faces)


def to_spot_frame(spot: Spot, axis: FloatArray) -> FloatArray:
    """Motion (4, 4) to the spot's frame; a MeshError where the normal points along the limb."""
    if np.linalg.norm(axis - (axis @ spot.normal) * spot.normal) < 0.3:
        raise MeshError(
            f"spot '{spot.name}': its normal points along the limb ({np.round(axis, 3).tolist()}); is it a "
            "mark on an end, or the axis wrong?"
        )
    motion = np.eye(4)
    motion[:3, :3] = spot_axes(spot.normal, axis).T
    motion[:3, 3] = -motion[:3, :3] @ spot.position_mm
    return motion


def _between(body: Any, along: FloatArray, half: float) -> Any:  # noqa: ANN401 - manifold3d has no types
    """The part of a solid between the cuts."""
    return body.trim_by_plane(along.tolist(), -half).trim_by_plane((-along).tolist(), -half)


def _check_bone(spot: str, piece: Surface, limb: Any, skin: Surface) -> None:  # noqa: ANN401 - as above
    """Refuse a bone that is not wholly within the limb, well below the skin."""
    body = solid(piece)
    outside = body - limb
    if outside.volume() > LEAST_SHARE * body.volume():
        place = np.round(surface_of(outside, "").points_mm.mean(axis=0), 1).tolist()
        raise MeshError(
            f"spot '{spot}': bone '{piece.name}' leaves the skin, by {outside.volume():.3g} mm³ near {place} "
            "mm in the spot's frame; check how the bones are placed, and their unit"
        )
    points = piece.points_mm[:: max(1, len(piece.points_mm) // 2000)]
    _, gaps = skin.nearest(points)
    if gaps.min() < LEAST_GAP_MM:
        place = np.round(points[gaps.argmin()], 1).tolist()
        raise MeshError(
            f"spot '{spot}': bone '{piece.name}' touches the skin ({gaps.min():.2g} mm apart) at {place} mm "
            f"in the spot's frame; check how the bones are placed; {LEAST_GAP_MM:g} mm of tissue are needed "
            "(cover moves it inwards)"
        )
