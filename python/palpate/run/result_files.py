"""Results as files: curves as rows of a table, and files that are absent or complete."""

import io
import os
import re
import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import polars as pl

from palpate.domain import Curve, FloatArray, Response

CURVES = pl.Schema(
    {
        "key": pl.String,
        "channel": pl.String,
        "point": pl.Int64,
        "abscissa": pl.Float64,
        "ordinate": pl.Float64,
        "std": pl.Float64,
    }
)
"""Columns of curves of several simulations, by key; a row is a point."""

SLOPE = "d_"
"""What the name of a further column begins with, of slopes in a parameter."""


def curve_rows(responses: Mapping[str, Response]) -> pl.DataFrame:
    """Curves of each key as rows, null where a curve has no std or slopes."""
    curves = [(key, curve) for key, response in responses.items() for curve in response.curves.values()]
    lengths = [curve.abscissa.size for _, curve in curves]

    def repeated(texts: Iterable[str]) -> pl.Series:
        which = pl.Series(np.repeat(np.arange(len(curves)), lengths), dtype=pl.UInt32)
        return pl.Series(texts, dtype=pl.String).gather(which)

    def column(arrays: Iterable[FloatArray | None]) -> pl.Series:
        filled = [np.full(n, np.nan) if a is None else a for a, n in zip(arrays, lengths, strict=True)]
        return pl.Series(np.concatenate([np.empty(0), *filled])).fill_nan(None)

    slopes = dict.fromkeys(name for _, curve in curves for name in curve.slopes)
    return pl.DataFrame(
        {
            "key": repeated(key for key, _ in curves),
            "channel": repeated(curve.channel for _, curve in curves),
            "point": column(np.arange(n, dtype=np.float64) for n in lengths).cast(pl.Int64),
            "abscissa": column(curve.abscissa for _, curve in curves),
            "ordinate": column(curve.ordinate for _, curve in curves),
            "std": column(curve.std for _, curve in curves),
            **{SLOPE + name: column(curve.slopes.get(name) for _, curve in curves) for name in slopes},
        },
        schema_overrides=CURVES,
    )


def frame_of(response: Response) -> pl.DataFrame:
    """Curves as rows of channel, point, abscissa, ordinate and, where any curve has it, std."""
    has_std = any(curve.std is not None for curve in response.curves.values())
    frame = curve_rows({"": response})
    return frame.select("channel", "point", "abscissa", "ordinate", *(["std"] if has_std else []))


def response_of(frame: pl.DataFrame) -> Response:
    """Make curves of rows: the inverse of :func:`frame_of`."""
    return Response(
        curves={
            str(name): Curve(
                channel=str(name),
                abscissa=rows["abscissa"].to_numpy(),
                ordinate=rows["ordinate"].to_numpy(),
                std=rows["std"].to_numpy() if "std" in rows and rows["std"].count() else None,
            )
            for (name,), rows in frame.group_by("channel", maintain_order=True)
        }
    )


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


_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{16}\.palpate")


def remove_temporary(folder: Path) -> None:
    """Remove what a killed process was writing in this very folder; a link to a folder is left alone."""
    if folder.is_symlink() or not folder.is_dir():
        return
    for path in filter(is_temporary, list(folder.iterdir())):
        path.unlink(missing_ok=True)


def is_temporary(path: Path) -> bool:
    """Whether palpate gave a file its name while writing it."""
    return _TEMPORARY.fullmatch(path.name) is not None


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
