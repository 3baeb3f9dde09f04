"""Layout of a delimited text file: guessed from its first lines, or as the study gives it."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from palpate.domain.component import Settings
from palpate.errors import CurveError
from palpate.experiment.delimited.characters import Encoding
from palpate.experiment.delimited.header_units import UNITS, bare_unit, kind_of

BLANKS = "blanks"
DELIMITERS: dict[str, str] = {",": ",", ";": ";", "tab": "\t", "\t": "\t", "|": "|", BLANKS: BLANKS}
"""What is between cells, by its word in the settings."""
NUMBERS = {
    ".": r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?",
    ",": r"[+-]?([0-9]+,?[0-9]*|,[0-9]+)([eE][+-]?[0-9]+)?",
}
"""Patterns of a finite number by its decimal mark."""
NO_VALUE = r"(?i)[+-]?nan|na|n/a|null|none|-|--|"
"""Pattern of a cell without a value."""
DATE = (
    r"(?i)(\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ]+\d{1,2}:\d\d(:\d\d([.,]\d+)?)?|\d{1,2}:\d\d:\d\d([.,]\d+)?)"
    r"( ?[AP]M)?(Z|\+00:00)?"
)
"""Pattern of a date and time, or a time of day."""
LIST = re.compile(r"[\[(]\s*([^\[\]()]*?)\s*[\])]")
_BETWEEN = re.compile(r"[\s,;]+")
_COMMENTS = ("#", "%", "//", "!")
_COMMENT_LABEL = re.compile(r"(columns?|fields?|names?|spalten)\s*[:=]\s*", re.IGNORECASE)
_SAMPLED_LINES = 60
_SAMPLED_ROWS = 20
_LONGEST_LINE = 100_000

Mark = Literal[".", ","]
Numbered = tuple[int, str]
Row = tuple[int, list[str]]


class TextFormat(Settings):
    """Layout of a text file; whatever is left out is guessed from its first lines."""

    delimiter: Literal[",", ";", "tab", "\t", "|", "blanks"] | None = Field(
        default=None, description="Between cells; blanks means any run of blanks and tabs."
    )
    decimal: Mark | None = Field(default=None, description="Decimal mark.")
    skip_lines: int | None = Field(default=None, ge=0, description="Lines before the header line.")
    comment: str | None = Field(
        default=None, description="Lines that start with it are passed over; empty: none."
    )
    encoding: Encoding | None = Field(default=None, description="Encoding of the characters.")
    names: list[str] | None = Field(
        default=None, min_length=1, description="Names of the columns, for a file without a line of names."
    )
    block: int | None = Field(
        default=None, ge=1, description="Which of several tables in the file is read, counted from 1."
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Layout of one table."""

    delimiter: str
    """One character, or ``BLANKS``."""
    decimal: Mark
    first_line: int
    """Line of the first row of data, counted from 1."""
    header_line: int
    """Line of the names; 0 where they are in a comment or in the settings."""
    names: tuple[str, ...]
    units: tuple[str, ...]
    """From a line of units under the names; empty texts without one."""
    kinds: tuple[str, ...]
    """``number``, ``date``, ``list`` or ``text`` by column, from the first rows."""
    comment: str

    @property
    def first_number(self) -> int:
        """Index of the first column of numbers or dates."""
        return next((i for i, kind in enumerate(self.kinds) if kind != "text"), 0)


def split(line: str, delimiter: str) -> list[str]:
    """Cells of a line, without surrounding blanks; none where quotation marks do not match."""
    if delimiter == BLANKS:
        return line.split()
    plain = line.replace("\r", " ").strip(" \n")  # a carriage return is a blank
    try:
        (cells,) = csv.reader([quoted_lists(plain)], delimiter=delimiter, strict=True) if plain else ([],)
    except csv.Error:
        return []
    return [cell.strip() for cell in cells]


