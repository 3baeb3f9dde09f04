"""Options of ``palpate limb SCAN``, and what their text means."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from palpate.api import MeshError

if TYPE_CHECKING:
    from palpate.api import FloatArray
    from palpate_limb.from_scan import BoneFile
    from palpate_limb.places import Place

PATHS = frozenset({"into", "motion", "landmarks", "reference", "points", "layers-at"})
"""Options that name a file or a folder; --bones does so in its own way."""

ScanFile: TypeAlias = Annotated[
    Path, typer.Argument(metavar="SCAN", help="Scan or model of the limb: .ply, .obj, .glb, .stl or .off.")
]
Bones: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--bones",
        metavar="[NAMES=]FILE",
        help="Model of a bone, or of several: tibia,fibula=bones.stl names them in the file's order. The "
        "scan's own file: what is in its skin. Repeat for more.",
    ),
]
Marks: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--mark",
        metavar="NAME[=COLOUR]",
        help="A spot and the colour of its ink, e.g. p1=red; without colours, names go along the limb. "
        "Repeat for more; others are left out. Default: p1=red, p2=green, p3=blue, p4=yellow.",
    ),
]
Places: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--spot",
        metavar="NAME=PLACE",
        help="A spot without ink: x,y,z in the scan's coordinates; 45%,120deg, so far along the limb and "
        "around it; ulna:40%, the skin nearest to the bone there; ulna:40%,120deg; or a point of --points. "
        "Repeat for more.",
    ),
]
Points: TypeAlias = Annotated[
    Path | None, typer.Option("--points", metavar="FILE", help="Points for --spot: name,x,y,z a line.")
]
Zero: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="X,Y,Z",
        help="Direction of 0 degrees around the limb; default: x, or y for a limb along x.",
    ),
]
Stump: TypeAlias = Annotated[
    bool,
    typer.Option("--stump", help="The limb ends in skin, not in a cut: a segment may reach past its end."),
]
Cover: TypeAlias = Annotated[
    str,
    typer.Option(help="Least tissue over a bone: points nearer to the skin move inwards; default: refused."),
]
OptionsFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--options",
        metavar="FILE",
        is_eager=True,
        callback=lambda context, given: options_from(context, given),
        help="These options from a TOML file; those of the command line come first.",
    ),
]
MarkRadii: TypeAlias = Annotated[
    str, typer.Option(metavar="LEAST,LARGEST", help="Radii between which a patch of ink is a mark.")
]
OutFolder: TypeAlias = Annotated[Path, typer.Option("--into", metavar="FOLDER", help="Where the meshes go.")]
Unit: TypeAlias = Annotated[
    str,
    typer.Option(
        help='Unit of the scan\'s coordinates: mm, cm, m, inch, or its length, as in "365 mm". '
        "Default: the one in which the scan is a limb."
    ),
]
BoneUnit: TypeAlias = Annotated[
    str, typer.Option(help="Unit of the bones' coordinates; default: that of the scan.")
]
Axis: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="X,Y,Z|BONE",
        help="Along the limb, or the bone that is; default: the scan's long principal axis.",
    ),
]
Length: TypeAlias = Annotated[
    str,
    typer.Option(help="Length of a segment, centred on its spot; default: 10.7 radii, 80 mm for 7.5 mm."),
]
Radius: TypeAlias = Annotated[str, typer.Option(help="Radius of the spherical indenter.")]
Size: TypeAlias = Annotated[
    str, typer.Option(help="Edge length under the indenter; default: 0.28 of its radius.")
]
Fine: TypeAlias = Annotated[
    bool,
    typer.Option("--fine", help="Also write a finer mesh of each spot, of about three times as many nodes."),
]
Skin: TypeAlias = Annotated[
    str, typer.Option(help="Thickness of a skin layer, a region of its own; default: none.")
]
Layers: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--layer",
        metavar="NAME=THICKNESS",
        help="A further layer below the skin, e.g. fat=5mm, or p1.fat=6mm for one spot; repeat for more, "
        "from the outside in.",
    ),
]
LayersAt: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--layers-at",
        metavar="FILE",
        help="Thickness of layers by spot, as from ultrasound: a table of spot,skin_mm,fat_mm.",
    ),
]
Core: TypeAlias = Annotated[str, typer.Option(help="Name of the region below all layers.")]
Motion: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Bones' motion to the scan: 4 × 4 numbers.")
]
Landmarks: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Landmarks x,y,z of the bones and x,y,z of the scan.")
]
Reference: TypeAlias = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Skin or mould in the bones' frame, laid onto the scan."),
]
Repair: TypeAlias = Annotated[
    bool, typer.Option("--repair", help="Close holes and remove crossing faces of the scan.")
]
Smoothing: TypeAlias = Annotated[
    int, typer.Option(min=0, max=200, help="Rounds of Taubin's filter against the scan's noise; 0: none.")
]
Linear: TypeAlias = Annotated[bool, typer.Option("--linear", help="Four-node elements; they lock.")]
MesherName: TypeAlias = Annotated[str, typer.Option(help="ftetwild, or gmsh where there are no layers.")]


def length_mm(option: str, given: str) -> float:
    """A length above 0.

    Raises
    ------
    MeshError
        It is none; naming the option.
    """
    from palpate.api import convert

    try:
        value = convert(given, "mm")
    except ValueError as error:
        raise MeshError(f"{option}: {error}") from error
    if not value > 0.0:
        raise MeshError(f"{option}: {given}; give more than 0 mm")
    return value


def unit_of(option: str, given: str) -> str | None:
    """A unit of length, as given; None where none is."""
    from palpate_limb.surface_files import mm_per_unit

    if not given:
        return None
    try:
        positive = mm_per_unit(given) > 0.0
    except ValueError as error:
        raise MeshError(f"{option}: {error}") from error
    if not positive:
        raise MeshError(f"{option}: {given}; give more than 0 mm")
    return given


def options_from(context: typer.Context, file: Path | None) -> Path | None:
    """Make the options of a file the command's defaults; paths in it are relative to its folder."""
    import tomllib

    if file is None or context.resilient_parsing:
        return None
    try:
        given = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise MeshError(f"{file}: cannot be read ({error}); write TOML with the names of options") from error
    known = {option[2:]: p for p in context.command.params for option in p.opts if option.startswith("--")}
    defaults = {}
    for key, value in given.items():
        if (parameter := known.get(key)) is None or key == "options":
            raise MeshError(
                f"{file}: no option '{key}'; there are {', '.join(sorted(set(known) - {'options'}))}"
            )
        if isinstance(value, dict):
            value = [f"{name}={text}" for name, text in value.items()]
        if key in PATHS and isinstance(value, str):
            value = str(file.parent / value)
        if key == "bones" and isinstance(value, list):
            value = [beside(file, str(text)) for text in value]
        if isinstance(value, list) != (parameter.nargs != 1 or getattr(parameter, "multiple", False)):
            raise MeshError(f"{file}: {key} = {value!r}; give one value, or a list where the option repeats")
        defaults[parameter.name or key] = value
    context.default_map = {**(context.default_map or {}), **defaults}
    return file


