"""The paper's study end to end, compared with the paper's tables: a command in one file.

``palpate --plugin examples/paper/reproduce.py reproduce``. The folder ``papers_study`` next to it has the
tables and the studies.
"""

import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.api import hookimpl
from palpate.api.cli import RUN, TEXT_WIDTH, AsJson, Command, Session, StageProgress, examples
from palpate.api.runs import Plugins

if TYPE_CHECKING:
    from papers_study.reproduction import Reproduction

if (here := str(Path(__file__).parent)) not in sys.path:
    sys.path.append(here)  # of papers_study

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
    from papers_study.reproduction import prepare

    session = Session.of(context)
    chosen, phantom = list(dict.fromkeys(material or MATERIALS)), "fine" if fine else "coarse"
    # Without this file, so that a run can be opened later without it.
    plugins = Plugins.load(without=session.without)
    size = n_sets or size_of(session, plugins, folder, chosen)
    made = prepare(folder, plugins, chosen, size, phantom).extended(size)
    _go(session, plugins, made, as_json=as_json)


def size_of(session: Session, plugins: Plugins, folder: Path, materials: list[str]) -> int:
    """Sets to draw: as many as there are, else as the paper's."""
    from papers_study.reproduction import PAPER_SETS, sets_of

    if n_sets := sets_of(folder, materials, plugins):
        session.note(f"continuing with {n_sets} sets of each material")
    return n_sets or PAPER_SETS


def _go(session: Session, plugins: Plugins, reproduction: "Reproduction", *, as_json: bool) -> None:
    from papers_study.comparison import TITLES, compare, write
    from papers_study.reproduction import run

    with StageProgress(session) as progress:
        outcome = run(reproduction, plugins, progress, announce=progress.note)
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


@hookimpl
def palpate_commands() -> list[Command]:
    """Provide the command."""
    call = "palpate --plugin examples/paper/reproduce.py reproduce"
    calls = examples(f"{call} --sets 20", call, f"{call} --fine")
    return [Command(function=reproduce, panel=RUN, epilog=calls)]
