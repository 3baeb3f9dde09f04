"""From a scan or model and bones to the limb around every spot."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from palpate.api import FloatArray, Limb, MeshError
from palpate.api.runs import check_limb
from palpate_limb.bones import IN_PLACE, Placement, by_icp, covered, read_bones, read_landmarks, read_motion
from palpate_limb.layers import layer_order
from palpate_limb.marks import find_marks, name_marks
from palpate_limb.places import Around, Place, position_mm, zero_direction
from palpate_limb.quality import Quality, assess, check_quality
from palpate_limb.repair import (
    LIMB_MM,
    check_size,
    closed,
    defects,
    extent,
    joined_parts,
    largest,
    parts,
    repaired,
)
from palpate_limb.segment import Segment, cut, limb_axis
from palpate_limb.spots import FoundSpot, locate, locate_at
from palpate_limb.surface_files import guessed_unit, mm_per_unit, read_surface
from palpate_limb.surfaces import Surface, outwards, smoothed
from palpate_limb.volume import MeshPlan, mesh_segment, moved_to_contact

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
class BoneFile:
    """A file of one bone or several; of the scan itself, its largest part is the skin.

    ``names`` are those of its bones in its order, by default that of the file.
    """

    path: Path
    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPlan:
    """What to make of a scan.

    Parameters
    ----------
    marks : mapping of spot to a colour, or to None
        Ink marks; without colours, names go along the limb.
    places : mapping of spot to Place
        Places of spots instead of marks.
    unit : str, optional
        Of the scan's coordinates, or how long it is ("365 mm"); by default the one in which it is a limb.
    bone_unit : str, optional
        By default that of the scan.
    length_mm : float
        Of a segment.
    indenter_radius_mm : float
    axis : (3,) array or str, optional
        Along the limb, if its long principal axis is not it; or the bone that is.
    zero : (3,) array, optional
        Direction of 0 degrees around the limb.
    layers_at_mm : mapping of spot to thickness by layer
        Where it is not that of ``mesh``, as ultrasound measures it.
    stump : bool
        The limb ends in skin.
    cover_mm : float
        Least tissue over a bone, whose points move inwards for it; 0 to refuse a bone at the skin.
    repair : bool
        Repair the scan's holes and crossings instead of refusing them.
    mark_radii_mm : tuple of float
        Least and largest radius of a mark.
    n_smoothing : int
        Rounds of Taubin's filter against the scan's noise; 0 for none. Spots are found without it.
    """

    mesh: MeshPlan
    marks: Mapping[str, str | None] = field(default_factory=dict)
    places: Mapping[str, Place] = field(default_factory=dict)
    unit: str | None = "mm"
    bone_unit: str | None = None
    length_mm: float = 80.0
    indenter_radius_mm: float = 7.5
    axis: FloatArray | str | None = None
    zero: FloatArray | None = None
    layers_at_mm: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stump: bool = False
    cover_mm: float = 0.0
    repair: bool = False
    mark_radii_mm: tuple[float, float] = (1.2, 10.0)
    n_smoothing: int = 20

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of all layers, from the skin inwards.

        Raises
        ------
        MeshError
            What is named together at the spots and for all leaves their order open, or contradicts itself.
        """
        return layer_order([list(named) for named in (self.mesh.layers_mm, *self.layers_at_mm.values())])

    def mesh_at(self, spot: str) -> MeshPlan:
        """How the segment of a spot is meshed.

        Raises
        ------
        MeshError
            A layer has no thickness there, or is too thin for its elements.
        """
        known = {**self.mesh.layers_mm, **self.layers_at_mm.get(spot, {})}
        if missing := [name for name in self.layers if name not in known]:
            raise MeshError(
                f"spot '{spot}': layer '{missing[0]}' has a thickness at other spots and none here; give "
                "one for this spot, or for all"
            )
        made = replace(self.mesh, layers_mm={name: known[name] for name in self.layers})
        made.check_layers(spot)
        return made


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
    """A scan with its spots, its axis and its bones, all in the scan's frame.

    ``unit`` is that of the file, and ``unit_why`` what it was guessed from; empty where it was given.
    """

    surface: Surface
    spots: Mapping[str, FoundSpot]
    axis: FloatArray
    bones: tuple[Surface, ...]
    placement: Placement = field(default_factory=lambda: Placement(motion=IN_PLACE, residual_mm=0.0))
    unit: str = "mm"
    unit_why: str = ""


def read_scan(
    path: Path, bones: Sequence[Path | BoneFile], plan: ScanPlan, places: BonePlaces | None = None
) -> ReadScan:
    """Read a scan, find its spots and place its bones.

    Raises
    ------
    MeshError
        Naming the file, the place and what to do.
    """
    files = [bone if isinstance(bone, BoneFile) else BoneFile(path=bone) for bone in bones]
    with_bones = [bone.path for bone in files if bone.path.resolve() == path.resolve()]
    scan, unit, why = _read_skin(path, plan.unit, with_bones=bool(with_bones))
    check_size(scan, LIMB_MM, unit)
    whole = _closed(scan, plan)
    placement = _placement(places or BonePlaces(), whole, plan, unit)
    models = tuple(
        bone.moved(placement.motion)
        for file in files
        for bone in read_bones(
            file.path, plan.bone_unit or unit, file.names, skin_too=file.path in with_bones
        )
    )
    taken = {"fixed", "contact", "cut", "skin", "bonded"}
    for model in models:
        if model.name in taken:
            raise MeshError(f"bone '{model.name}': that name is taken; rename its file")
        taken.add(model.name)
    if plan.cover_mm > 0.0:
        models = tuple(covered(bone, whole, plan.cover_mm) for bone in models)
    axis, span_mm = _axis(scan, models, plan)
    if plan.places:
        zero = zero_direction(axis) if plan.zero is None else plan.zero
        around = Around(
            skin=whole, bones=models, axis=axis, span_mm=span_mm, zero=zero, mm_per_unit=mm_per_unit(unit)
        )
        spots = {n: locate_at(n, position_mm(n, place, around), scan) for n, place in plan.places.items()}
    else:
        least, largest = plan.mark_radii_mm
        marks = find_marks(scan, least_radius_mm=least, largest_radius_mm=largest)
        named = name_marks(marks, dict(plan.marks), axis, scan.name)
        spots = {name: locate(name, mark, scan) for name, mark in named.items()}
    return ReadScan(
        surface=smoothed(whole, plan.n_smoothing),
        spots=spots,
        axis=axis,
        bones=models,
        placement=placement,
        unit=unit,
        unit_why=why,
    )


