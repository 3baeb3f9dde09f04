"""Layout of a delimited text file: guessed from its first lines, or as the study gives it."""

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, product, zip_longest
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from palpate.domain.component import Settings
from palpate.errors import CurveError
from palpate.experiment.delimited.header_units import bare_unit, is_units_line, kind_of, stated_units, unit_in

if TYPE_CHECKING:
    import polars as pl

BLANKS = "blanks"
DELIMITERS: dict[str, str] = {",": ",", ";": ";", "tab": "\t", "\t": "\t", "|": "|", BLANKS: BLANKS}
"""What is between cells, by its word in the settings."""
NUMBERS = {
    ".": r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eEdD][+-]?[0-9]+)?",
    ",": r"[+-]?([0-9]+,?[0-9]*|,[0-9]+)([eE][+-]?[0-9]+)?",
}
"""Patterns of a finite number by its decimal mark."""
_THOUSANDS = r"[+-]?[1-9]\d{0,2}([%s'\u00a0\u202f ]\d{3})+(\%s\d*)?"
THOUSANDS = {".": _THOUSANDS % (",", "."), ",": _THOUSANDS % (".", ",")}
"""Patterns of a number with marks between its thousands, by its decimal mark."""
NO_VALUE = r"(?i:[+-]?nan|na|n/a|null|none|-*)"
"""Pattern of a cell without a value."""
_HEX = r"0[xX][0-9A-Fa-f]+"
_DATE = (
    r"(?i:(\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}[T ]+\d{1,2}:\d\d(:\d\d([.,]\d+)?)?|\d{1,2}:\d\d:\d\d([.,]\d+)?)"
    r"( ?[AP]M)?(Z|[+-]\d\d:\d\d)?)"
)
NO_NUMBERS = ("text", "hex")
"""Kinds of columns that are not read."""
HEXADECIMAL = "hexadecimal counts; write decimal numbers in their units"
_LIST = re.compile(r"[A-Za-z]*[\[(](.*)[\])]")  # p[…] is a pose of Universal Robots
_LIST_WITH_COMMAS = r'(^|,)\s*([A-Za-z]*\[(?:[^\[\]"]|\[[^\[\]"]*\])*,(?:[^\[\]"]|\[[^\[\]"]*\])*\])'
BETWEEN_NUMBERS = r"[\s,;\[\]()]+"
"""Pattern of all that is between the numbers of a list, which may hold lists."""
_LABVIEW, _LABVIEW_HEAD = "LabVIEW Measurement", "***End_of_Header***"
_UNIT_LABELS = frozenset(("y_unit_label", "unit", "units", "einheit", "einheiten"))
"""First cells, in small letters, of a line above the names that holds the units of the columns below it."""
_COMMENT_LABEL = re.compile(r"(columns?|fields?|names?|spalten)\s*[:=]\s*", re.IGNORECASE)
_SNIFFED_LINES, _SAMPLED_LINES, _SAMPLED_ROWS = 400, 60, 20
_LONGEST_LINE, _LONGEST_PREAMBLE = 100_000, 4000


Encoding = Literal["utf-8", "utf-16", "latin-1", "cp1252", "cp1251", "cp1250", "shift_jis", "gb18030"]
Mark = Literal[".", ","]


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
    """Layout of one table: its marks, the lines of its first row and of its names, and its columns.

    ``header_line`` is 0 where the names are in a comment or in the settings; ``kinds`` are as of a cell, by
    the first rows. ``steps`` are the first time and the time between rows [s] that LabVIEW writes.
    """

    delimiter: str
    decimal: Mark
    comment: str
    first_line: int
    header_line: int
    names: tuple[str, ...]
    is_named: bool  # by the file or by the settings, not by number alone
    units: tuple[str, ...]
    kinds: tuple[str, ...]
    steps: tuple[float, float] | None = None

    @property
    def first_number(self) -> int:
        """Index of the first column of numbers or dates."""
        return next((i for i, kind in enumerate(self.kinds) if kind not in NO_NUMBERS), 0)


