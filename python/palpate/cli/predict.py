"""``palpate predict``: what the fitted limb feels under another tool."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options import AsJson, RunPath, TrustPlugins
from palpate.cli.progress import StageProgress
from palpate.cli.runs import find_run, study_of_run
from palpate.cli.session import Session

if TYPE_CHECKING:
    from palpate.cli.output import PredictOutput
    from palpate_prediction import Prediction


def predict(
    context: typer.Context,
    tool: Annotated[Path, typer.Option("--tool", metavar="FILE", help="Tool, motion and spots.")],
    run: RunPath = None,
    draws: Annotated[
        int, typer.Option("--draws", min=0, help="Draws of the fitted values to simulate too, for a band.")
    ] = 0,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Predict force, moment, pressure and shear under another tool, with a band and what extrapolates."""
    from palpate.run.directory import RunDirectory
    from palpate.study.tool import read_tool
    from palpate_prediction import run_prediction, write_prediction
    from palpate_prediction.files import notes

    folder = find_run(run)
    session, study = study_of_run(Session.of(context), folder, trust=trust_plugins)
    given = read_tool(tool, study, session.plugins)
    with StageProgress(session, folder) as progress:
        found = run_prediction(study, RunDirectory(folder), given, session.plugins, progress, n_solved=draws)
    into = folder / "predictions" / given.name
    notice = "SIMULATED curves, not a real experiment." if study.data == "simulated" else ""
    files = write_prediction(found, session.plugins.channels, notice, into)
    if as_json:
        session.json(_output(found, notice, files))
        return
    session.frame("Prediction", found.summary)
    for text in notes(found, notice):
        session.say(text)
    session.labelled("Page", files[-1].resolve().as_uri())


def _output(found: "Prediction", notice: str, files: Sequence[Path]) -> "PredictOutput":
    from palpate_prediction.files import notes

    return {
        "source": found.fitted.source,
        "scenario": found.fitted.scenario,
        "n_draws": found.n_draws,
        "notes": notes(found, notice),
        "summary": found.summary.to_dicts(),
        "strains": found.strains.to_dicts(),
        "files": [str(path) for path in files],
    }
