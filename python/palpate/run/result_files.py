"""Results as files: curves as rows of a table."""

import io
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from palpate.domain import Curve, FloatArray, Response
from palpate.domain.surface import SurfaceStates
from palpate.errors import MeshError
from palpate.run.atomic_files import write_atomically

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

Files = Mapping[str, pl.DataFrame | Mapping[str, Any] | Path]
"""Results of a stage by name: a table is the file ``<name>.parquet``, plain values are ``<name>.json``, and a
path is that of a file which is written already."""

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
    """Curves as rows of channel, point, abscissa, ordinate and, where any curve has them, std and time_s."""
    curves = response.curves.values()
    known = [name for name in ("std", "time_s") if any(getattr(c, name) is not None for c in curves)]
    times = [np.full(c.abscissa.size, np.nan) if c.time_s is None else c.time_s for c in curves]
    time_s = pl.Series("time_s", np.concatenate([np.empty(0), *times])).fill_nan(None)
    frame = curve_rows({"": response}).with_columns(time_s)
    return frame.select("channel", "point", "abscissa", "ordinate", *known)


def response_of(frame: pl.DataFrame) -> Response:
    """Make curves of rows: the inverse of :func:`frame_of`."""

    def known(rows: pl.DataFrame, name: str) -> FloatArray | None:
        return rows[name].to_numpy() if name in rows and rows[name].count() else None

    return Response(
        curves={
            str(name): Curve(
                channel=str(name),
                abscissa=rows["abscissa"].to_numpy(),
                ordinate=rows["ordinate"].to_numpy(),
                std=known(rows, "std"),
                time_s=known(rows, "time_s"),
            )
            for (name,), rows in frame.group_by("channel", maintain_order=True)
        }
    )


def parquet(frame: pl.DataFrame) -> bytes:
    """Content of a Parquet file."""
    buffer = io.BytesIO()
    frame.write_parquet(buffer)
    return buffer.getvalue()


FOLDER = "surface"


def surface_path(folder: Path, key: str) -> Path:
    """File of a simulation in a run directory."""
    return folder / FOLDER / f"{key}.npz"


def write_surface(path: Path, states: SurfaceStates) -> None:
    """Write states of the skin; an OSError leaves nothing behind."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **states.compact())
    write_atomically(path, buffer.getvalue())


def read_surface(path: Path) -> SurfaceStates | None:
    """States of the skin as they were written; None where the file is missing or damaged."""
    try:
        with np.load(io.BytesIO(path.read_bytes())) as arrays:
            return SurfaceStates(**{each.name: arrays[each.name] for each in fields(SurfaceStates)})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, MeshError):
        return None
