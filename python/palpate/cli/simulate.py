"""``palpate simulate``: every set at every spot, or one alone."""

import faulthandler
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, run_folder
from palpate.errors import StudyError

if TYPE_CHECKING:
    from palpate.study.reading import Study


def simulate(
    context: typer.Context,
    study: StudyPath,
    out: OutFolder = None,
    only: Annotated[
        str | None,
        typer.Option("--only", metavar="SPOT/SET", help="One job, in this process; nothing is kept."),
    ] = None,
    traceback: Annotated[
        bool, typer.Option("--traceback", help="With --only: show where the solver failed.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate every set at every spot; each result is stored as it comes."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    if only is not None:
        _simulate_one(session, checked, folder, only, traceback=traceback, as_json=as_json)
        return
    if traceback:
        raise StudyError("--traceback is for one job; name it with --only SPOT/SET")
    with StageProgress(session, folder) as progress:
        simulations = pipeline.simulate(checked, folder, session.plugins, progress)
    counts = Counter(str(simulation.status) for simulation in simulations)
    if as_json:
        session.json(counts)
        return
    session.table("Simulations", ["status", "number"], [[s, str(n)] for s, n in counts.most_common()])
    session.next(f"score {study} --out {folder}", f"written to {folder}; ")


def _simulate_one(
    session: Session, study: "Study", folder: Path, only: str, *, traceback: bool, as_json: bool
) -> None:
    """Simulate one job in this process, and exit with 1 where it failed."""
    from palpate import pipeline
    from palpate.domain import Status

    spot, slash, number = only.rpartition("/")
    if not slash or not number.isdecimal():
        raise StudyError(f"--only {only}: name a spot and a set, such as p1/3")
    if traceback:
        faulthandler.enable(file=2)  # for a solver that ends this process
    found = pipeline.simulate_one(study, folder, spot, int(number))
    if traceback:
        session.stderr.print(str(found.diagnostics.get("traceback", "no traceback")), markup=False)
    if as_json:
        session.json({str(found.status): 1})
    else:
        row = [only, str(found.status), f"{found.seconds:.3g}", found.message]
        session.table("Simulation", ["job", "status", "seconds", "message"], [row])
    if found.status is not Status.OK:
        raise typer.Exit(1)
