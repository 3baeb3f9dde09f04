"""Tables, figures and one page from what a run has found; recomputes nothing."""

from pathlib import Path

from palpate.report.content import Content
from palpate.report.convergence import by_spot, contact_along
from palpate.report.figures import write_figures
from palpate.report.page import write_page
from palpate.report.presses import draw_presses
from palpate.report.table_files import write_tables
from palpate.report.tables import finding, make_tables

__all__ = ["Content", "by_spot", "contact_along", "draw_presses", "finding", "make_tables", "write_report"]


def write_report(content: Content, folder: Path) -> tuple[Path, ...]:
    """Write ``tables/*.csv|tex|md``, ``figures/*.svg|pdf|png`` and ``index.html``; returns the files."""
    tables = make_tables(content)
    table_files = write_tables(tables, folder / "tables")
    figure_files = write_figures(content, folder / "figures")
    page = write_page(content, tables, (*table_files, *figure_files), folder)
    return (*table_files, *figure_files, page)
