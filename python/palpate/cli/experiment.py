"""``palpate experiment``: measured curves into the run directory."""

from typing import Annotated

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, cell, run_folder

Plots = Annotated[
    bool, typer.Option("--plots", help="Draw every step from file to curve into measured/plots/.")
]


def experiment(
    context: typer.Context,
    study: StudyPath,
    out: OutFolder = None,
    plots: Plots = False,
    as_json: AsJson = False,
) -> None:
    """Read the measured curves into measured/<spot>.parquet."""
    from palpate import pipeline

    session = Session.of(context)
    checked = session.study(study)
    folder = run_folder(checked, out)
    with StageProgress(session) as progress:
        measured = pipeline.measure(checked, folder, session.plugins, progress, plots=plots)
    n_presses = {spot.spot.name: max(map(len, spot.measured.values())) for spot in checked.spots}
    rows = [
        {
            "spot": spot,
            "channel": channel,
            "n_points": int(response[channel].abscissa.size),
            "n_presses": n_presses[spot],
            "largest_std": None if (std := response[channel].std) is None else float(std.max()),
        }
        for spot, response in measured.items()
        for channel in response
    ]
    if as_json:
        session.json(rows)
        return
    session.table(
        "Measured curves",
        ["spot", "channel", "points", "presses", "largest std"],
        [list(map(cell, row.values())) for row in rows],
    )
    if plots:
        session.note(f"pictures in {folder / 'measured' / 'plots'}")
    session.next(f"sample {study} --out {folder}", f"written to {folder}; ")
