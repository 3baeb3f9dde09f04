"""``palpate reproduce``: the paper's study end to end, compared with the paper's tables."""

import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.api.cli import TEXT_WIDTH, AsJson, Session, StageProgress

if TYPE_CHECKING:
    from palpate_forearm.reproduction import Reproduction

MATERIALS = ("ogden", "yeoh", "neo_hookean")

LEAST_SETS = 2
"""Fewest sets that can be drawn."""


def reproduce(
    context: typer.Context,
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Folder of the reproduction; an existing one is continued."),
    ] = Path("runs/reproduce"),
    n_sets: Annotated[
        int | None,
        typer.Option("--sets", min=LEAST_SETS, help="Number of sets of each material; the paper draws 250."),
    ] = None,
    material: Annotated[
        list[str] | None,
        typer.Option(
            "--material",
            help="Run and compare only this material; repeat for more: ogden, yeoh, neo_hookean.",
        ),
    ] = None,
    fine: Annotated[
        bool, typer.Option("--fine", help="Meshes of 3,600 nodes a spot instead of 1,500.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Repeat the paper's study on a simulated phantom: three materials, four spots, three scenarios.

    Without --sets an existing reproduction continues with its sets, and a new one draws the paper's 250.
    Called again with more sets it keeps the simulations.
    """
    from palpate_forearm.reproduction import prepare

    session = Session.of(context)
    chosen, phantom = list(dict.fromkeys(material or MATERIALS)), "fine" if fine else "coarse"
    size = n_sets or _size(session, folder, chosen)
    made = prepare(folder, session.plugins, chosen, size, phantom).extended(size)
    _go(session, made, as_json=as_json)


def _size(session: Session, folder: Path, materials: list[str]) -> int:
    """Sets to draw: as many as there are, else as the paper's."""
    from palpate_forearm.reproduction import PAPER_SETS, sets_of

    if n_sets := sets_of(folder, materials, session.plugins):
        session.note(f"continuing with {n_sets} sets of each material")
    return n_sets or PAPER_SETS


def _go(session: Session, reproduction: "Reproduction", *, as_json: bool) -> None:
    from palpate_forearm.comparison import TITLES, compare, write
    from palpate_forearm.reproduction import run

    with StageProgress(session) as progress:
        outcome = run(reproduction, session.plugins, progress, announce=progress.note)
    comparison = compare(outcome)
    file = write(comparison, outcome.results, reproduction.folder)
    if as_json:
        session.json({"file": str(file), **comparison.as_dict()})
        return
    for name, frame in comparison.tables.items():
        session.frame(TITLES[name], frame)
    for erratum in comparison.errata:
        session.say(_as_lines(erratum))
    session.paragraph("Not shared with the paper: " + "; ".join(comparison.not_shared) + ".")
    session.say(f"Comparison: {file}")


def _as_lines(erratum: Mapping[str, str]) -> str:
    """An erratum in lines that fit a terminal."""
    lines = [
        textwrap.fill(text, TEXT_WIDTH, initial_indent=f"  {name}: ".ljust(9), subsequent_indent=" " * 9)
        for name, text in erratum.items()
        if name != "where"
    ]
    return "\n".join([erratum["where"], *lines])
