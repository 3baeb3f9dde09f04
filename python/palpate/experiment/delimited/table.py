"""Tables of numbers in text, read by polars: lines, cells, then numbers, each step for all rows at once."""

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.domain import FloatArray, IntArray
from palpate.errors import CurveError
from palpate.experiment.delimited.characters import decoded
from palpate.experiment.delimited.header_units import unit_in
from palpate.experiment.delimited.layout import (
    BLANKS,
    DELIMITERS,
    NO_VALUE,
    NUMBERS,
    Layout,
    TextFormat,
    find_layout,
    kind_of_cell,
    numbers_in,
)

if TYPE_CHECKING:
    import polars as pl

_SNIFFED_LINES = 400
_FORMATS = tuple(
    f"{date} {time}"
    for date in ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%m/%d/%Y", "%d/%m/%Y")
    for time in ("%H:%M:%S%.f", "%I:%M:%S%.f %p", "%H:%M")
)
"""Dates and times that are read; a month that is taken for a day changes no difference within the day."""


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
        The file cannot be read as text, has no names, or no numbers.
    """

    def __init__(self, path: Path, text_format: TextFormat | None = None) -> None:
        self.path = path
        self.text_format = text_format or TextFormat()
        text, self.encoding = decoded(path, self.text_format.encoding)
        self._is_ended = text.endswith("\n")
        lines = text.split("\n")
        head = list(enumerate(lines[: (self.text_format.skip_lines or 0) + _SNIFFED_LINES], start=1))
        try:
            self.layout = find_layout(str(path), head, self.text_format)
        except CurveError:
            self._check_marks()
            raise
        self._lines = _classified(lines, self.layout)
        self.blocks = _blocks(self._lines, self.layout)
        if (chosen := self.text_format.block or 1) > 1:
            self.layout = self._layout_of(chosen, lines)
            self._lines = _classified(lines, self.layout)
        rows = self._lines.filter(self._lines["line"].is_between(*self.blocks[chosen - 1]))
        self._rows = rows.filter(~rows["is_over"])
        self._columns = self._found_columns()

    def _layout_of(self, block: int, lines: Sequence[str]) -> Layout:
        """Layout of another table than the first: its names stand above it, or it has those of the first."""
        if block > len(self.blocks):
            raise CurveError(f"{self.path}: block = {block} where {self._shown_blocks()}; lower block")
        begin, (first, last) = self.blocks[block - 2][1] + 1, self.blocks[block - 1]
        numbered = list(enumerate(lines[begin - 1 : last], start=begin))[:_SNIFFED_LINES]
        wanted = self.text_format.model_copy(update={"skip_lines": None})
        try:
            return find_layout(str(self.path), numbered, wanted)
        except CurveError:
            return replace(self.layout, first_line=first)

    def _shown_blocks(self) -> str:
        return f"the file holds {len(self.blocks)} tables: lines " + ", ".join(
            f"{first} to {last}" for first, last in self.blocks
        )

    def _found_columns(self) -> dict[str, tuple[int, int | None]]:
        """Cell of each column, and place in its list, by name; a name that occurs twice is left out."""
        lists = {index for index, kind in enumerate(self.layout.kinds) if kind == "list"}
        first = _cells(self._rows.head(1), self.layout, lists) if lists else None
        found: dict[str, tuple[int, int | None]] = {}
        for index, (name, kind) in enumerate(zip(self.layout.names, self.layout.kinds, strict=True)):
            if self.layout.names.count(name) > 1:
                continue
            if first is not None and kind == "list":
                n_numbers = numbers_in(str(first[str(index)][0]))
                found.update({f"{name}[{place}]": (index, place) for place in range(n_numbers)})
            else:
                found[name] = (index, None)
        return found

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that can be read."""
        return tuple(self._columns)

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
        layout, is_strict = self.layout, wanted is not None
        if is_strict and self.text_format.block is None and len(self.blocks) > 1:
            raise CurveError(
                f"{self.path}: {self._shown_blocks()}; choose one with block = 1 in the loader's settings"
            )
        chosen = self._chosen(wanted)
        self._check_cells()
        cells = _cells(self._rows, layout, {index for index, _ in chosen.values()})
        lines = self._rows["line"].to_numpy()
        if lines.size < 2:
            raise CurveError(f"{self.path}: only {lines.size} row of data; export the file again")
        read = [
            self._values(cells[str(index)], layout.kinds[index], place) for index, place in chosen.values()
        ]
        bad = [
            (int(mask.arg_max() or 0), name)
            for (_, mask), name in zip(read, chosen, strict=True)
            if mask.any()
        ]
        if is_strict and bad:
            row, name = min(bad, key=lambda one: one[0])
            index, place = chosen[name]
            cell = str(cells[str(index)][row]).strip()
            raise CurveError(
                f"{self.path}: line {lines[row]}, column '{name}': {self._problem_of(cell, index, place)}"
            )
        columns = {}
        for (name, (index, _)), (values, mask) in zip(chosen.items(), read, strict=True):
            first = f", the first in line {lines[mask.arg_max()]}" if mask.any() else ""
            columns[name] = Column(
                name=name,
                values=values,
                unit="s" if layout.kinds[index] == "date" else layout.units[index],
                note=f"{mask.sum()} cells are no numbers{first}" if first else "",
            )
        return lines.astype(np.int64), columns

    def _chosen(self, wanted: Sequence[str] | None) -> dict[str, tuple[int, int | None]]:
        kinds = self.layout.kinds
        if wanted is None:
            return {name: cell for name, cell in self._columns.items() if kinds[cell[0]] != "text"}
        for name in wanted:
            if self.layout.names.count(name) > 1:
                raise CurveError(
                    f"{self.path}: line {self.layout.header_line} names column '{name}' more than once; "
                    "give each its own name, or give names in the loader's settings"
                )
            if name not in self._columns:
                self._check_marks()
                raise CurveError(
                    f"{self.path}: no column '{name}'{close_to(name, self.names)} (columns there: "
                    f"{listed(self.names)}); correct the name in the loader's settings, or see "
                    "'palpate experiment inspect'"
                )
        return {name: self._columns[name] for name in wanted}

    def _check_marks(self) -> None:
        """Refuse a file that has more columns under other marks than the settings give."""
        given = self.text_format
        if given.delimiter is None and given.decimal is None:
            return
        try:
            other = TextTable(self.path, given.model_copy(update={"delimiter": None, "decimal": None}))
        except CurveError:
            return
        found = other.settings()
        marks = [
            f'{key} = "{found[key]}"'
            for key, mark in (("decimal", given.decimal), ("delimiter", given.delimiter))
            if mark is not None and DELIMITERS.get(mark, mark) != DELIMITERS.get(str(found[key]), found[key])
        ]
        if marks:
            raise CurveError(
                f"{self.path}: its cells are separated by '{found['delimiter']}', its numbers written with "
                f"'{found['decimal']}'; set {' and '.join(marks)} in the loader's settings"
            )

    def _check_cells(self) -> None:
        """Refuse rows whose quotation marks or count of cells do not match."""
        is_open = self._rows["bare"].str.contains('"', literal=True)
        if is_open.any():
            line = self._rows["line"][int(is_open.arg_max() or 0)]
            raise CurveError(f"{self.path}: line {line}: unexpected end of data; close the quotation marks")
        n_columns = len(self.layout.names)
        other = self._rows.filter(self._rows["n_cells"] != n_columns)
        if other.height:
            raise CurveError(
                f"{self.path}: line {other['line'][0]} has {other['n_cells'][0]} cells where there are "
                f"{n_columns} columns; the file may be cut off there: repair or remove the row, or set "
                "delimiter, comment or skip_lines"
            )

    def _values(self, cells: "pl.Series", kind: str, place: int | None) -> tuple[FloatArray, "pl.Series"]:
        """Numbers of a column, NaN where there is none, and where a cell is neither number nor empty."""
        import polars as pl

        if kind == "date":
            return _seconds(cells)
        text = cells.str.strip_chars(" \t")
        if place is not None:
            inside = text.str.strip_chars("[]()").str.strip_chars().str.replace_all(r"[\s,;]+", ";")
            text = inside.str.split(";").list.get(place, null_on_oob=True).fill_null("?")
        plain = (
            text.str.replace(",", ".", literal=True) if self.layout.decimal == "," and place is None else text
        )
        values = plain.cast(pl.Float64, strict=False)
        bad = pl.Series([False]).new_from_index(0, len(text))
        if values.null_count() or values.is_infinite().any() or plain is not text:
            pattern = NUMBERS[self.layout.decimal if place is None else "."]
            is_number = text.str.contains(f"^(?:{pattern})$")
            values = plain.str.replace("[dD]", "e").cast(pl.Float64, strict=False)
            bad = ~(is_number | text.str.contains(f"^(?:{NO_VALUE})$")) | values.is_infinite().fill_null(
                value=False
            )
            values = values.set(~is_number | bad, None)
        return np.array(values.fill_null(math.nan).to_numpy()), bad

    def _problem_of(self, cell: str, index: int, place: int | None) -> str:
        """Reason why a cell is no number of its column, and what to do."""
        if self.layout.kinds[index] == "date":
            return f"'{cell}' is no date and time such as 2030-01-31T12:00:00.000; repair the row"
        if place is not None:
            return f"'{cell}' is no list of numbers as in the first row; repair or remove the row"
        if re.fullmatch(r"(?i)[+-]?inf(inity)?", cell):
            return f"{cell} is not a finite number; repair or remove the row"
        if kind_of_cell(cell, self.layout.decimal) == "number":
            return f"{cell} is too large for a number; repair the row"
        other = "." if self.layout.decimal == "," else ","
        if kind_of_cell(cell.replace(other, "."), ".") == "number":
            return (
                f"'{cell}' is not a number with decimal mark '{self.layout.decimal}'; "
                f'repair the row, or set decimal = "{other}"'
            )
        return f"'{cell}' is not a number; repair or remove the row"

    def notes(self) -> tuple[str, ...]:
        """Remarks on the file for a person."""
        names, kinds = self.layout.names, self.layout.kinds
        notes = []
        if text := [name for name, kind in zip(names, kinds, strict=True) if kind == "text"]:
            notes.append(f"columns of text passed over: {listed(text)}")
        if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
            notes.append(f"columns passed over because their name occurs twice: {listed(twice)}")
        if len(self.blocks) > 1:
            notes.append(f"{self._shown_blocks()}; block chooses the one that is read")
        last = self._rows["line"].max()
        after = self._lines.filter((self._lines["line"] > last) & ~self._lines["is_over"])["line"]
        if len(self.blocks) == 1 and len(after):
            notes.append(f"lines passed over after the table: {after[0]} to {after[-1]}")
        if not self._is_ended:
            notes.append("the last line does not end: it may have been cut short")
        return tuple(notes)

    def settings(self) -> dict[str, object]:
        """Settings of :class:`TextFormat` that read this file without guessing."""
        layout, given = self.layout, self.text_format
        found: dict[str, object] = {
            "delimiter": "tab" if layout.delimiter == "\t" else layout.delimiter,
            "decimal": layout.decimal,
        }
        if self.encoding != "utf-8":
            found["encoding"] = self.encoding
        if layout.comment != "#":
            found["comment"] = layout.comment
        if not layout.header_line:
            found["names"] = list(layout.names)
        elif layout.header_line > 1 and (given.block or 1) == 1:
            found["skip_lines"] = layout.header_line - 1
        if len(self.blocks) > 1:
            found["block"] = given.block or 1
        return found


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


