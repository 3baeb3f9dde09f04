"""Files that hold columns with their types: Parquet, by polars, and LabVIEW's TDMS, by npTDMS.

TDMS gives one stream for each group, and for each length or rate within it.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.api import CurveError, FloatArray
from palpate.api.files import Column, close_to, listed
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

if TYPE_CHECKING:
    import polars as pl

TIME = "time"  # column of a waveform's time, which a TDMS file gives as a start and an increment
UNSET = np.datetime64("1904-01-02")
"""LabVIEW counts from 1904-01-01; an earlier start is that of a clock which was not set."""

_LONGEST_LIST = 16


def read_parquet(path: Path, wanted: Sequence[str] | None = None) -> RawLog:
    """Columns of numbers and of time stamps; a list of fixed length counts as several.

    Time stamps and durations become seconds, stamps since the first row.
    """
    import polars as pl

    kinds = (pl.exceptions.PolarsError, pl.exceptions.PanicException)
    with or_damaged(path, "the Parquet file is damaged or cut off", "export it again", kinds):
        schema = pl.read_parquet_schema(path)
        names = [name for name, dtype in schema.items() if _is_numeric(dtype)]
        if wanted is not None:
            held = {name if name in schema else name.split("[", 1)[0]: name for name in wanted}
            for own, name in held.items():
                if own not in schema:
                    raise CurveError(
                        f"{path}: no column '{name}'{close_to(name, schema)} (columns there: "
                        f"{listed(schema)}); correct the channel map, or see 'palpate experiment inspect'"
                    )
                if own not in names:
                    raise CurveError(
                        f"{path}: column '{own}' holds {schema[own]} and no numbers; choose another"
                    )
            names = list(held)
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


def _is_numeric(dtype: "pl.DataType") -> bool:
    """Whether a column of this type gives numbers; a list of numbers gives several."""
    import polars as pl

    if isinstance(dtype, pl.Array | pl.List):
        return isinstance(dtype.inner, pl.DataType) and dtype.inner.is_numeric()
    return dtype.is_numeric() or isinstance(dtype, pl.Datetime | pl.Duration | pl.Boolean)


def _columns(path: Path, series: "pl.Series") -> list[Column]:
    """Column of numbers or of seconds; ``name[0]``, ``name[1]`` … of lists that all have one length."""
    import polars as pl

    def floats(series: "pl.Series") -> FloatArray:
        values: FloatArray = series.cast(pl.Float64).fill_null(float("nan")).to_numpy()
        return values

    name, dtype = series.name, series.dtype
    if isinstance(dtype, pl.List | pl.Array):
        lists = series.cast(pl.List(pl.Float64))
        lengths = lists.list.len().unique().to_list()
        if len(lengths) != 1 or lengths[0] is None or not 0 < int(lengths[0]) <= _LONGEST_LIST:
            raise CurveError(
                f"{path}: the lists of column '{name}' have {len(lengths)} lengths; "
                "give each number its own column"
            )
        indices = range(int(lengths[0]))
        return [Column(name=f"{name}[{index}]", values=floats(lists.list.get(index))) for index in indices]
    if isinstance(dtype, pl.Datetime | pl.Duration):
        # A stamp's own count is since 1970.
        counts = series.to_physical()
        start = counts.drop_nulls().first() if isinstance(dtype, pl.Datetime) else 0
        per_second = {"ns": 1e9, "us": 1e6, "ms": 1e3}[dtype.time_unit or "us"]
        return [Column(name=name, values=floats(counts - (start or 0)) / per_second, unit="s")]
    return [Column(name=name, values=floats(series))]


# --------------------------------------------------------------------------------- TDMS


class _Clock(NamedTuple):
    """Rows of a stream, and the time step and start [s] where they are waveforms."""

    n_rows: int
    step_s: float | None
    start_s: float


def read_tdms(path: Path) -> RawLog:
    """Channels of numbers and of time stamps, scaled as LabVIEW shows them.

    Units are those of the property ``unit_string``. Waveforms have a column ``time`` [s]. It and time stamps
    are seconds since the earliest stamp of the file, so that streams have one clock. Streams have the
    group's name; it is empty if there is one stream.
    """
    try:
        from nptdms import TdmsFile
    except ImportError:
        raise CurveError(
            f"{path}: TDMS files need npTDMS; run: pip install 'palpate-robot-log[tdms]', "
            "or export the file as CSV"
        ) from None
    streams: list[Stream] = []
    passed_over: list[str] = []
    with or_damaged(path, "the TDMS file is damaged or cut off", "export it again"):
        file = TdmsFile.read(path)
        if file.file_status.incomplete_final_segment:
            raise CurveError(f"{path}: the TDMS file is cut off in its last segment; export it again")
        origin = min((s for g in file.groups() for c in g.channels() for s in _stamps(c)), default=None)
        for group in file.groups():
            streams.extend(_streams(group, origin, passed_over))
    if not streams:
        raise CurveError(f"{path}: no channels of numbers; export channels of at least two numbers")
    notes = (f"channels without numbers: {listed(passed_over)}",) if passed_over else ()
    if len(streams) == 1:
        streams = [Stream(name="", rows=streams[0].rows, columns=streams[0].columns)]
    return RawLog(source=str(path), format="TDMS", row_word="row", streams=tuple(streams), notes=notes)


def _stamps(channel: Any) -> Iterator[np.datetime64]:  # noqa: ANN401 - npTDMS is untyped
    """Stamps that a channel starts at; a waveform whose start nobody set has that of LabVIEW's epoch."""
    values, start = channel[:1], channel.properties.get("wf_start_time")
    if values.size and values.dtype.kind == "M":
        yield values[0]
    if start is not None and np.datetime64(start) > UNSET:
        yield np.datetime64(start)


