"""Tables of numbers in text: polars gives their cells as text, which are cast."""

import difflib
import math
import re
import zipfile
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from palpate.domain import FloatArray, IntArray
from palpate.errors import CurveError
from palpate.experiment.delimited.header_units import kind_of, unit_in
from palpate.experiment.delimited.layout import (
    BETWEEN_NUMBERS,
    BLANKS,
    HEXADECIMAL,
    NO_NUMBERS,
    NO_VALUE,
    NUMBERS,
    THOUSANDS,
    Encoding,
    Layout,
    TextFormat,
    body_of,
    cells_of,
    find_layout,
    kind_of_cell,
    lines_of,
    numbers_in,
    period_of,
    split,
)

if TYPE_CHECKING:
    import polars as pl

_NO_WORD = rf'^(?:[-+.,0-9"(\[].*|(?i:inf|infinity)|{NO_VALUE})$'
_FORMATS = tuple(
    f"{date} {time}"
    for date in ("%Y-%m-%d", "%Y/%m/%d", "%d.%m.%Y", "%m/%d/%Y", "%d/%m/%Y")
    for time in ("%H:%M:%S%.f", "%I:%M:%S%.f %p", "%H:%M")
)
"""Dates and times that are read; a month that is taken for a day changes no difference within the day."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Column:
    """Numbers under a name."""

    name: str  # as in the file, without its unit where that has a line of its own
    values: FloatArray  # (n,), NaN where there is no number
    unit: str = ""  # from the file; empty where it shows none
    note: str = ""  # what a person should know about the column, such as cells that are no numbers

    @property
    def shown_unit(self) -> str:
        """Unit that the file gives, or the column's name; empty where neither does."""
        return self.unit or unit_in(self.name)[1]


_MARKS: Mapping[bytes, Encoding] = {BOM_UTF8: "utf-8", BOM_UTF16_LE: "utf-16", BOM_UTF16_BE: "utf-16"}
_USUAL_PAIRS: Mapping[Encoding, bytes] = {
    "shift_jis": rb"[\x81-\x83\x88-\x97][\x40-\x7e\x80-\xfc]",
    "gb18030": rb"[\xa1-\xa3\xb0-\xd7][\xa1-\xfe]",
    "cp1251": rb"[\xc0-\xff]{3,}",
    "cp1250": rb"(?s)\A(?=.*[a-z][\xb3\xb9\xbf]+[a-z]).*",
}
"""Two bytes of frequent characters of Japanese and Chinese, words of Russian, text with Polish letters."""
_NEVER_READ = (
    (b"\x1f\x8b", "is compressed by gzip; unpack it first"),
    (b"BZh", "is compressed by bzip2; unpack it first"),
    (b"\x28\xb5\x2f\xfd", "is compressed by zstd; unpack it first"),
    (b"\xfd7zXZ", "is compressed by xz; unpack it first"),
    (b"\x80", "is a pickle, which could run code and is never read; save plain numbers"),
    (b"\xd0\xcf\x11\xe0", "is a spreadsheet or document; save the table as CSV"),
    (b"TDSh", "is the index of a LabVIEW TDMS file; give the .tdms file itself"),
    (b"\x05\x00", "is a binary wave of Igor Pro; save it as delimited text (Data > Save Waves)"),
    (b"\x00\x05", "is a binary wave of Igor Pro; save it as delimited text (Data > Save Waves)"),
    (b"%PDF", "is a PDF document; save the table as CSV"),
    (b"xl/", "is a spreadsheet of Excel; save the table as CSV"),
    (b"content.xml", "is a spreadsheet of OpenDocument; save the table as CSV"),
    (b"word/", "is a document of Word; save the table as CSV"),
    (b"header.properties", "is a force curve of JPK; export it as text with the JPK software"),
)
"""First bytes of files, or of names in a zip archive, and what to do."""
_COLUMNS = (
    (b"MATLAB", "a MATLAB file"),
    (b"\x89HDF", "an HDF5 file"),
    (b"PAR1", "a Parquet file"),
    (b"\x93NUMPY", "a NumPy file"),
    (b"PK\x03\x04", "an archive"),
    (b"TDSm", "a TDMS file"),
)
"""First bytes of files that hold columns and are no text."""


