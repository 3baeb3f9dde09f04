"""Tables, figures and one page from what a run has found; simulates nothing.

What draws is imported when something is drawn: most commands do not, and it takes long.
"""

from pathlib import Path

from palpate.api.runs import keep_only
from palpate_report.headline import with_verdicts
from palpate_report.paper_tables import materials_of, paper_tables
from palpate_report.report_data import ReportData
from palpate_report.result import Report
from palpate_report.table_files import write_tables
from palpate_report.tables import make_tables
from palpate_report.verdict import make_verdict
from palpate_report.written_units import in_written_units


def write_report(data: ReportData, folder: Path) -> Report:
    """Write ``tables/*.csv|tex|md``, ``figures/*.svg|pdf|png`` and ``index.html``, in the study's units.

    Files of an earlier report that this one does not have are removed afterwards.
    """
    from palpate_report.page import write_page

    data = in_written_units(data)
    tables = with_verdicts(data, make_tables(data))
    verdict = make_verdict(data, tables)
    paper = paper_tables({materials_of(data): data})
    failures = [verdict.failure] if verdict.failure else []
    written = write_tables(tables, folder / "tables", paper, failures)
    files = (*written, *write_figures(data, folder / "figures"))
    page = write_page(data, tables, verdict, files, folder)
    keep_only(folder, (*files, page))
    return Report(tables=tables, files=(*files, page), verdict=verdict)


def write_figures(data: ReportData, folder: Path) -> tuple[Path, ...]:
    """Draw every figure: see :func:`palpate_report.figures.write_figures`."""
    from palpate_report import figures

    return figures.write_figures(data, folder)