def quoted_lists(line: str) -> str:
    """Line with quotation marks around lists that hold commas: 0.1,[1, 2],3."""
    return re.sub(r'(^|[,;|\t])\s*(\[[^\]"]*\])', r'\1"\2"', line) if "[" in line else line


def numbers_in(cell: str) -> int:
    """Count of numbers in a cell that is a list of at least two; 0 for any other cell."""
    found = LIST.fullmatch(cell)
    parts = _BETWEEN.split(found[1]) if found else []
    return len(parts) if len(parts) > 1 and all(re.fullmatch(NUMBERS["."], part) for part in parts) else 0


def is_passed_over(line: str, comment: str) -> bool:
    """Whether a line is a comment, or has neither letter nor digit."""
    return bool(comment and line.lstrip().startswith(comment)) or not any(map(str.isalnum, line))


def kind_of_cell(cell: str, decimal: str) -> str:
    """``number``, ``date``, ``list``, ``text``, or ``none`` for a cell without a value."""
    if re.fullmatch(NUMBERS[decimal], cell):
        return "number"
    if re.fullmatch(NO_VALUE, cell):
        return "none"
    if re.fullmatch(DATE, cell):
        return "date"
    return "list" if numbers_in(cell) else "text"


def comment_of(lines: Sequence[str], wanted: TextFormat) -> str:
    """What comments begin with: as given, or as the first line does where others do not."""
    if wanted.comment is not None:
        return wanted.comment
    first, second = [*(line.strip() for line in lines if line.strip()), "", ""][:2]
    # %time is a name of ROS; "% time", or a second such line, is a comment.
    is_comment = {
        mark: first.startswith((f"{mark} ", f"{mark}\t")) or second.startswith(mark) for mark in _COMMENTS
    }
    found = next((mark for mark in _COMMENTS if first.startswith(mark) and is_comment[mark]), "#")
    is_between = sum(";" in line for line in lines) >= len(lines) / 2
    return ";" if first.startswith(";") and not is_between else found


def find_layout(source: str, lines: Sequence[Numbered], wanted: TextFormat) -> Layout:
    """Layout of a table, called ``source`` in messages, from its first lines and what the study gives.

    A CurveError where there is no line of names, or are no rows of numbers.
    """
    if any(len(line) > _LONGEST_LINE for _, line in lines):
        raise CurveError(
            f"{source}: a line of more than {_LONGEST_LINE} characters; this is no table of numbers"
        )
    lines = [one for one in lines if one[0] > (wanted.skip_lines or 0)]
    comment = comment_of([line for _, line in lines], wanted)
    body = [(n, line) for n, line in lines if not is_passed_over(line, comment)]
    if not body:
        raise CurveError(
            f"{source}: no names and no rows after line {wanted.skip_lines or 0}; "
            "lower skip_lines, or export the file again"
        )
    delimiter, decimal = _marks(source, [line for _, line in body], wanted)
    rows = [(n, split(line, delimiter)) for n, line in body]
    kinds = [[kind_of_cell(cell, decimal) for cell in cells] for _, cells in rows]
    if rows[1:] and not any(kind in ("number", "date", "list") for row in kinds for kind in row):
        # What another file holds does not belong into a message.
        raise CurveError(f"{source}: no cell holds a number, so this is no table of numbers; check the path")
    start = _first_row(kinds)
    width = max((_filled(cells) for _, cells in rows[start : start + _SAMPLED_ROWS]), default=0)
    header, below = _header(rows, kinds, start, wanted)
    names = _names(body[header][1], delimiter, width) if header is not None else wanted.names or []
    if not names:
        comments = [line for n, line in lines if n < body[min(start, len(body) - 1)][0]]
        names = _names_in_comment(comments, comment, delimiter, width)
    if not names:
        raise CurveError(
            f"{source}: line {rows[start][0]} holds numbers where column names belong; "
            "add a line of names, or give names in the loader's settings"
        )
    data = rows[below:]
    if not data:
        raise CurveError(f"{source}: a line of names and no data; export the file again")
    if wanted.names is not None and len(names) < width:
        raise CurveError(
            f"{source}: line {data[0][0]} has {width} cells where names has {len(names)} entries; "
            "give each column a name"
        )
    above = rows[below - 1][1] if below else []
    units = [bare_unit(cell) for cell in above] if _is_units_line(above) and header != below - 1 else []
    return Layout(
        delimiter=delimiter,
        decimal=decimal,
        first_line=data[0][0],
        header_line=0 if header is None else body[header][0],
        names=tuple(names),
        units=(*units, *[""] * len(names))[: len(names)],
        kinds=_kinds(len(names), [cells for _, cells in data[:_SAMPLED_ROWS]], decimal),
        comment=comment,
    )


