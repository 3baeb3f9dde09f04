"""Files that are absent or complete, whatever happens while they are written."""

import os
import re
import secrets
from pathlib import Path


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either absent or complete, whatever happens meanwhile, power included."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)


def write_whole(path: Path, content: bytes, *, durable: bool = True) -> None:
    """Write a file under another name in its folder, which exists, and move it there.

    With ``durable``, wait until the file and its name are on the disk. An OSError leaves nothing behind.
    """
    part = path.with_name(temporary_name(path.name))
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    try:
        with open(os.open(part, flags, 0o666), "wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(part, path)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    if durable:
        _sync_folder(path.parent)


def temporary_name(name: str) -> str:
    """Name of a file while it is written: nobody can guess it, and it shows who wrote it."""
    return f".{name}.{secrets.token_hex(8)}.palpate"


def remove_temporary(folder: Path) -> None:
    """Remove what a killed process was writing in this very folder; a link to a folder is left alone."""
    if folder.is_symlink() or not folder.is_dir():
        return
    for path in filter(is_temporary, list(folder.iterdir())):
        path.unlink(missing_ok=True)


def is_temporary(path: Path) -> bool:
    """Whether palpate gave a file its name while writing it."""
    return re.fullmatch(r"\..+\.[0-9a-f]{16}\.palpate", path.name) is not None


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
