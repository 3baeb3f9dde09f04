"""Tables as files: CSV with every digit, LaTeX and Markdown to be printed, none wider than its column."""

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import polars as pl

from palpate.api.files import write_atomically
from palpate.api.fit import explained, mark_of
from palpate.api.report import rounded_rows, shown
from palpate_report.data.tables import TITLES, printed

PREAMBLE = r"\usepackage{booktabs,graphicx}"
"""What a document needs for these tables."""

COLUMN_CHARACTERS = 56
"""Widest table, in characters, that is set in one of two columns."""

_SHRUNK = (
    r"\resizebox*{!}{\ifdim\totalheight>.8\textheight .8\textheight\else\totalheight\fi}{%",
    r"\resizebox{\ifdim\width>\linewidth\linewidth\else\width\fi}{!}{%",
)
_GREEK = {
    letter: unicodedata.name(letter).rpartition(" ")[2].lower().replace("lamda", "lambda")
    for letter in "αβγδεζηθικλμνξπρσςτυφχψω"
}
_ESCAPED = str.maketrans(
    {letter: rf"$\{name}$" for letter, name in _GREEK.items()}
    | {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "$": r"\$",
        "&": r"\&",
        "#": r"\#",
        "%": r"\%",
        "_": r"\_",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        "[": "{[}",  # an optional argument after the end of a row
        "]": "{]}",
        "…": r"\ldots{}",
        "–": "--",
        "·": r"$\cdot$",
        "²": r"$^2$",
        "±": r"$\pm$",
        "≤": r"$\leq$",
        "≥": r"$\geq$",
        "†": r"$^{\dagger}$",
        "‡": r"$^{\ddagger}$",
        "§": r"$^{\S}$",
        "¶": r"$^{\P}$",
        "\n": " ",
        "\r": " ",
    }
)


def escaped(text: str) -> str:
    """Text as LaTeX prints it, whatever it holds; Greek letters for ``pdflatex`` too."""
    return text.translate(_ESCAPED)


def symbol(name: str) -> str:
    """Name of a parameter as a symbol: ``c1`` and ``kappa`` in italics with subscript; else as text."""
    region, dot, last = name.rpartition(".")
    letters, number = re.fullmatch(r"(.*?)(\d*)", last, re.DOTALL).groups()  # type: ignore[union-attr]
    if letters not in _GREEK.values() and len(letters) != 1:
        return escaped(name)
    letter = rf"\{letters}" if letters in _GREEK.values() else escaped(letters)
    return f"{escaped(region + dot)}${letter}{f'_{{{number}}}' if number else ''}$"


def number(text: str) -> str:
    """Text of a number in mathematics, its exponent as a power of ten."""
    mantissa, _, exponent = text.replace("inf", r"\infty").partition("e")
    return f"${mantissa}" + (rf"\times10^{{{int(exponent)}}}$" if exponent else "$")


def head(name: str, unit: str, power: int = 0) -> str:
    """Head of a column: the symbol, a power of ten and the unit."""
    parts = [f"$10^{{{power}}}$" if power else "", "" if unit in ("", "1") else escaped(unit)]
    brackets = r"\,".join(part for part in parts if part)
    return f"{symbol(name)} {{[}}{brackets}{{]}}" if brackets else symbol(name)


def power_of_ten(largest: float) -> int:
    """Power of ten, a multiple of 3, that numbers are divided by to be printed without exponents."""
    if largest == 0.0 or 0.01 <= largest < 1e4:
        return 0
    return 3 * math.floor(math.log10(largest) / 3)


def tabular(
    columns: str, lines: Sequence[str], *, caption: str, label: str, wide: bool, warnings: Sequence[str] = ()
) -> str:
    r"""Lay a table out, shrunk where it would be wider than its column or too long for a page.

    Parameters
    ----------
    columns : str
        Of ``tabular``.
    lines : sequence of str
        Rows, with their ``\\``, and rules.
    caption, label : str
        LaTeX.
    wide : bool
        Whether it spans both columns of a page.
    warnings : sequence of str
        Text of the comment at the head.
    """
    environment = "table*" if wide else "table"
    whole = [
        *(f"% WARNING: {' '.join(text.split())}" for text in warnings),
        f"% {PREAMBLE}",
        rf"\begin{{{environment}}}",
        r"\centering\footnotesize",
        rf"\caption{{{caption}}}",
        rf"\label{{tab:{label}}}",
        *_SHRUNK,
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        *lines,
        r"\bottomrule",
        r"\end{tabular}}}",
        rf"\end{{{environment}}}",
    ]
    return "\n".join(whole) + "\n"


