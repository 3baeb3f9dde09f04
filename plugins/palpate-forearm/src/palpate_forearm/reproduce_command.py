"""``palpate reproduce``: the paper's study end to end, with its tables beside these."""

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options import AsJson
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session

if TYPE_CHECKING:
    from palpate_forearm.reproduction import Cost, Reproduction

MATERIALS = ("ogden", "yeoh", "neo_hookean")


def reproduce(
    context: typer.Context,
    folder: Annotated[
        Path, typer.Argument(help="Folder of the reproduction; one that was begun goes on.")
    ] = Path("runs/reproduce"),
    n_sets: Annotated[
        int | None,
        typer.Option("--sets", min=2, help="Sets to draw of each material; the paper draws 250."),
    ] = None,
    minutes: Annotated[
        float | None,
        typer.Option("--minutes", min=0.1, help="Draw as many sets as fit into this time, at most 250."),
    ] = None,
    material: Annotated[
        list[str] | None,
        typer.Option("--material", help="Only this material; repeat for more: ogden, yeoh, neo_hookean."),
    ] = None,
    fine: Annotated[
        bool, typer.Option("--fine", help="Meshes of 3,600 nodes a spot instead of 1,500.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Repeat the paper's study on a simulated phantom: three materials, four spots, three scenarios.

    Without --sets and --minutes the time of several sizes is estimated, and asked for in a terminal.
    Called again with more sets it keeps what is simulated.
    """
    session = Session.of(context)
    chosen, phantom = material or list(MATERIALS), "fine" if fine else "coarse"
    size = n_sets or _size(session, chosen, phantom, minutes)
    if size is None:
        session.note("choose a size: palpate reproduce --sets 250, or --minutes 60")
        return
    _go(session, _prepared(session, folder, chosen, phantom, size), as_json=as_json)


def _prepared(
    session: Session, folder: Path, materials: list[str], phantom: str, n_sets: int
) -> "Reproduction":
    from palpate_forearm.reproduction import prepare

    return prepare(folder, session.plugins, materials, n_sets, phantom).extended(n_sets)


def _size(session: Session, materials: list[str], phantom: str, minutes: float | None) -> int | None:
    """Sets to draw, by the time there is or as somebody answers; None where nobody can be asked."""
    from palpate_forearm.reproduction import PAPER_SETS, sets_within

    n_workers = os.cpu_count() or 1
    costs = _costs(session, materials, phantom)
    if minutes is not None:
        return sets_within(minutes, costs, n_workers)
    rows = []
    for n in (sets_within(15.0, costs, n_workers), sets_within(60.0, costs, n_workers), PAPER_SETS):
        n_simulations = sum(round(c.n_simulations * n / c.n_drawn) for c in costs)
        seconds = sum(c.seconds(n_workers) * n / c.n_drawn for c in costs)
        rows.append([str(n), str(n_simulations), f"{seconds / 60:.0f} min"])
    session.table(f"About, with {n_workers} workers", ["sets", "simulations", "time"], rows)
    if not (sys.stdin.isatty() and session.stderr.is_terminal):
        return None
    return int(typer.prompt("sets of each material", default=int(rows[1][0]), type=int, err=True))


def _costs(session: Session, materials: list[str], phantom: str) -> "list[Cost]":
    from tempfile import TemporaryDirectory

    from palpate_forearm.reproduction import PAPER_SETS, cost, prepare

    session.note("timing a few simulations of each material …")
    with TemporaryDirectory(prefix="palpate-reproduce-") as scratch:
        trial = prepare(Path(scratch), session.plugins, materials, PAPER_SETS, phantom)
        return [cost(study, session.plugins) for study in trial.studies.values()]


def _go(session: Session, reproduction: "Reproduction", *, as_json: bool) -> None:
    from palpate_forearm.comparison import compare, write
    from palpate_forearm.reproduction import run

    with StageProgress(session) as progress:
        results = run(
            reproduction, session.plugins, progress, announce=lambda name: session.note(f"{name} …")
        )
    comparison = compare(results)
    file = write(comparison, results, reproduction.folder)
    if as_json:
        session.json({"file": str(file), **comparison.as_dict()})
        return
    for name, frame in comparison.tables.items():
        session.frame(name, frame)
    for doubt in comparison.doubts:
        session.say(f"{doubt.where}: the paper: {doubt.paper}. {doubt.found}. Here: {doubt.here}.")
    session.say("Not shared with the paper: " + "; ".join(comparison.not_shared) + ".")
    session.say(f"Comparison: {file}")
