"""Parquet: size from the footer first, then the columns of numbers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.domain import FloatArray
from palpate.errors import CurveError
from palpate_experiments.reading.limits import Limits
from palpate_experiments.reading.raw import Column, RawLog, Stream, close_to, listed

if TYPE_CHECKING:
    import polars as pl


def read_parquet(path: Path, limits: Limits, wanted: Sequence[str] | None = None) -> RawLog:
    """Read the columns of numbers and of time stamps; a list of fixed length counts as several.

    Time stamps and durations become seconds, stamps since the first row.

    Raises
    ------
    CurveError
        The file is damaged, too large, or lacks a column.
    """
    import polars as pl

    try:
        schema = pl.read_parquet_schema(path)
        # The path is taken as it stands, not as a pattern of several files.
        n_rows = int(pl.scan_parquet(path, glob=False).select(pl.len()).collect().item())
        names = _wanted(path, schema, wanted)
        width = sum(_width(schema[name]) for name in names)
        limits.check_values(str(path), n_rows * max(width, 1), f"{n_rows} rows of {len(names)} columns")
        frame = pl.scan_parquet(path, glob=False).select(names).collect()
        columns = [column for name in names for column in _columns(path, frame[name])]
    except pl.exceptions.PolarsError as error:
        raise _damaged(path, error) from None
    except pl.exceptions.PanicException as error:
        raise _damaged(path, error) from None
    if n_rows < 2 or not columns:
        raise CurveError(f"{path}: {n_rows} rows and {len(columns)} columns of numbers; export the log anew")
    return RawLog(
        source=str(path),
        format="Parquet",
        row_word="row",
        streams=(
            Stream(
                name="",
                rows=np.arange(n_rows, dtype=np.int64),
                columns={column.name: column for column in columns},
            ),
        ),
        notes=_notes(schema, names, wanted),
    )


def _damaged(path: Path, error: BaseException) -> CurveError:
    first_line = str(error).strip().splitlines()[:1] or [type(error).__name__]
    return CurveError(f"{path}: the Parquet file is damaged or cut off ({first_line[0]}); export it anew")


def _base_name(name: str) -> str:
    return name.split("[", 1)[0]


def _wanted(path: Path, schema: Mapping[str, "pl.DataType"], wanted: Sequence[str] | None) -> list[str]:
    if wanted is None:
        return [name for name, dtype in schema.items() if _width(dtype)]
    names = []
    for name in wanted:
        held = name if name in schema else _base_name(name)
        if held not in schema:
            raise CurveError(
                f"{path}: no column '{name}'{close_to(name, schema)} (columns there: {listed(schema)}); "
                "correct the channel map, or see 'palpate experiment inspect'"
            )
        if not _width(schema[held]):
            raise CurveError(f"{path}: column '{held}' holds {schema[held]} and no numbers; choose another")
        names.append(held)
    return list(dict.fromkeys(names))


def _notes(
    schema: Mapping[str, "pl.DataType"], names: Sequence[str], wanted: Sequence[str] | None
) -> tuple[str, ...]:
    others = [f"{name} ({dtype})" for name, dtype in schema.items() if name not in names]
    return (f"columns passed over: {listed(others)}",) if others and wanted is None else ()


def _width(dtype: "pl.DataType") -> int:
    """Columns of numbers that a column of this type makes."""
    import polars as pl

    if isinstance(dtype, pl.Array):
        inner = dtype.inner
        is_flat = isinstance(inner, pl.DataType) and inner.is_numeric() and len(dtype.shape) == 1
        return dtype.size if is_flat else 0
    if isinstance(dtype, pl.List):
        inner = dtype.inner
        return 16 if isinstance(inner, pl.DataType) and inner.is_numeric() else 0
    return int(dtype.is_numeric() or isinstance(dtype, pl.Datetime | pl.Duration | pl.Boolean))


def _columns(path: Path, series: "pl.Series") -> list[Column]:
    import polars as pl

    if isinstance(series.dtype, pl.List | pl.Array):
        return _spread(path, series)
    if isinstance(series.dtype, pl.Datetime | pl.Duration):
        return [Column(name=series.name, values=_seconds(series), unit="s")]
    return [Column(name=series.name, values=_floats(series))]


def _floats(series: "pl.Series") -> FloatArray:
    import polars as pl

    values: FloatArray = series.cast(pl.Float64).fill_null(float("nan")).to_numpy()
    return values


def _seconds(series: "pl.Series") -> FloatArray:
    """Seconds of a duration, or since the first stamp."""
    import polars as pl

    counts = series.to_physical()
    per_second = {"ns": 1e9, "us": 1e6, "ms": 1e3}[str(getattr(series.dtype, "time_unit", "us"))]
    start = counts.drop_nulls().first() if isinstance(series.dtype, pl.Datetime) else 0
    return _floats(counts - (start or 0)) / per_second


def _spread(path: Path, series: "pl.Series") -> list[Column]:
    """Columns ``name[0]``, ``name[1]`` … of lists that all have one length."""
    import polars as pl

    if isinstance(series.dtype, pl.Array):
        width = series.dtype.size
        lists = series.arr.to_list()
    else:
        lengths = series.list.len().unique().to_list()
        if len(lengths) != 1 or lengths[0] is None or not 0 < int(lengths[0]) <= 16:
            raise CurveError(
                f"{path}: the lists of column '{series.name}' have {len(lengths)} lengths; "
                "give each number its own column"
            )
        width, lists = int(lengths[0]), series
    return [
        Column(name=f"{series.name}[{index}]", values=_floats(lists.list.get(index)))
        for index in range(width)
    ]
