"""``palpate report`` and ``palpate compare``: tables and figures of one run, or of several."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.api import StudyError
from palpate.api.cli import (
    AsJson,
    OutFolder,
    RunPath,
    Session,
    StageProgress,
    Tables,
    TrustPlugins,
    find_run,
    newest_run,
    run_folder,
    show_summary,
    study_of_run,
)


def report(
    context: typer.Context,
    run: RunPath = None,
    out: OutFolder = None,
    trust_plugins: TrustPlugins = False,
    tables: Tables = False,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    as_json: AsJson = False,
) -> None:
    """Lay the results out as tables and figures under report/, also while the run goes on.

    A run directory needs nothing besides it. A study is compared with the run: its files must be there.
    """
    from palpate.api.runs import is_run
    from palpate_report import from_run
    from palpate_report.stage import ReportOutput, summary_of

    session = Session.of(context)
    if as_run := run is None or (is_run(run) and out in (None, run)):
        folder = find_run(run if run is not None else out)
        session, checked = study_of_run(session, folder, trust=trust_plugins)
    else:
        checked = session.study(run)
        folder = out or newest_run(run) or run_folder(checked, out)
    with StageProgress(session) as progress:
        made = from_run.report(checked, folder, session.plugins, progress, as_run=as_run)
    if open_page:
        typer.launch(next(file for file in made.files if file.suffix == ".html").resolve().as_uri())
    summary = summary_of(checked, made)
    values = {name: summary.values[name] for name in ReportOutput.__annotations__} if as_json else None
    show_summary(session, summary, progress, tables=tables, values=values)


def compare(
    context: typer.Context,
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN RUN…", help="Run directories, or studies for their newest runs."),
    ],
    into: Annotated[
        Path, typer.Option("--into", metavar="FOLDER", help="Where the page, tables and figure go.")
    ] = Path("comparison"),
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Compare materials or limbs: parameters, intervals, curves, information criteria."""
    from palpate_report import comparison, from_run

    session = Session.of(context)
    folders = list(dict.fromkeys(find_run(run) for run in runs))
    if len(folders) < 2:
        raise StudyError("one run is nothing to compare; name two or more: palpate compare RUN RUN")
    found = {}
    with StageProgress(session) as progress:
        for folder in folders:
            own, study = study_of_run(session, folder, trust=trust_plugins)
            found[folder] = from_run.read_results(study, folder, own.plugins, progress)
    made = comparison.write_comparison(comparison.named(found), into)
    if as_json:
        tables = {name: table.to_dicts() for name, table in made["tables"].items()}
        session.json({**made, "tables": tables})
        return
    for name, table in made["tables"].items():
        session.frame(name.capitalize(), table)
    for note in made["notes"]:
        session.paragraph(note)
    session.say(f"Page: {(into / 'index.html').resolve().as_uri()}")
