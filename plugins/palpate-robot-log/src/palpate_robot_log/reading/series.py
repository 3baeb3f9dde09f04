"""A part of a log that shares its time: columns picked by the map, in the recording's units."""

from dataclasses import dataclass, replace

import numpy as np

from palpate.api import BoolArray, CurveError, FloatArray, IntArray
from palpate.delimited import BASE_UNITS, UNITS, Kind, factor_to_base, unit_in
from palpate_robot_log.reading.channel_map import NO_COLUMN, ChannelMap, Orientation, Vector, bare
from palpate_robot_log.reading.raw import RawLog, Stream


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """Values over their own time.

    Parameters
    ----------
    source : str
        The file, for messages.
    what : str
        position, orientation, force or moment.
    names : tuple of str
        Columns, for messages.
    stream : str
    row_word : str
    time_s : (n,) array
    values : (n, k) array
    rows : (n,) array of int
    units : tuple of str
        Unit of time and of the values in the file.
    """

    source: str
    what: str
    names: tuple[str, ...]
    stream: str
    row_word: str
    time_s: FloatArray
    values: FloatArray
    rows: IntArray
    units: tuple[str, str]

    def at(self, index: int) -> str:
        """Row and time stamp, for messages."""
        return f"{self.row_word} {int(self.rows[index])} (t = {self.time_s[index]:.4f} s)"

    def fault(self, message: str, index: int | None = None, column: int | None = None) -> CurveError:
        """Error that names file, stream, row, time stamp and column."""
        where = [f"stream '{self.stream}'"] if self.stream else []
        where += [] if index is None else [self.at(index)]
        where += [self.what] if column is None else [self.what, f"column '{self.names[column]}'"]
        return CurveError(f"{self.source}: {', '.join(where)}: {message}")

    def part(self, kept: BoolArray) -> "Series":
        """Only some rows."""
        return replace(self, time_s=self.time_s[kept], values=self.values[kept], rows=self.rows[kept])


def pick(log: RawLog, channels: ChannelMap, what: str, kind: Kind | None) -> Series:
    """Columns of one quantity and their time, converted to the recording's units.

    Parameters
    ----------
    log : RawLog
    channels : ChannelMap
    what : str
        position, orientation, force or moment.
    kind : Kind, optional
        What the columns measure; None for plain numbers.

    Raises
    ------
    CurveError
        A column is missing, its unit is unknown or of another kind, or a row lacks a value.
    """
    source: Vector | Orientation = getattr(channels, what)
    time_name = source.time or channels.time.column
    real = [bare(name) for name in source.columns if name != NO_COLUMN]
    stream = log.stream_of([time_name, *real], source.stream)
    time_factor, time_unit = _factor(log, channels, stream, time_name, channels.time.unit, "time")
    time = stream.columns[time_name].values
    # Column after column in memory: what is done to each axis of a long log takes a tenth of the time.
    table = np.zeros((len(source.columns), stream.rows.size)).T
    units = []
    for index, name in enumerate(source.columns):
        if name != NO_COLUMN:
            factor, unit = _factor(log, channels, stream, bare(name), source.unit, kind)
            sign = -1.0 if name.startswith("-") else 1.0
            np.multiply(stream.columns[bare(name)].values, sign * factor, out=table[:, index])
            units.append(unit)
    series = Series(
        source=log.source,
        what=what,
        names=tuple(source.columns),
        stream=stream.name,
        row_word=log.row_word,
        # Series that share a column of time are known by sharing the array.
        time_s=time if time_factor == 1.0 else time_factor * time,
        values=table,
        rows=stream.rows,
        units=(time_unit, units[0] if units else ""),
    )
    return _complete(series, channels, time_name)


def _factor(
    log: RawLog, channels: ChannelMap, stream: Stream, name: str, unit: str | None, kind: Kind | None
) -> tuple[float, str]:
    """Factor from the file's unit to the recording's, and the file's unit."""
    column = stream.columns[name]
    where = f"{log.source}: column '{name}'"
    if kind is None:
        return 1.0, ""
    # A unit that the file gives counts where its spelling is known.
    given = (column.unit, unit_in(name)[1]) if channels.header_units else ()
    found = next((text for text in given if text in UNITS), "")
    if not unit and not found:
        raise CurveError(
            f"{where} shows no unit, and the channel map gives none; "
            f'write unit = "{BASE_UNITS[kind]}", or whatever it is, next to the columns'
        )
    factor = factor_to_base(unit or found, kind, where)
    if unit and found and not np.isclose(factor, factor_to_base(found, kind, where), rtol=1e-9):
        raise CurveError(
            f"{where} is in {found} as the file shows, and in {unit} as the channel map gives; remove unit "
            "there, or set header_units = false if the file is wrong"
        )
    return factor, unit or found


def _complete(series: Series, channels: ChannelMap, time_name: str) -> Series:
    """Series without rows that lack a value, where the map allows to leave them out."""
    # A sum is finite only if all its terms are: one pass in the usual case.
    if np.isfinite(series.time_s.sum()) and np.isfinite(series.values.sum()):
        return series
    lacking = ~np.isfinite(series.values)
    bad_rows = lacking.any(axis=1) | ~np.isfinite(series.time_s)
    if not bad_rows.any():
        return series
    if channels.missing == "skip":
        return series.part(~bad_rows)
    first = int(np.argmax(bad_rows))
    name = series.names[int(np.argmax(lacking[first]))] if lacking[first].any() else time_name
    raise CurveError(
        f"{series.source}: {series.at(first)}, column '{name}': no value (NaN or empty), as in "
        f'{int(bad_rows.sum())} rows in all; repair or remove them, or set missing = "skip" in the channel '
        "map to interpolate between the rows that have one"
    )
