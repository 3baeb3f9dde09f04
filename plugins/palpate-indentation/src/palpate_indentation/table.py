"""Text tables: a header line and rows, each cell known by its line and column.

Numbers are read here and nowhere else, so that every mistake in a file is told
in the same way: file, line (counted from 1 in the file), column, remedy.
"""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from palpate.errors import CurveError
from palpate_robot_log.reading.raw import close_to

DELIMITERS = (",", ";", "\t")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_LIKE_A_NUMBER = re.compile(r"[+-]?[.,]?\d")
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """Cells of a file, unparsed.

    Parameters
    ----------
    path : Path
    decimal : {".", ","}
    header : tuple of str
        Column names, without surrounding blanks.
    header_line : int
    rows : tuple of (line, cells)
        Every row has as many cells as the header.
    """

    path: Path
    decimal: Literal[".", ","]
    header: tuple[str, ...]
    header_line: int
    rows: tuple[tuple[int, tuple[str, ...]], ...]

    def column(self, name: str) -> list[float]:
        """Numbers of one column, all finite.

        Raises
        ------
        CurveError
            No such column, text among the numbers, NaN or infinity.
        """
        if name not in self.header:
            raise CurveError(self._no_column(name))
        index = self.header.index(name)
        return [self._number(line, name, cells[index]) for line, cells in self.rows]

    def _no_column(self, name: str) -> str:
        return (
            f"{self.path}: line {self.header_line} has no column '{name}'{close_to(name, self.header)} "
            f"(columns there: {', '.join(self.header)}); rename it in the file, or name the file's "
            "columns under channels in the loader's settings"
        )

    def _number(self, line: int, name: str, cell: str) -> float:
        where = f"{self.path}: line {line}, column '{name}'"
        if not cell:
            raise CurveError(f"{where}: the cell is empty; fill it or remove the row")
        if _NOT_FINITE.fullmatch(cell):
            raise CurveError(f"{where}: {cell} is not a finite number; repair or remove the row")
        number = self._with_point(cell)
        if not _NUMBER.fullmatch(number):
            raise CurveError(f"{where}: '{cell}' is not a number; {self._remedy(cell)}")
        value = float(number)
        if not math.isfinite(value):
            raise CurveError(f"{where}: {cell} is too large for a number; repair the row")
        return value

    def _with_point(self, cell: str) -> str:
        """Cell with a point as decimal mark; the other mark, which may group thousands, spoils it."""
        if self.decimal == ".":
            return cell
        return cell.translate({ord(","): ".", ord("."): "?"})

    def _remedy(self, cell: str) -> str:
        other = "." if self.decimal == "," else ","
        if _NUMBER.fullmatch(cell.replace(other, ".")):
            return (
                f'its decimal mark is not "{self.decimal}"; set decimal = "{other}" in the loader\'s settings'
            )
        return "repair or remove the row"


def read_table(
    path: Path,
    *,
    delimiter: str | None = None,
    decimal: Literal[".", ","] = ".",
    skip_lines: int = 0,
    comment: str = "#",
) -> TextTable:
    """Read a delimited text file with a header line.

    Blank lines and lines that start with ``comment`` are passed over. A carriage
    return counts as a blank, wherever it stands in a line.

    Parameters
    ----------
    path : Path
    delimiter : str, optional
        Guessed from the header line when left out: comma, semicolon or tab.
    decimal : {".", ","}
    skip_lines : int
        Lines before the header line, such as a test machine's preamble.
    comment : str
        Empty: no comments.

    Raises
    ------
    CurveError
        The file cannot be read as text, has no header, fewer than two rows, a
        row of another length than the header, or a column twice.
    """
    lines = _content(path, skip_lines, comment)
    if not lines:
        remedy = "lower skip_lines in the loader's settings" if skip_lines else "export the data anew"
        raise CurveError(f"{path}: no header and no rows after line {skip_lines}; {remedy}")
    header_line, header_text = lines[0]
    split = delimiter or _guess(header_text, decimal)
    cells = (cell.strip(' "') for _, text in lines[1:] for cell in text.split(split))
    if lines[1:] and not any(map(_LIKE_A_NUMBER.match, cells)):
        # Any other file is none of a message's business.
        raise CurveError(f"{path}: no cell holds a number, so this is no table of curves; check the path")
    header = _cells(path, header_line, header_text, split)
    _check_header(path, header_line, header)
    rows = tuple((line, _cells(path, line, text, split)) for line, text in lines[1:])
    _check_rows(path, header, rows)
    return TextTable(path=path, decimal=decimal, header=header, header_line=header_line, rows=rows)


def _content(path: Path, skip_lines: int, comment: str) -> list[tuple[int, str]]:
    """Lines that hold something, with their number in the file."""
    numbered = [(n, text.replace("\r", " ")) for n, text in enumerate(_text(path).split("\n"), start=1)]
    return [
        (n, text)
        for n, text in numbered[skip_lines:]
        if text.strip() and not (comment and text.lstrip().startswith(comment))
    ]


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if not raw.strip():
        raise CurveError(f"{path}: the file is empty; export the data anew")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CurveError(f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8") from None
    if "\0" in text:
        raise CurveError(f"{path}: byte {raw.index(0)} is zero, so this is no text; give a CSV or TSV file")
    return text if "\n" in text else text.replace("\r", "\n")


def _guess(header: str, decimal: str) -> str:
    candidates = [d for d in DELIMITERS if d != decimal]
    return max(candidates, key=header.count)


def _cells(path: Path, line: int, text: str, delimiter: str) -> tuple[str, ...]:
    try:
        (cells,) = csv.reader([text], delimiter=delimiter, strict=True)
    except csv.Error as error:
        raise CurveError(f"{path}: line {line}: {error}; close the quotation marks") from None
    return tuple(cell.strip() for cell in cells)


def _check_header(path: Path, line: int, header: Sequence[str]) -> None:
    if all(_NUMBER.fullmatch(name.replace(",", ".")) for name in header):
        raise CurveError(
            f"{path}: line {line} holds numbers where column names belong; "
            "add a header line such as depth_mm,force_N"
        )
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise CurveError(
            f"{path}: line {line} names column '{twice[0]}' more than once; give each its own name"
        )


def _check_rows(path: Path, header: Sequence[str], rows: Sequence[tuple[int, tuple[str, ...]]]) -> None:
    for line, cells in rows:
        if len(cells) != len(header):
            raise CurveError(
                f"{path}: line {line} has {len(cells)} cells where the header has {len(header)}; "
                "repair the row, or set delimiter or skip_lines in the loader's settings"
            )
    if len(rows) < 2:
        found = "only one row of data" if rows else "a header and no data"
        raise CurveError(f"{path}: {found}; a curve needs at least two rows")