def _classified(lines: Sequence[str], layout: Layout) -> "pl.DataFrame":
    """Lines with their number, text, count of cells, and what each looks like."""
    import polars as pl

    text = pl.col("text").str.strip_chars(" \r")
    between = "\t" if layout.delimiter == BLANKS else layout.delimiter
    mark, n_columns = re.escape(between), len(layout.names)
    if layout.delimiter == BLANKS:
        text = text.str.strip_chars().str.replace_all(r"\s+", "\t")
    if "[" in lines[layout.first_line - 1]:
        text = text.str.replace_all(r'(^|[,;|\t])\s*(\[[^\]"]*\])', '${1}"${2}"')
    frame = pl.DataFrame({"line": range(1, len(lines) + 1), "text": lines}).with_columns(text)
    bare = pl.col("text")
    if frame["text"].str.contains('"', literal=True).any():
        bare = bare.str.replace_all(f'"([^"{mark}]*)"', "${1}")
        bare = bare.str.replace_all('"([+-]?[0-9]+),([0-9]+(?:[eE][+-]?[0-9]+)?)"', "${1}.${2}")
        bare = bare.str.replace_all('"([^"]|"")*"', "q")
    frame = frame.with_columns(bare=bare)
    bare = pl.col("bare")
    frame = frame.with_columns(n_cells=bare.str.count_matches(between, literal=True) + 1)
    # Only lines that are no plain rows are looked at closely: most lines of a long log are.
    is_plain = (pl.col("n_cells") == n_columns) & pl.col("text").str.contains(r"^[-+.0-9]")
    if layout.first_number or not layout.comment or layout.comment[0] in "-+.0123456789":
        is_plain = pl.col("line") < 0
    at = frame.select((~is_plain).arg_true()).to_series()
    # Empty cells at the end of a row are none.
    n_filled = bare.str.strip_chars_end(f" {between}").str.count_matches(between, literal=True) + 1
    first = bare.str.extract(rf"^(?:[^{mark}]*{mark}){{{layout.first_number}}}\s*([^{mark}]*)", 1)
    cell = first.fill_null(bare.str.extract(rf"^\s*([^{mark}]*)", 1)).str.strip_chars()
    comment = bare.str.starts_with(layout.comment) if layout.comment else pl.lit(value=False)
    looks: dict[str, pl.Expr] = {
        "is_over": comment | ~bare.str.contains(r"[\p{L}\p{N}]"),
        "is_word": ~cell.str.contains(rf'^(?:[-+.,0-9"(\[].*|q|inf|infinity|{NO_VALUE})$'),
        "has_number": bare.str.contains(rf"(?:^|{mark})\s*[+-]?[.,]?[0-9]"),
        "n_cells": pl.when(pl.col("n_cells") > n_columns)
        .then(pl.max_horizontal(n_filled, n_columns))
        .otherwise(pl.col("n_cells"))
        .cast(pl.UInt32),
    }
    other = frame[at].select(**looks)
    usual = {"is_over": False, "is_word": False, "has_number": True, "n_cells": n_columns}
    return frame.with_columns(
        pl.repeat(value, frame.height, dtype=other[name].dtype, eager=True)
        .scatter(at, other[name])
        .alias(name)
        for name, value in usual.items()
    )


