"""``palpate report``: tables and figures of what a run found."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, run_folder


def report(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Lay the results out as tables and figures under report/."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        made = pipeline.report(checked, folder, session.plugins, progress)
    if as_json:
        session.json({"files": made.files})
        return
    for file in made.files:
        session.say(str(file))
