"""The piece of limb around a spot, in the spot's frame.

The x axis of the frame (:mod:`palpate.mesh.spot_frame`) is the limb's axis, as far as it is tangential.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.api import FloatArray, MeshError, Spot
from palpate.mesh.spot_frame import spot_axes
from palpate_limb.surfaces import Surface, joined, solid, surface_of

LEAST_GAP_MM = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """A piece of limb, cut at right angles to its axis.

    Parameters
    ----------
    name : str
        Of its spot.
    to_spot : (4, 4) array
        Motion from the scan's frame to the spot's.
    axis : (3,) array
        Unit vector of the limb's axis, in the spot's frame.
    length_mm : float
        The cuts lie half of it on either side of the spot.
    skin : Surface
        The whole closed scan, in the spot's frame.
    bones : tuple of Surface
        Those that reach between the cuts, whole and closed, in the spot's frame.
    tissue : Surface
        Closed surface of what is between skin, bones and cuts.
    """

    name: str
    to_spot: FloatArray
    axis: FloatArray
    length_mm: float
    skin: Surface
    bones: tuple[Surface, ...]
    tissue: Surface


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
    axis: FloatArray = vectors[:, 2] * np.sign(vectors[np.abs(vectors[:, 2]).argmax(), 2])
    return axis


def cut(
    scan: Surface, bones: Sequence[Surface], spot: Spot, axis: FloatArray, length_mm: float = 80.0
) -> Segment:
    """Cut the segment of a spot.

    Parameters
    ----------
    scan : Surface
        Closed.
    bones : sequence of Surface
        Closed, in the scan's frame.
    spot : Spot
    axis : (3,) array
        Unit vector along the limb.
    length_mm : float

    Raises
    ------
    MeshError
        The limb ends within the segment, a bone touches the skin, leaves it or is at the spot.
    """
    motion = to_spot_frame(spot, axis)
    skin, placed = scan.moved(motion), tuple(bone.moved(motion) for bone in bones)
    along = motion[:3, :3] @ axis
    reach = skin.points_mm @ along
    half = 0.5 * length_mm
    if reach.min() > -half or reach.max() < half:
        raise MeshError(
            f"spot '{spot.name}': the scan reaches {-reach.min():.4g} mm and {reach.max():.4g} mm along the "
            f"limb from it, and a segment of {length_mm:g} mm needs {half:g} mm on either side; the mark "
            "is too near an end: shorten the segment, or scan more of the limb"
        )
    tissue, inside = _tissue(spot.name, skin, placed, along, half)
    return Segment(
        name=spot.name,
        to_spot=motion,
        axis=along,
        length_mm=length_mm,
        skin=skin,
        bones=inside,
        tissue=tissue,
    )


def _tissue(
    spot: str, skin: Surface, bones: Sequence[Surface], along: FloatArray, half: float
) -> tuple[Surface, tuple[Surface, ...]]:
    """What is left of the limb between the cuts without its bones, and the bones that reach there."""
    rest, inside = solid(skin), []
    volume = _between(rest, along, half).volume()
    for bone in bones:
        piece = _between(solid(bone), along, half)
        if piece.is_empty():
            continue
        _check_bone(spot, surface_of(piece, bone.name), rest, skin)
        # Whole bones, and the cuts last: ends of bone and limb in one plane would leave a film between them.
        rest = rest - solid(bone)
        inside.append(bone)
        volume -= piece.volume()
    tissue = _in_one(spot, _between(rest, along, half))
    if abs(tissue.volume_mm3 - volume) > 1e-6 * volume:
        raise MeshError(
            f"spot '{spot}': {tissue.volume_mm3:.6g} mm³ of tissue where skin less bones leaves "
            f"{volume:.6g} mm³; check that the bones are closed and do not touch each other"
        )
    return tissue, tuple(inside)


def _in_one(spot: str, body: Any) -> Surface:  # noqa: ANN401 - manifold3d has no types
    """The surface of a body without crumbs; bones wholly within it are shells of negative volume."""
    least = 1e-6 * body.volume()
    shells = [shell for shell in body.decompose() if abs(shell.volume()) > least]
    n_parts = sum(shell.volume() > 0.0 for shell in shells)
    if n_parts != 1:
        raise MeshError(
            f"spot '{spot}': the segment falls into {n_parts} parts; check the axis and where the bones lie"
        )
    points, faces = joined([surface_of(shell, "tissue") for shell in shells])
    return Surface(name="tissue", points_mm=points, faces=faces)


def to_spot_frame(spot: Spot, axis: FloatArray) -> FloatArray:
    """Motion (4, 4) to the spot's frame.

    Raises
    ------
    MeshError
        The normal points along the limb.
    """
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


def _check_bone(spot: str, piece: Surface, rest: Any, skin: Surface) -> None:  # noqa: ANN401 - as above
    """Refuse a bone that is not wholly within the tissue that is left, well below the skin."""
    body = solid(piece)
    outside = body - rest
    if outside.volume() > 1e-6 * body.volume():
        place = np.round(surface_of(outside, "").points_mm.mean(axis=0), 1).tolist()
        raise MeshError(
            f"spot '{spot}': bone '{piece.name}' leaves the skin or crosses another bone, by "
            f"{outside.volume():.3g} mm³ near {place} mm in the spot's frame; check how the bones are "
            "placed, and their unit"
        )
    points = piece.points_mm[:: max(1, len(piece.points_mm) // 2000)]
    _, gaps = skin.nearest(points)
    if gaps.min() < LEAST_GAP_MM:
        place = np.round(points[gaps.argmin()], 1).tolist()
        raise MeshError(
            f"spot '{spot}': bone '{piece.name}' touches the skin ({gaps.min():.2g} mm apart) at {place} mm "
            f"in the spot's frame; check how the bones are placed; {LEAST_GAP_MM:g} mm of tissue are needed"
        )
