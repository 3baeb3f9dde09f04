"""``palpate experiment``: measured curves into the run directory."""

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, run_folder


def experiment(
    context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False
) -> None:
    """Read the measured curves into measured/<spot>.parquet."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        measured = pipeline.measure(checked, folder, session.plugins, progress)
    rows = [
        {"spot": spot, "channel": channel, "n_points": int(response[channel].abscissa.size)}
        for spot, response in measured.items()
        for channel in response
    ]
    if as_json:
        session.json(rows)
        return
    session.table(
        "Measured curves", ["spot", "channel", "points"], [list(map(str, r.values())) for r in rows]
    )
    session.next(f"sample {study} --out {folder}", f"written to {folder}; ")