def refuse_binary(path: Path) -> None:
    """Refuse a file that is no log and no text, with its kind and what to save instead."""
    with path.open("rb") as stream:
        heads = [stream.read(16)]
    if heads[0].startswith(b"PK\x03\x04"):
        try:
            heads = [name.encode() for name in zipfile.ZipFile(path).namelist()]
        except (zipfile.BadZipFile, OSError, ValueError):
            heads = []
    for magic, why in _NEVER_READ:
        if any(head.startswith(magic) for head in heads):
            raise CurveError(f"{path}: the file {why}")


def decoded(path: Path, given: Encoding | None) -> tuple[str, Encoding]:
    """Text of a file without a byte order mark, and its encoding: as given, or the first that fits."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if not raw or raw.isspace():
        raise CurveError(f"{path}: the file is empty; export it again")
    refuse_binary(path)
    if kind := next((kind for magic, kind in _COLUMNS if raw.startswith(magic)), ""):
        raise CurveError(
            f"{path}: is {kind}, and this loader reads text alone; see "
            "'palpate experiment inspect' for the loader that reads it, or save its columns as CSV"
        )
    marked = given or next((encoding for mark, encoding in _MARKS.items() if raw.startswith(mark)), None)
    # Japanese or Chinese text has most bytes outside of ASCII in its usual pairs.
    head, plain = raw[:100_000], bytes(range(128))
    n_least = 0.7 * len(head.translate(None, plain))
    found = {key: b"".join(re.findall(of, head)) for key, of in _USUAL_PAIRS.items()}
    paired = (key for key, pairs in found.items() if len(pairs.translate(None, plain)) > n_least)
    guesses: tuple[Encoding, ...] = ("utf-8", *paired, "cp1252", "latin-1")
    for encoding in (marked,) if marked else guesses:
        try:
            text = raw.decode("utf-8-sig" if encoding == "utf-8" else encoding)
        except UnicodeDecodeError as error:
            bad = error.start
            continue
        if "\0" in text:
            raise CurveError(
                f"{path}: byte {raw.index(0)} is zero, so this is no text; give a CSV or TSV file, or "
                "another format that 'palpate experiment inspect' knows"
            )
        return text if "\n" in text else text.replace("\r", "\n"), encoding
    raise CurveError(
        f"{path}: byte {bad} is not {marked} text; leave encoding out of the loader's settings, "
        "or save the file as UTF-8"
    )


class TextTable:
    """A delimited text file with a line of names, in a format that is guessed where it is left out.

    A CurveError if the file cannot be read as text, has no names, or no numbers.
    """

    row_word: ClassVar[str] = "line"

    def __init__(self, path: Path, text_format: TextFormat | None = None) -> None:
        import polars as pl

        self.path, self.text_format = path, text_format or TextFormat()
        text, self.encoding = decoded(path, self.text_format.encoding)
        self._is_ended, lines = text.endswith("\n"), lines_of(text)
        try:
            self.layout = find_layout(str(path), lines, self.text_format)
        except CurveError:
            self._check_marks()
            raise
        self._rows, self.blocks = _blocks(lines, self.layout)
        lengths = [last - first for first, last in self.blocks]
        longest = next(i for i, length in enumerate(lengths, 1) if 2 * length >= max(lengths))
        self.block = self.text_format.block or longest
        spans = ", ".join(f"{first} to {last}" for first, last in self.blocks)
        self._shown_blocks = f"the file holds {len(self.blocks)} tables: lines {spans}"
        if self.block > len(self.blocks):
            raise CurveError(f"{path}: block = {self.block} where {self._shown_blocks}; lower block")
        if self.block > 1:  # its names are above it, or it has the names of the first
            before, (first, last) = self.blocks[self.block - 2][1], self.blocks[self.block - 1]
            wanted = self.text_format.model_copy(update={"skip_lines": None})
            self.layout = replace(self.layout, first_line=first)
            with suppress(CurveError):
                self.layout = find_layout(str(path), lines[before:last], wanted)
            self._rows = _blocks(lines, self.layout)[0]
        self._after = self._rows["line"].filter(self._rows["line"] > self.blocks[-1][1])
        self._rows = self._rows.filter(pl.col("line").is_between(*self.blocks[self.block - 1]))
        self.preamble = "\n".join(lines["text"].head((self.layout.header_line or self.layout.first_line) - 1))
        # Cell of each column, and place in its list, by name; a name that occurs twice is left out.
        self._columns: dict[str, tuple[int, int | None]] = {}
        names = self.layout.names[: period_of(self.layout.names)]
        if len(names) < len(self.layout.names):  # of tables side by side one may end before another
            cells = cells_of(self._rows, self.layout.delimiter, range(len(names)))
            self._rows = self._rows.filter(cells.select(pl.any_horizontal(pl.all() != "")).to_series())
        self._twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        first_cells = cells_of(self._rows.head(1), self.layout.delimiter, range(len(names))).row(0)
        for index, name in enumerate(names):
            n_numbers = numbers_in(first_cells[index]) if self.layout.kinds[index] == "list" else 0
            parts: dict[str, tuple[int, int | None]] = {f"{name}[{k}]": (index, k) for k in range(n_numbers)}
            self._columns |= {} if name in self._twice else parts or {name: (index, None)}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns that can be read."""
        return tuple(self._columns)

    def _of_kind(self, kind: str) -> list[str]:
        """Names of the columns of a kind."""
        return [name for name, each in zip(self.layout.names, self.layout.kinds, strict=True) if each == kind]

    def read(self, wanted: Sequence[str] | None = None) -> tuple[IntArray, dict[str, Column]]:
        """Line of each row, and columns by name; a column of dates gives seconds since its first row.

        Each cell of the columns ``wanted`` must be a number or empty, else a CurveError names line and
        column. Without them all columns that are no text are read: cells that are no numbers are NaN, and
        counted in the column's note.
        """
        if wanted is not None and self.text_format.block is None and len(self.blocks) > 1:
            raise CurveError(
                f"{self.path}: {self._shown_blocks}; choose one with block = {self.block} in the loader's "
                "settings"
            )
        chosen, lines = self._chosen(wanted), self._rows["line"].to_numpy().astype(np.int64)
        self._check_cells()
        if lines.size < 2:
            raise CurveError(f"{self.path}: only {lines.size} row of data; export the file again")
        cells = cells_of(self._rows, self.layout.delimiter, {index for index, _ in chosen.values()})
        columns, first_bad = {}, []
        for name, (index, place) in chosen.items():
            kind, text = self.layout.kinds[index], cells[str(index)]
            if kind == "quantity":
                text = text.str.strip_chars().str.strip_suffix(self.layout.units[index])
            values, bad = _seconds(text) if kind == "date" else _numbers(text, self.layout.decimal, place)
            note = ""
            if n_bad := int(bad.sum()):
                row = int(bad.arg_max() or 0)
                problem = self._problem_of(text[row].strip(), index, place)
                note = f"{n_bad} cells are no numbers, the first in line {lines[row]}: {problem}"
                first_bad.append((row, name, problem))
            unit = "s" if kind == "date" else self.layout.units[index]
            if index == 0 and self.layout.steps is not None:
                (begin, step), unit = self.layout.steps, "s"
                if np.isnan(values).all():
                    values = begin + step * np.arange(values.size, dtype=np.float64)
            columns[name] = Column(name=name, values=values, unit=unit, note=note)
        if wanted is not None and first_bad:
            row, name, problem = min(first_bad, key=lambda one: one[0])
            raise CurveError(f"{self.path}: line {lines[row]}, column '{name}': {problem}")
        return lines, columns

    def _chosen(self, wanted: Sequence[str] | None) -> dict[str, tuple[int, int | None]]:
        layout = self.layout
        if wanted is None:
            kinds, counts = layout.kinds, self._of_kind("hex")
            if found := {name: at for name, at in self._columns.items() if kinds[at[0]] not in NO_NUMBERS}:
                return found
            why = f"every column is text, or has the name of another ({listed(layout.names)}); give names in "
            why = f"{listed(counts)}: {HEXADECIMAL}" if counts else f"{why}the loader's settings"
            raise CurveError(f"{self.path}: {why}")
        if not layout.is_named:
            self._check_marks()
            raise CurveError(
                f"{self.path}: line {layout.first_line} holds numbers where column names belong; "
                "add a line of names, or give names in the loader's settings"
            )
        for name in wanted:
            if name in self._twice:
                raise CurveError(
                    f"{self.path}: line {layout.header_line} names column '{name}' more than once; "
                    "give each its own name, or give names in the loader's settings"
                )
            if name not in self._columns:
                self._check_marks()
        check_columns(self.path, wanted, self.names)
        return {name: self._columns[name] for name in wanted}

    def _check_cells(self) -> None:
        """Refuse rows whose quotation marks or count of cells do not match."""
        n_columns = len(self.layout.names)
        odd = self._rows.filter(self._rows["n_cells"] != n_columns)
        for line in self._rows.filter("is_open")["line"][:1]:
            raise CurveError(f"{self.path}: line {line}: unexpected end of data; close the quotation marks")
        for line, n_cells in odd["line", "n_cells"][:1].rows():
            raise CurveError(
                f"{self.path}: line {line} has {n_cells} cells where there are {n_columns} columns; the file "
                "may be cut off there: repair or remove the row, or set delimiter, comment or skip_lines"
            )

    def _check_marks(self) -> None:
        """Refuse a file that has columns under other marks than the settings give."""
        given = self.text_format.model_dump(include={"delimiter", "decimal"}, exclude_none=True)
        found = dict[str, str]()
        with suppress(CurveError):
            guessed = self.text_format.model_copy(update=dict.fromkeys(given))
            found = TextTable(self.path, guessed).marks if given else {}
        wrong = [k for k in sorted(found) if given.get(k, found[k]).replace("\t", "tab") != found[k]]
        if marks := [f'{key} = "{found[key]}"' for key in wrong]:
            raise CurveError(
                f"{self.path}: its cells are separated by '{found['delimiter']}', its numbers written with "
                f"'{found['decimal']}'; set {' and '.join(marks)} in the loader's settings"
            )

    def _problem_of(self, cell: str, index: int, place: int | None) -> str:
        """Reason why a cell is no number of its column, and what to do."""
        decimal = self.layout.decimal
        if self.layout.kinds[index] == "hex":
            return f"'{cell}': {HEXADECIMAL}"
        if self.layout.kinds[index] == "date":
            return f"'{cell}' is no date and time such as 2030-01-31T12:00:00.000; repair the row"
        if place is not None:
            return f"'{cell}' is no list of numbers as in the first row; repair or remove the row"
        if re.fullmatch(r"(?i)[+-]?inf(inity)?", cell):
            return f"{cell} is not a finite number; repair or remove the row"
        if re.fullmatch(THOUSANDS[decimal], cell):
            shown = f"'{cell}' has marks between its thousands; export the file without them"
            return f"{shown}, or give each of two values its own column" if " " in cell else shown
        if kind_of_cell(cell, decimal) == "number":
            return f"{cell} is too large for a number; repair the row"
        other = "." if decimal == "," else ","
        if kind_of_cell(cell.replace(other, "."), ".") == "number":
            how = f'repair the row, or set decimal = "{other}"'
            return f"'{cell}' is not a number with decimal mark '{decimal}'; {how}"
        return f"'{cell}' is not a number; repair or remove the row"

    def notes(self) -> tuple[str, ...]:
        """Remarks on the file for a person."""
        names = self.layout.names
        notes = [] if self.layout.is_named else ["the file names no columns: write them under names"]
        if text := self._of_kind("text"):
            notes.append(f"columns of text passed over: {listed(text)}")
        if counts := self._of_kind("hex"):
            notes.append(f"{listed(counts)}: {HEXADECIMAL}")
        if (period := period_of(names)) < len(names):
            n_tables = len(names) // period
            notes.append(f"{n_tables} tables are side by side, with the same names; the first is read")
        elif self._twice:
            notes.append(f"columns passed over because their name occurs twice: {listed(self._twice)}")
        if len(self.blocks) > 1:
            notes.append(f"{self._shown_blocks}; block chooses the one that is read")
        elif len(self._after):
            notes.append(f"lines passed over after the table: {self._after[0]} to {self._after[-1]}")
        if not self._is_ended:
            notes.append("the last line does not end: it may have been cut short")
        return tuple(notes)

    @property
    def marks(self) -> dict[str, str]:
        """Delimiter and decimal mark, as in the settings."""
        delimiter = self.layout.delimiter
        return {"delimiter": "tab" if delimiter == "\t" else delimiter, "decimal": self.layout.decimal}

    def settings(self) -> dict[str, object]:
        """Settings of :class:`TextFormat` that read this file without guessing."""
        layout = self.layout
        return {
            **self.marks,
            **({"encoding": self.encoding} if self.encoding != "utf-8" else {}),
            **({"comment": layout.comment} if layout.comment != "#" else {}),
            **({} if layout.header_line else {"names": list(layout.names)}),
            **({"skip_lines": layout.header_line - 1} if layout.header_line > 1 and self.block == 1 else {}),
            **({"block": self.block} if len(self.blocks) > 1 else {}),
        }


