"""Content of a file as a reader makes it: named streams of named columns of numbers, as in the file.

A table has one stream. A bag has one for each topic, and a MATLAB file one for each
length of its arrays. Nothing is converted here: units are those of the file, where
the file shows them, and a value that is missing is NaN.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from palpate.api import BoolArray, CurveError, FloatArray, IntArray
from palpate.api.files import Column, close_to, listed


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
    """Columns with common rows.

    Parameters
    ----------
    name : str
        Topic of a bag; empty for the one table of a file.
    rows : (n,) array of int
        Line of a text file, message of a bag, else the row counted from 0.
    """

    name: str
    rows: IntArray
    columns: Mapping[str, Column]

    @property
    def label(self) -> str:
        """Name by which messages call it."""
        return f"stream '{self.name}'" if self.name else "the file"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawLog:
    """Everything read from one file.

    Parameters
    ----------
    source : str
        The file, for messages.
    format : str
        Its format in words.
    row_word : str
        What its rows are called in messages: line, row or message.
    notes : tuple of str
        What was passed over, and why.
    layout : mapping of str to str
        How the file was understood, in the words of the loader's settings.
    """

    source: str
    format: str
    row_word: str
    streams: tuple[Stream, ...]
    notes: tuple[str, ...] = ()
    layout: Mapping[str, object] = field(default_factory=dict)

    def stream(self, name: str) -> Stream:
        """Stream by its name; a name that is not there is a CurveError."""
        for stream in self.streams:
            if stream.name == name:
                return stream
        known = [stream.name for stream in self.streams]
        raise CurveError(
            f"{self.source}: no stream '{name}'{close_to(name, known)} (streams there: {listed(known)}); "
            "correct stream in the channel map"
        )

    def stream_of(self, columns: Iterable[str], stream: str | None = None) -> Stream:
        """The one stream that has all these columns; a CurveError where none has them, or several do."""
        wanted = list(columns)
        among = self.streams if stream is None else (self.stream(stream),)
        found = [s for s in among if all(name in s.columns for name in wanted)]
        if len(found) == 1:
            return found[0]
        if found:
            names = listed(s.name for s in found)
            raise CurveError(
                f"{self.source}: the columns {listed(wanted)} are in several streams ({names}); "
                "choose one with stream in the channel map"
            )
        known = [name for one in among for name in one.columns]
        missing = [name for name in wanted if name not in known]
        if not missing:
            raise CurveError(
                f"{self.source}: no one stream has all of {listed(wanted)}; "
                "take the columns of one vector from one stream"
            )
        raise CurveError(
            f"{self.source}: no column '{missing[0]}'{close_to(missing[0], known)} "
            f"(columns there: {listed(known)}); correct the channel map, or see 'palpate experiment inspect'"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """Values of one quantity over their own time, in the recording's units.

    Parameters
    ----------
    log : RawLog
        Where they come from, for messages.
    what : str
        position, orientation, force or moment.
    names : tuple of str
        Columns, as the channel map has them.
    stream : str
        Of the columns.
    time_s : (n,) array
        One array of all series that share a column of time.
    values : (n, k) array
        A column for each name.
    rows : (n,) array of int
        As in the stream.
    units : tuple of str
        Unit of time and of the values in the file.
    """

    log: RawLog
    what: str
    names: tuple[str, ...]
    stream: str
    time_s: FloatArray
    values: FloatArray
    rows: IntArray
    units: tuple[str, str]

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