# ------------------------------------------------------------------------------- lines and cells


def lines_of(text: str) -> "pl.DataFrame":
    """Lines of a text, counted from 1."""
    import polars as pl

    texts = text.split("\n")
    odd = (i for i, line in enumerate(texts[:_SNIFFED_LINES]) if line.count('"') % 2)
    for begin, end in zip(odd, odd, strict=False):
        cells = [one.strip() for one in texts[begin : end + 1]]
        is_cell = re.search(r'(^|[,;\t|])\s*"[^"]*$', cells[0])
        if is_cell and not any(re.match(r'"?[-+.,]?\d', one) for one in cells):  # names on two lines
            texts[begin : end + 1] = [" ".join(cells), *[""] * (end - begin)]
    lines = pl.DataFrame({"text": texts}).with_row_index("line", offset=1)
    return lines.with_columns(pl.col("text").str.strip_chars(" \r"))


def body_of(lines: "pl.DataFrame", comment: str) -> "pl.DataFrame":
    """Lines that are no comment, and have a letter or a digit."""
    import polars as pl

    text = pl.col("text")
    is_comment = text.str.starts_with(comment) if comment else pl.lit(value=False)
    return lines.filter(~is_comment & text.str.contains(r"[\p{L}\p{N}]"))


def split(lines: "pl.DataFrame", delimiter: str) -> "pl.DataFrame":
    """Lines that are ready to be cut, with their counts of cells."""
    import polars as pl

    between, text, has_lists = delimiter, pl.col("text"), False
    if delimiter == BLANKS:
        between, text = "\t", text.str.replace_all(r"\s+", "\t").str.strip_chars()
    elif has_lists := delimiter == "," and lines["text"].str.contains("[", literal=True).any():
        text = text.str.replace_all(_LIST_WITH_COMMAS, '${1}"${2}"')
    bare, is_open = text, pl.lit(value=False)
    if has_lists or lines["text"].str.contains('"', literal=True).any():
        text = text.str.replace_all(r'([\[(])\s*""?\s*([\])])', "${1}″${2}")  # inches
        bare = text.str.replace_all('"([^"]|"")*"', "\x01")
        is_open = bare.str.contains('"', literal=True)
        # Quotation marks around a part of a cell are characters like others.
        is_odd = is_open | bare.str.contains(rf"[^{between}]\x01|\x01[^{between}]")
        text = (
            pl.when(is_odd)
            .then(text.str.replace_all(r'(\pL)\s+"', "$1 ″").str.replace_all('"', ""))
            .otherwise(text)
        )
        bare = pl.when(is_odd).then(text).otherwise(bare)
    n_cells = bare.str.count_matches(between, literal=True) + 1
    return lines.with_columns(text, n_cells=n_cells, is_open=is_open)


def cells_of(lines: "pl.DataFrame", delimiter: str, indices: Iterable[int]) -> "pl.DataFrame":
    """Cells of split lines as text, by the column's index."""
    import polars as pl

    wanted, between = sorted(indices), "\t" if delimiter == BLANKS else delimiter
    # The first line has as many cells as are wanted, so that no row is too long or too short.
    body = "\n".join([between * (wanted[-1] + 1), lines["text"].str.join("\n").item()])
    read = pl.read_csv(
        io.BytesIO(body.encode()),
        has_header=False,
        columns=wanted,
        separator=between,
        quote_char='"' if '"' in body else None,
        infer_schema=False,
        truncate_ragged_lines=True,
    )
    return read[1:].fill_null("").rename(dict(zip(read.columns, map(str, wanted), strict=True)))


