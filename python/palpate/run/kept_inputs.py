"""Copies of a study and of the files that it names, in its run, which can be moved without them."""

import os
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from palpate.run.atomic_files import write_atomically
from palpate.study.reading import Study

FOLDER, PLUGINS = "inputs", "plugins"

MOST_BYTES = 64_000_000
"""Larger files are not kept: those of a log that recorded more than the press."""


def is_kept(run: Path, file: Path) -> bool:
    """Whether a file is one of the copies that a run keeps."""
    return file.resolve().is_relative_to((run / FOLDER).resolve())


def keep_inputs(run: Path, study: Study) -> str:
    """Place of the kept study file, relative to the run; the files around it keep their places.

    Kept are the study file, files that it names, and those next to a mesh with the same name. Nothing is
    copied where the study is the kept one. Empty where there is no study file.
    """
    if is_kept(run, study.file):
        return study.file.resolve().relative_to(run.resolve()).as_posix()
    # Not resolved: a link is found by its own name, next to what it is named with.
    file, into = _absolute(study.file), run / FOLDER
    if not file.is_file():
        return ""
    named = {file, *_named(file)}
    root = Path(os.path.commonpath([path.parent for path in named]))
    places = {path: into / path.relative_to(root) for path in named}
    for number, path in enumerate(study.plugin_files):
        places.setdefault(_absolute(path), kept_plugin(run, number, path))
    for path, kept in places.items():
        if path.is_file() and path.stat().st_size <= MOST_BYTES:
            content = path.read_bytes()
            if not (kept.is_file() and kept.read_bytes() == content):
                write_atomically(kept, content)
    return (Path(FOLDER) / file.relative_to(root)).as_posix()


def kept_study(run: Path, manifest: Mapping[str, Any]) -> Path | None:
    """Kept study file of a run; None in a run without one."""
    kept = manifest.get("kept_study", "")
    return run / kept if kept and (run / kept).is_file() else None


def study_file(run: Path, manifest: Mapping[str, Any]) -> Path:
    """Study file that a run was made from; where it is gone, the copy that the run keeps, if there is one."""
    file: Path = run / manifest["study_file"]
    return file if file.is_file() else kept_study(run, manifest) or file


def kept_plugin(run: Path, number: int, file: Path) -> Path:
    """Copy that a run keeps of a plugin file which its study does not name; it need not exist.

    Plugin files of several folders may have one name, so their numbers in the manifest tell them apart.
    """
    return run / FOLDER / PLUGINS / str(number) / file.name


def _named(file: Path) -> Iterator[Path]:
    """Files that a study file names, and those that lie next to one with the same stem."""
    for text in _texts(tomllib.loads(file.read_text(encoding="utf-8-sig"))):
        try:
            path = _absolute(file.parent / text)
            if text and not Path(text).is_absolute() and path.is_file():
                siblings = path.parent.iterdir()
                yield from (each for each in siblings if each.stem == path.stem and each.is_file())
        except (OSError, ValueError):  # a text that is no file name
            continue


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))


def _texts(value: object) -> Iterator[str]:
    """Every text in a tree of tables and lists."""
    match value:
        case str():
            yield value
        case dict():
            for item in value.values():
                yield from _texts(item)
        case list():
            for item in value:
                yield from _texts(item)