def beside(file: Path, given: str) -> str:
    """The text of --bones with its path relative to the folder of a file."""
    names, equals, path = given.rpartition("=")
    return f"{names}{equals}{file.parent / path}"


def bones_of(given: list[str]) -> "list[BoneFile]":
    """Files of bones, with the names of theirs."""
    from palpate_limb.from_scan import BoneFile

    files = []
    for text in given:
        names, equals, path = text.partition("=")
        if not equals or Path(text).exists():
            files.append(BoneFile(path=Path(text)))
            continue
        each = tuple(name.strip() for name in names.split(","))
        if not all(_is_name(name) for name in each) or len(set(each)) < len(each):
            raise MeshError(f"--bones {text}: give each bone a name of its own, of letters, digits, - and _")
        files.append(BoneFile(path=Path(path), names=each))
    return files


def places_of(given: list[str], points: Path | None) -> "dict[str, Place]":
    """The place of each spot."""
    from palpate_limb.places import place_of, read_points

    named = read_points(points) if points is not None else {}
    places: dict[str, Place] = {}
    for text in given:
        name, equals, place = text.partition("=")
        if not (equals and _is_name(name)) or name in places:
            raise MeshError(f"--spot {text}: give a name of its own and a place, e.g. p1=45%,120deg")
        places[name] = place_of(name, place, named)
    return places


