"""Marks of folders and files that palpate made: only those are written over or removed.

A run directory has a marker, ``.palpate-run``. What is to be removed later is listed by name when it
is written, in ``files.json`` next to it. No link is followed to what is removed.
"""

import contextlib
import errno
import json
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from palpate.errors import LedgerError, StudyError, typed
from palpate.run.atomic_files import is_temporary, remove_temporary, write_atomically

MARKER, LISTING = ".palpate-run", "files.json"

_WRITE, _PLACE = "give write permission or name another folder", "another file or a link is there; move it"
_FULL, _CHECK = "no space is left on the disk; make room", "cannot be written or read; check the disk"
_REASONS = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), _FULL),
    **dict.fromkeys((errno.EROFS, errno.EACCES, errno.EPERM), f"cannot be written; {_WRITE}"),
    **dict.fromkeys((errno.EMFILE, errno.ENFILE), "too many files are open; raise the limit (ulimit -n)"),
    **dict.fromkeys((errno.ELOOP, errno.EEXIST, errno.ENOTDIR, errno.EISDIR), f"cannot be written; {_PLACE}"),
    errno.EIO: _CHECK,
}
KEPT = "everything finished before is kept, and `palpate run` goes on from there"


def reason(error: OSError) -> str:
    """Reason why a file cannot be written, and what to do."""
    text = _REASONS.get(error.errno or 0, _CHECK)
    what, _, remedy = text.partition("; ")
    return f"{what} ({error.strerror}); {remedy}"


def is_of_disk(error: OSError) -> bool:
    """Whether the disk or the permissions, and not a mistake in the program, are behind an error."""
    return error.errno in _REASONS


@contextlib.contextmanager
def writing_in(folder: Path) -> Iterator[None]:
    """Turn a full disk, or a folder without write permission, into a LedgerError with path and remedy."""
    try:
        yield
    except OSError as error:
        if not is_of_disk(error):
            raise
        raise LedgerError(f"{error.filename or folder}: {reason(error)}; {KEPT}") from error


def claim(folder: Path) -> None:
    """Make a folder a run directory; a StudyError where it holds something else, or cannot be made."""
    check_claimable(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / MARKER).is_file():
            text = b"palpate made this folder for one run of a study, and writes over its own files in it.\n"
            write_atomically(folder / MARKER, text)
    except OSError as error:
        raise _refusal(folder, error) from None


def check_claimable(folder: Path) -> None:
    """Refuse a folder that is neither missing, empty, nor a run directory."""
    try:
        if is_run(folder) or not folder.exists():
            return
        others = sorted(path.name for path in folder.iterdir() if not is_temporary(path))
    except OSError as error:
        raise _refusal(folder, error) from None
    if others:
        raise StudyError(
            f"{folder}: is not empty and not a run directory of palpate (it holds {', '.join(others[:3])}"
            f"{' …' if others[3:] else ''}); name a new folder with --out"
        )


def _refusal(folder: Path, error: OSError) -> StudyError:
    why = error.strerror
    return StudyError(f"{folder}: cannot be a run directory ({why}); name another folder with --out")


def is_run(folder: Path) -> bool:
    """Whether palpate made a folder: by its marker, or by a manifest where a copy left hidden files out."""
    if (folder / MARKER).is_file():
        return True
    try:
        manifest = json.loads((folder / "manifest.json").read_bytes())
        return bool({"study", "units", "study_file", "n_sets"} <= manifest.keys())
    except (OSError, ValueError, AttributeError, RecursionError):
        return False


def refuse_other(folder: Path, before: Path, now: Path, name: str) -> None:
    """Refuse the run of another study file, which may have the same name, as long as that file is there."""
    try:
        is_other = before.is_file() and now.is_file() and not before.samefile(now)
    except (OSError, ValueError):
        return
    if is_other:
        other = "name another folder with --out"
        if folder.name == name:  # not every command has the option
            other = f"change the name '{name}' under [study]"
        raise StudyError(
            f"{folder}: holds the run of {before.resolve()}, not of {now}; {other}, "
            f"or continue that run with this study: palpate run {typed(folder)} --study {typed(now)}"
        )


def tidy(folder: Path) -> None:
    """Remove what a killed process was writing, in the folders that palpate makes in a run directory."""
    names = ("", "measured", "report", "report/tables", "report/figures")
    for name in names:
        remove_temporary(folder / name)


# ----------------------------------------------------------------- files by name


@contextlib.contextmanager
def drawing_in(folder: Path) -> Iterator[Path]:
    """Make a folder of pictures; those drawn there before are removed, and what is new is listed."""
    folder.mkdir(parents=True, exist_ok=True)
    keep_only(folder, ())
    others = set(folder.rglob("*"))
    try:
        yield folder
    finally:
        keep_only(folder, (path for path in folder.rglob("*") if path.is_file() and path not in others))


def listed(folder: Path) -> set[Path]:
    """Files below ``folder`` that palpate listed as its own; links on the way to them are left out."""
    try:
        names = json.loads((folder / LISTING).read_text(encoding="utf-8"))["files"]
        paths = [PurePosixPath(name) for name in names]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return set()
    return {folder / path for path in paths if _is_inside(folder, path)}


def _is_inside(folder: Path, path: PurePosixPath) -> bool:
    if path.is_absolute() or ".." in path.parts or not path.parts:
        return False
    return not any((folder / parent).is_symlink() for parent in (*path.parents, PurePosixPath()))


def keep_only(folder: Path, files: Iterable[Path]) -> None:
    """Remove what was listed before and is not among these files, and list these."""
    now = set(files)
    for path in listed(folder) - now:
        with contextlib.suppress(IsADirectoryError, PermissionError):
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # of the folders in between those go that are empty now
            for parent in path.relative_to(folder).parents[:-1]:
                (folder / parent).rmdir()
    names = sorted(path.relative_to(folder).as_posix() for path in now)
    write_atomically(folder / LISTING, json.dumps({"files": names}, indent=1).encode() + b"\n")
