"""Tables as files: CSV with every digit, LaTeX and Markdown to be printed."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import polars as pl

from palpate.report.tables import TITLES
from palpate.run.result_files import write_atomically

_MISSING = "–"
_FORMULA = r"^[=+@\-\t\r]"
"""How a cell begins that a spreadsheet would run."""
_INFINITE = r"\infty"
_LATEX = str.maketrans(
    {
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
        "…": r"\ldots{}",
        "–": "--",
        "\n": " ",
        "\r": " ",
    }
)
_MARKDOWN = str.maketrans(
    {character: f"\\{character}" for character in "\\`*_{}[]<>#|~$&!"} | {"\n": " ", "\r": " "}
)


def write_tables(tables: Mapping[str, pl.DataFrame], folder: Path) -> tuple[Path, ...]:
    """Write each table as CSV, LaTeX and Markdown."""
    kinds = {".csv": _csv, ".tex": latex, ".md": markdown}
    files = []
    for name, table in tables.items():
        for suffix, written in kinds.items():
            path = folder / f"{name}{suffix}"
            write_atomically(path, written(name, table).encode())
            files.append(path)
    return tuple(files)


def _csv(_: str, table: pl.DataFrame) -> str:
    """Write a table for a spreadsheet: an apostrophe keeps text that begins like a formula from being one."""
    heads = {name: _not_a_formula(name) for name in table.columns}
    texts = pl.col(pl.String).str.replace(_FORMULA, "'$0")
    return table.with_columns(texts).rename(heads).write_csv()


def _not_a_formula(text: str) -> str:
    return re.sub(_FORMULA, r"'\g<0>", text)


def latex(name: str, table: pl.DataFrame) -> str:
    """Write a table for LaTeX with the package ``booktabs``; whatever is special there is escaped.

    Parameters
    ----------
    name : str
        Key of ``TITLES``; the label is ``tab:<name>``.
    table : DataFrame
    """
    columns = "".join("r" if dtype.is_numeric() else "l" for dtype in table.dtypes)
    head = " & ".join(text.translate(_LATEX) for text in table.columns)
    rows = (" & ".join(_latex_cell(value) for value in row) for row in table.iter_rows())
    lines = [
        r"\begin{table}",
        rf"\caption{{{TITLES.get(name, name).translate(_LATEX)}}}",
        rf"\label{{tab:{name}}}",
        rf"\begin{{tabular}}{{{columns}}}",
        r"\toprule",
        rf"{head} \\",
        r"\midrule",
        *(rf"{row} \\" for row in rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def markdown(name: str, table: pl.DataFrame) -> str:
    """Write a table for Markdown, under its caption; names are text there, whatever they hold."""
    rule = ["---:" if dtype.is_numeric() else "---" for dtype in table.dtypes]
    head = [text.translate(_MARKDOWN) for text in table.columns]
    rows = ([shown(value).translate(_MARKDOWN) for value in row] for row in table.iter_rows())
    return f"{TITLES.get(name, name)}\n\n" + "".join(_line(cells) for cells in (head, rule, *rows))


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |\n"


def _latex_cell(value: object) -> str:
    text = shown(value)
    if isinstance(value, float) and "e" in text:
        mantissa, exponent = text.split("e")
        return rf"${mantissa}\times10^{{{int(exponent)}}}$"
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return f"${text.replace('inf', _INFINITE)}$"
    return text.translate(_LATEX)


def shown(value: object) -> str:
    """Text of a value for people: four digits; a dash for what is missing."""
    if value is None:
        return _MISSING
    return f"{value:.4g}" if isinstance(value, float) else str(value)
