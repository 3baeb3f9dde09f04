"""Tables, figures and one page from what a run has found; simulates nothing.

What draws is imported when something is drawn: most commands do not, and it takes long.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import polars as pl

from palpate.domain import Channel, Response
from palpate.report.content import Content
from palpate.report.convergence import by_spot, contact_along
from palpate.report.table_files import write_tables
from palpate.report.tables import finding, make_tables
from palpate.run.ownership import keep_only
from palpate.stages.experiment import Presses

if TYPE_CHECKING:
    from palpate.report.verdict import Verdict

__all__ = [
    "Content",
    "by_spot",
    "contact_along",
    "draw_presses",
    "finding",
    "make_tables",
    "make_verdict",
    "write_report",
]


def write_report(content: Content, folder: Path) -> tuple[Path, ...]:
    """Write ``tables/*.csv|tex|md``, ``figures/*.svg|pdf|png`` and ``index.html``; returns the files.

    Those of an earlier report that this one does not have are removed afterwards.
    """
    tables = make_tables(content)
    table_files = write_tables(tables, folder / "tables")
    figure_files = write_figures(content, folder / "figures")
    page = write_page(content, tables, (*table_files, *figure_files), folder)
    keep_only(folder, (*table_files, *figure_files, page))
    return (*table_files, *figure_files, page)


def make_verdict(content: Content, tables: Mapping[str, pl.DataFrame]) -> "Verdict":
    """Sum up a run: see :func:`palpate.report.verdict.make_verdict`."""
    from palpate.report import verdict

    return verdict.make_verdict(content, tables)


def write_figures(content: Content, folder: Path) -> tuple[Path, ...]:
    """Draw every figure: see :func:`palpate.report.figures.write_figures`."""
    from palpate.report import figures

    return figures.write_figures(content, folder)


def write_page(
    content: Content, tables: Mapping[str, pl.DataFrame], files: Sequence[Path], folder: Path
) -> Path:
    """Write ``index.html``: see :func:`palpate.report.page.write_page`."""
    from palpate.report import page

    return page.write_page(content, tables, files, folder)


def draw_presses(
    presses: Presses, mean: Response, channels: Mapping[str, Channel], notice: str, folder: Path
) -> tuple[Path, ...]:
    """Draw what was measured at a spot: see :func:`palpate.report.presses.draw_presses`."""
    from palpate.report import presses as pictures

    return pictures.draw_presses(presses, mean, channels, notice, folder)
