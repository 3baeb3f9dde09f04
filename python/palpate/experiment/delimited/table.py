"""Tables of numbers in text: polars reads what is regular, and a slow reader decides about the rest.

Both take a cell for a number under the same rule, so that the fast one changes
nothing but the time. Where a cell that is wanted is no number, the slow reader
names its line and column.
"""

import csv
import difflib
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.domain import FloatArray, IntArray
from palpate.errors import CurveError
from palpate.experiment.delimited.header_units import unit_in
from palpate.experiment.delimited.layout import (
    BLANKS,
    NUMBER,
    Layout,
    TextFormat,
    find_layout,
    is_date,
    is_number,
    is_passed_over,
    split,
)

if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 18


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Column:
    """Numbers under a name.

    Parameters
    ----------
    name : str
        As in the file, without its unit where that has a line of its own.
    values : (n,) array
        NaN where there is no number.
    unit : str
        From the file; empty where it shows none.
    note : str
        What a person should know about the column, such as cells that are no numbers.
    """

    name: str
    values: FloatArray
    unit: str = ""
    note: str = ""

    @property
    def shown_unit(self) -> str:
        """Unit that the file gives, or the column's name; empty where neither does."""
        return self.unit or unit_in(self.name)[1]


class TextTable:
    """A delimited text file with a line of names.

    Parameters
    ----------
    text_format : TextFormat, optional
        Guessed when left out.

    Raises
    ------
    CurveError
        The file cannot be read as text, has no names, no numbers, or a name twice.
    """

    def __init__(self, path: Path, text_format: TextFormat | None = None) -> None:
        self.path = path
        self.text_format = text_format or TextFormat()
        self._data = _bytes(path, self.text_format)
        lines = (line.decode() for line in io.BytesIO(self._data))
        self.layout = find_layout(str(path), lines, self.text_format)

    def read(self, wanted: Sequence[str] | None = None) -> tuple[IntArray, dict[str, Column]]:
        """Line of each row, and columns by name; a column of dates gives seconds since its first row.

        Parameters
        ----------
        wanted : sequence of str, optional
            Columns to read, each cell of which must be a number or empty. All columns that are no
            text when left out; then cells that are no numbers are NaN and counted in the column's note.

        Raises
        ------
        CurveError
            Naming line and column.
        """
        layout = self.layout
        chosen = self._chosen(wanted)
        begin = sum(map(len, islice(io.BytesIO(self._data), layout.first_line - 1)))
        rows, values, notes = _fast(self._data, begin, layout, chosen) or _slow(
            str(self.path), self._data[begin:], layout, chosen, strict=wanted is not None
        )
        return rows, {
            layout.names[index]: Column(
                name=layout.names[index],
                values=column,
                unit="s" if layout.kinds[index] == "date" else layout.units[index],
                note=note,
            )
            for index, column, note in zip(chosen, values, notes, strict=True)
        }

    def _chosen(self, wanted: Sequence[str] | None) -> list[int]:
        names = self.layout.names
        if wanted is None:
            return [index for index, kind in enumerate(self.layout.kinds) if kind != "text"]
        for name in wanted:
            if name not in names:
                self._check_marks(wanted)
                raise CurveError(
                    f"{self.path}: no column '{name}'{close_to(name, names)} (columns there: "
                    f"{listed(names)}); correct the name in the loader's settings, or see "
                    "'palpate experiment inspect'"
                )
        return [names.index(name) for name in dict.fromkeys(wanted)]

    def _check_marks(self, wanted: Sequence[str]) -> None:
        """Refuse a file that has all columns under other marks than the settings give."""
        free = self.text_format.model_copy(update={"delimiter": None, "decimal": None})
        try:
            other = TextTable(self.path, free)
        except CurveError:
            return
        found, given = other.settings(), self.settings()
        names = other.layout.names
        if set(wanted) <= set(names) or len(names) > len(self.layout.names):
            asked = self.text_format.delimiter is not None
            marks = [
                f'{key} = "{found[key]}"'
                for key in ("decimal", "delimiter")
                if found[key] != given[key] and (key == "decimal" or asked)
            ]
            raise CurveError(
                f"{self.path}: its cells are separated by '{found['delimiter']}', its numbers written with "
                f"'{found['decimal']}'; set {' and '.join(marks)} in the loader's settings"
            )

    def notes(self) -> tuple[str, ...]:
        """Remarks on the file for a person."""
        columns = zip(self.layout.names, self.layout.kinds, strict=True)
        notes = []
        if text := [name for name, kind in columns if kind == "text"]:
            notes.append(f"columns of text passed over: {listed(text)}")
        if not self._data.endswith(b"\n"):
            notes.append("the last line does not end: it may have been cut short")
        return tuple(notes)

    def settings(self) -> dict[str, object]:
        """Settings of :class:`TextFormat` that read this file without guessing."""
        delimiter, encoding = self.layout.delimiter, self.text_format.encoding
        return {
            "delimiter": "tab" if delimiter == "\t" else delimiter,
            "decimal": self.layout.decimal,
            **({} if encoding == "utf-8" else {"encoding": encoding}),
        }


