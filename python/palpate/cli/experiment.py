"""``palpate experiment``: measured curves into the run directory."""

from typing import Annotated, Any

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import opened

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
    from palpate.stages import pipeline

    session, checked, folder = opened(context, study, out)
    with StageProgress(session) as progress:
        measured = pipeline.measure(checked, folder, session.plugins, progress, plots=plots)
    rows: list[dict[str, Any]] = []
    for spot in checked.spots:
        n_presses = max(map(len, spot.measured.values()))
        for name, curve in measured[spot.spot.name].curves.items():
            along, unit = session.plugins.channels[name].units
            row = {
                "spot": spot.spot.name,
                "channel": name,
                "n_points": curve.abscissa.size,
                "n_presses": n_presses,
                "over": f"{curve.abscissa.min():.4g} to {curve.abscissa.max():.4g} {along}".rstrip(),
                "least": float(curve.ordinate.min()),
                "largest": float(curve.ordinate.max()),
                "unit": unit,
                "largest_std": None if curve.std is None else float(curve.std.max()),
            }
            rows.append(row)
    if as_json:
        session.json(rows)
        return
    cells = [
        [
            *(row[key] for key in ("spot", "channel", "n_points", "n_presses", "over")),
            f"{row['least']:.4g} to {row['largest']:.4g} {row['unit']}",
            None if row["largest_std"] is None else f"{row['largest_std']:.2g} {row['unit']}",
        ]
        for row in rows
    ]
    heads = ["spot", "channel", "points", "presses", "over", "values", "largest std"]
    session.table("Measured curves", heads, cells)
    if plots:
        session.note(f"pictures in {folder / 'measured' / 'plots'}")
    session.next(f"sample {study} --out {folder}", f"written to {folder}; ")
