"""LabVIEW's TDMS, by npTDMS: one stream for each group, and for each length or rate within it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import CurveError
from palpate.delimited import Column, listed
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

TIME = "time"
"""Column of a waveform's time, which the file gives as a start and an increment."""


def read_tdms(path: Path) -> RawLog:
    """Read the channels of numbers and of time stamps, scaled as LabVIEW shows them.

    Units are those of the property ``unit_string``. Time stamps become seconds since the first row.
    Waveforms have a column ``time`` [s]. Streams have the group's name; it is empty if there is one stream.

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
        for group in file.groups():
            streams.extend(_streams(group, passed_over))
    if not streams:
        raise CurveError(f"{path}: no channels of numbers; export channels of at least two numbers")
    notes = (f"channels without numbers: {listed(passed_over)}",) if passed_over else ()
    if len(streams) == 1:
        streams = [Stream(name="", rows=streams[0].rows, columns=streams[0].columns)]
    return RawLog(source=str(path), format="TDMS", row_word="row", streams=tuple(streams), notes=notes)


def _streams(group: Any, passed_over: list[str]) -> Iterator[Stream]:  # noqa: ANN401 - npTDMS is untyped
    """The channels of a group by their length and time step."""
    by_rows: dict[tuple[int, float | None, float], dict[str, Column]] = {}
    for channel in group.channels():
        column = _column(channel)
        if column is None:
            passed_over.append(f"{group.name}.{channel.name}")
            continue
        step = channel.properties.get("wf_increment")
        offset = float(channel.properties.get("wf_start_offset", 0.0))
        by_rows.setdefault((column.values.size, step, offset), {})[channel.name] = column
    for (n_rows, step, offset), columns in by_rows.items():
        if step is not None and TIME not in columns:
            seconds = offset + float(step) * np.arange(n_rows, dtype=np.float64)
            columns[TIME] = Column(name=TIME, values=seconds, unit="s")
        name = group.name if len(by_rows) == 1 else f"{group.name}, {n_rows} rows"
        yield Stream(name=name, rows=np.arange(n_rows, dtype=np.int64), columns=columns)


def _column(channel: Any) -> Column | None:  # noqa: ANN401 - npTDMS is untyped
    """Numbers of a channel; None where it has none."""
    values = channel[:]
    if values.ndim != 1 or values.size < 2:
        return None
    if values.dtype.kind == "M":
        return Column(
            name=channel.name,
            values=np.asarray(values - values[0], dtype="timedelta64[ns]").astype(np.float64) * 1e-9,
            unit="s",
        )
    if values.dtype.kind not in "fiub" or values.dtype.itemsize > 8:
        return None
    unit = str(channel.properties.get("unit_string", ""))
    return Column(name=channel.name, values=np.asarray(values, dtype=np.float64), unit=unit)
