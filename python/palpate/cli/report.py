"""``palpate report``: tables and figures of what a run found."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, OutFolder, Tables, TrustPlugins
from palpate.cli.progress import StageProgress
from palpate.cli.results import check_results, show_report, verdict_json
from palpate.cli.runs import study_of_run
from palpate.cli.session import Session, run_folder


def report(
    context: typer.Context,
    study: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY|RUN",
            help="A study.toml, the folder that holds one, or a run directory, which needs neither.",
        ),
    ],
    out: OutFolder = None,
    trust_plugins: TrustPlugins = False,
    tables: Tables = False,
    as_json: AsJson = False,
) -> None:
    """Lay the results out as tables and figures under report/."""
    from palpate import pipeline
    from palpate.run.ownership import is_run

    session = Session.of(context)
    if as_run := is_run(study) and out in (None, study):
        folder = study
        session, checked = study_of_run(session, folder, trust=trust_plugins)
    else:
        checked = session.study(study)
        folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        made = pipeline.report(checked, folder, session.plugins, progress, as_run=as_run)
    if as_json:
        session.json(verdict_json(made))
        check_results(made.verdict.without_result)
    else:
        show_report(session, checked, made, progress, tables=tables)
