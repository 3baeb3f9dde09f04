"""A command for each stage, such as ``palpate score STUDY``, and what it prints."""

import faulthandler
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options import AsJson, OutFolder, StudyOrRun, TrustPlugins, examples
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, opened, run_folder
from palpate.errors import NothingSelectableError, StudyError

if TYPE_CHECKING:
    from palpate.domain.component import Component
    from palpate.stages.stage import Run
    from palpate.study.reading import Study

GENERATED = {
    "sample": "Draw the parameter sets into design.parquet.",
    "score": "Compare simulated with measured curves into scores.parquet.",
    "select": "Choose the best set by scenario and over all spots.",
    "verify": "Verify the selected sets, such as with halved steps.",
    "fit": "Search the parameters for which the curves fit best.",
    "surface": "Simulate the skin under the press with the fitted parameters; one simulation per spot.",
    "answer": "List every value that was found, with its interval and its verdict.",
}
"""Help of the core's stages, whose command needs nothing of theirs: importing them takes long."""


def stage_command(name: str, help_text: str) -> Callable[..., None]:
    """Typer command that runs one stage and prints its summary, or its tables as JSON."""

    def command(
        context: typer.Context,
        study: StudyOrRun,
        out: OutFolder = None,
        trust_plugins: TrustPlugins = False,
        as_json: AsJson = False,
    ) -> None:
        from palpate.stages import pipeline

        session, checked, folder = opened(context, study, out, trust=trust_plugins)
        with StageProgress(session) as progress:
            run = pipeline.run_stage(name, checked, folder, session.plugins, progress)
        summary = run.stages[name].summarise(run)
        if as_json:
            tables = {table: run.table(table).to_dicts() for table in run.stages[name].tables}
            session.json({**tables, "warnings": progress.warnings})
        else:
            for line in summary.lines:
                session.say(line)
            for title, frame in summary.tables.items():
                session.frame(title, frame)
            show_next(session, run, name, study)
        if summary.missing:
            raise NothingSelectableError(summary.missing)

    command.__name__, command.__doc__ = name.replace("-", "_"), help_text
    return command


def show_next(session: Session, run: "Run", name: str, study: Path) -> None:
    """Print where a stage has written its results, and the command to call next."""
    folder, step = run.directory.folder, _command_after(run, name)
    is_default = folder in (study, run_folder(run.study, None))
    out = "" if is_default else " --out {out}"
    session.next(f"{step} {{study}}{out}", f"written to {folder}; ", study=study, out=folder)


def _command_after(run: "Run", name: str) -> str:
    """Command to call next: what the first stage of every run that needs this one still lacks, or that stage.

    The report where none does; the whole run of a study without a sweep, whose next stages make nothing.
    """
    from palpate.stages.order import in_order

    if not (run.study.n_sets or run.directory.records.has("fit")):
        return "run"
    later = [each.name for each in run.stages.values() if each.is_in_run(run.study) and name in each.needs]
    for each in in_order(run.stages, later[:1]):
        if each.tables and not run.directory.records.has(each.name):
            return each.name
    return next(iter(later), "report")


def add_stage(app: typer.Typer, panel: str, stage: "type[Component]") -> None:
    """Add the command of a plugin's stage."""
    how = examples(f"palpate {stage.name} arm")
    app.command(stage.name, rich_help_panel=panel, epilog=how)(stage_command(stage.name, stage.summary))


def simulate(
    context: typer.Context,
    study: StudyOrRun,
    out: OutFolder = None,
    only: Annotated[
        str | None,
        typer.Option("--only", metavar="SPOT/SET", help="One job, in this process; nothing is kept."),
    ] = None,
    traceback: Annotated[
        bool, typer.Option("--traceback", help="With --only: show where the solver failed.")
    ] = False,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Simulate every set at every spot; each result is stored as it comes."""
    from palpate.stages import pipeline

    session, checked, folder = opened(context, study, out, trust=trust_plugins)
    if only is not None:
        _simulate_one(session, checked, folder, only, traceback=traceback, as_json=as_json)
        return
    if traceback:
        raise StudyError("--traceback is for one job; name it with --only SPOT/SET")
    with StageProgress(session) as progress:
        run = pipeline.run_stage("simulate", checked, folder, session.plugins, progress)
    counts = Counter(str(simulation.status) for simulation in run.swept())
    if as_json:
        session.json(counts)
        return
    session.table("Simulations", ["status", "number"], counts.most_common())
    show_next(session, run, "simulate", study)


SAMPLE, *_AFTER_SIMULATE = (stage_command(name, text) for name, text in GENERATED.items())
STAGE_COMMANDS = (SAMPLE, simulate, *_AFTER_SIMULATE)
"""Commands of the core's stages between the inputs and the report."""


def _simulate_one(
    session: Session, study: "Study", folder: Path, only: str, *, traceback: bool, as_json: bool
) -> None:
    """Simulate one job in this process, and exit with 1 where it failed."""
    from palpate.domain import Status
    from palpate.stages import pipeline

    spot, slash, number = only.rpartition("/")
    if not slash or not number.isdecimal():
        raise StudyError(f"--only {only}: name a spot and a set, such as p1/3")
    if traceback:
        faulthandler.enable(file=2)  # for a solver that ends this process
    found = pipeline.simulate_one(study, folder, session.plugins, spot, int(number))
    if traceback:
        session.stderr.print(str(found.diagnostics.get("traceback", "no traceback")), markup=False)
    if as_json:
        session.json({str(found.status): 1})
    else:
        row = [only, found.status, f"{found.seconds:.3g}", found.message]
        session.table("Simulation", ["job", "status", "seconds", "message"], [row])
    if found.status is not Status.OK:
        raise typer.Exit(1)
