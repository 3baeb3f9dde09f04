"""``palpate limb SCAN``: from a scan or model and bones to one mesh per spot."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from palpate.api import MeshError
from palpate.api.cli import AsJson, Session, StageProgress
from palpate_limb import cli_options as options

if TYPE_CHECKING:
    from palpate_limb.from_scan import BoneFile, BonePlaces, ScanPlan
    from palpate_limb.volume import MeshPlan

DEFAULT_SIZE = 0.28
"""Edge length under the indenter over its radius; ``mesh_error`` has what it costs."""
DEFAULT_LENGTH = 80.0 / 7.5
"""Length of a segment over the indenter's radius; docs/limb.md has what it costs."""
SCAN_SUFFIXES = frozenset({".ply", ".obj", ".glb", ".stl", ".off"})
"""Of surfaces."""
DEFAULT_MARKS = ("p1=red", "p2=green", "p3=blue", "p4=yellow")


def scan(
    context: typer.Context,
    file: options.ScanFile,
    given: options.OptionsFile = None,
    bones: options.Bones = None,
    spots: options.Places = None,
    points: options.Points = None,
    marks: options.Marks = None,
    mark_radii: options.MarkRadii = "1.2 mm,10 mm",
    out: options.OutFolder = Path("meshes"),
    unit: options.Unit = "",
    bone_unit: options.BoneUnit = "",
    axis: options.Axis = "",
    zero: options.Zero = "",
    stump: options.Stump = False,
    cover: options.Cover = "",
    length: options.Length = "",
    radius: options.Radius = "7.5 mm",
    size: options.Size = "",
    fine: options.Fine = False,
    skin: options.Skin = "",
    layers: options.Layers = None,
    layers_at: options.LayersAt = None,
    core: options.Core = "soft_tissue",
    motion: options.Motion = None,
    landmarks: options.Landmarks = None,
    reference: options.Reference = None,
    repair: options.Repair = False,
    smoothing: options.Smoothing = 20,
    linear: options.Linear = False,
    mesher: options.MesherName = "ftetwild",
    as_json: AsJson = False,
) -> None:
    """Mesh the limb around every spot of a scan or model: ink marks, or places that are named."""
    from palpate_limb.from_scan import BonePlaces, ScanPlan

    session = Session.of(context)
    if spots and marks:
        raise MeshError("--spot and --mark: give the spots by place or by ink, not both")
    for option, given_too, what in (("--points", points, "names points"), ("--zero", zero, "counts angles")):
        if given_too and not spots:
            raise MeshError(
                f"{option}: {what} for --spot, which is not given; add --spot NAME=POINT, or leave "
                f"{option} out"
            )
    radius_mm = options.length_mm("--radius", radius)
    thickness = options.thickness_of(skin, layers or [], layers_at)
    places = options.places_of(spots or [], points)
    plan = ScanPlan(
        marks={} if places else options.marks_of(marks or list(DEFAULT_MARKS)),
        places=places,
        mesh=_mesh_plan(radius_mm, size, thickness[""], core, linear, mesher),
        layers_at_mm={spot: of_spot for spot, of_spot in thickness.items() if spot},
        unit=options.unit_of("--unit", unit),
        bone_unit=options.unit_of("--bone-unit", bone_unit),
        length_mm=options.length_mm("--length", length) if length else DEFAULT_LENGTH * radius_mm,
        indenter_radius_mm=radius_mm,
        axis=options.axis_of(axis),
        zero=options.direction_of("--zero", zero),
        stump=stump,
        cover_mm=options.length_mm("--cover", cover) if cover else 0.0,
        repair=repair,
        mark_radii_mm=options.radii_mm(mark_radii),
        n_smoothing=smoothing,
    )
    bone_places = BonePlaces(motion=motion, landmarks=landmarks, reference=reference)
    plans = {out: plan} | ({out / "fine": replace(plan, mesh=plan.mesh.finer)} if fine else {})
    notes = _meshed(session, file, options.bones_of(bones or []), plans, bone_places)
    _show(session, notes, plan, as_json=as_json)