def close_to(name: str, known: Iterable[str]) -> str:
    """Suggest names like this one, for a message: first those that differ in case or unit alone."""
    label, unit = unit_in(name)
    kind = kind_of(unit)
    names = [each for each in known if kind is None or kind_of(unit_in(each)[1]) in (None, kind)]
    same = [each for each in names if unit_in(each)[0].casefold() == label.casefold()]
    alike = [each for each in names if unit and unit_in(each)[1] == unit]
    close = (
        same[:2]
        or (alike if len(alike) == 1 else [])
        or difflib.get_close_matches(name, names, n=2, cutoff=0.5)
    )
    return f"; did you mean {' or '.join(map(repr, close))}?" if close else ""


def check_columns(source: object, wanted: Iterable[str], known: Iterable[str]) -> None:
    """Refuse a column that a file, called ``source`` in messages, does not have."""
    names = list(known)
    for name in (each for each in wanted if each not in names):
        raise CurveError(
            f"{source}: no column '{name}'{close_to(name, names)} (columns there: {listed(names)}); "
            "correct the name in the loader's settings, or see 'palpate experiment inspect'"
        )


def listed(names: Iterable[str], most: int = 24) -> str:
    """Names on one line, of a long list the first ones."""
    all_names = list(names)
    shown = ", ".join(all_names[:most]) or "none"
    return shown if len(all_names) <= most else f"{shown} … and {len(all_names) - most} more"


