"""``palpate synthesise``: the curves that a study's truth would give."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session


def synthesise(
    context: typer.Context,
    study: StudyPath,
    out: Annotated[
        Path | None,
        typer.Option("--into", metavar="FOLDER", help="Instead of the study's folder; file names stay."),
    ] = None,
    noise: Annotated[
        float, typer.Option(help="Standard deviation of noise, as a share of each curve's largest value.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 1,
    as_json: AsJson = False,
) -> None:
    """Simulate a study's [truth] and write it as measured curves, to plan an experiment.

    Before anyone touches a limb: write a study with the limb's mesh, the protocol, a guess of
    the tissue under [truth] and data = "simulated". This command simulates the truth at each
    spot, with the study's solver, into the files that the study names as measured; they need
    not exist before. `palpate run` then shows which parameters the planned channels identify.

    The curves come from the same model that will be fitted to them, so a good fit says that the
    parameters can be identified, not that the model is right. --noise makes it harder. Nothing
    is overwritten; origin.json next to the curves records how they were made.
    """
    from palpate.simulation.synthesis import synthesise as write_curves

    session = Session.of(context)
    planned = session.study(study, need_measured=False)
    with StageProgress(session) as progress:
        made = write_curves(planned, session.plugins.channels, out, noise=noise, seed=seed, progress=progress)
    if as_json:
        session.json({"study": planned.name, "files": [str(file) for file in made.files]})
        return
    rows = [
        [spot, name, str(y.size), f"{y.min():.6g}", f"{y.max():.6g}"]
        for spot, response in made.responses.items()
        for name, y in ((name, curve.ordinate) for name, curve in response.curves.items())
    ]
    session.table("Simulated curves", ["spot", "channel", "points", "least", "largest"], rows)
    for file in made.files:
        session.say(str(file))
    session.next(f"check {study}" if out is None else "check STUDY, once the study names these files")
