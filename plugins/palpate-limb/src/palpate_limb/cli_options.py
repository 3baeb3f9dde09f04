"""Options of ``palpate limb SCAN``, and what their text means."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from palpate.api import MeshError

if TYPE_CHECKING:
    from palpate.api import FloatArray

ScanFile: TypeAlias = Annotated[
    Path, typer.Argument(metavar="SCAN", help="Coloured scan: .ply, .obj or .glb.")
]
Bones: TypeAlias = Annotated[
    list[Path] | None, typer.Option("--bones", metavar="FILE", help="A bone's model; repeat for more.")
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
MarkRadii: TypeAlias = Annotated[
    str, typer.Option(metavar="LEAST,LARGEST", help="Radii between which a patch of ink is a mark.")
]
OutFolder: TypeAlias = Annotated[Path, typer.Option("--into", metavar="FOLDER", help="Where the meshes go.")]
Unit: TypeAlias = Annotated[str, typer.Option(help="Unit of the scan's coordinates: mm, cm, m or inch.")]
BoneUnit: TypeAlias = Annotated[str, typer.Option(help="Unit of the bones' coordinates.")]
Axis: TypeAlias = Annotated[
    str, typer.Option(metavar="X,Y,Z", help="Along the limb; default: the scan's long principal axis.")
]
Length: TypeAlias = Annotated[str, typer.Option(help="Length of a segment, centred on its spot.")]
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
        help="A further layer below the skin, e.g. fat=5mm; repeat for more, from the outside in.",
    ),
]
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
MesherName: TypeAlias = Annotated[str, typer.Option(help="ftetwild, gmsh, tetgen, or module:class.")]


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


def unit_of(option: str, given: str) -> str:
    """A unit of length, as given."""
    length_mm(option, f"1 {given}")
    return given


def radii_mm(given: str) -> tuple[float, float]:
    """Least and largest radius of a mark."""
    least, comma, largest = given.partition(",")
    if not comma:
        raise MeshError(f'--mark-radii: {given}; give the least and the largest, e.g. "1 mm,10 mm"')
    between = length_mm("--mark-radii", least.strip()), length_mm("--mark-radii", largest.strip())
    if not between[0] < between[1]:
        raise MeshError(f"--mark-radii: {given}; give the least first and a larger one after it")
    return between


def axis_of(given: str) -> "FloatArray | None":
    """A direction; None where none is given."""
    import numpy as np

    if not given:
        return None
    try:
        axis = np.array([float(number) for number in given.split(",")])
    except ValueError:
        axis = np.empty(0)
    if axis.shape != (3,) or not np.isfinite(axis).all() or not axis.any():
        raise MeshError(f"--axis: {given}; give three numbers, not all 0, e.g. 1,0,0")
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


def layers_of(skin: str, given: list[str]) -> dict[str, float]:
    """Thickness [mm] of each layer, from the outside in."""
    layers = {"skin": length_mm("--skin", skin)} if skin else {}
    for text in given:
        name, equals, thickness = text.partition("=")
        if not (equals and _is_name(name)) or name in layers:
            raise MeshError(f"--layer {text}: give a name of its own and a thickness, e.g. fat=5mm")
        layers[name] = length_mm(f"--layer {name}", thickness)
    return layers


def _is_name(name: str) -> bool:
    return name.replace("-", "").replace("_", "").isalnum()
