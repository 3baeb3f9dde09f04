"""Delimited text: polars reads what is regular, and a slow reader decides about the rest.

Both take a cell for a number under the same rule, so that the fast one changes
nothing but the time. Where a cell that is wanted is no number, the slow reader
names its line and column.
"""

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.domain import FloatArray, IntArray
from palpate.errors import CurveError
from palpate_robot_log.reading.raw import Column, RawLog, Stream, close_to, listed
from palpate_robot_log.reading.text_layout import (
    BLANKS,
    NUMBER,
    Layout,
    TextFormat,
    find_layout,
    is_date,
    is_number,
)

if TYPE_CHECKING:
    import polars as pl

_PIECE = 1 << 18
_ENCODED = {"utf-8": "utf-8-sig"}


def read_text(
    path: Path, wanted: Sequence[str] | None = None, text_format: TextFormat | None = None
) -> RawLog:
    """Read a delimited text file with a line of names.

    Parameters
    ----------
    path : Path
    wanted : sequence of str, optional
        Columns to read, each cell of which must be a number or empty. All columns when
        left out; then cells that are no numbers are NaN and counted.
    text_format : TextFormat, optional

    Raises
    ------
    CurveError
        Naming the file, line and column.
    """
    text_format = text_format or TextFormat()
    data = _bytes(path, text_format)
    layout = find_layout(str(path), _lines(data), text_format)
    chosen = _chosen(path, layout, wanted)
    begin = _offset(data, layout.first_line)
    table = _fast(data, begin, layout, chosen) or _slow(
        str(path), data[begin:], layout, chosen, strict=wanted is not None
    )
    rows, values, notes = table
    columns = {
        layout.names[index]: Column(
            name=layout.names[index],
            values=column,
            unit="s" if layout.kinds[index] == "date" else layout.units[index],
            note=note,
        )
        for index, column, note in zip(chosen, values, notes, strict=True)
    }
    return RawLog(
        source=str(path),
        format="delimited text",
        row_word="line",
        streams=(Stream(name="", rows=rows, columns=columns),),
        notes=_notes(data, layout, wanted),
        layout=_settings(layout, text_format),
    )


def _bytes(path: Path, text_format: TextFormat) -> bytes:
    raw = path.read_bytes()
    if not raw or raw.isspace():
        raise CurveError(f"{path}: the file is empty; export the log anew")
    codec = _ENCODED.get(text_format.encoding, text_format.encoding)
    if text_format.encoding == "utf-8" and not raw.startswith(b"\xef\xbb\xbf") and raw.isascii():
        data = raw
    else:
        try:
            data = raw.decode(codec).encode()
        except UnicodeDecodeError as error:
            raise CurveError(
                f"{path}: byte {error.start} is not {text_format.encoding} text; save the file as UTF-8, "
                "or set encoding under text in the loader's settings"
            ) from None
    if b"\0" in data:
        raise CurveError(
            f"{path}: byte {data.index(0)} is zero, so this is no text; give a CSV or TSV file, or another "
            "format that 'palpate experiment inspect' knows"
        )
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def _lines(data: bytes) -> Iterator[str]:
    return (line.decode() for line in io.BytesIO(data))


def _offset(data: bytes, line: int) -> int:
    """Where a line, counted from 1, begins."""
    position = 0
    for _ in range(line - 1):
        position = data.index(b"\n", position) + 1
    return position


def _chosen(path: Path, layout: Layout, wanted: Sequence[str] | None) -> list[int]:
    if wanted is None:
        return [index for index, kind in enumerate(layout.kinds) if kind != "text"]
    for name in wanted:
        if name not in layout.names:
            raise CurveError(
                f"{path}: no column '{name}'{close_to(name, layout.names)} "
                f"(columns there: {listed(layout.names)}); correct the channel map, "
                "or see 'palpate experiment inspect'"
            )
    return [layout.names.index(name) for name in dict.fromkeys(wanted)]


def _notes(data: bytes, layout: Layout, wanted: Sequence[str] | None) -> tuple[str, ...]:
    notes = []
    text = [name for name, kind in zip(layout.names, layout.kinds, strict=True) if kind == "text"]
    if wanted is None and text:
        notes.append(f"columns of text passed over: {listed(text)}")
    if not data.endswith(b"\n"):
        notes.append("the last line does not end: it may have been cut short")
    return tuple(notes)


