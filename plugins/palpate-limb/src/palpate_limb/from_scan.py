"""From a scan or model and bones to the limb around every spot."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from palpate.api import FloatArray, Limb, MeshError
from palpate.api.runs import check_limb
from palpate_limb.bones import IN_PLACE, Placement, by_icp, covered, read_bones, read_landmarks, read_motion
from palpate_limb.marks import FoundSpot, find_marks, locate, locate_at, name_marks
from palpate_limb.options import ScanOptions
from palpate_limb.places import Around, position_mm
from palpate_limb.quality import Quality, assess, check_quality
from palpate_limb.repair import check_size, closed, defects, extent, joined_parts, largest, parts, repaired
from palpate_limb.segment import Segment, cut, limb_axis
from palpate_limb.surfaces import (
    LIMB_MM,
    Surface,
    guessed_unit,
    mm_per_unit,
    outwards,
    read_surface,
    smoothed,
)
from palpate_limb.volume import MeshPlan, mesh_segment, moved_to_contact

MOST_MESHES = 4
"""Meshes that are made of a segment before a poor one is refused."""


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

    ``unit`` is the unit of the file, and ``unit_why`` the evidence for a guess; empty where it was given.
    """

    surface: Surface
    spots: Mapping[str, FoundSpot]
    axis: FloatArray
    bones: tuple[Surface, ...]
    placement: Placement = field(default_factory=lambda: Placement(motion=IN_PLACE, residual_mm=0.0))
    unit: str = "mm"
    unit_why: str = ""


def read_scan(path: Path, options: ScanOptions) -> ReadScan:
    """Read a scan, find its spots and place its bones; a MeshError names the file and the place."""
    with_bones = [bone.path for bone in options.bones if bone.path.resolve() == path.resolve()]
    scan, unit, why = _read_skin(path, options.unit, with_bones=bool(with_bones))
    check_size(scan, LIMB_MM, unit)
    whole = _closed(scan, repair=options.repair)
    bone_unit = options.bone_unit or unit
    placement = _placement(whole, options, bone_unit)
    models = tuple(
        bone.moved(placement.motion)
        for file in options.bones
        for bone in read_bones(file.path, bone_unit, file.names, skin_too=file.path in with_bones)
    )
    taken = {"fixed", "contact", "cut", "skin", "bonded"}
    for model in models:
        if model.name in taken:
            raise MeshError(f"bone '{model.name}': that name is taken; rename its file")
        taken.add(model.name)
    if options.cover is not None:
        models = tuple(covered(bone, whole, options.cover) for bone in models)
    axis, span_mm = _axis(scan, models, options.axis)
    if places := options.places:
        across = np.eye(3)[0 if abs(axis[0]) < 0.8 else 1]
        zero = across if options.zero is None else np.array(options.zero)
        around = Around(
            skin=whole, bones=models, axis=axis, span_mm=span_mm, zero=zero, mm_per_unit=mm_per_unit(unit)
        )
        spots = {n: locate_at(n, position_mm(n, place, around), scan) for n, place in places.items()}
    else:
        least, most = options.mark_radii
        named = name_marks(find_marks(scan, least, most), options.mark, axis, scan.name)
        spots = {name: locate(name, mark, scan) for name, mark in named.items()}
    return ReadScan(
        surface=smoothed(whole, options.smoothing),
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


def limbs_of(scan: ReadScan, options: ScanOptions, *, finer: bool = False) -> Iterator[ScannedLimb]:
    """Mesh the segment of each spot, yielding each as it is done; a MeshError names the spot."""
    if missing := sorted(set(options.layer_at) - set(scan.spots)):
        raise MeshError(f"layers of spot '{missing[0]}': no such spot (there: {', '.join(scan.spots)})")
    plans = {name: options.mesh_at(name) for name in scan.spots}
    segments = {}
    for name, found in scan.spots.items():  # all before the first mesh, which takes longer
        deep_mm, given = sum(plans[name].layers_mm.values()), (found.spot, scan.axis, options.length_mm)
        segments[name] = cut(scan.surface, scan.bones, *given, stump=options.stump, deep_mm=deep_mm)
    for name, found in scan.spots.items():
        plan, segment = plans[name].finer if finer else plans[name], segments[name]
        limb, rise = moved_to_contact(sound_mesh(segment, plan), options.radius)
        quality = assess(limb, segment, plan.size.radius_mm, rise)
        check_quality(quality, name, plan.size.fine_mm)
        check_limb(limb, limb.mesh.regions)
        remarks = (*found.remarks, *segment.remarks, *layers_at_bone(segment, plan.layers_mm))
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
    return [
        f"layers of {deep:g} mm together reach bone {' and '.join(reached)}: they are thinner above it; give "
        "the spot's own thicknesses (layer_at)"
    ]


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


def _axis(
    scan: Surface, bones: Sequence[Surface], given: list[float] | str | None
) -> tuple[FloatArray, tuple[float, float]]:
    """Unit vector along the limb, and the coordinates along it of 0 and 100 %."""
    if isinstance(given, str):
        bone = next((bone for bone in bones if bone.name == given), None)
        if bone is None:
            raise MeshError(
                f"axis '{given}': no such bone (there: {', '.join(b.name for b in bones) or 'none'}); "
                "name one of them, or give three numbers"
            )
        along = limb_axis(bone)
        return along, extent(bone, along)
    axis = limb_axis(scan) if given is None else np.array(given) / np.linalg.norm(given)
    return axis, extent(scan, axis)


def _closed(scan: Surface, *, repair: bool) -> Surface:
    """The scan with its openings closed, repaired where that was asked for."""
    whole = closed(scan)
    found = defects(whole)
    if found and not repair:
        raise MeshError(
            f"{scan.name}: {'; '.join(found)}. Fix the scan, let palpate repair it (repair = "
            "true), or, if its parts are bones, name the file under bones too"
        )
    # Caps of holes, and of what was cut out with crossing faces, are skin then.
    return replace(repaired(whole), caps=None) if repair else whole


def _placement(scan: Surface, options: ScanOptions, unit: str) -> Placement:
    start = Placement(motion=IN_PLACE, residual_mm=0.0)
    if options.motion is not None:
        start = read_motion(options.motion)
    elif options.landmarks is not None:
        start = read_landmarks(options.landmarks)
    if options.reference is None:
        return start
    return by_icp(read_surface(options.reference, unit), scan, start.motion)
