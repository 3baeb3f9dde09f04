"""Results as files: curves as rows of a table, and files that are absent or complete."""

import io
import os
import re
import secrets
from pathlib import Path

import polars as pl

from palpate.domain import Curve, FloatArray, Response


def frame_of(response: Response) -> pl.DataFrame:
    """Curves as rows of channel, point, abscissa, ordinate and, where any curve has it, std."""
    frame = pl.concat(
        [_rows_of(name, curve) for name, curve in response.curves.items()] or [pl.DataFrame(schema=_CURVES)]
    )
    if all(curve.std is None for curve in response.curves.values()):
        return frame.drop("std")
    return frame


def _rows_of(name: str, curve: Curve) -> pl.DataFrame:
    return pl.DataFrame(
        {
            "channel": [name] * curve.abscissa.size,
            "point": range(curve.abscissa.size),
            "abscissa": curve.abscissa,
            "ordinate": curve.ordinate,
            "std": [None] * curve.abscissa.size if curve.std is None else curve.std,
        },
        schema=_CURVES,
    )


def response_of(frame: pl.DataFrame) -> Response:
    """Make curves of rows: the inverse of :func:`frame_of`."""
    return Response(
        curves={
            str(name): Curve(
                channel=str(name),
                abscissa=rows["abscissa"].to_numpy(),
                ordinate=rows["ordinate"].to_numpy(),
                std=_std(rows),
            )
            for (name,), rows in frame.group_by("channel", maintain_order=True)
        }
    )


def _std(rows: pl.DataFrame) -> FloatArray | None:
    if "std" not in rows.columns or rows["std"].null_count() == rows.height:
        return None
    return rows["std"].to_numpy()


_CURVES = pl.Schema(
    {
        "channel": pl.String,
        "point": pl.Int64,
        "abscissa": pl.Float64,
        "ordinate": pl.Float64,
        "std": pl.Float64,
    }
)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either absent or complete, whatever happens meanwhile, power included."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, content)


def write_whole(path: Path, content: bytes, *, durable: bool = True) -> None:
    """Write a file beside its place and move it there.

    Parameters
    ----------
    path : Path
        In a folder that exists.
    content : bytes
    durable : bool
        Whether to wait until the file, and its name, are on the disk.

    Raises
    ------
    OSError
        Nothing is left behind then.
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


_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{16}\.palpate")


def remove_temporary(folder: Path) -> None:
    """Remove what a killed process was writing in this very folder; a link to a folder is left alone."""
    if folder.is_symlink() or not folder.is_dir():
        return
    for path in list(folder.iterdir()):
        if is_temporary(path.name):
            path.unlink(missing_ok=True)


def is_temporary(name: str) -> bool:
    """Whether a file of this name was being written by palpate."""
    return _TEMPORARY.fullmatch(name) is not None


def _sync_folder(folder: Path) -> None:
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_frame(path: Path, frame: pl.DataFrame) -> None:
    """Write a Parquet file atomically."""
    write_atomically(path, parquet(frame))


def parquet(frame: pl.DataFrame) -> bytes:
    """Content of a Parquet file."""
    buffer = io.BytesIO()
    frame.write_parquet(buffer)
    return buffer.getvalue()