def _meshed(
    session: Session,
    file: Path,
    bones: list["BoneFile"],
    plans: dict[Path, "ScanPlan"],
    places: "BonePlaces",
) -> dict[Path, list[dict[str, Any]]]:
    """Write the limb of every spot into the folder of each plan; returns their notes."""
    from palpate_limb.from_scan import limbs_of, read_scan

    notes: dict[Path, list[dict[str, Any]]] = {folder: [] for folder in plans}
    with StageProgress(session, keeps=False) as progress:
        progress.begin("read the scan", 1)
        read = read_scan(file, bones, next(iter(plans.values())), places)
        progress.step()
        if read.unit_why:
            session.note(
                f"{file.name}: {read.unit_why}, so its unit is taken to be {read.unit}; --unit gives another"
            )
        progress.begin("mesh the spots", len(read.spots) * len(plans))
        for folder, plan in plans.items():
            folder.mkdir(parents=True, exist_ok=True)
            for made in limbs_of(read, plan):
                notes[folder].append(_written(read, made, plan, folder))
                progress.step(made.found.spot.name)
    return notes


def _mesh_plan(
    radius_mm: float, size: str, layers_mm: dict[str, float], core: str, linear: bool, mesher: str
) -> "MeshPlan":
    """Fine under the indenter, coarse away from it."""
    from palpate.api.mesh import NEAR
    from palpate_limb.meshing import SizeField
    from palpate_limb.volume import MeshPlan

    fine_mm = options.length_mm("--size", size) if size else DEFAULT_SIZE * radius_mm
    coarse_mm = max(2.4 * radius_mm, fine_mm)
    return MeshPlan(
        size=SizeField(fine_mm=fine_mm, coarse_mm=coarse_mm, radius_mm=NEAR * radius_mm),
        kind="tet4" if linear else "tet10",
        layers_mm=layers_mm,
        core=options.region_of(core),
        mesher=mesher,
    )


def _written(read: Any, made: Any, plan: "ScanPlan", out: Path) -> dict[str, Any]:  # noqa: ANN401 - types are imported late
    from palpate_limb.limb_files import note, write_limb
    from palpate_limb.preview import draw

    name = made.found.spot.name
    write_limb(out / f"{name}.vtu", made.limb)
    content = note(read, made, plan.indenter_radius_mm)
    (out / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")
    draw(made, out / f"{name}.png", plan.indenter_radius_mm)
    return content


def _show(
    session: Session, notes: dict[Path, list[dict[str, Any]]], plan: "ScanPlan", *, as_json: bool
) -> None:
    from palpate_limb.limb_files import study_tables

    if as_json:
        session.json([{"folder": str(folder), **note} for folder, of in notes.items() for note in of])
        return
    for folder, of_folder in notes.items():
        _table(session, folder, of_folder)
    session.paragraph(
        "shape: least scaled Jacobian of an element; volume: its error; ±: standard deviation of the spot's "
        "position and normal; force, torque: error by the mesh, the largest measured on three limbs"
    )
    first = next(iter(notes.values()))
    for name, repairs in first[0]["repairs"].items():
        session.say(f"{name}: {repairs}")
    for note in first:
        for remark in note["remarks"]:
            session.say(f"{note['spot']}: {remark}")
    regions = (*plan.layers, plan.mesh.core)
    session.say("\n" + study_tables([note["spot"] for note in first], regions, list(notes)))
    session.next("limb STUDY", "put these tables into a study.toml; ")


def _table(session: Session, folder: Path, notes: list[dict[str, Any]]) -> None:
    columns = ["spot", "nodes", "edge mm", "shape", "volume", "± mm", "± deg", "force", "torque"]
    rows = [
        [
            n["spot"],
            str(n["quality"]["n_nodes"]),
            f"{n['quality']['contact_edge_mm']:.2f}",
            f"{n['quality']['least_scaled_jacobian']:.3f}",
            f"{100 * n['quality']['volume_error']:+.2f} %",
            f"{n['std_across_mm']:.2f}",
            f"{n['std_normal_deg']:.2f}",
            *(_share(n["mesh_error"][channel]) for channel in ("force", "torque")),
        ]
        for n in notes
    ]
    session.table(f"Limbs in {folder}", columns, rows)


def _share(error: float | None) -> str:
    return "not studied" if error is None else f"{100 * error:+.1f} %"
