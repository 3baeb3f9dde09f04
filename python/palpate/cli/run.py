"""``palpate run``: from measured curves to identified parameters."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.results import run_as_json, show_run
from palpate.cli.session import Session, run_folder


def run(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Run every stage of a study; what is already simulated is not simulated again."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        result = pipeline.run_study(checked, folder, session.plugins, progress)
    if as_json:
        session.json(run_as_json(checked, result))
        return
    show_run(session, checked, result)
    session.next(
        f"run {study} --out {folder}", "change the study and run it again; what is simulated is kept; "
    )