def _blocks(lines: "pl.DataFrame", layout: Layout) -> tuple["pl.DataFrame", list[tuple[int, int]]]:
    """Rows from a table on, and first and last line of each table: lines of words are between them."""
    import polars as pl

    n_columns, between = len(layout.names), "\t" if layout.delimiter == BLANKS else layout.delimiter
    rows = split(body_of(lines[layout.first_line - 1 :], layout.comment), layout.delimiter)
    if (rows["n_cells"] > n_columns).any():  # empty cells at the end of a row are none
        n_empty = pl.col("text").str.extract(rf"([ {between}]*)$").str.count_matches(between, literal=True)
        n_more = (pl.col("n_cells").cast(pl.Int64) - n_columns).clip(0)
        rows = rows.with_columns(n_cells=pl.col("n_cells") - pl.min_horizontal(n_empty, n_more))
    # Most lines of a long log begin with a number: the others are looked at closely.
    index, cell = layout.first_number, pl.col(str(layout.first_number))
    others = rows if index else rows.filter(~pl.col("text").str.contains(r"^[-+.0-9]"))
    cell = pl.when(pl.col("n_cells") > index).then(cell).otherwise("0").str.strip_chars()
    words = others.hstack(cells_of(others, layout.delimiter, {0, index})).filter(~cell.str.contains(_NO_WORD))
    has_number = pl.col("text").str.contains(rf'(?:^|{re.escape(between)})\s*"?[+-]?[.,]?[0-9]')
    ends = words.filter((pl.col("n_cells") != n_columns) | ~has_number)["line"]
    is_word, is_end = rows["line"].is_in(words["line"].implode()), rows["line"].is_in(ends.implode())
    # A word in a row of numbers is a damaged row, and a line of results where no row follows.
    tables = (
        rows.with_columns(part=is_end.cum_sum())
        .filter(~is_word)
        .group_by("part", maintain_order=True)
        .agg(first=pl.col("line").min(), last=pl.col("line").max(), n=pl.len())
    )
    found = [(first, last) for part, first, last, n in tables.iter_rows() if part == 0 or n > 1]
    found = [(layout.first_line, found[0][1] if found else rows["line"][-1]), *found[1:]]
    return _joined(rows, found, layout, lines["text"][: layout.first_line - 1].to_list())


