"""Curves of several simulations in one Parquet file, which anything can read.

A row is a point: ``key`` of the simulation, channel, point, abscissa, ordinate, std, and, where a
curve has slopes, a column for each parameter: ``d_`` and its name.
"""

import io
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
import polars as pl

from palpate.domain import Curve, FloatArray, Response
from palpate.errors import CurveError

_SCHEMA = pl.Schema(
    {
        "key": pl.String,
        "channel": pl.String,
        "point": pl.Int64,
        "abscissa": pl.Float64,
        "ordinate": pl.Float64,
        "std": pl.Float64,
    }
)

SLOPE = "d_"
"""What the name of a column of slopes begins with."""


def pack(responses: Mapping[str, Response]) -> bytes:
    """Content of a Parquet file with the curves of each key."""
    curves = [(key, curve) for key, response in responses.items() for curve in response.curves.values()]
    lengths = [curve.abscissa.size for _, curve in curves]
    columns = {
        "key": pl.Series([key for key, _ in curves], dtype=pl.String),
        "channel": pl.Series([curve.channel for _, curve in curves], dtype=pl.String),
    }
    repeated = pl.Series(np.repeat(np.arange(len(curves)), lengths), dtype=pl.UInt32)
    names = dict.fromkeys(name for _, curve in curves for name in curve.slopes)
    slopes = {
        SLOPE + name: _column([curve.slopes.get(name) for _, curve in curves], lengths) for name in names
    }
    frame = pl.DataFrame(
        {
            **{name: column.gather(repeated) for name, column in columns.items()},
            "point": pl.Series(_joined([np.arange(n, dtype=np.float64) for n in lengths])).cast(pl.Int64),
            "abscissa": _joined([curve.abscissa for _, curve in curves]),
            "ordinate": _joined([curve.ordinate for _, curve in curves]),
            "std": _column([curve.std for _, curve in curves], lengths),
            **slopes,
        },
        schema=pl.Schema({**_SCHEMA, **dict.fromkeys(slopes, pl.Float64)}),
    )
    buffer = io.BytesIO()
    frame.write_parquet(buffer)
    return buffer.getvalue()


def unpack(content: bytes, keys: Collection[str]) -> dict[str, Response | CurveError]:
    """Curves of these keys, or why they are none: the inverse of :func:`pack`.

    Raises
    ------
    polars.exceptions.PolarsError
        Not a Parquet file of curves.
    """
    frame = pl.read_parquet(io.BytesIO(content)).filter(pl.col("key").is_in(list(keys)))
    curves: dict[str, dict[str, Curve]] = {key: {} for key in keys}
    unusable: dict[str, CurveError] = {}
    for key, channel, make in _curves(frame.select(*_SCHEMA, f"^{SLOPE}.*$")):
        try:
            curves[key][channel] = make()
        except CurveError as error:
            unusable[key] = error
    return {key: unusable.get(key) or Response(curves=found) for key, found in curves.items()}


def _curves(frame: pl.DataFrame) -> Iterator[tuple[str, str, Callable[[], Curve]]]:
    """Cut the columns where a curve ends, which is much faster than a table for each curve."""
    abscissa, ordinate = frame["abscissa"].to_numpy(), frame["ordinate"].to_numpy()
    std = frame["std"].to_numpy()
    slopes = {c.name.removeprefix(SLOPE): c.to_numpy() for c in frame.iter_columns() if c.name not in _SCHEMA}
    lengths = frame.group_by("key", "channel", maintain_order=True).len()
    end = 0
    for key, channel, length in lengths.iter_rows():
        begin, end = end, end + length
        rows = slice(begin, end)
        yield (
            key,
            channel,
            partial(
                Curve,
                channel=channel,
                abscissa=abscissa[rows],
                ordinate=ordinate[rows],
                std=None if np.isnan(std[rows]).any() else std[rows],
                slopes={n: values[rows] for n, values in slopes.items() if not np.isnan(values[rows]).any()},
            ),
        )


def _column(arrays: Sequence[FloatArray | None], lengths: Sequence[int]) -> pl.Series:
    """Values of all curves, null for a curve without."""
    filled = [np.full(n, np.nan) if a is None else a for a, n in zip(arrays, lengths, strict=True)]
    return pl.Series(_joined(filled), dtype=pl.Float64).fill_nan(None)


def _joined(arrays: list[FloatArray]) -> FloatArray:
    return np.concatenate(arrays) if arrays else np.empty(0)