def _settings(layout: Layout, text_format: TextFormat) -> dict[str, object]:
    """Words of the loader's settings for this layout, for the record and the proposal."""
    named = {"\t": "tab"}.get(layout.delimiter, layout.delimiter)
    found: dict[str, object] = {"delimiter": named, "decimal": layout.decimal}
    if text_format.encoding != "utf-8":
        found["encoding"] = text_format.encoding
    return found


Table = tuple[IntArray, list[FloatArray], list[str]]


def _fast(data: bytes, begin: int, layout: Layout, chosen: Sequence[int]) -> Table | None:
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
    """How often a character of one byte follows; bytes.count takes four times as long."""
    codes = np.frombuffer(data, dtype=np.uint8, offset=begin)
    pieces = range(0, codes.size, _PIECE)
    return sum(int(np.count_nonzero(codes[at : at + _PIECE] == ord(mark))) for at in pieces)


def _slow(source: str, body: bytes, layout: Layout, chosen: Sequence[int], *, strict: bool) -> Table:
    """Columns cell by cell; the judge of what is a number."""
    rows: list[int] = []
    values: list[list[float]] = [[] for _ in chosen]
    spoilt: list[list[int]] = [[] for _ in chosen]
    for line, cells in _rows(source, body, layout):
        rows.append(line)
        for column, bad, index in zip(values, spoilt, chosen, strict=True):
            try:
                column.append(_value(cells[index], layout, index))
            except ValueError as error:
                if strict:
                    where = f"{source}: line {line}, column '{layout.names[index]}'"
                    raise CurveError(f"{where}: {error}") from None
                bad.append(line)
                column.append(math.nan)
    if len(rows) < 2:
        raise CurveError(f"{source}: {len(rows)} row of data; a log needs many, export it anew")
    notes = [f"{len(bad)} cells are no numbers, the first in line {bad[0]}" if bad else "" for bad in spoilt]
    return (
        np.array(rows, dtype=np.int64),
        [
            _from_first_date(column, layout, i)
            for column, i in zip(
                (np.array(column, dtype=np.float64) for column in values), chosen, strict=True
            )
        ],
        notes,
    )


def _rows(source: str, body: bytes, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    for line, raw in enumerate(io.BytesIO(body), start=layout.first_line):
        text = raw.decode()
        if not text.strip() or (layout.comment and text.lstrip().startswith(layout.comment)):
            continue
        try:
            cells = layout.cells(text)
        except csv.Error as error:
            raise CurveError(f"{source}: line {line}: {error}; close the quotation marks") from None
        if len(cells) != len(layout.names):
            raise CurveError(
                f"{source}: line {line} has {len(cells)} cells where there are {len(layout.names)} columns; "
                "the log may be cut off there: repair or remove the row, or set delimiter or skip_lines"
            )
        yield line, cells


def _value(cell: str, layout: Layout, index: int) -> float:
    """Value of a cell in its column: of a date the nanoseconds since 1970."""
    if layout.kinds[index] != "date":
        return _number(cell, layout)
    if not is_date(cell):
        raise ValueError(f"'{cell}' is no date and time such as 2030-01-31T12:00:00.000; repair the row")
    plain = cell.removesuffix("Z").removesuffix("+00:00").replace(",", ".")
    return float(np.datetime64(plain, "ns").astype(np.int64))


def _number(cell: str, layout: Layout) -> float:
    """Value of a cell; NaN when it is empty or says so.

    Raises
    ------
    ValueError
        Saying what to do.
    """
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
            f"'{cell}' is not a number with decimal mark '{layout.decimal}'; repair the row, or set decimal"
        )
    raise ValueError(f"'{cell}' is not a number; repair or remove the row")


def _from_first_date(column: FloatArray, layout: Layout, index: int) -> FloatArray:
    """Seconds since the first row, of dates; they arrive as nanoseconds."""
    if layout.kinds[index] != "date":
        return column
    seconds: FloatArray = (column - column[0]) * 1e-9
    return seconds
