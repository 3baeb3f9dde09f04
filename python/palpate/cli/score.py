"""``palpate score``: simulated against measured curves."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, run_folder


def score(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Compare simulated with measured curves into scores.parquet."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        scores = pipeline.score(checked, folder, session.plugins, progress)
    if as_json:
        session.json({"scores": scores.to_dicts(), "warnings": progress.warnings})
        return
    session.frame("Scores", scores)
    session.next(f"select {study} --out {folder}", f"written to {folder}; ")
