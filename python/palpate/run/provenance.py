"""Origins of each stage's files, and their checksums: ``stages.json``.

::

    {"score": {"made_from": {"normaliser": "4f…", "results of `palpate sample`": "a0…"},
               "files": {"scores.parquet": "<SHA-256>"}}}

A stage reads the files of earlier stages only as they were written, and only where they were made from
what the study has now.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import polars as pl

from palpate.domain.component import Component
from palpate.errors import StudyError, typed
from palpate.executors.answers import plain
from palpate.run.atomic_files import write_atomically
from palpate.run.keys import identity
from palpate.study.reading import Study

_T = TypeVar("_T")


class StageRecords:
    """Records of the stages of one run directory."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / "stages.json"

    def write(self, stage: str, files: Iterable[Path], made_from: Mapping[str, str]) -> None:
        """Record the files of a stage, as they are now, and what they were made from."""
        sums = {path.relative_to(self.folder).as_posix(): sha256(path.read_bytes()) for path in files}
        every = self._read() | {stage: {"made_from": dict(made_from), "files": sums}}
        write_atomically(self.path, json.dumps(every, indent=1).encode() + b"\n")

    def forget(self, stage: str) -> None:
        """Remove the files of a stage, and their record."""
        files = [self.folder / name for name in self._files(stage)]
        others = {name: entry for name, entry in self._read().items() if name != stage}
        write_atomically(self.path, json.dumps(others, indent=1).encode() + b"\n")
        for file in files:
            file.unlink(missing_ok=True)

    def has(self, stage: str) -> bool:
        """True if a stage has been run."""
        return stage in self._read()

    @property
    def is_going_on(self) -> bool:
        """True if a whole run has begun here and not ended, whether a process runs it or not."""
        return self.has("whole run")

    def writer(self, path: Path) -> str:
        """Stage that wrote a file last; empty where none is on record."""
        name = self._name(path)
        return next(
            (stage for stage, entry in self._read().items() if name in _table(entry.get("files"))), ""
        )

    def read(self, stage: str, path: Path, parse: Callable[[bytes], _T]) -> _T:
        """Read a file of a stage; a StudyError where it is missing, or not as the stage wrote it."""
        again, out = f"run `palpate {stage}` again", typed(self.folder)
        if not path.exists():
            raise StudyError(f"{path}: not there yet; run `palpate {stage} STUDY --out {out}` first")
        try:
            content = path.read_bytes()
            if self._files(stage).get(self._name(path)) != sha256(content):
                raise StudyError(f"{path}: damaged or replaced, it is not as {self.path} records it; {again}")
            return parse(content)
        except StudyError:
            raise
        except (OSError, ValueError, TypeError, KeyError, RecursionError, pl.exceptions.PolarsError) as error:
            raise StudyError(f"{path}: cannot be read ({error}); {again}") from error

    def refuse_missing(self, stage: str, table: str, command: str) -> None:
        """Raise a StudyError: a stage has no record of its table, which ``palpate COMMAND`` makes."""
        folder, out = self.folder / table, typed(self.folder)  # the first is of measured curves
        file = self.folder / f"{table}.parquet"
        if file.exists() or folder.exists():
            raise StudyError(
                f"{file if file.exists() else folder}: damaged or replaced, {self.path} has no record of it; "
                f"run `palpate {stage}` again"
            )
        raise StudyError(f"{folder}: not there yet; run `palpate {command} STUDY --out {out}` first")

    def check(self, stage: str, made_from: Mapping[str, str]) -> None:
        """Refuse the files of a stage that were made from something else; an empty value is not compared."""
        recorded = self._entry(stage).get("made_from", {})
        other = [name for name, value in made_from.items() if value and recorded.get(name) != value]
        other += [name for name in recorded if name not in made_from]
        if other:
            raise StudyError(
                f"{self.folder}: the results of `palpate {stage}` were made before a change of "
                f"{', '.join(other)}; run `palpate run {typed(self.folder)}` again"
            )

    def is_current(self, stage: str) -> bool:
        """True if a stage has been run, and none of those that it needs has changed its files since."""
        recorded, every = self._entry(stage).get("made_from"), self._read()
        return recorded is not None and all(
            recorded.get(f"results of `palpate {need}`", now) == now
            for need in every
            if (now := self.fingerprint(need))
        )

    def fingerprint(self, stage: str) -> str:
        """Hash of the files that a stage wrote."""
        return fingerprint(self._files(stage))

    def _files(self, stage: str) -> dict[str, Any]:
        return _table(self._entry(stage).get("files"))

    def _entry(self, stage: str) -> dict[str, Any]:
        return _table(self._read().get(stage))

    def _read(self) -> dict[str, Any]:
        """Every record; none where the file is damaged, so that each stage has to be run again."""
        try:
            return _table(json.loads(self.path.read_bytes()))
        except (OSError, ValueError, RecursionError):
            return {}

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def _table(content: Any) -> dict[str, Any]:  # noqa: ANN401 - whatever the file holds
    return content if isinstance(content, dict) else {}


def fingerprint(value: object) -> str:
    """Short hash of plain values."""
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True).encode()).hexdigest()[:16]


def described(component: Component, study: Study | None = None) -> tuple[str, object, str]:
    """Name, settings and code of a component; of a material, the earlier code that a study accepts."""
    earlier = study.trusted.get(f"material:{component.name}") if study else None
    return component.name, component.settings.model_dump(mode="json"), earlier or identity(component)


def sha256(content: bytes) -> str:
    """Checksum of a file's content."""
    return hashlib.sha256(content).hexdigest()
