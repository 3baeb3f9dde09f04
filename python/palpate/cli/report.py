"""``palpate report``: tables and figures of what a run found."""

from typing import Annotated

import typer

from palpate.cli.options import AsJson, OutFolder, RunPath, Tables, TrustPlugins
from palpate.cli.progress import StageProgress
from palpate.cli.results import check_results, show_report, verdict_json
from palpate.cli.runs import find_run, newest_run, study_of_run
from palpate.cli.session import Session, run_folder


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
    from palpate.run.ownership import is_run
    from palpate.stages import pipeline

    session = Session.of(context)
    if as_run := run is None or (is_run(run) and out in (None, run)):
        folder = find_run(run if run is not None else out)
        session, checked = study_of_run(session, folder, trust=trust_plugins)
    else:
        checked = session.study(run)
        folder = out or newest_run(run) or run_folder(checked, out)
    with StageProgress(session) as progress:
        made = pipeline.report(checked, folder, session.plugins, progress, as_run=as_run)
    if open_page:
        typer.launch(next(file for file in made.files if file.suffix == ".html").resolve().as_uri())
    if as_json:
        session.json(verdict_json(made))
        check_results(made.verdict.without_result)
    else:
        show_report(session, checked, made, progress, tables=tables)
