"""``palpate init``: a ready study to start from."""

import shutil
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.demo import DEMO
from palpate.cli.options import AsJson
from palpate.cli.session import Session
from palpate.errors import StudyError


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
        rows = [[name, studies.provider(name), studies[name].summary] for name in studies]
        if as_json:
            session.json([dict(zip(("name", "plugin", "summary"), row, strict=True)) for row in rows])
            return
        session.table("Ready studies", ["name", "plugin", "summary"], rows)
        session.next("init --study NAME FOLDER")
        return
    copy_study(Path(studies[study].directory), folder)
    if as_json:
        session.json({"study": study, "folder": str(folder)})
        return
    session.say(f"{study} copied to {folder}")
    session.next(f"check {folder}")


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
