"""Content of a file as a reader makes it: a frame of named columns with their units, for each stream.

A table has one stream. A bag has one for each topic, and a MATLAB file one for each length of its arrays.
Nothing is converted here: units are those that the file shows.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.api import BoolArray, CurveError, FloatArray, IntArray
from palpate.api.files import Column, check_columns, close_to, listed

if TYPE_CHECKING:
    import polars as pl

# Who lists the plugins imports this file, and has no need of polars.


@contextmanager
def or_damaged(
    path: Path, what: str, advice: str, kinds: tuple[type[BaseException], ...] = (Exception,)
) -> Iterator[None]:
    """Turn whatever damaged bytes lead a library to into one error that names the file."""
    try:
        yield
    except (CurveError, MemoryError):
        raise
    except kinds as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise CurveError(f"{path}: {what} ({reason}); {advice}") from None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stream:
    """Frame of columns with common rows, and what the file or a person should know of some of them."""

    name: str  # topic of a bag; empty for the one table of a file
    frame: "pl.DataFrame"  # doubles; a value that is missing is NaN
    rows: IntArray  # (n,), line of a text file, message of a bag, else the row counted from 0
    units: Mapping[str, str]
    notes: Mapping[str, str]

    @classmethod
    def of(cls, columns: Iterable[Column], name: str = "", rows: IntArray | None = None) -> "Stream":
        """Stream of columns of one length; its rows are counted from 0 where none are given."""
        import polars as pl

        all_columns = list(columns)
        return cls(
            name=name,
            frame=pl.DataFrame({one.name: one.values for one in all_columns}),
            rows=np.arange(all_columns[0].values.size) if rows is None else rows,
            units={one.name: one.unit for one in all_columns if one.unit},
            notes={one.name: one.note for one in all_columns if one.note},
        )

    @property
    def columns(self) -> Mapping[str, Column]:
        """Columns by name, in the order of the file."""
        return {name: self.column(name) for name in self.frame.columns}

    def column(self, name: str) -> Column:
        """One column, by its name in the file."""
        unit, note = self.units.get(name, ""), self.notes.get(name, "")
        return Column(name=name, values=self.frame[name].to_numpy(), unit=unit, note=note)

    @property
    def label(self) -> str:
        """Name by which messages call it."""
        return f"stream '{self.name}'" if self.name else "the file"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawLog:
    """Everything read from one file."""

    source: str  # the file, for messages
    format: str  # in words
    row_word: str  # what its rows are called in messages: line, row or message
    streams: tuple[Stream, ...]
    notes: tuple[str, ...] = ()  # what was passed over, and why
    layout: Mapping[str, object] = field(default_factory=dict)  # of the text, as in the loader's settings
    preamble: str = ""  # text above the names

    @property
    def path(self) -> Path:
        """File that it was read from."""
        return Path(self.source)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of all streams."""
        return tuple(name for stream in self.streams for name in stream.frame.columns)

    def read(self, wanted: Sequence[str]) -> tuple[IntArray, dict[str, Column]]:
        """Rows and columns of the one stream that has all that are wanted."""
        stream = self.stream_of(wanted, choose="save one of them in a file of its own")
        return stream.rows, {name: stream.column(name) for name in wanted}

    def stream(self, name: str) -> Stream:
        """Stream by its name; a name that is not there is a CurveError."""
        known = {stream.name: stream for stream in self.streams}
        if name not in known:
            raise CurveError(
                f"{self.source}: no stream '{name}'{close_to(name, known)} (streams there: {listed(known)}); "
                "correct stream in the channel map"
            )
        return known[name]

    def columns(self, stream: str, names: Iterable[str]) -> list[Column]:
        """Columns of a stream by their names."""
        return [self.stream(stream).column(name) for name in names]

    def stream_of(
        self,
        columns: Iterable[str],
        stream: str | None = None,
        choose: str = "choose one with stream in the channel map",
    ) -> Stream:
        """The one stream that has all these columns; a CurveError where none has them, or several do."""
        wanted = dict.fromkeys(columns)
        among = self.streams if stream is None else (self.stream(stream),)
        check_columns(self.source, wanted, [name for one in among for name in one.frame.columns])
        found = [one for one in among if {*wanted} <= {*one.frame.columns}]
        if len(found) == 1:
            return found[0]
        parts = found or [one for one in among if {*wanted} & {*one.frame.columns}]
        problem = f"the columns {listed(wanted)} are in {'several' if found else 'different'} streams"
        remedy = choose if found else "take columns of one stream"
        raise CurveError(f"{self.source}: {problem} ({listed(one.name for one in parts)}); {remedy}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """Values of one quantity over their own time, in the recording's units."""

    log: RawLog
    what: str  # position, orientation, force or moment
    names: tuple[str, ...]  # columns, as the channel map has them
    stream: str
    time_s: FloatArray  # (n,), one array of all series that share a column of time
    values: FloatArray  # (n, k), a column for each name
    rows: IntArray  # (n,), as in the stream
    units: tuple[str, str]  # of time and of the values in the file

    def at(self, index: int) -> str:
        """Row and time stamp, for messages."""
        return f"{self.log.row_word} {int(self.rows[index])} (t = {self.time_s[index]:.4f} s)"

    def fault(self, message: str, index: int | None = None, column: int | None = None) -> CurveError:
        """Error that names file, stream, row, time stamp and column."""
        where = [f"stream '{self.stream}'"] if self.stream else []
        where += [] if index is None else [self.at(index)]
        where += [self.what] if column is None else [self.what, f"column '{self.names[column]}'"]
        return CurveError(f"{self.log.source}: {', '.join(where)}: {message}")

    def part(self, kept: BoolArray) -> "Series":
        """Only some rows."""
        return replace(self, time_s=self.time_s[kept], values=self.values[kept], rows=self.rows[kept])
