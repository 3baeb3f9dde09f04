"""Layout of a delimited text file: guessed from its first lines, or as the study gives it."""

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Literal

from pydantic import Field

from palpate.domain.component import Settings
from palpate.errors import CurveError
from palpate.experiment.delimited.header_units import UNITS

BLANKS = "blanks"
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
DELIMITERS: dict[str, str] = {",": ",", ";": ";", "tab": "\t", "\t": "\t", "|": "|", BLANKS: BLANKS}
"""What is between cells, by its word in the settings."""
_NOT_A_NUMBER = re.compile(r"[+-]?(nan|inf|infinity)|", re.IGNORECASE)
_COMMA_DECIMAL = re.compile(r"[+-]?(\d+,\d*|,\d+|\d+)([eE][+-]?\d+)?")
_SECONDS = r":\d\d([.,]\d{1,9})?"
_DATE = re.compile(rf"(\d{{4}}-\d\d-\d\d[T ]\d\d:\d\d({_SECONDS})?|\d\d:\d\d{_SECONDS})(Z|\+00:00)?")
_SNIFFED_LINES = 400
_SAMPLED_ROWS = 20
_LONGEST_LINE = 100_000


class TextFormat(Settings):
    """Layout of a text file; whatever is left out is guessed from its first lines."""

    delimiter: Literal[",", ";", "tab", "\t", "|", "blanks"] | None = Field(
        default=None, description="Between cells; blanks means any run of blanks and tabs."
    )
    decimal: Literal[".", ","] | None = Field(default=None, description="Decimal mark.")
    skip_lines: int | None = Field(default=None, ge=0, description="Lines before the header line.")
    comment: str = Field(default="#", description="Lines that start with it are passed over; empty: none.")
    encoding: Literal["utf-8", "utf-16", "latin-1", "cp1252"] = Field(
        default="utf-8", description="Encoding of the characters."
    )
    names: list[str] | None = Field(
        default=None, min_length=1, description="Names of the columns, for a file without a line of names."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Layout of one file."""

    delimiter: str
    """One character, or ``BLANKS``."""
    decimal: Literal[".", ","]
    first_line: int
    """Line of the first row of data, counted from 1."""
    names: tuple[str, ...]
    units: tuple[str, ...]
    """From a line of units under the names; empty texts without one."""
    kinds: tuple[str, ...]
    """``number``, ``date`` or ``text`` by column, from the first rows."""
    comment: str


def split(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without surrounding blanks; a csv.Error where quotation marks do not match."""
    if delimiter == BLANKS:
        return line.split()
    plain = line.replace("\r", " ").strip(" \n")  # a carriage return is a blank
    (cells,) = csv.reader([plain], delimiter=delimiter, strict=True) if plain else ([],)
    return [cell.strip() for cell in cells]


def is_passed_over(line: str, comment: str) -> bool:
    """Whether a line is blank or a comment."""
    return not line.strip() or bool(comment and line.lstrip().startswith(comment))


def is_date(cell: str) -> bool:
    """Whether a cell is a date and time, or a time of day, as ISO 8601 writes them."""
    return _DATE.fullmatch(cell) is not None


def find_layout(source: str, lines: Iterator[str], wanted: TextFormat) -> Layout:
    """Layout of a text file, called ``source`` in messages, from its first lines and what the study gives.

    A CurveError where there is no line of names, are no rows of numbers, or a name occurs twice.
    """
    numbered = [
        (number, line)
        for number, line in enumerate(islice(lines, _SNIFFED_LINES), start=1)
        if not is_passed_over(line, wanted.comment)
    ]
    if any(len(line) > _LONGEST_LINE for _, line in numbered):
        raise CurveError(
            f"{source}: a line of more than {_LONGEST_LINE} characters; this is no table of numbers"
        )
    body = [(n, line) for n, line in numbered if n > (wanted.skip_lines or 0)]
    delimiter, decimal = _marks(source, [line for _, line in body], wanted)
    rows = [(n, _tolerant_split(line, delimiter)) for n, line in body]
    if rows[1:] and not any(is_number(c, decimal) or is_date(c) for _, cells in rows for c in cells):
        # What another file holds does not belong into a message.
        raise CurveError(f"{source}: no cell holds a number, so this is no table of numbers; check the path")
    start = 0 if wanted.skip_lines is not None or wanted.names is not None else _header_index(rows, decimal)
    names, units, data = _names_and_units(source, rows[start:], wanted, decimal)
    if not data:
        raise CurveError(f"{source}: a line of names and no data; export the file again")
    return Layout(
        delimiter=delimiter,
        decimal=decimal,
        first_line=data[0][0],
        names=names,
        units=units,
        kinds=_kinds(len(names), [cells for _, cells in data[:_SAMPLED_ROWS]], decimal),
        comment=wanted.comment,
    )


def _tolerant_split(line: str, delimiter: str) -> list[str]:
    try:
        return split(line, delimiter)
    except csv.Error:
        return []


def _marks(source: str, lines: Sequence[str], wanted: TextFormat) -> tuple[str, Literal[".", ","]]:
    """Delimiter and decimal mark under which most lines are rows of numbers of one length."""
    if not lines:
        raise CurveError(
            f"{source}: no names and no rows after line {wanted.skip_lines or 0}; "
            "lower skip_lines, or export the file again"
        )
    delimiters = [DELIMITERS[wanted.delimiter]] if wanted.delimiter else dict.fromkeys(DELIMITERS.values())
    decimals: list[Literal[".", ","]] = [wanted.decimal] if wanted.decimal else [".", ","]
    sample = lines[-60:] if len(lines) < _SNIFFED_LINES else lines[-60:-1]
    marks = [(d, m) for d in delimiters for m in decimals if d != m]
    if not marks:
        raise CurveError(f"{source}: delimiter and decimal are both ','; give another delimiter")
    return max(marks, key=lambda marks: _likelihood(sample, *marks))


def _likelihood(lines: Sequence[str], delimiter: str, decimal: str) -> tuple[float, float]:
    """Share of cells that are numbers, of rows that have the usual length, and how many a row has."""
    rows = [_tolerant_split(line, delimiter) for line in lines]
    lengths = [len(row) for row in rows]
    usual = max(set(lengths), key=lengths.count)
    if usual < 2:
        return 0.0, 0.0
    cells = [cell for row in rows if len(row) == usual for cell in row]
    n_numbers = sum(not cell or is_number(cell, decimal) for cell in cells)
    return n_numbers / len(cells) * lengths.count(usual) / len(rows), n_numbers / len(rows)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a finite number with this decimal mark."""
    pattern = _COMMA_DECIMAL if decimal == "," else NUMBER
    return pattern.fullmatch(cell) is not None


def _header_index(rows: Sequence[tuple[int, list[str]]], decimal: str) -> int:
    """Index of the line of names: the last line of text before rows of its length that hold numbers."""
    lengths = [len(cells) for _, cells in rows]
    usual = max(set(lengths), key=lengths.count)
    first_row = next(
        (
            i
            for i, (_, cells) in enumerate(rows)
            if len(cells) == usual
            and any(is_number(cell, decimal) for cell in cells)
            # A name such as "1" does not make the line of names a row.
            and 2 * sum(is_number(c, decimal) or not c or is_date(c) for c in cells) >= usual
        ),
        len(rows),
    )
    if first_row > 1 and _is_units_line(rows[first_row - 1][1]):
        return first_row - 2
    return max(0, first_row - 1)


def _is_units_line(cells: Sequence[str]) -> bool:
    """Whether most cells of a line are units, as some loggers write them under the names."""
    bare = [cell.strip("[]() ") for cell in cells]
    n_units = sum(cell in UNITS for cell in bare)
    return n_units > 0 and all(cell in UNITS or cell in {"", "-", "1"} for cell in bare)


def _names_and_units(
    source: str, rows: Sequence[tuple[int, list[str]]], wanted: TextFormat, decimal: str
) -> tuple[tuple[str, ...], tuple[str, ...], Sequence[tuple[int, list[str]]]]:
    line, first = rows[0]
    if wanted.names is not None:
        if len(wanted.names) != len(first):
            raise CurveError(
                f"{source}: line {line} has {len(first)} cells where names has {len(wanted.names)} entries; "
                "give each column a name"
            )
        return tuple(wanted.names), ("",) * len(first), rows
    if all(is_number(cell, decimal) or _NOT_A_NUMBER.fullmatch(cell) for cell in first):
        raise CurveError(
            f"{source}: line {line} holds numbers where column names belong; "
            "add a line of names, or give names in the loader's settings"
        )
    names = tuple(name or f"column {index + 1}" for index, name in enumerate(first))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CurveError(
            f"{source}: line {line} names column '{twice[0]}' more than once; "
            "give each its own name, or give names in the loader's settings and skip this line"
        )
    if len(rows) > 1 and len(rows[1][1]) == len(names) and _is_units_line(rows[1][1]):
        units = tuple("" if (bare := cell.strip("[]() ")) in {"-", "1"} else bare for cell in rows[1][1])
        return names, units, rows[2:]
    return names, ("",) * len(names), rows[1:]


def _kinds(n_columns: int, rows: Sequence[Sequence[str]], decimal: str) -> tuple[str, ...]:
    """Kind of each column, by the first rows."""
    kinds = []
    for index in range(n_columns):
        cells = [row[index] for row in rows if index < len(row) and row[index]]
        n_numbers = sum(
            is_number(cell, decimal) or _NOT_A_NUMBER.fullmatch(cell) is not None for cell in cells
        )
        if cells and all(is_date(cell) for cell in cells):
            kinds.append("date")
        else:
            kinds.append("number" if not cells or 2 * n_numbers >= len(cells) else "text")
    return tuple(kinds)
