"""``palpate reproduce``: the paper's study end to end, compared with the paper's tables."""

import math
import sys
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.api import StudyError
from palpate.api.cli import TEXT_WIDTH, AsJson, Session, StageProgress

if TYPE_CHECKING:
    from palpate_forearm.errata import Erratum
    from palpate_forearm.reproduction import Cost, Reproduction

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
    minutes: Annotated[
        float | None,
        typer.Option("--minutes", min=0.1, help="Draw as many sets as fit into this time, at most 250."),
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

    Without --sets and --minutes an existing reproduction continues with its sets. For a
    new one the time of several sizes is estimated, and asked for in a terminal. Called again with
    more sets it keeps what is simulated.
    """
    session = Session.of(context)
    chosen, phantom = list(dict.fromkeys(material or MATERIALS)), "fine" if fine else "coarse"
    size = _size(session, folder, chosen, phantom, n_sets=n_sets, minutes=minutes)
    if size is None:
        session.note("choose a size: palpate reproduce --sets 250, or --minutes 60")
        return
    _go(session, _prepared(session, folder, chosen, phantom, size), as_json=as_json)


def _prepared(
    session: Session, folder: Path, materials: list[str], phantom: str, n_sets: int
) -> "Reproduction":
    from palpate_forearm.reproduction import prepare

    return prepare(folder, session.plugins, materials, n_sets, phantom).extended(n_sets)


def _size(
    session: Session,
    folder: Path,
    materials: list[str],
    phantom: str,
    *,
    n_sets: int | None,
    minutes: float | None,
) -> int | None:
    """Sets to draw: as asked for, as there were, or by the time there is; None where nobody can be asked."""
    from palpate_forearm.reproduction import refuse, sets_of

    if n_sets is not None and minutes is not None:
        raise StudyError("--sets and --minutes both say how many sets to draw; give one of them")
    refuse(folder, materials, phantom)
    if n_sets is not None:
        return n_sets
    begun = sets_of(folder, materials, session.plugins)
    if minutes is None and begun:
        session.note(f"going on with {begun} sets of each material")
        return begun
    costs = _costs(session, materials, phantom)
    return _asked(session, costs) if minutes is None else _fitting(session, costs, minutes, begun)


def _fitting(session: Session, costs: "list[Cost]", minutes: float, begun: int) -> int:
    """Sets for a time, and no fewer than there are."""
    from palpate.api.executors import n_cores
    from palpate_forearm.reproduction import sets_within

    size = max(begun, sets_within(minutes, costs, n_cores()))
    session.note(f"{size} sets of each material: about {_minutes(costs, size)} from the beginning")
    return size


def _asked(session: Session, costs: "list[Cost]") -> int | None:
    from palpate.api.executors import n_cores
    from palpate_forearm.reproduction import FEWEST_SETS, PAPER_SETS, sets_within

    sizes = sorted({FEWEST_SETS, *(sets_within(m, costs, n_cores()) for m in (15.0, 60.0)), PAPER_SETS})
    rows = [
        [str(n), str(sum(round(c.n_simulations * n / c.n_drawn) for c in costs)), _minutes(costs, n)]
        for n in sizes
    ]
    session.table(f"About, with {n_cores()} workers", ["sets", "simulations", "time"], rows)
    if not (sys.stdin.isatty() and session.stderr.is_terminal):
        return None
    default = sets_within(60.0, costs, n_cores())
    return int(typer.prompt("sets of each material", default=default, value_proc=_number, err=True))


def _minutes(costs: "list[Cost]", n_sets: int) -> str:
    from palpate.api.executors import n_cores

    seconds = sum(c.seconds(n_cores()) * n_sets / c.n_drawn for c in costs)
    return f"{math.ceil(seconds / 60.0)} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def _number(text: str) -> int:
    """Number of sets that somebody typed."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < LEAST_SETS:
        raise typer.BadParameter(f"'{text}' is not a whole number of {LEAST_SETS} or more")
    return number


def _costs(session: Session, materials: list[str], phantom: str) -> "list[Cost]":
    from tempfile import TemporaryDirectory

    from palpate_forearm.reproduction import PAPER_SETS, cost, prepare

    session.note("timing a few simulations of each material …")
    with TemporaryDirectory(prefix="palpate-reproduce-") as scratch:
        trial = prepare(Path(scratch), session.plugins, materials, PAPER_SETS, phantom)
        return [cost(study, session.plugins) for study in trial.studies.values()]


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


def _as_lines(erratum: "Erratum") -> str:
    """An erratum in lines that fit a terminal."""
    parts = {"paper": erratum.paper, "found": erratum.found, "here": erratum.here}
    lines = [
        textwrap.fill(text, TEXT_WIDTH, initial_indent=f"  {name}: ".ljust(9), subsequent_indent=" " * 9)
        for name, text in parts.items()
    ]
    return "\n".join([erratum.where, *lines])
