"""``palpate limb SCAN``: from a scan or model and bones to one mesh per spot."""

import json
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.api import MeshError, typed
from palpate.api.cli import AsJson, Session, StageProgress

if TYPE_CHECKING:
    from palpate_limb.options import ScanOptions

SCAN_SUFFIXES = frozenset({".ply", ".obj", ".glb", ".stl", ".off"})
Notes = dict[Path, list[dict[str, Any]]]  # of the spots by the folder of their meshes


OptionsFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Options of a TOML file, of which docs/limb.md has all; those given here come first.",
    ),
]
Bones = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAMES=]FILE",
        help="Model of a bone, or of several: tibia,fibula=bones.stl names them in the file's order. The "
        "scan's own file: all parts inside its skin. Repeat for more.",
    ),
]
Spots = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=PLACE",
        help="A spot without ink: x,y,z in the scan's coordinates; 45%,120deg, so far along the limb and "
        "around it; ulna:40%, the skin nearest to the bone there; or ulna:40%,120deg. Repeat for more.",
    ),
]
Marks = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME[=COLOUR]",
        help="A spot and the colour of its ink; without colours, names go along the limb. Repeat for "
        "more. Default: p1=red, p2=green, p3=blue, p4=yellow.",
    ),
]
Into = Annotated[str | None, typer.Option(metavar="FOLDER", help="Where the meshes go; default: meshes.")]
Size = Annotated[
    str | None, typer.Option(help="Edge length under the indenter; default: 0.28 of its radius.")
]
Fine = Annotated[
    bool, typer.Option("--fine", help="Also write a finer mesh of each spot, of about three times the nodes.")
]


def scan(
    context: typer.Context,
    file: Annotated[
        Path,
        typer.Argument(metavar="SCAN", help="Scan or model of the limb: .ply, .obj, .glb, .stl or .off."),
    ],
    options: OptionsFile = None,
    bones: Bones = None,
    spot: Spots = None,
    mark: Marks = None,
    into: Into = None,
    size: Size = None,
    fine: Fine = False,
    as_json: AsJson = False,
) -> None:
    """Mesh the limb around every spot of a scan or model: ink marks, or places that are named."""
    from palpate.api.runs import read_options
    from palpate_limb.options import ScanOptions

    session = Session.of(context)
    given: dict[str, Any] = {"bones": bones, "into": into, "size": size, "fine": fine}
    given |= {"spot": _by_name("spot", spot), "mark": _by_name("mark", mark)}
    plan = read_options(options, ScanOptions, {key: value for key, value in given.items() if value})
    regions = (*plan.layers, plan.core)
    notes = _meshed(session, file, plan)
    if as_json:
        session.json([{"folder": str(folder), **note} for folder, of in notes.items() for note in of])
    else:
        _show(session, notes, regions)


def inspect(
    context: typer.Context,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Mesh or deck, such as .vtu, .inp or .feb.")],
    as_json: AsJson = False,
) -> None:
    """Show regions and sets of a mesh or deck, the tables of study.toml that read it, and a picture."""
    from palpate.api.cli import look_into_mesh
    from palpate_limb.mesh_picture import draw_limb

    session = Session.of(context)
    if file.suffix.lower() in SCAN_SUFFIXES:
        raise MeshError(f"{file}: a surface and no mesh; mesh it with `palpate limb {typed(file)}`")
    found = look_into_mesh(file, session)
    picture = file.with_suffix(".png")
    try:
        drawn = found.limb is not None and draw_limb(found.limb, picture)
    except OSError as error:
        drawn = False
        session.note(f"no picture, since {picture} cannot be written: {error.strerror}")
    if as_json:
        session.json(
            {**found.record, "study_text": found.study_text, "picture": str(picture) if drawn else None}
        )
        return
    for table in found.tables:
        session.table(table.title, table.columns, table.rows)
    for finding in found.findings:
        session.say(f"- {finding}")
    session.say(f"\n{found.study_text}")
    if drawn:
        session.say(f"picture: {picture}")
    how = "put these tables into a study.toml, or make one with your measured curves; "
    session.next("init my-study --measured FILE --mesh {file}", how, file=file)