def _blocks(lines: "pl.DataFrame", layout: Layout) -> list[tuple[int, int]]:
    """First and last line of each table: lines of words are between them, and after the last one."""
    import polars as pl

    body = lines.filter((pl.col("line") >= layout.first_line) & ~pl.col("is_over")).with_columns(
        part=(
            pl.col("is_word") & ((pl.col("n_cells") != len(layout.names)) | ~pl.col("has_number"))
        ).cum_sum()
    )
    # A word in a row of numbers is a damaged row, and a line of results where no row follows.
    rows = body.filter(~pl.col("is_word"))
    parts = rows.group_by("part", maintain_order=True).agg(
        first=pl.col("line").min(), last=pl.col("line").max(), n=pl.len()
    )
    blocks = [(first, last) for part, first, last, n in parts.iter_rows() if part == 0 or n > 1]
    last = body["line"][-1] if body.height else layout.first_line
    return [(layout.first_line, blocks[0][1]), *blocks[1:]] if blocks else [(layout.first_line, last)]


def _cells(rows: "pl.DataFrame", layout: Layout, chosen: Iterable[int]) -> "pl.DataFrame":
    """Cells of some columns of rows of one length, as text, by the column's index."""
    import io

    import polars as pl

    body = "\n".join(rows["text"].to_list())
    indices = sorted(chosen)
    read = pl.read_csv(
        io.BytesIO(body.encode()),
        has_header=False,
        columns=indices,
        separator="\t" if layout.delimiter == BLANKS else layout.delimiter,
        quote_char='"' if '"' in body else None,
        infer_schema=False,
        truncate_ragged_lines=True,
    )
    return read.fill_null("").rename(dict(zip(read.columns, map(str, indices), strict=True)))


def _seconds(cells: "pl.Series") -> tuple[FloatArray, "pl.Series"]:
    """Seconds since the first row of a column of dates, and where a cell is none."""
    text = cells.str.strip_chars().str.replace(r"(Z|\+00:00)$", "").str.replace(",", ".", literal=True)
    text = text.str.replace(r"^(\d{1,2}:)", "1970-01-01 ${1}").str.replace(r"[T ]+", " ").str.to_uppercase()
    tried = (text.str.to_datetime(each, strict=False, time_unit="ns") for each in _FORMATS)
    stamps = min(tried, key=lambda found: found.null_count())
    ticks = (
        stamps.to_physical()
    )  # whole nanoseconds: seconds since 1970 would leave a quarter of a microsecond
    since = (ticks - ticks.drop_nulls().first()).cast(float).fill_null(math.nan)
    return np.array(since.to_numpy() * 1e-9), stamps.is_null()
