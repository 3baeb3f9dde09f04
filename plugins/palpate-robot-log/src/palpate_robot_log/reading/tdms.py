"""LabVIEW's TDMS, by npTDMS: one stream for each group, and for each length or rate within it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from palpate.api import CurveError, FloatArray
from palpate.delimited import Column, listed
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

TIME = "time"
"""Column of a waveform's time, which the file gives as a start and an increment."""


UNSET = np.datetime64("1904-01-02")
"""LabVIEW counts from 1904-01-01; an earlier start is that of a clock which was not set."""


class _Clock(NamedTuple):
    """Rows of a stream, and the time step and start [s] where they are waveforms."""

    n_rows: int
    step_s: float | None
    start_s: float

    @classmethod
    def of(cls, channel: Any, n_rows: int, origin: np.datetime64 | None) -> Self:  # noqa: ANN401 - npTDMS is untyped
        given = channel.properties
        if (step := given.get("wf_increment")) is None:
            return cls(n_rows, None, 0.0)
        offset, start = float(given.get("wf_start_offset", 0.0)), given.get("wf_start_time")
        if origin is None or start is None or not np.datetime64(start) > UNSET:
            return cls(n_rows, float(step), offset)
        return cls(n_rows, float(step), offset + float(_seconds(np.datetime64(start), origin)))


def read_tdms(path: Path) -> RawLog:
    """Read the channels of numbers and of time stamps, scaled as LabVIEW shows them.

    Units are those of the property ``unit_string``. Waveforms have a column ``time`` [s]. It and time stamps
    are seconds since the earliest stamp of the file, so that streams have one clock. Streams have the
    group's name; it is empty if there is one stream.

    Raises
    ------
    CurveError
        The file is damaged, or holds no numbers.
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
    by_rows: dict[_Clock, dict[str, Column]] = {}
    for channel in group.channels():
        column = _column(channel, origin)
        if column is None:
            passed_over.append(f"{group.name}.{channel.name}")
            continue
        by_rows.setdefault(_Clock.of(channel, column.values.size, origin), {})[channel.name] = column
    names = _names(group.name, list(by_rows))
    for name, (clock, columns) in zip(names, by_rows.items(), strict=True):
        if clock.step_s is not None and TIME not in columns:
            seconds = clock.start_s + clock.step_s * np.arange(clock.n_rows, dtype=np.float64)
            columns[TIME] = Column(name=TIME, values=seconds, unit="s")
        yield Stream(name=name, rows=np.arange(clock.n_rows, dtype=np.int64), columns=columns)


def _names(group: str, clocks: list[_Clock]) -> list[str]:
    """Names of a group's streams, by as much of the clocks as they differ in."""
    parts = [(f"{c.n_rows} rows", f"every {c.step_s} s", f"from {c.start_s} s") for c in clocks]
    named = [[", ".join([group, *each[:n]]) for each in parts] for n in range(4)]
    return next((names for names in named if len(set(names)) == len(clocks)), named[-1])


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
