"""Curves of several simulations in one Parquet file, which anything can read.

A row is a point: ``key`` of the simulation, channel, point, abscissa, ordinate, std.
"""

import io
from collections.abc import Callable, Collection, Iterator, Mapping
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


def pack(responses: Mapping[str, Response]) -> bytes:
    """Content of a Parquet file with the curves of each key."""
    curves = [(key, curve) for key, response in responses.items() for curve in response.curves.values()]
    lengths = [curve.abscissa.size for _, curve in curves]
    columns = {
        "key": pl.Series([key for key, _ in curves], dtype=pl.String),
        "channel": pl.Series([curve.channel for _, curve in curves], dtype=pl.String),
    }
    repeated = pl.Series(np.repeat(np.arange(len(curves)), lengths), dtype=pl.UInt32)
    frame = pl.DataFrame(
        {
            **{name: column.gather(repeated) for name, column in columns.items()},
            "point": pl.Series(_joined([np.arange(n, dtype=np.float64) for n in lengths])).cast(pl.Int64),
            "abscissa": _joined([curve.abscissa for _, curve in curves]),
            "ordinate": _joined([curve.ordinate for _, curve in curves]),
            "std": pl.Series(_joined([_std(curve) for _, curve in curves])).fill_nan(None),
        },
        schema=_SCHEMA,
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
    for key, channel, make in _curves(frame.select(_SCHEMA.names())):
        try:
            curves[key][channel] = make()
        except CurveError as error:
            unusable[key] = error
    return {key: unusable.get(key) or Response(curves=found) for key, found in curves.items()}


def _curves(frame: pl.DataFrame) -> Iterator[tuple[str, str, Callable[[], Curve]]]:
    """Cut the columns where a curve ends, which is much faster than a table for each curve."""
    abscissa, ordinate = frame["abscissa"].to_numpy(), frame["ordinate"].to_numpy()
    std = frame["std"].to_numpy()
    lengths = frame.group_by("key", "channel", maintain_order=True).len()
    end = 0
    for key, channel, length in lengths.iter_rows():
        begin, end = end, end + length
        spread = std[begin:end]
        yield (
            key,
            channel,
            partial(
                Curve,
                channel=channel,
                abscissa=abscissa[begin:end],
                ordinate=ordinate[begin:end],
                std=None if np.isnan(spread).any() else spread,
            ),
        )


def _std(curve: Curve) -> FloatArray:
    return np.full(curve.abscissa.shape, np.nan) if curve.std is None else curve.std


def _joined(arrays: list[FloatArray]) -> FloatArray:
    return np.concatenate(arrays) if arrays else np.empty(0)
