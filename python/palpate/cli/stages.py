"""The stages of a run: ``palpate sample``, ``simulate``, ``score``, ``select``, ``fit`` and after it."""

import faulthandler
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.results import check_results, tables_of
from palpate.cli.session import Session, opened
from palpate.errors import StudyError

if TYPE_CHECKING:
    from palpate.study.reading import Study


def sample(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Draw the parameter sets into design.parquet."""
    from palpate import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        design = pipeline.sample(checked, folder, session.plugins, progress)
    if as_json:
        names = [parameter.name for parameter in design.parameters]
        sets = [dict(zip(names, row, strict=True)) for row in design.values.tolist()]
        session.json({"n_drawn": design.n_drawn, "n_sets": design.n_sets, "seed": design.seed, "sets": sets})
        return
    session.say(f"{design.n_drawn} sets drawn, {design.n_sets} kept by the filters (seed {design.seed})")
    if design.n_kept:
        session.say(f"the first {design.n_kept} are of an earlier design with wider ranges")
    session.next(f"simulate {study} --out {folder}", f"written to {folder}; ")


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

    session, checked, folder = opened(context, study, out)
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
    session.table("Simulations", ["status", "number"], counts.most_common())
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
        row = [only, found.status, f"{found.seconds:.3g}", found.message]
        session.table("Simulation", ["job", "status", "seconds", "message"], [row])
    if found.status is not Status.OK:
        raise typer.Exit(1)


def score(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Compare simulated with measured curves into scores.parquet."""
    from palpate import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        scores = pipeline.score(checked, folder, session.plugins, progress)
    if as_json:
        session.json({"scores": scores.to_dicts(), "warnings": progress.warnings})
        return
    session.frame("Scores", scores)
    session.next(f"select {study} --out {folder}", f"written to {folder}; ")


def select(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Choose the best set by scenario and over all spots."""
    from palpate import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        selected = pipeline.select(checked, folder, session.plugins, progress)
    tables = tables_of(selected)
    if as_json:
        rows = {name: frame.to_dicts() for name, frame in tables.items()}
        session.json({**rows, "warnings": progress.warnings})
    else:
        for name, frame in tables.items():
            if frame.height:
                session.frame(name.capitalize(), frame)
        session.next(f"report {study} --out {folder}", f"written to {folder}; ")
    check_results(selected.without_result)


def fit(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Search the parameters for which the curves fit best."""
    from palpate import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        found = pipeline.fit(checked, folder, session.plugins, progress)
    if as_json:
        tables = {"fit": found.table, "mesh": found.mesh, "trace": found.trace}
        rows = {name: frame.to_dicts() for name, frame in tables.items()}
        session.json({**rows, "warnings": progress.warnings})
        return
    session.frame("Fit", found.table)
    session.next(f"report {study} --out {folder}", f"written to {folder}; ")


def certainty(
    context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False
) -> None:
    """Draw the posteriors of the joint fits; simulates some sets more."""
    from dataclasses import asdict

    from palpate import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        found = pipeline.certainty(checked, folder, session.plugins, progress)
    if as_json:
        rows = {name: frame.to_dicts() for name, frame in asdict(found).items()}
        session.json({**rows, "warnings": progress.warnings})
        return
    session.frame("Posterior", found.posterior)
    session.frame("Ends of profiles", found.profile_ends)
    session.frame("Volumes of posteriors", found.volumes)
    session.frame("Errors of emulated curves", found.emulator)
    session.next(f"report {study} --out {folder}", f"written to {folder}; ")


def surface(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Simulate the skin under the press with what was found; one simulation per spot."""
    from palpate import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        table = pipeline.surface(checked, folder, session.plugins, progress)
    if as_json:
        session.json(table.to_dicts())
        return
    session.frame("Skin", table.drop("key"))
    session.next(f"report {study} --out {folder}", f"written to {folder}; ")
