"""From a coloured scan and bone models to the limb around every marked spot."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.api import FloatArray, Limb, MeshError, check_limb
from palpate_limb.bones import IN_PLACE, Placement, by_icp, read_bone, read_landmarks, read_motion
from palpate_limb.first_contact import moved_to_contact
from palpate_limb.marks import find_marks, name_marks
from palpate_limb.quality import Quality, assess, check_quality
from palpate_limb.segment import Segment, cut, limb_axis
from palpate_limb.spots import FoundSpot, locate
from palpate_limb.surface_checks import LIMB_MM, check_size, defects, repaired
from palpate_limb.surface_files import read_surface
from palpate_limb.surfaces import Surface, outwards, smoothed
from palpate_limb.volume import MeshPlan, mesh_segment

MOST_MESHES = 4
"""Meshes that are made of a segment before a poor one is refused."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BonePlaces:
    """Where the bones are: at most one of these, or a reference that may start from one of them.

    Parameters
    ----------
    motion : Path, optional
        Four rows of four numbers, from the bones' frame to the scan's.
    landmarks : Path, optional
        Six numbers a line: a point in the bones' frame and in the scan's.
    reference : Path, optional
        The limb's skin or mould in the bones' frame, to be laid onto the scan.
    """

    motion: Path | None = None
    landmarks: Path | None = None
    reference: Path | None = None

    def __post_init__(self) -> None:
        if self.motion and self.landmarks:
            raise MeshError("bones: both a motion and landmarks; give one of them")


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPlan:
    """What to make of a scan.

    Parameters
    ----------
    marks : mapping of spot to a colour, or to None
        Without colours, names go along the limb.
    unit, bone_unit : str
        Of the scan's and the bones' coordinates.
    length_mm : float
        Of a segment.
    indenter_radius_mm : float
    mesh : MeshPlan
    axis : (3,) array, optional
        Along the limb, if its long principal axis is not it.
    repair : bool
        Repair the scan's holes and crossings instead of refusing them.
    mark_radii_mm : tuple of float
        Least and largest radius of a mark.
    n_smoothing : int
        Rounds of Taubin's filter against the scan's noise; 0 for none. Spots are found without it.
    """

    marks: Mapping[str, str | None]
    mesh: MeshPlan
    unit: str = "mm"
    bone_unit: str = "mm"
    length_mm: float = 80.0
    indenter_radius_mm: float = 7.5
    axis: FloatArray | None = None
    repair: bool = False
    mark_radii_mm: tuple[float, float] = (1.2, 10.0)
    n_smoothing: int = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScannedLimb:
    """A spot's limb, and what it was made from.

    ``rise_mm`` is how far the mesh was moved along the normal for the indenter to touch it at depth 0.
    """

    limb: Limb
    found: FoundSpot
    segment: Segment
    quality: Quality
    rise_mm: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadScan:
    """A scan with its spots, its axis and its bones, all in the scan's frame."""

    surface: Surface
    spots: Mapping[str, FoundSpot]
    axis: FloatArray
    bones: tuple[Surface, ...]
    placement: Placement = field(default_factory=lambda: Placement(motion=IN_PLACE, residual_mm=0.0))


def read_scan(
    path: Path, bones: Sequence[Path], plan: ScanPlan, places: BonePlaces | None = None
) -> ReadScan:
    """Read a scan, find its spots and place its bones.

    Raises
    ------
    MeshError
        Naming the file, the place and what to do.
    """
    scan = outwards(read_surface(path, plan.unit))
    check_size(scan, LIMB_MM, plan.unit)
    axis = _axis(scan, plan)
    least, largest = plan.mark_radii_mm
    marks = find_marks(scan, least_radius_mm=least, largest_radius_mm=largest)
    named = name_marks(marks, dict(plan.marks), axis, scan.name)
    closed = _closed(scan, plan)
    spots = {name: locate(name, mark, scan) for name, mark in named.items()}
    placement = _placement(places or BonePlaces(), closed, plan)
    models = tuple(read_bone(bone, plan.bone_unit).moved(placement.motion) for bone in bones)
    _check_names([model.name for model in models])
    smooth = smoothed(closed, plan.n_smoothing)
    return ReadScan(surface=smooth, spots=spots, axis=axis, bones=models, placement=placement)


def limbs_of(scan: ReadScan, plan: ScanPlan) -> Iterator[ScannedLimb]:
    """Mesh the segment of each spot, yielding each as it is done.

    Raises
    ------
    MeshError
        Naming the spot, the place and what to do.
    """
    for found in scan.spots.values():
        segment = cut(scan.surface, scan.bones, found.spot, scan.axis, plan.length_mm)
        limb, rise = moved_to_contact(sound_mesh(segment, plan.mesh), plan.indenter_radius_mm)
        quality = assess(limb, segment, plan.mesh.size.radius_mm)
        check_quality(quality, found.spot.name, plan.mesh.size.fine_mm)
        check_limb(limb, limb.mesh.regions)
        yield ScannedLimb(limb=limb, found=found, segment=segment, quality=quality, rise_mm=rise)


def sound_mesh(segment: Segment, plan: MeshPlan) -> Limb:
    """Mesh a segment, again where the mesh is poor: the mesher makes another one each time.

    The last of :data:`MOST_MESHES` is returned whatever it is like.
    """
    for _ in range(MOST_MESHES):
        limb = mesh_segment(segment, plan)
        with suppress(MeshError):
            check_quality(assess(limb, segment, plan.size.radius_mm), segment.name, plan.size.fine_mm)
            break
    return limb


def _axis(scan: Surface, plan: ScanPlan) -> FloatArray:
    if plan.axis is None:
        return limb_axis(scan)
    length = float(np.linalg.norm(plan.axis))
    if plan.axis.shape != (3,) or not length > 0.0:
        raise MeshError(f"axis {plan.axis.tolist()}: give three numbers, not all zero")
    axis: FloatArray = plan.axis / length
    return axis


def _closed(scan: Surface, plan: ScanPlan) -> Surface:
    """The scan, repaired where that was asked for."""
    if not (found := defects(scan)):
        return scan
    if not plan.repair:
        raise MeshError(
            f"{scan.name}: {'; '.join(map(str, found))}. Fix the scan, or let palpate close it with --repair"
        )
    return repaired(scan)


def _placement(places: BonePlaces, scan: Surface, plan: ScanPlan) -> Placement:
    start = Placement(motion=IN_PLACE, residual_mm=0.0)
    if places.motion is not None:
        start = read_motion(places.motion)
    elif places.landmarks is not None:
        start = read_landmarks(places.landmarks)
    if places.reference is None:
        return start
    return by_icp(read_surface(places.reference, plan.bone_unit), scan, start.motion)


def _check_names(names: list[str]) -> None:
    taken = {"fixed", "contact", "cut", "skin", "bonded"}
    for name in names:
        if name in taken:
            raise MeshError(f"bone '{name}': that name is taken; rename its file")
        taken.add(name)