def _joined(
    rows: "pl.DataFrame", tables: list[tuple[int, int]], layout: Layout, heads: Sequence[str]
) -> tuple["pl.DataFrame", list[tuple[int, int]]]:
    """Tables with each page joined to the one before: no other names are between, and its steps go on."""
    import polars as pl

    line, joined = pl.col("line"), tables[:1]
    is_head = pl.col("text").is_in(heads) | (pl.col("n_cells") != len(layout.names))
    for table in tables[1:]:
        is_between = line.is_between(joined[-1][1] + 1, table[0] - 1)
        parts = [rows.filter(line.is_between(*each)) for each in (joined[-1], table)]
        ends = pl.concat([parts[0].tail(2), parts[1].head(2)])
        cells = cells_of(ends, layout.delimiter, {layout.first_number})[str(layout.first_number)]
        steps = np.diff(_numbers(cells, layout.decimal, None)[0])
        goes_on = steps.size == 3 and steps[0] != 0.0 and bool(np.all(abs(steps / steps[0] - 1.25) < 0.75))
        if goes_on and rows.filter(is_between & ~is_head).is_empty():
            rows, joined[-1] = rows.filter(~is_between), (joined[-1][0], table[1])
        else:
            joined.append(table)
    return rows, joined


def _numbers(cells: "pl.Series", decimal: str, place: int | None) -> tuple[FloatArray, "pl.Series"]:
    """Numbers of a column, NaN where there is none, and where a cell is neither number nor empty."""
    import polars as pl

    if place is not None:
        inside = cells.str.replace("^[A-Za-z]+", "").str.replace_all(BETWEEN_NUMBERS, ";")
        parts, decimal = inside.str.strip_chars(";").str.split(";"), "."
        cells = parts.list.get(place, null_on_oob=True).fill_null("?")
    values = cells.cast(pl.Float64, strict=False)
    bad = pl.Series([False]).new_from_index(0, len(cells))
    if decimal == "," or values.null_count() or values.is_infinite().any():
        cells = cells.str.strip_chars()
        plain = cells.str.replace(",", ".", literal=True) if decimal == "," else cells
        is_number = cells.str.contains(f"^(?:{NUMBERS[decimal]})$")
        marked = ~is_number & cells.str.contains(f"^(?:{THOUSANDS[decimal]})$")
        # A comma stands between thousands next to a decimal, a blank next to numbers below 1,000 alone.
        are_small = cells.filter(is_number).str.contains(r"^[+-]?\d{1,3}(\D|$)")
        marks = cells.filter(marked)
        if marks.str.contains(rf"\{decimal}|['\u00a0\u202f ]").any() and (
            not marks.str.contains(" ", literal=True).any() or (are_small.len() and are_small.all())
        ):
            bare = cells.str.replace_all(rf"[^\d{decimal}+-]", "").str.replace(",", ".", literal=True)
            plain, is_number = plain.zip_with(~marked, bare), is_number | marked
        values = plain.str.replace("[dD]", "e").cast(pl.Float64, strict=False)
        too_large = values.is_infinite().fill_null(value=False)
        bad = ~(is_number | cells.str.contains(f"^(?:{NO_VALUE})$")) | too_large
        values = values.set(~is_number | bad, None)
    return np.array(values.fill_null(math.nan).to_numpy()), bad


def _seconds(cells: "pl.Series") -> tuple[FloatArray, "pl.Series"]:
    """Seconds since the first row of a column of dates, and where a cell is none."""
    text = cells.str.strip_chars().str.replace(r"(Z|[+-]\d\d:\d\d)$", "").str.replace(",", ".", literal=True)
    text = text.str.replace(r"^(\d{1,2}:)", "1970-01-01 ${1}").str.replace(r"[T ]+", " ").str.to_uppercase()
    tried = (text.str.to_datetime(each, strict=False, time_unit="ns") for each in _FORMATS)
    stamps = min(tried, key=lambda found: found.null_count())
    # Whole nanoseconds: seconds since 1970 would leave a quarter of a microsecond.
    ticks = stamps.to_physical()
    since = (ticks - ticks.drop_nulls().first()).cast(float).fill_null(math.nan)
    return np.array(since.to_numpy() * 1e-9), stamps.is_null()