def _rows(lines: "Sequence[str] | pl.Series", delimiter: str) -> list[list[str]]:
    """Cells of each of some lines."""
    import polars as pl

    parted = split(pl.DataFrame({"text": lines}), delimiter)
    counts = parted["n_cells"].to_list()
    cells = cells_of(parted, delimiter, range(max(counts))).rows()
    return [[cell.strip() for cell in row[:n]] for row, n in zip(cells, counts, strict=True)]


def numbers_in(cell: str) -> int:
    """Count of numbers in a cell that is a list of at least two; 0 for any other cell."""
    found = _LIST.fullmatch(cell)
    parts = re.sub(BETWEEN_NUMBERS, " ", found[1]).split() if found else []
    return len(parts) if len(parts) > 1 and all(re.fullmatch(NUMBERS["."], part) for part in parts) else 0


def unit_of_cell(cell: str, decimal: str) -> str:
    """Unit behind the number of a cell, such as "0.5 sec"; empty where there is none that is known."""
    found = re.fullmatch(rf"{NUMBERS[decimal]}\s*([^\W\d_][^\d_]*|[°%])", cell)
    return found[found.re.groups] if found and kind_of(found[found.re.groups]) else ""


def kind_of_cell(cell: str, decimal: str) -> str:
    """``number``, ``quantity``, ``date``, ``list``, ``hex``, ``text``, or ``none`` without a value."""
    other = r"\." if decimal == "," else ","
    marked = rf"(?![+-]?\d+({other}\d+)+$){THOUSANDS[decimal]}"  # 1,000 alone may be a thousand, or one
    patterns = {"number": f"{NUMBERS[decimal]}|{marked}", "none": NO_VALUE, "date": _DATE, "hex": _HEX}
    found = next((kind for kind, pattern in patterns.items() if re.fullmatch(pattern, cell)), "")
    return found or ("list" if numbers_in(cell) else "quantity" if unit_of_cell(cell, decimal) else "text")


# ------------------------------------------------------------------------------------- a layout