def _by_name(option: str, given: list[str] | None) -> dict[str, str | None]:
    """Text that follows each name; None where nothing does."""
    pairs = [text.partition("=") for text in given or []]
    found = {name.strip(): value if equals else None for name, equals, value in pairs}
    if len(found) < len(pairs):
        raise MeshError(f"--{option}: one name twice; give each spot a name of its own")
    return found


def _meshed(session: Session, file: Path, options: "ScanOptions") -> Notes:
    """Write the limb of every spot, and its finer mesh where that is asked for."""
    from palpate_limb.from_scan import limbs_of, read_scan
    from palpate_limb.limb_files import draw, note, write_limb

    folders = [options.into, options.into / "fine"][: 1 + options.fine]
    notes: Notes = {folder: [] for folder in folders}
    with StageProgress(session, keeps=False) as progress:
        progress.begin("read the scan", 1)
        read = read_scan(file, options)
        progress.step()
        if read.unit_why:
            session.note(
                f"{file.name}: {read.unit_why}, so its unit is taken to be {read.unit}; unit in a file of "
                "--options gives another"
            )
        progress.begin("mesh the spots", len(read.spots) * len(folders))
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
            for made in limbs_of(read, options, finer=folder != options.into):
                name = made.found.spot.name
                write_limb(folder / f"{name}.vtu", made.limb)
                notes[folder].append(note(file, options, read, made))
                (folder / f"{name}.json").write_text(json.dumps(notes[folder][-1], indent=1) + "\n")
                draw(made, folder / f"{name}.png", options.radius)
                progress.step(name)
    return notes


def _show(session: Session, notes: Notes, regions: tuple[str, ...]) -> None:
    from palpate_limb.limb_files import study_tables

    columns = ["spot", "nodes", "edge mm", "shape", "volume", "± mm", "± deg", "force", "torque"]
    for folder, of_folder in notes.items():
        rows = [
            [
                n["spot"],
                str(n["quality"]["n_nodes"]),
                f"{n['quality']['contact_edge_mm']:.2f}",
                f"{n['quality']['least_scaled_jacobian']:.3f}",
                f"{100 * n['quality']['volume_error']:+.2f} %",
                f"{n['std_across_mm']:.2f}",
                f"{n['std_normal_deg']:.2f}",
                *(
                    "not studied" if (error := n["mesh_error"][channel]) is None else f"{100 * error:+.1f} %"
                    for channel in ("force", "torque")
                ),
            ]
            for n in of_folder
        ]
        session.table(f"Limbs in {folder}", columns, rows)
    session.paragraph(
        "shape: least scaled Jacobian of an element; volume: its error; ±: standard deviation of the spot's "
        "position and normal; force, torque: error by the mesh, the largest measured on three limbs"
    )
    first = next(iter(notes.values()))
    for name, repairs in first[0]["repairs"].items():
        session.say(f"{name}: {repairs}")
    for note in first:
        for layer, (mean, sd) in note["quality"]["layers_mm"].items():
            session.say(f"{note['spot']}: {layer} is {mean:.2f} ± {sd:.2f} mm thick under the indenter")
        for remark in note["remarks"]:
            session.say(f"{note['spot']}: {remark}")
    session.say("\n" + study_tables([note["spot"] for note in first], regions, list(notes)))
    folder = next(iter(notes)).parent
    if (folder / "study.toml").is_file():
        step = "synthesise" if _is_to_simulate(folder / "study.toml") else "check"
        how = "put these tables into a study.toml, or go on with the one there; "
        session.next(f"{step} {{folder}}", how, folder=folder)
        return
    meshes = (f" --measured {note['spot']}.csv --mesh {{folder}}/{note['spot']}.vtu" for note in first)
    how = "put these tables into a study.toml, or make one with your measured curves; "
    session.next(f"init my-study{''.join(meshes)}", how, folder=next(iter(notes)))


def _is_to_simulate(study: Path) -> bool:
    """Whether the curves of a study follow from its ``[truth]``, and are not there yet."""
    try:
        tables = tomllib.loads(study.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    spots = found if isinstance(found := tables.get("spot"), list) else []
    files = (spot.get("measured") for spot in spots if isinstance(spot, dict))
    missing = (not (study.parent / file).exists() for file in files if isinstance(file, str))
    return "truth" in tables and any(missing)
