"""``palpate init`` and ``palpate synthesise``: a study to start from, and simulated measurements of one."""

import shutil
import tomllib
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, StudyPath
from palpate.cli.progress import StageProgress
from palpate.cli.session import Session
from palpate.errors import StudyError

FIRST = "first-press"
"""The ready study that is copied where none is named."""


def init(
    context: typer.Context,
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help="Folder to make; must be empty or new.")
    ] = None,
    study: Annotated[str, typer.Option("--study", help="Name of a ready study.")] = FIRST,
    as_json: AsJson = False,
) -> None:
    """Copy a ready study into FOLDER; without FOLDER, list the ready studies."""
    session = Session.of(context)
    studies = session.plugins.studies
    if folder is None:
        rows = [
            {
                "name": name,
                "plugin": studies.provider(name),
                "simulations": n_simulations(Path(studies[name].directory)),
                "summary": studies[name].summary,
            }
            for name in sorted(studies, key=lambda name: name != FIRST)
        ]
        if as_json:
            session.json(rows)
            return
        shown = ("name", "simulations", "summary")
        session.table("Ready studies", shown, [[row[key] for key in shown] for row in rows])
        session.next("init --study NAME FOLDER")
        return
    copy_study(Path(studies[study].directory), folder)
    if as_json:
        session.json({"study": study, "folder": str(folder)})
        return
    session.say(f"{study} copied to {folder}")
    session.next(f"check {folder}")


def n_simulations(folder: Path) -> int | None:
    """Simulations of a ready study before the filters; None where its file does not say."""
    try:
        raw = tomllib.loads((folder / "study.toml").read_text(encoding="utf-8"))
        return len(raw["spot"]) * int(raw["sampling"]["n_sets"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def copy_study(source: Path, folder: Path) -> None:
    """Copy a template into a folder that is new or empty.

    Raises
    ------
    StudyError
        The folder holds something, is a file, or cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{folder}: is a file; name a new folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise StudyError(f"{folder}: is not empty; name a new folder, nothing is overwritten")
    try:
        shutil.copytree(source, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    except OSError as error:
        raise StudyError(f"{folder}: cannot be written ({error}); name another folder") from error


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
