"""``palpate select``: the best set by scenario and over all spots."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.results import check_results
from palpate.cli.session import Session, run_folder


def select(context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False) -> None:
    """Choose the best set by scenario and over all spots."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        selected = pipeline.select(checked, folder, session.plugins, progress)
    frames = {
        "selection": selected.selection,
        "generalisation": selected.generalisation,
        "refinement": selected.refinement,
        "stiffness_scaling": selected.stiffness_scaling,
        "verification": selected.verification,
    }
    if as_json:
        tables = {name: frame.to_dicts() for name, frame in frames.items()}
        session.json({**tables, "warnings": progress.warnings})
    else:
        for name, frame in frames.items():
            if frame.height:
                session.frame(name.capitalize(), frame)
        session.next(f"report {study} --out {folder}", f"written to {folder}; ")
    check_results(selected.without_result)
