"""Text, numbers and tables for LaTeX; no table is wider than its column."""

import math
import re
import unicodedata
from collections.abc import Sequence
from itertools import chain

PREAMBLE = r"\usepackage{booktabs,graphicx}"
"""What a document needs for these tables."""

COLUMN_CHARACTERS = 56
"""Widest table, in characters, that is set in one of two columns."""

MOST_TRANSPOSED = 6
"""Most rows of a wide table that become its columns."""

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


def marked(text: str, mark: str) -> str:
    """Text of a number with its marks."""
    return f"{text}{escaped(mark)}"


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
    columns: str,
    lines: Sequence[str],
    *,
    caption: str,
    label: str,
    wide: bool,
    warnings: Sequence[str] = (),
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
        What a comment at the head says.
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


def plain(
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    numeric: Sequence[bool],
    *,
    caption: str,
    label: str,
    warnings: Sequence[str] = (),
) -> str:
    """Lay rows out under their heads; a wide table of few rows is transposed, and long texts are broken."""
    lengths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    if sum(lengths) > 2 * COLUMN_CHARACTERS and len(rows) <= MOST_TRANSPOSED < len(heads):
        heads, *rows = [list(column) for column in zip(heads, *rows, strict=True)]
        lengths, numeric = [max(map(len, column)) for column in zip(heads, *rows, strict=True)], ()
    kinds = ["r" if i < len(numeric) and numeric[i] else "l" for i in range(len(heads))]
    columns = "".join(
        "p{60mm}" if n > COLUMN_CHARACTERS else kind for n, kind in zip(lengths, kinds, strict=True)
    )
    lines = chain([row(*heads), r"\midrule"], (row(*cells) for cells in rows))
    wide = sum(lengths) > COLUMN_CHARACTERS
    return tabular(columns, list(lines), caption=caption, label=label, wide=wide, warnings=warnings)
