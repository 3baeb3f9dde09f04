"""Parquet, by polars: the columns of numbers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.api import CurveError, FloatArray
from palpate.delimited import Column, close_to, listed
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

if TYPE_CHECKING:
    import polars as pl

_LONGEST_LIST = 16


def read_parquet(path: Path, wanted: Sequence[str] | None = None) -> RawLog:
    """Read the columns of numbers and of time stamps; a list of fixed length counts as several.

    Time stamps and durations become seconds, stamps since the first row.

    Raises
    ------
    CurveError
        The file is damaged, or lacks a column.
    """
    import polars as pl

    kinds = (pl.exceptions.PolarsError, pl.exceptions.PanicException)
    with or_damaged(path, "the Parquet file is damaged or cut off", "export it again", kinds):
        schema = pl.read_parquet_schema(path)
        names = _wanted(path, schema, wanted)
        # The path is taken as it is, not as a pattern of several files.
        frame = pl.read_parquet(path, columns=names, glob=False)
        columns = [column for name in names for column in _columns(path, frame[name])]
    if frame.height < 2 or not columns:
        raise CurveError(
            f"{path}: {frame.height} rows and {len(columns)} columns of numbers; export the log again"
        )
    others = [f"{name} ({dtype})" for name, dtype in schema.items() if name not in names]
    rows = np.arange(frame.height, dtype=np.int64)
    stream = Stream(name="", rows=rows, columns={column.name: column for column in columns})
    return RawLog(
        source=str(path),
        format="Parquet",
        row_word="row",
        streams=(stream,),
        notes=(f"columns passed over: {listed(others)}",) if others and wanted is None else (),
    )


def _wanted(path: Path, schema: Mapping[str, "pl.DataType"], wanted: Sequence[str] | None) -> list[str]:
    if wanted is None:
        return [name for name, dtype in schema.items() if _is_numeric(dtype)]
    names = []
    for name in wanted:
        held = name if name in schema else name.split("[", 1)[0]
        if held not in schema:
            raise CurveError(
                f"{path}: no column '{name}'{close_to(name, schema)} (columns there: {listed(schema)}); "
                "correct the channel map, or see 'palpate experiment inspect'"
            )
        if not _is_numeric(schema[held]):
            raise CurveError(f"{path}: column '{held}' holds {schema[held]} and no numbers; choose another")
        names.append(held)
    return list(dict.fromkeys(names))


def _is_numeric(dtype: "pl.DataType") -> bool:
    """Whether a column of this type gives numbers; a list of numbers gives several."""
    import polars as pl

    if isinstance(dtype, pl.Array | pl.List):
        return isinstance(dtype.inner, pl.DataType) and dtype.inner.is_numeric()
    return dtype.is_numeric() or isinstance(dtype, pl.Datetime | pl.Duration | pl.Boolean)


def _columns(path: Path, series: "pl.Series") -> list[Column]:
    """Column of numbers or of seconds; ``name[0]``, ``name[1]`` … of lists that all have one length."""
    import polars as pl

    name, dtype = series.name, series.dtype
    if isinstance(dtype, pl.List | pl.Array):
        lists = series.cast(pl.List(pl.Float64))
        lengths = lists.list.len().unique().to_list()
        if len(lengths) != 1 or lengths[0] is None or not 0 < int(lengths[0]) <= _LONGEST_LIST:
            raise CurveError(
                f"{path}: the lists of column '{name}' have {len(lengths)} lengths; "
                "give each number its own column"
            )
        return [
            Column(name=f"{name}[{index}]", values=_floats(lists.list.get(index)))
            for index in range(int(lengths[0]))
        ]
    if isinstance(dtype, pl.Datetime | pl.Duration):
        # A stamp's own count is since 1970.
        counts = series.to_physical()
        start = counts.drop_nulls().first() if isinstance(dtype, pl.Datetime) else 0
        per_second = {"ns": 1e9, "us": 1e6, "ms": 1e3}[dtype.time_unit or "us"]
        return [Column(name=name, values=_floats(counts - (start or 0)) / per_second, unit="s")]
    return [Column(name=name, values=_floats(series))]


def _floats(series: "pl.Series") -> FloatArray:
    import polars as pl

    values: FloatArray = series.cast(pl.Float64).fill_null(float("nan")).to_numpy()
    return values