def find_layout(source: str, lines: "pl.DataFrame", wanted: TextFormat) -> Layout:
    """Layout of a table, called ``source`` in messages, by its first lines and what the study gives.

    A CurveError where there is no line of names, or are no rows of numbers.
    """
    skipped = _preamble(source, lines, wanted) if wanted.skip_lines is None else wanted.skip_lines
    every = lines.head(skipped + _SNIFFED_LINES)
    _refuse_messages(source, every["text"].head(_SNIFFED_LINES))
    if wanted.skip_lines is None and every["text"].head(1).str.starts_with(_LABVIEW).any():
        heads = every.filter(every["text"].str.starts_with(_LABVIEW_HEAD))["line"].head(2).to_list()
        skipped = max(heads, default=0)
    lines = every.filter(every["line"] > skipped).head(_SNIFFED_LINES)
    if lines.filter(lines["text"].str.len_bytes() > _LONGEST_LINE).height:
        raise CurveError(f"{source}: a line of more than {_LONGEST_LINE} characters; no table of numbers")
    comment = _comment_of(lines["text"].to_list()) if wanted.comment is None else wanted.comment
    body = body_of(lines, comment)
    if body.is_empty():
        raise CurveError(
            f"{source}: no names and no rows after line {skipped}; lower skip_lines, or export again"
        )
    delimiter, decimal = _marks(source, body.tail(_SAMPLED_LINES), wanted)
    numbers, rows = body["line"].to_list(), _rows(body["text"], delimiter)
    if wanted.decimal is None:
        _check_thousands(source, rows, decimal)
    kinds = [[kind_of_cell(cell, decimal) for cell in cells] for cells in rows]
    if not any(map(_n_values, kinds)):  # 0.2 mm in every cell
        kinds = [[kind.replace("quantity", "number") for kind in row] for row in kinds]
    if rows[1:] and not any(map(_n_values, kinds)):  # a message shows nothing of another file
        raise CurveError(f"{source}: no cell holds a number, so this is no table of numbers; check the path")
    start = _first_row(kinds)
    width = max(map(_filled, rows[start : start + _SAMPLED_ROWS]), default=0)
    header, below = _header(rows, kinds, start, wanted)
    sampled = rows[below : below + _SAMPLED_ROWS]
    names = _names(body["text"][header], delimiter, width) if header is not None else wanted.names or []
    over: list[str] = []
    if header is not None and wanted.names is None:
        nearest = body_of(every.filter(every["line"] == numbers[header] - 1), comment)
        over = _rows(nearest["text"], delimiter)[0] if len(nearest) else []
        names = _apart(names, over)
        # R counts the rows, and names no column for it.
        counts = [row[0] for row in sampled if len(row) == len(names) + 1]
        are_counts = len(counts) > 1 and counts == [str(k) for k in range(1, len(sampled) + 1)]
        names = ["row", *names] if are_counts and delimiter != "," else names
    if not names:
        above = lines.filter(lines["line"] < numbers[min(start, len(numbers) - 1)])["text"].to_list()
        names = _names_in_comment(above, comment, delimiter, width)
    if not names and width > len(rows) and all(row[:1] == ["text"] for row in kinds):
        raise CurveError(f"{source}: each line begins with its name; transpose the table")
    is_named, names = bool(names), names or [f"column {index}" for index in range(1, width + 1)]
    if below == len(rows) or not names:
        raise CurveError(f"{source}: a line of names and no data; export the file again")
    if wanted.names is not None and len(names) < width:
        raise CurveError(
            f"{source}: line {numbers[below]} has {width} cells where names has {len(names)} entries; "
            "give each column a name"
        )
    if names[-1].lower() in ("comment", "comments", "kommentar"):  # rows without a remark leave it out
        names = names[:width]
    above = every.filter(every["line"] < numbers[below])["text"].to_list()
    between = None if delimiter == BLANKS else delimiter
    parted = ([cell.strip(' "') for cell in line.split(between)] for line in above if line)
    labels = {label.lower(): cells for label, *cells in parted}
    remarks = [line.lstrip(f"{comment} ") for line in above if comment and line.startswith(comment)]
    found = _rows(remarks, delimiter) if any(remarks) else []
    # All of its cells: "radius, mm" is a remark, and no units of two columns.
    commented = [cells for cells in found if len(cells) == len(names) and is_units_line(cells, share=1.0)]
    under = rows[max(below - 1, 0) if header is None else header + 1 : below]
    if measured := [cells for cells in under if is_units_line(cells)]:
        units = [bare_unit(cell) for cell in measured[-1]]
    else:  # a name's own unit counts first: LabVIEW labels what nobody has set with volts
        labelled = (["", *labels[label]] for label in reversed(labels) if label in _UNIT_LABELS)
        stated = over if is_units_line(over) else [stated_units("\n".join(above), names), *commented][-1]
        given = zip(names, next(labelled, stated), strict=False)
        units = ["" if unit_in(name)[1] else bare_unit(cell) for name, cell in given]
    kinds_of = _kinds(len(names), sampled, decimal)
    units = [*units, *[""] * len(names)][: len(names)]
    if len({*names}) < len({*zip(names, units, strict=True)}):  # of one name the units tell columns apart
        names = [f"{n} ({unit})" if names.count(n) > 1 else n for n, unit in zip(names, units, strict=True)]
    for index in (k for k, kind in enumerate(kinds_of) if kind == "quantity"):
        units[index] = unit_of_cell(rows[below][index], decimal)
    return Layout(
        delimiter=delimiter,
        decimal=decimal,
        comment=comment,
        first_line=numbers[below],
        header_line=0 if header is None else numbers[header],
        names=tuple(names),
        is_named=is_named,
        units=tuple(units),
        kinds=kinds_of,
        steps=_steps(labels),
    )