def _seconds(stamps: NDArray[np.datetime64] | np.datetime64, origin: np.datetime64) -> FloatArray:
    since = np.asarray(stamps - origin, dtype="timedelta64[ns]")
    return np.asarray(since.astype(np.float64) * 1e-9)


def _streams(
    group: Any,  # noqa: ANN401 - npTDMS is untyped
    origin: np.datetime64 | None,
    passed_over: list[str],
) -> Iterator[Stream]:
    """The channels of a group by their length, time step and start."""
    by_clock: dict[_Clock, dict[str, Column]] = {}
    for channel in group.channels():
        column = _column(channel, origin)
        if column is None:
            passed_over.append(f"{group.name}.{channel.name}")
            continue
        given = channel.properties
        step, start = given.get("wf_increment"), given.get("wf_start_time")
        clock = _Clock(column.values.size, None, 0.0)
        if step is not None:
            offset = float(given.get("wf_start_offset", 0.0))
            if origin is not None and start is not None and np.datetime64(start) > UNSET:
                offset += float(_seconds(np.datetime64(start), origin))
            clock = _Clock(column.values.size, float(step), offset)
        by_clock.setdefault(clock, {})[channel.name] = column
    # Names have as much of the clocks as they differ in.
    parts = [(f"{c.n_rows} rows", f"every {c.step_s} s", f"from {c.start_s} s") for c in by_clock]
    named = [[", ".join([group.name, *each[:n]]) for each in parts] for n in range(4)]
    names = next((names for names in named if len(set(names)) == len(parts)), named[-1])
    for name, (clock, columns) in zip(names, by_clock.items(), strict=True):
        if clock.step_s is not None and TIME not in columns:
            seconds = clock.start_s + clock.step_s * np.arange(clock.n_rows, dtype=np.float64)
            columns[TIME] = Column(name=TIME, values=seconds, unit="s")
        yield Stream(name=name, rows=np.arange(clock.n_rows, dtype=np.int64), columns=columns)


def _column(channel: Any, origin: np.datetime64 | None) -> Column | None:  # noqa: ANN401 - npTDMS is untyped
    """Numbers of a channel; None where it has none."""
    values = channel[:]
    if values.ndim != 1 or values.size < 2:
        return None
    if values.dtype.kind == "M":
        start = values[0] if origin is None else origin
        return Column(name=channel.name, values=_seconds(values, start), unit="s")
    if values.dtype.kind not in "fiub" or values.dtype.itemsize > 8:
        return None
    unit = str(channel.properties.get("unit_string", ""))
    return Column(name=channel.name, values=np.asarray(values, dtype=np.float64), unit=unit)
