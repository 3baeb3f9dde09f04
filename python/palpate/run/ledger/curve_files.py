"""Curves of several simulations in one Parquet file, which anything can read.

A row is a point: ``key`` of the simulation, channel, point, abscissa, ordinate, std, and, where a
curve has slopes, a column for each parameter: ``d_`` and its name.
"""

import io
from collections.abc import Collection, Mapping

import numpy as np
import polars as pl

from palpate.domain import Curve, Response
from palpate.errors import CurveError
from palpate.run.result_files import CURVES, SLOPE, curve_rows, parquet


def pack(responses: Mapping[str, Response]) -> bytes:
    """Content of a Parquet file with the curves of each key."""
    return parquet(curve_rows(responses))


def unpack(content: bytes, keys: Collection[str]) -> dict[str, Response | CurveError]:
    """Curves of these keys, or why they are none: the inverse of :func:`pack`.

    Raises
    ------
    polars.exceptions.PolarsError
        Not a Parquet file of curves.
    """
    frame = pl.read_parquet(io.BytesIO(content)).select(*CURVES, f"^{SLOPE}.*$")
    frame = frame.filter(pl.col("key").is_in(list(keys)))
    # Columns are cut where a curve ends, which is much faster than a table for each curve.
    columns = {column.name: column.to_numpy() for column in frame.iter_columns()}
    names = [name for name in columns if name not in CURVES]
    curves: dict[str, dict[str, Curve]] = {key: {} for key in keys}
    unusable: dict[str, CurveError] = {}
    end = 0
    for key, channel, length in frame.group_by("key", "channel", maintain_order=True).len().iter_rows():
        begin, end = end, end + length
        own = {name: columns[name][begin:end] for name in ("abscissa", "ordinate", "std", *names)}
        slopes = {name.removeprefix(SLOPE): own[name] for name in names if not np.isnan(own[name]).any()}
        try:
            curves[key][channel] = Curve(
                channel=channel,
                abscissa=own["abscissa"],
                ordinate=own["ordinate"],
                std=None if np.isnan(own["std"]).any() else own["std"],
                slopes=slopes,
            )
        except CurveError as error:
            unusable[key] = error
    return {key: unusable.get(key) or Response(curves=found) for key, found in curves.items()}