def _preamble(source: str, lines: "pl.DataFrame", wanted: TextFormat) -> int:
    """Count of lines before the first window in which rows of numbers begin; 0 where they begin in none."""
    last = min(lines.height, _LONGEST_PREAMBLE) if lines.height > _SNIFFED_LINES else 0
    for after in range(0, last, _SNIFFED_LINES - _SAMPLED_LINES):
        window = lines[after : after + _SNIFFED_LINES]
        window = window.filter(window["text"].str.len_bytes() <= _LONGEST_LINE)
        if not (body := body_of(window, _comment_of(window["text"].to_list()))).is_empty():
            delimiter, decimal = _marks(source, body.tail(_SAMPLED_LINES), wanted)
            rows = _rows(body["text"], delimiter)
            kinds = [[kind_of_cell(cell, decimal) for cell in cells] for cells in rows]
            if _first_row(kinds) < len(kinds):
                return after
    return 0


def _refuse_messages(source: str, lines: "pl.Series") -> None:
    """Refuse the text of messages, one key and value in each line."""
    for pattern, lines_are, remedy in (
        (r"^\s*(- )?[A-Za-z_]\w*:(\s+\S.*)?$|^---$", "lines of 'key: value', as of rostopic echo",
         "write one row for each message with rostopic echo -p or ros2 topic echo --csv, or give the bag"),
        (r"((^|\s)[A-Za-z_]\w*\s*[:=]\s*[-+]?\.?\d.*){2}", "a name before each number of a line",
         "write the names once, in a line above the numbers"),
    ):  # fmt: skip
        if lines.len() > _SAMPLED_ROWS and lines.str.contains(pattern).sum() > 0.9 * lines.len():
            raise CurveError(f"{source}: {lines_are}, and no table; {remedy}")


def _check_thousands(source: str, rows: Sequence[Sequence[str]], decimal: Mark) -> None:
    """Refuse marks between thousands that look like decimal ones: all as in 1,000, next to a whole 800."""
    for cells in zip_longest(*rows, fillvalue=""):
        marked = [cell for cell in cells if decimal in cell and re.fullmatch(NUMBERS[decimal], cell)]
        plain = [cell for cell in cells if re.fullmatch(r"[+-]?[1-9]\d\d", cell)]
        if plain and marked and all(re.fullmatch(r"[+-]?[1-9]\d?\d?[.,]\d{3}", cell) for cell in marked):
            raise CurveError(
                f"{source}: '{marked[0]}' next to '{plain[0]}' has marks between its thousands; export the "
                f'file without them, or set decimal = "{decimal}" in the loader\'s settings'
            )


def _steps(labels: Mapping[str, Sequence[str]]) -> tuple[float, float] | None:
    """First time and time between rows [s] in the lines X0 and Delta_X of LabVIEW."""
    values = {label: cells[0].replace(",", ".") for label, cells in labels.items() if cells}
    found = [values.get(label, "") for label in ("x0", "delta_x")]
    is_time = values.get("x_dimension", "Time") == "Time"
    are_numbers = all(re.fullmatch(NUMBERS["."], cell) for cell in found)
    return (float(found[0]), float(found[1])) if is_time and are_numbers else None


def _comment_of(lines: Sequence[str]) -> str:
    """Mark at the start of comments: as the first line has it where others do not."""
    first, second = [*filter(None, lines), "", ""][:2]
    # %time is a name of ROS; "% time", or a second such line, is a comment.
    marks = ("#", "%", "//", "!")
    found = (m for m in marks if re.match(rf"{m}\s", first) or first[: len(m)] == second[: len(m)] == m)
    is_between = sum(";" in line for line in lines) >= len(lines) / 2
    return ";" if first.startswith(";") and not is_between else next(found, "#")


def _filled(cells: Sequence[str]) -> int:
    """Count of cells without the empty ones at the end."""
    return max((i for i, cell in enumerate(cells, start=1) if cell), default=0)


