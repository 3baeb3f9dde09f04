"""``palpate experiment``: measured curves into the run directory."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session, cell, run_folder

if TYPE_CHECKING:
    from palpate.domain import Channel, Curve

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
    rows: list[dict[str, Any]] = [
        {
            "spot": spot,
            "channel": channel,
            "n_points": int(response[channel].abscissa.size),
            "n_presses": n_presses[spot],
            **_extent(response[channel], session.plugins.channels[channel]),
            "largest_std": None if (std := response[channel].std) is None else float(std.max()),
        }
        for spot, response in measured.items()
        for channel in response
    ]
    if as_json:
        session.json(rows)
        return
    heads = ["spot", "channel", "points", "presses", "over", "values", "largest std"]
    session.table("Measured curves", heads, [_cells(row) for row in rows])
    if plots:
        session.note(f"pictures in {folder / 'measured' / 'plots'}")
    session.next(f"sample {study} --out {folder}", f"written to {folder}; ")


def _cells(row: dict[str, Any]) -> list[str]:
    std = row["largest_std"]
    return [
        *(str(row[key]) for key in ("spot", "channel", "n_points", "n_presses", "over")),
        f"{row['least']:.4g} to {row['largest']:.4g} {row['unit']}",
        cell(std) if std is None else f"{std:.2g} {row['unit']}",
    ]


def _extent(curve: "Curve", channel: "Channel") -> dict[str, Any]:
    """Range of a curve in both directions, with units."""
    along, unit = channel.units
    ends = f"{curve.abscissa.min():.4g} to {curve.abscissa.max():.4g} {along}".rstrip()
    least, largest = float(curve.ordinate.min()), float(curve.ordinate.max())
    return {"over": ends, "least": least, "largest": largest, "unit": unit}