def close_to(name: str, known: Iterable[str]) -> str:
    """Suggest names like this one, for a message: first those that differ in case or unit alone."""
    names = list(known)
    label = unit_in(name)[0].casefold()
    same = [each for each in names if unit_in(each)[0].casefold() == label]
    close = same[:2] or difflib.get_close_matches(name, names, n=2, cutoff=0.5)
    return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""


def listed(names: Iterable[str], most: int = 24) -> str:
    """Names on one line, of a long list the first ones."""
    all_names = list(names)
    shown = ", ".join(all_names[:most]) or "none"
    return shown if len(all_names) <= most else f"{shown} … and {len(all_names) - most} more"


def _bytes(path: Path, text_format: TextFormat) -> bytes:
    """Content of the file in UTF-8 without a byte order mark, lines ending with a line feed."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if not raw or raw.isspace():
        raise CurveError(f"{path}: the file is empty; export it again")
    encoding = "utf-8-sig" if text_format.encoding == "utf-8" else text_format.encoding
    try:
        data = raw if encoding == "utf-8-sig" and raw.isascii() else raw.decode(encoding).encode()
    except UnicodeDecodeError as error:
        raise CurveError(
            f"{path}: byte {error.start} is not {text_format.encoding} text; save the file as UTF-8, "
            "or set encoding in the loader's settings"
        ) from None
    if b"\0" in data:
        raise CurveError(
            f"{path}: byte {data.index(0)} is zero, so this is no text; give a CSV or TSV file, or another "
            "format that 'palpate experiment inspect' knows"
        )
    return data if b"\n" in data else data.replace(b"\r", b"\n")


Numbers = tuple[IntArray, list[FloatArray], list[str]]


def _fast(data: bytes, begin: int, layout: Layout, chosen: Sequence[int]) -> Numbers | None:
    """Columns of what begins at a byte, by polars; None where that is not regular enough for it."""
    import polars as pl

    n_lines = _count(data, begin, "\n") + (not data.endswith(b"\n"))
    is_plain = all(layout.kinds[index] == "number" for index in chosen)
    if not chosen or n_lines < 2 or not is_plain or not _is_regular(data, begin, layout, n_lines):
        return None
    names = [str(index) for index in range(len(layout.names))]
    try:
        frame = pl.read_csv(
            data,
            # Skipped here: a copy without it would take as long as a part of the parsing.
            skip_lines=layout.first_line - 1,
            has_header=False,
            new_columns=names,
            columns=sorted(chosen),
            schema_overrides=dict.fromkeys((names[index] for index in chosen), pl.Float64),
            separator=layout.delimiter,
            decimal_comma=layout.decimal == ",",
            quote_char=None,
            infer_schema=False,
            ignore_errors=False,
        )
    except (pl.exceptions.PolarsError, OSError):
        return None
    values = [_values(frame[names[index]]) for index in chosen]
    # A number too large, or written as infinite, is for the slow reader to refuse.
    if frame.height != n_lines or any(np.isinf(column).any() for column in values):
        return None
    rows = np.arange(layout.first_line, layout.first_line + n_lines, dtype=np.int64)
    return rows, values, [""] * len(values)


def _values(series: "pl.Series") -> FloatArray:
    """Numbers of a column. Polars makes null of an empty cell and NaN of "nan", as the slow reader does."""
    whole = series.fill_null(math.nan) if series.null_count() else series
    # Pieces put together by NumPy, which asks for large pages: a third of the time polars takes.
    return np.concatenate([piece.to_numpy() for piece in whole.get_chunks()])


def _is_regular(data: bytes, begin: int, layout: Layout, n_lines: int) -> bool:
    """No quotes, comments, rows of another length (so no blank lines), nor marks that group thousands."""
    unwanted = [b'"', *([layout.comment.encode()] if layout.comment else [])]
    unwanted += [b"."] if layout.decimal == "," else []
    if len(layout.names) < 2 or layout.delimiter == BLANKS:
        return False
    if any(data.find(mark, begin) >= 0 for mark in unwanted):
        return False
    return _count(data, begin, layout.delimiter) == n_lines * (len(layout.names) - 1)


def _count(data: bytes, begin: int, mark: str) -> int:
    """Count of a character of one byte; bytes.count takes four times as long."""
    codes = np.frombuffer(data, dtype=np.uint8, offset=begin)
    pieces = range(0, codes.size, _PIECE)
    return sum(int(np.count_nonzero(codes[at : at + _PIECE] == ord(mark))) for at in pieces)


def _slow(source: str, body: bytes, layout: Layout, chosen: Sequence[int], *, strict: bool) -> Numbers:
    """Columns cell by cell; the judge of what is a number."""
    rows: list[int] = []
    values: list[list[float]] = [[] for _ in chosen]
    bad_lines: list[list[int]] = [[] for _ in chosen]
    for line, cells in _rows(source, body, layout):
        rows.append(line)
        for column, bad, index in zip(values, bad_lines, chosen, strict=True):
            try:
                column.append(_value(cells[index], layout, index))
            except ValueError as error:
                if strict:
                    where = f"{source}: line {line}, column '{layout.names[index]}'"
                    raise CurveError(f"{where}: {error}") from None
                bad.append(line)
                column.append(math.nan)
    if len(rows) < 2:
        raise CurveError(f"{source}: only {len(rows)} row of data; export the file again")
    notes = [
        f"{len(bad)} cells are no numbers, the first in line {bad[0]}" if bad else "" for bad in bad_lines
    ]
    columns = [np.array(column, dtype=np.float64) for column in values]
    for whole, index in zip(columns, chosen, strict=True):
        if layout.kinds[index] == "date":  # nanoseconds, to seconds since the first row
            whole[:] = (whole - whole[0]) * 1e-9
    return np.array(rows, dtype=np.int64), columns, notes


def _rows(source: str, body: bytes, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    for line, raw in enumerate(io.BytesIO(body), start=layout.first_line):
        text = raw.decode()
        if is_passed_over(text, layout.comment):
            continue
        try:
            cells = split(text, layout.delimiter)
        except csv.Error as error:
            raise CurveError(f"{source}: line {line}: {error}; close the quotation marks") from None
        if len(cells) != len(layout.names):
            raise CurveError(
                f"{source}: line {line} has {len(cells)} cells where there are {len(layout.names)} columns; "
                "the file may be cut off there: repair or remove the row, or set delimiter or skip_lines"
            )
        yield line, cells


def _value(cell: str, layout: Layout, index: int) -> float:
    """Value of a cell in its column: of a date the nanoseconds since 1970."""
    if layout.kinds[index] != "date":
        return _number(cell, layout)
    if not is_date(cell):
        raise ValueError(f"'{cell}' is no date and time such as 2030-01-31T12:00:00.000; repair the row")
    plain = cell.removesuffix("Z").removesuffix("+00:00").replace(",", ".")
    plain = plain if "-" in plain else f"1970-01-01T{plain}"
    return float(np.datetime64(plain, "ns").astype(np.int64))


def _number(cell: str, layout: Layout) -> float:
    """Value of a cell; NaN when it is empty or NaN. A ValueError has what to do."""
    if not cell or cell.lower() in {"nan", "+nan", "-nan", "na", "null", "none"}:
        return math.nan
    if is_number(cell, layout.decimal):
        value = float(cell.replace(",", ".").replace("d", "e").replace("D", "e"))
        if math.isfinite(value):
            return value
        raise ValueError(f"{cell} is too large for a number; repair the row")
    if cell.lower().lstrip("+-") in {"inf", "infinity"}:
        raise ValueError(f"{cell} is not a finite number; repair or remove the row")
    other = "." if layout.decimal == "," else ","
    if NUMBER.fullmatch(cell.replace(other, ".")):
        raise ValueError(
            f"'{cell}' is not a number with decimal mark '{layout.decimal}'; "
            f'repair the row, or set decimal = "{other}"'
        )
    raise ValueError(f"'{cell}' is not a number; repair or remove the row")