def _marks(source: str, lines: "pl.DataFrame", wanted: TextFormat) -> tuple[str, Mark]:
    """Delimiter and decimal mark under which most lines are rows of numbers of one length."""
    delimiters = [DELIMITERS[wanted.delimiter]] if wanted.delimiter else dict.fromkeys(DELIMITERS.values())
    decimals: list[Mark] = [wanted.decimal] if wanted.decimal else [".", ","]
    # Quotation marks tell a decimal comma from one between cells.
    has_quotes = lines["text"].str.contains('"', literal=True).any()
    marks = [(d, m) for d in delimiters for m in decimals if d != m or has_quotes]
    if not marks:
        raise CurveError(f"{source}: delimiter and decimal are both ','; give another delimiter")
    rows = {delimiter: _rows(lines["text"], delimiter) for delimiter in delimiters}
    return max(marks, key=lambda mark: _likelihood(rows[mark[0]], *mark))


def _likelihood(rows: Sequence[Sequence[str]], delimiter: str, decimal: str) -> tuple[float, float, bool]:
    """Share of cells that are numbers in rows of the usual length, how many a row has, and no comma."""
    lengths = [len(row) for row in rows]
    usual = max(set(lengths), key=lengths.count)
    if usual < 2:
        return 0.0, 0.0, False
    kinds = [kind_of_cell(cell, decimal) for row in rows if len(row) == usual for cell in row]
    n_numbers = len(kinds) - kinds.count("text")
    # Blanks are in many names and remarks: of two that fit alike they are the worse.
    share = (0.9 if delimiter == BLANKS else 1.0) * n_numbers / len(kinds) * lengths.count(usual) / len(rows)
    return share, n_numbers / len(rows), delimiter != ","  # which may be between thousands


def _n_values(kinds: Sequence[str]) -> int:
    return sum(kind in ("number", "date", "list", "hex") for kind in kinds)


def _is_values(kinds: Sequence[str]) -> bool:
    """Whether at least half of the cells that hold something are values."""
    return 2 * _n_values(kinds) >= len(kinds) - kinds.count("none") > 0


def _first_row(kinds: Sequence[Sequence[str]]) -> int:
    """Index of the first of two lines that look like the rows of values; their count where none does."""
    dense = [row for row in kinds if _is_values(row)]
    lengths = [len(row) for row in dense]
    usual = max(set(lengths), key=lengths.count, default=0)
    columns = list(zip(*(row for row in dense if len(row) == usual), strict=True))
    numeric = [i for i, column in enumerate(columns) if _n_values(column) > column.count("text")]

    def is_row(row: Sequence[str]) -> bool:
        cells = [row[i] for i in numeric if i < len(row) and row[i] != "none"]
        return len(row) >= usual and cells[:1] not in ([], ["text"]) and _is_values(cells)

    found = [is_row(row) for row in kinds]
    return next((i for i, row in enumerate(found) if row and all(found[i + 1 : i + 2])), len(kinds))


def _header(
    rows: Sequence[Sequence[str]], kinds: Sequence[Sequence[str]], start: int, wanted: TextFormat
) -> tuple[int | None, int]:
    """Index of the line of names, None where there is none, and the index of the first line of data."""
    if wanted.names is not None or start == 0:
        return None, start
    fewest = min(2, _filled(rows[start])) if start < len(rows) else 1
    header = 0 if wanted.skip_lines is not None else start - 1
    # A damaged row is no line of names, nor is one with a number under as many words.
    while header > 0:
        row = kinds[header]
        words = next((each for each in reversed(kinds[:header]) if not _n_values(each)), [])
        if not (_is_damaged(row) or (_n_values(row) and words == ["text"] * len(row))):
            break
        header -= 1
    # Names may be numbers, but not the first of them.
    is_row = _is_damaged(kinds[header]) and kinds[header][:1] != ["text"] and header + 1 < len(rows)
    if is_row or _filled(rows[header]) < fewest:
        return None, start
    above = rows[header - 1] if header > 1 and wanted.skip_lines is None else []
    if is_units_line(above) and len({*rows[header]}) < len(above) == _filled(rows[header - 2]):
        header -= 2  # remarks under names and units, as of Origin
    is_units = header > 0 and wanted.skip_lines is None and is_units_line(rows[header])
    if is_units and not _n_values(kinds[header - 1]) and _filled(rows[header - 1]) >= fewest:
        header -= 1
    return header, next((i for i in range(header + 1, start) if _n_values(kinds[i])), max(start, header + 1))


