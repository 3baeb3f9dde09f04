"""Tables as files: CSV with every digit, LaTeX and Markdown to be printed."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import polars as pl

from palpate.api.files import write_atomically
from palpate_report.latex import escaped, number, plain
from palpate_report.marks import explained, mark_of
from palpate_report.tables import COMPARISON_TITLES, TITLES, printed

_TITLES = {**TITLES, **COMPARISON_TITLES}
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
    """Write each table as CSV, LaTeX and Markdown, and those of a paper, which are LaTeX already.

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

    Parameters
    ----------
    name : str
        Key of ``TITLES``; the label is ``tab:<name>``.
    table : DataFrame
    """
    return plain(
        [escaped(text) for text in table.columns],
        [[_latex_cell(value) for value in cells] for cells in table.iter_rows()],
        [dtype.is_numeric() for dtype in table.dtypes],
        caption=escaped(_caption(name, table, failures)),
        label=name,
        warnings=failures,
    )


def markdown(name: str, table: pl.DataFrame, failures: Sequence[str] = ()) -> str:
    """Write a table for Markdown, under its caption; names are text there, whatever they hold."""
    rule = ["---:" if dtype.is_numeric() else "---" for dtype in table.dtypes]
    head = [text.translate(_MARKDOWN) for text in table.columns]
    rows = ([shown(value).translate(_MARKDOWN) for value in row] for row in table.iter_rows())
    lines = [f"| {' | '.join(cells)} |" for cells in (head, rule, *rows)]
    warnings = [text for each in failures for text in (f"**WARNING: {each.translate(_MARKDOWN)}**", "")]
    return "\n".join([*warnings, _caption(name, table), "", *lines, ""])


def _caption(name: str, table: pl.DataFrame, failures: Sequence[str] = ()) -> str:
    """Title of a table, why no parameters can be read, and what the marks in it mean."""
    marks = explained(map(mark_of, table["verdict"])) if "verdict" in table.columns else ""
    parts = [part for part in (_TITLES.get(name, name), *failures, marks) if part]
    return parts[0] if len(parts) == 1 else " ".join(f"{part.rstrip('.')}." for part in parts)


def _latex_cell(value: object) -> str:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return number(shown(value)) if is_number else escaped(shown(value))


def shown(value: object) -> str:
    """Text of a value for people: four digits; a dash for what is missing."""
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