def radii_mm(given: str) -> tuple[float, float]:
    """Least and largest radius of a mark."""
    least, comma, largest = given.partition(",")
    if not comma:
        raise MeshError(f'--mark-radii: {given}; give the least and the largest, e.g. "1 mm,10 mm"')
    between = length_mm("--mark-radii", least.strip()), length_mm("--mark-radii", largest.strip())
    if not between[0] < between[1]:
        raise MeshError(f"--mark-radii: {given}; give the least first and a larger one after it")
    return between


def axis_of(given: str) -> "FloatArray | str | None":
    """A direction, or a bone's name; None where none is given."""
    return given if given and _is_name(given) else direction_of("--axis", given)


def direction_of(option: str, given: str) -> "FloatArray | None":
    """A direction; None where none is given."""
    import numpy as np

    if not given:
        return None
    try:
        axis = np.array([float(number) for number in given.split(",")])
    except ValueError:
        axis = np.empty(0)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise MeshError(f"{option}: {given}; give three numbers, not all 0, e.g. 1,0,0")
    return axis


def marks_of(given: list[str]) -> dict[str, str | None]:
    """Colour of each named mark; None where names go along the limb."""
    named: dict[str, str | None] = {}
    for text in given:
        name, equals, colour = text.partition("=")
        if not _is_name(name) or name in named:
            raise MeshError(f"--mark {text}: give each mark a name of its own, of letters, digits, - and _")
        named[name] = colour if equals else None
    if len({colour is None for colour in named.values()}) > 1:
        raise MeshError("--mark: give every mark a colour, or none of them")
    return named


def thickness_of(skin: str, given: list[str], file: Path | None) -> dict[str, dict[str, float]]:
    """Thickness [mm] of each layer from the outside in, for all (``""``) and where a spot has its own."""
    found: dict[str, dict[str, float]] = {"": {"skin": length_mm("--skin", skin)} if skin else {}}
    for text in given:
        name, equals, thickness = text.partition("=")
        spot, dot, layer = name.rpartition(".")
        of_spot = found.setdefault(spot, {})
        if not (equals and _is_name(layer)) or bool(dot) != _is_name(spot) or layer in of_spot:
            raise MeshError(
                f"--layer {text}: give a name of its own and a thickness, e.g. fat=5mm, or p1.fat=6mm "
                "at one spot"
            )
        of_spot[layer] = length_mm(f"--layer {name}", thickness)
    from palpate_limb.layers import layer_order

    table = _layer_table(file) if file is not None else {}
    # Before the two are merged, which names none of them together.
    order = layer_order([list(layers) for layers in (*found.values(), *table.values())])
    for spot, layers in table.items():
        found[spot] = {**layers, **found.get(spot, {})}
    return {spot: {name: layers[name] for name in order if name in layers} for spot, layers in found.items()}


def _layer_table(file: Path) -> dict[str, dict[str, float]]:
    """Thickness [mm] by spot and layer."""
    import csv

    try:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream, skipinitialspace=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise MeshError(f"{file}: cannot be read ({error}); write a table of spot,skin_mm,fat_mm") from error
    found: dict[str, dict[str, float]] = {}
    for number, row in enumerate(rows, start=2):
        spot = (row.pop("spot", None) or "").strip()
        try:
            layers = {name.removesuffix("_mm"): float(value) for name, value in row.items()}
        except (TypeError, ValueError, AttributeError):
            layers = {}
        wrong = not all(name.endswith("_mm") for name in row if name) or not all(
            0.0 < thickness < 1000.0 for thickness in layers.values()
        )
        if not layers or wrong or not _is_name(spot) or spot in found:
            raise MeshError(
                f"{file}: line {number}: write each spot once, with thicknesses > 0 under a heading such as "
                "spot,skin_mm,fat_mm"
            )
        found[spot] = layers
    if not found:
        raise MeshError(f"{file}: no spot; write a heading such as spot,skin_mm,fat_mm and a line for each")
    return found


def region_of(given: str) -> str:
    """Name of the region below all layers."""
    if not _is_name(given):
        raise MeshError(f"--core {given}: give a name of letters, digits, - and _")
    return given


def _is_name(name: str) -> bool:
    return name.replace("-", "").replace("_", "").isalnum()