def _is_damaged(kinds: Sequence[str]) -> bool:
    """Whether a line before the rows is one of them with a word in it, or with quotation marks left open."""
    n_most = max(1, kinds.count("text"))
    return not kinds or (_is_values(kinds) and (kinds[0] != "text" or _n_values(kinds) > n_most))


def _names(line: str, delimiter: str, width: int) -> list[str]:
    """Names of the columns in a line, each as it stands there; numbered where a cell is empty."""
    (cells,) = _rows([line], delimiter)
    if delimiter == BLANKS and len(cells) != width:
        apart = re.split(r"\s{2,}|\t", line)
        with_units = re.findall(r"\S+(?:\s+[\[(][^\])]*[\])])?", line)
        cells = next((each for each in (apart, with_units) if len(each) == width), cells)
    n_names = max(_filled(cells), min(len(cells), width))
    return [cell or f"column {index}" for index, cell in enumerate(cells[:n_names], start=1)]


def _apart(names: list[str], above: Sequence[str]) -> list[str]:
    """Names with the groups in the line above them, where the groups tell equal names apart."""
    groups: Iterable[str] = accumulate(above, lambda before, cell: cell or before)
    grouped = [f"{group} {name}".strip() for group, name in zip(groups, names, strict=False)]
    is_one_table, n_names = period_of(names) == len(names), len({*names})
    return grouped if is_one_table and n_names < len(names) == len({*grouped}) else names


def period_of(names: Sequence[str]) -> int:
    """Count of columns of the first of several tables side by side, which have the same names."""
    n_names = len(names)
    return next((n for n in range(2, n_names) if [*names] == [*names[:n]] * (n_names // n)), n_names)


def _names_in_comment(lines: Sequence[str], comment: str, delimiter: str, width: int) -> list[str]:
    """Names in the last comment before the rows; none where it holds no name for each column."""
    comments = [line for line in lines if comment and line.startswith(comment)]
    bare = (_COMMENT_LABEL.sub("", line.lstrip(comment).strip(), count=1) for line in comments[:-3:-1])
    for line, between in product(filter(None, bare), (delimiter, *DELIMITERS.values())):
        names = _names(line, between, width)
        are_words = not any(kind_of_cell(name, ".") == "number" for name in names)
        if len(names) == width > 0 and are_words and not is_units_line(names, share=1.0):
            return names
    return []


def _kinds(n_columns: int, rows: Sequence[Sequence[str]], decimal: str) -> tuple[str, ...]:
    """Kind of each column, by the first rows."""
    found = []
    for index in range(n_columns):
        cells = [row[index] for row in rows if index < len(row)]
        kinds = [kind_of_cell(cell, decimal) for cell in cells if cell]
        whole = kinds[0] if len({*kinds}) == 1 and kinds[0] not in ("number", "text") else ""
        # 4E20 is no number where other cells of its length are 4E3F.
        is_bare = len({*map(len, cells)}) == 1 and all(re.fullmatch("[0-9A-F]{4,8}", cell) for cell in cells)
        whole = "hex" if is_bare and any(re.search(r"\d[A-DF]", cell) for cell in cells) else whole
        n_marked = sum(bool(re.fullmatch(THOUSANDS[decimal], cell)) for cell in cells)
        n_numbers = max(kinds.count("number"), n_marked) + kinds.count("none")
        found.append(whole or ("number" if 2 * n_numbers >= len(kinds) else "text"))
    return tuple(found)
