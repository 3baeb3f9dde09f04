"""``palpate limb SCAN``: from a coloured scan and bone models to one mesh per marked spot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.options import AsJson
from palpate.cli.session import Session

if TYPE_CHECKING:
    from palpate_limb.from_scan import ScanPlan

DEFAULT_SIZE = 0.3
"""Edge length under the indenter in units of its radius."""


def scan(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="SCAN", help="Coloured scan: .ply, .obj or .glb.")],
    bones: Annotated[
        list[Path] | None, typer.Option("--bones", metavar="FILE", help="A bone's model; repeat for more.")
    ] = None,
    marks: Annotated[
        list[str] | None,
        typer.Option(
            "--mark",
            metavar="NAME[=COLOUR]",
            help="A spot and the colour of its ink, e.g. p1=red; without colours, names go along the limb. "
            "Repeat for more; default: p1=red, p2=green, p3=blue, p4=yellow.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where the meshes go.")] = Path(
        "meshes"
    ),
    unit: Annotated[str, typer.Option(help="Unit of the scan's coordinates: mm, cm, m or inch.")] = "mm",
    bone_unit: Annotated[str, typer.Option(help="Unit of the bones' coordinates.")] = "mm",
    length: Annotated[str, typer.Option(help="Length of a segment, centred on its spot.")] = "80 mm",
    radius: Annotated[str, typer.Option(help="Radius of the spherical indenter.")] = "7.5 mm",
    size: Annotated[
        str, typer.Option(help="Edge length under the indenter; default: 0.3 of its radius.")
    ] = "",
    skin: Annotated[
        str, typer.Option(help="Thickness of a skin layer, a region of its own; default: none.")
    ] = "",
    motion: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Bones' motion to the scan: 4 × 4 numbers.")
    ] = None,
    landmarks: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Landmarks x,y,z of the bones and x,y,z of the scan.")
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Skin or mould in the bones' frame, laid onto the scan."),
    ] = None,
    repair: Annotated[
        bool, typer.Option("--repair", help="Close holes and mend crossings of the scan.")
    ] = False,
    linear: Annotated[bool, typer.Option("--linear", help="Four-node elements; they lock.")] = False,
    mesher: Annotated[str, typer.Option(help="ftetwild, gmsh, tetgen, or module:class.")] = "ftetwild",
    as_json: AsJson = False,
) -> None:
    """Mesh the limb around every ink mark of a coloured scan."""
    from palpate_limb.from_scan import BonePlaces, limbs_of, read_scan

    session = Session.of(context)
    plan = _plan(marks, unit, bone_unit, length, radius, size, skin, repair, linear, mesher)
    places = BonePlaces(motion=motion, landmarks=landmarks, reference=reference)
    read = read_scan(file, bones or [], plan, places)
    out.mkdir(parents=True, exist_ok=True)
    notes = [_written(read, made, plan, out) for made in limbs_of(read, plan)]
    if as_json:
        session.json(notes)
        return
    _tell(session, notes, plan, out)


def _written(read: Any, made: Any, plan: "ScanPlan", out: Path) -> dict[str, Any]:  # noqa: ANN401 - types are imported late
    from palpate_limb.limb_files import note, write_limb, write_note
    from palpate_limb.preview import draw

    name = made.found.spot.name
    write_limb(out / f"{name}.vtu", made.limb)
    content = note(read, made)
    write_note(out / f"{name}.json", content)
    draw(made, out / f"{name}.png", plan.indenter_radius_mm)
    return content


def _tell(session: Session, notes: list[dict[str, Any]], plan: "ScanPlan", out: Path) -> None:
    from palpate_limb.limb_files import study_tables

    columns = ["spot", "nodes", "elements", "edge mm", "least Jacobian", "volume", "± mm", "± normal"]
    rows = [
        [
            n["spot"],
            str(n["quality"]["n_nodes"]),
            str(n["quality"]["n_cells"]),
            f"{n['quality']['contact_edge_mm']:.2f}",
            f"{n['quality']['least_scaled_jacobian']:.3f}",
            f"{100 * n['quality']['volume_error']:+.2f} %",
            f"{n['std_across_mm']:.2f}",
            f"{n['std_normal_deg']:.2f}°",
        ]
        for n in notes
    ]
    session.table(f"Limbs in {out}", columns, rows)
    for name, mended in notes[0]["mended"].items():
        session.say(f"{name}: {mended}")
    regions = (*plan.mesh.layers_mm, "soft_tissue")
    session.say("\n" + study_tables([n["spot"] for n in notes], regions, out))
    session.next("limb STUDY", "put these tables into a study.toml; ")


def _plan(
    marks: list[str] | None,
    unit: str,
    bone_unit: str,
    length: str,
    radius: str,
    size: str,
    skin: str,
    repair: bool,
    linear: bool,
    mesher: str,
) -> "ScanPlan":
    from palpate_limb.from_scan import ScanPlan
    from palpate_limb.meshing import SizeField
    from palpate_limb.volume import MeshPlan

    for name, given in (("--unit", unit), ("--bone-unit", bone_unit)):
        _mm(name, f"1 {given}")
    radius_mm = _mm("--radius", radius)
    fine_mm = _mm("--size", size) if size else DEFAULT_SIZE * radius_mm
    return ScanPlan(
        marks=_marks(marks or ["p1=red", "p2=green", "p3=blue", "p4=yellow"]),
        mesh=MeshPlan(
            size=SizeField(
                fine_mm=fine_mm, coarse_mm=max(2.4 * radius_mm, fine_mm), radius_mm=1.2 * radius_mm
            ),
            kind="tet4" if linear else "tet10",
            layers_mm={"skin": _mm("--skin", skin)} if skin else {},
            mesher=mesher,
        ),
        unit=unit,
        bone_unit=bone_unit,
        length_mm=_mm("--length", length),
        indenter_radius_mm=radius_mm,
        repair=repair,
    )


def _mm(option: str, given: str) -> float:
    from palpate.errors import MeshError
    from palpate.units import convert

    try:
        value = convert(given, "mm")
    except ValueError as error:
        raise MeshError(f"{option}: {error}") from error
    if not value > 0.0:
        raise MeshError(f"{option}: {given}; give more than 0 mm")
    return value


def _marks(given: list[str]) -> dict[str, str | None]:
    from palpate.errors import MeshError

    named: dict[str, str | None] = {}
    for text in given:
        name, equals, colour = text.partition("=")
        if not name.replace("-", "").replace("_", "").isalnum() or name in named:
            raise MeshError(f"--mark {text}: give each mark a name of its own, of letters, digits, - and _")
        named[name] = colour if equals else None
    if len({colour is None for colour in named.values()}) > 1:
        raise MeshError("--mark: give every mark a colour, or none of them")
    return named