def row(*cells: str) -> str:
    """Join the cells of one row."""
    return " & ".join(cells) + r" \\"


_FORMULA = r"^[=+@\-\t\r]"
"""How a cell begins that a spreadsheet would run."""
_MARKDOWN = str.maketrans(
    {character: f"\\{character}" for character in "\\`*_{}[]<>#|~$&!"} | {"\n": " ", "\r": " "}
)


def write_tables(
    tables: Mapping[str, pl.DataFrame],
    folder: Path,
    paper: Mapping[str, str] = MappingProxyType({}),
    failures: Sequence[str] = (),
) -> tuple[Path, ...]:
    """Write each table as CSV, LaTeX and Markdown, and the tables of a paper, which are LaTeX already.

    Parameters
    ----------
    failures : sequence of str
        Why no parameters can be read, which every table for print states.
    """
    texts = {
        folder / f"{name}{suffix}": text
        for name, table in tables.items()
        for suffix, text in (
            (".csv", _csv(table)),
            (".tex", latex(name, printed(name, table), failures)),
            (".md", markdown(name, printed(name, table), failures)),
        )
    }
    texts |= {folder / f"{name}.tex": text for name, text in paper.items()}
    for path, text in texts.items():
        write_atomically(path, text.encode())
    return tuple(texts)


def _csv(table: pl.DataFrame) -> str:
    """Write a table for a spreadsheet: an apostrophe keeps text that begins like a formula from being one."""
    heads = {name: re.sub(_FORMULA, r"'\g<0>", name) for name in table.columns}
    texts = pl.col(pl.String).str.replace(_FORMULA, "'$0")
    return table.with_columns(texts).rename(heads).write_csv()


def latex(name: str, table: pl.DataFrame, failures: Sequence[str] = ()) -> str:
    """Write a table for LaTeX with the packages ``booktabs`` and ``graphicx``; names are text there.

    A wide table of few rows is transposed, and long texts are broken.

    Parameters
    ----------
    name : str
        Key of ``TITLES``; the label is ``tab:<name>``.
    """
    heads = [escaped(text) for text in table.columns]
    rows = [list(map(_latex_cell, cells, table.dtypes)) for cells in rounded_rows(table)]
    kinds = ["r" if dtype.is_numeric() else "l" for dtype in table.dtypes]
    lengths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    # Most rows of a wide table that become its columns.
    if sum(lengths) > 2 * COLUMN_CHARACTERS and len(rows) <= 6 < len(heads):
        heads, *rows = [list(column) for column in zip(heads, *rows, strict=True)]
        lengths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
        kinds = ["l"] * len(heads)
    return tabular(
        "".join("p{60mm}" if n > COLUMN_CHARACTERS else kind for n, kind in zip(lengths, kinds, strict=True)),
        [row(*heads), r"\midrule", *(row(*cells) for cells in rows)],
        caption=escaped(_caption(name, table, failures)),
        label=name,
        wide=sum(lengths) > COLUMN_CHARACTERS,
        warnings=failures,
    )


def markdown(name: str, table: pl.DataFrame, failures: Sequence[str] = ()) -> str:
    """Write a table for Markdown, under its caption; names are text there, whatever they hold."""
    rule = ["---:" if dtype.is_numeric() else "---" for dtype in table.dtypes]
    head = [text.translate(_MARKDOWN) for text in table.columns]
    rows = ([shown(value).translate(_MARKDOWN) for value in row] for row in rounded_rows(table))
    lines = [f"| {' | '.join(cells)} |" for cells in (head, rule, *rows)]
    warnings = [text for each in failures for text in (f"**WARNING: {each.translate(_MARKDOWN)}**", "")]
    return "\n".join([*warnings, _caption(name, table), "", *lines, ""])


def _caption(name: str, table: pl.DataFrame, failures: Sequence[str] = ()) -> str:
    """Title of a table, why no parameters can be read, and what the marks in it mean."""
    marks = explained(map(mark_of, table["verdict"])) if "verdict" in table.columns else ""
    parts = [part for part in (TITLES.get(name, name), *failures, marks) if part]
    return parts[0] if len(parts) == 1 else " ".join(f"{part.rstrip('.')}." for part in parts)


def _latex_cell(value: object, dtype: pl.DataType) -> str:
    is_number = dtype.is_numeric() and value is not None and value == value
    return number(shown(value)) if is_number else escaped(shown(value))