def _filled(cells: Sequence[str]) -> int:
    """Count of cells without the empty ones at the end."""
    return max((i for i, cell in enumerate(cells, start=1) if cell), default=0)


def _marks(source: str, lines: Sequence[str], wanted: TextFormat) -> tuple[str, Mark]:
    """Delimiter and decimal mark under which most lines are rows of numbers of one length."""
    delimiters = [DELIMITERS[wanted.delimiter]] if wanted.delimiter else dict.fromkeys(DELIMITERS.values())
    decimals: list[Mark] = [wanted.decimal] if wanted.decimal else [".", ","]
    sample = lines[-_SAMPLED_LINES:]
    has_quotes = any('"' in line for line in sample)  # which tell a decimal comma from one between cells
    marks = [(d, m) for d in delimiters for m in decimals if d != m or has_quotes]
    if not marks:
        raise CurveError(f"{source}: delimiter and decimal are both ','; give another delimiter")
    return max(marks, key=lambda marks: _likelihood(sample, *marks))


def _likelihood(lines: Sequence[str], delimiter: str, decimal: str) -> tuple[float, float]:
    """Share of cells that are numbers, of rows that have the usual length, and how many a row has."""
    rows = [split(line, delimiter) for line in lines]
    lengths = [len(row) for row in rows]
    usual = max(set(lengths), key=lengths.count)
    if usual < 2:
        return 0.0, 0.0
    kinds = [kind_of_cell(cell, decimal) for row in rows if len(row) == usual for cell in row]
    n_numbers = sum(kind in ("number", "none", "list", "date") for kind in kinds)
    # Blanks are in many names and remarks: of two that fit alike they are the worse.
    share = (0.9 if delimiter == BLANKS else 1.0) * n_numbers / len(kinds) * lengths.count(usual) / len(rows)
    return share, n_numbers / len(rows)


_Kinds = Sequence[str]


def _n_values(kinds: _Kinds) -> int:
    return sum(kind in ("number", "date", "list") for kind in kinds)


def _is_values(kinds: _Kinds) -> bool:
    """Whether at least half of the cells that hold something are values."""
    return 2 * _n_values(kinds) >= len(kinds) - kinds.count("none") > 0


def _first_row(kinds: Sequence[_Kinds]) -> int:
    """Index of the first of two lines that look like the rows of values; their count where none does."""
    dense = [row for row in kinds if _is_values(row)]
    lengths = [len(row) for row in dense]
    usual = max(set(lengths), key=lengths.count, default=0)
    columns = list(zip(*(row for row in dense if len(row) == usual), strict=True))
    numeric = [i for i, column in enumerate(columns) if _n_values(column) > column.count("text")]

    def is_row(row: _Kinds) -> bool:
        cells = [row[i] for i in numeric if i < len(row) and row[i] != "none"]
        return len(row) >= usual and cells[:1] not in ([], ["text"]) and _is_values(cells)

    found = [is_row(row) for row in kinds]
    return next((i for i, row in enumerate(found) if row and all(found[i + 1 : i + 2])), len(kinds))