def _read_skin(path: Path, unit: str | None, *, with_bones: bool) -> tuple[Surface, str, str]:
    """The skin in mm, open or closed, its unit, and why that is it where none was given."""
    pieces = parts(outwards(read_surface(path, unit or "mm")))
    skin = outwards(largest(pieces) if with_bones else joined_parts(pieces))
    if unit is not None:
        return skin, unit, ""
    guessed, why = guessed_unit(closed(skin))
    return replace(skin, points_mm=skin.points_mm * mm_per_unit(guessed)), guessed, why


def limbs_of(scan: ReadScan, plan: ScanPlan) -> Iterator[ScannedLimb]:
    """Mesh the segment of each spot, yielding each as it is done.

    Raises
    ------
    MeshError
        Naming the spot, the place and what to do.
    """
    if missing := sorted(set(plan.layers_at_mm) - set(scan.spots)):
        raise MeshError(f"layers of spot '{missing[0]}': no such spot (there: {', '.join(scan.spots)})")
    plans = {name: plan.mesh_at(name) for name in scan.spots}
    for name, found in scan.spots.items():
        segment = cut(scan.surface, scan.bones, found.spot, scan.axis, plan.length_mm, stump=plan.stump)
        limb, rise = moved_to_contact(sound_mesh(segment, plans[name]), plan.indenter_radius_mm)
        quality = assess(limb, segment, plan.mesh.size.radius_mm)
        check_quality(quality, found.spot.name, plan.mesh.size.fine_mm)
        check_limb(limb, limb.mesh.regions)
        remarks = (*found.remarks, *segment.remarks, *layers_at_bone(segment, plans[name].layers_mm))
        yield ScannedLimb(
            limb=limb, found=found, segment=replace(segment, remarks=remarks), quality=quality, rise_mm=rise
        )


def layers_at_bone(segment: Segment, layers_mm: Mapping[str, float]) -> list[str]:
    """A remark where the layers reach a bone below the spot."""
    deep = sum(layers_mm.values())
    gaps = {bone.name: float(bone.nearest(np.zeros((1, 3)))[1][0]) for bone in segment.bones}
    reached = [f"'{name}', {gap:.3g} mm from the spot" for name, gap in gaps.items() if gap <= deep]
    if not reached:
        return []
    return [f"layers of {deep:g} mm together reach bone {' and '.join(reached)}: check their thickness there"]


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


def _axis(scan: Surface, bones: Sequence[Surface], plan: ScanPlan) -> tuple[FloatArray, tuple[float, float]]:
    """Unit vector along the limb, and the coordinates along it of 0 and 100 %."""
    if isinstance(plan.axis, str):
        bone = next((bone for bone in bones if bone.name == plan.axis), None)
        if bone is None:
            raise MeshError(
                f"axis '{plan.axis}': no such bone (there: {', '.join(b.name for b in bones) or 'none'}); "
                "name one of them, or give three numbers"
            )
        along = limb_axis(bone)
        return along, extent(bone, along)
    if plan.axis is None:
        along = limb_axis(scan)
        return along, extent(scan, along)
    length = float(np.linalg.norm(plan.axis))
    if plan.axis.shape != (3,) or not length > 0.0:
        raise MeshError(f"axis {plan.axis.tolist()}: give three numbers, not all zero")
    axis: FloatArray = plan.axis / length
    return axis, extent(scan, axis)


def _closed(scan: Surface, plan: ScanPlan) -> Surface:
    """The scan with its openings closed, repaired where that was asked for."""
    whole = closed(scan)
    found = defects(whole)
    if not found:
        return replace(whole, caps=None) if plan.repair else whole
    if not plan.repair:
        raise MeshError(
            f"{scan.name}: {'; '.join(map(str, found))}. Fix the scan, let palpate repair it with --repair, "
            "or, if its parts are bones, name the file under --bones too"
        )
    # Caps of holes, and of what was cut out with crossing faces, are skin now.
    return replace(repaired(whole), caps=None)


def _placement(places: BonePlaces, scan: Surface, plan: ScanPlan, unit: str) -> Placement:
    start = Placement(motion=IN_PLACE, residual_mm=0.0)
    if places.motion is not None:
        start = read_motion(places.motion)
    elif places.landmarks is not None:
        start = read_landmarks(places.landmarks)
    if places.reference is None:
        return start
    return by_icp(read_surface(places.reference, plan.bone_unit or unit), scan, start.motion)
