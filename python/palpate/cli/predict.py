"""``palpate predict``: what the fitted limb feels under another tool."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, RunPath, TrustPlugins
from palpate.cli.progress import StageProgress
from palpate.cli.runs import find_run, study_of_run
from palpate.cli.session import Session


def predict(
    context: typer.Context,
    run: RunPath = None,
    tool: Annotated[Path, typer.Option("--tool", metavar="FILE", help="Tool, motion and spots.")] = Path(
        "tool.toml"
    ),
    draws: Annotated[
        int, typer.Option("--draws", min=0, help="Draws of the fitted values to simulate too, for a band.")
    ] = 0,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Predict force, moment, pressure and shear under another tool, with a band and what extrapolates."""
    from palpate.prediction import run_prediction, write_prediction
    from palpate.prediction.files import beyond
    from palpate.run.directory import RunDirectory
    from palpate.study.tool import read_tool

    folder = find_run(run)
    session, study = study_of_run(Session.of(context), folder, trust=trust_plugins)
    given = read_tool(tool, study, session.plugins)
    with StageProgress(session, folder) as progress:
        found = run_prediction(
            study, RunDirectory(folder), given, session.plugins.channels, progress, n_solved=draws
        )
    into = folder / "predictions" / given.name
    notice = "SIMULATED curves, not a real experiment." if study.data == "simulated" else ""
    files = write_prediction(found, session.plugins.channels, notice, into)
    if as_json:
        tables = {"summary": found.summary, "strains": found.strains}
        session.json({name: frame.to_dicts() for name, frame in tables.items()} | {"files": files})
        return
    session.frame("Prediction", found.summary)
    session.say(beyond(found.strains))
    session.labelled("Page", files[-1].resolve().as_uri())
