"""``palpate init``: a ready study to start from."""

import shutil
import tomllib
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson
from palpate.cli.session import Session
from palpate.errors import StudyError

DEMO = "forearm-demo"


def init(
    context: typer.Context,
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help="Folder to make; must be empty or new.")
    ] = None,
    study: Annotated[str, typer.Option("--study", help="Name of a ready study.")] = DEMO,
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
            for name in studies
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
