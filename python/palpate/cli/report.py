"""``palpate report``: tables and figures of what a run found."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.results import check_results, show_verdict
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
        verdict = made.verdict
        session.json({"verdict": verdict.sentences, "warnings": verdict.warnings, "files": made.files})
    else:
        for file in made.files:
            session.say(str(file))
        show_verdict(session, made.verdict, made.files)
    check_results(made.verdict.without_result)