def _header(
    rows: Sequence[Row], kinds: Sequence[_Kinds], start: int, wanted: TextFormat
) -> tuple[int | None, int]:
    """Index of the line of names, None where there is none, and the index of the first line of data."""
    if wanted.names is not None or start == 0:
        return None, start
    fewest = min(2, _filled(rows[start][1])) if start < len(rows) else 1
    header = 0 if wanted.skip_lines is not None else start - 1
    # A row that is damaged is no line of names.
    while header > 0 and (_is_damaged(kinds[header]) or _is_under_names(kinds, header)):
        header -= 1
    # Names may be numbers, but not the first of them.
    is_row = _is_damaged(kinds[header]) and kinds[header][:1] != ["text"] and header + 1 < len(rows)
    if is_row or _filled(rows[header][1]) < fewest:
        return None, start
    above = header - 1
    is_units = above >= 0 and wanted.skip_lines is None and _is_units_line(rows[header][1])
    if is_units and not _n_values(kinds[above]) and _filled(rows[above][1]) >= fewest:
        header = above
    below = header + 1
    while below < start and not _n_values(kinds[below]):
        below += 1
    return header, below


def _is_damaged(kinds: _Kinds) -> bool:
    """Whether a line before the rows is one of them with a word in it, or with quotation marks left open."""
    n_words = kinds.count("text")
    return not kinds or (_is_values(kinds) and (kinds[0] != "text" or _n_values(kinds) > max(1, n_words)))


def _is_under_names(kinds: Sequence[_Kinds], index: int) -> bool:
    """Whether a line with a number is a row: a line of as many words is above, perhaps with rows between."""
    above = next((row for row in reversed(kinds[:index]) if not _n_values(row)), [])
    return bool(_n_values(kinds[index])) and above == ["text"] * len(kinds[index])


def _is_units_line(cells: Sequence[str]) -> bool:
    """Whether most cells of a line are units, as some loggers write them under the names."""
    filled = [cell for cell in cells if bare_unit(cell)]
    known = [
        cell for cell in filled if cell in UNITS or (bare_unit(cell) != cell and kind_of(bare_unit(cell)))
    ]
    return 0 < len(filled) <= 2 * len(known) and all(len(cell) <= 12 for cell in filled)


def _names(line: str, delimiter: str, width: int) -> list[str]:
    """Names of the columns in a line, each as it stands there; numbered where a cell is empty."""
    cells = split(line, delimiter)
    if delimiter == BLANKS and len(cells) != width:
        apart = re.split(r"\s{2,}|\t", line.strip())
        with_units = re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", line)
        cells = next((each for each in (apart, with_units) if len(each) == width), cells)
    n_names = max(_filled(cells), min(len(cells), width))
    return [cell or f"column {index}" for index, cell in enumerate(cells[:n_names], start=1)]


def _names_in_comment(lines: Sequence[str], comment: str, delimiter: str, width: int) -> list[str]:
    """Names in the last comment before the rows; none where it holds no name for each column."""
    comments = [line.strip() for line in lines if comment and line.strip().startswith(comment)]
    if not comments or not width:
        return []
    line = _COMMENT_LABEL.sub("", comments[-1].lstrip(comment).strip(), count=1)
    for between in (delimiter, *DELIMITERS.values()):
        names = _names(line, between, width)
        if len(names) == width and not any(kind_of_cell(name, ".") == "number" for name in names):
            return names
    return []


def _kinds(n_columns: int, rows: Sequence[Sequence[str]], decimal: str) -> tuple[str, ...]:
    """Kind of each column, by the first rows."""
    found = []
    for index in range(n_columns):
        kinds = [kind_of_cell(row[index], decimal) for row in rows if index < len(row) and row[index]]
        whole = next((kind for kind in ("date", "list") if kinds and kinds.count(kind) == len(kinds)), "")
        n_numbers = kinds.count("number") + kinds.count("none")
        found.append(whole or ("number" if 2 * n_numbers >= len(kinds) else "text"))
    return tuple(found)
