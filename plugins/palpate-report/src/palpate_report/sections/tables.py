"""Tables and figures of the report as blocks of a section."""

from collections.abc import Iterator

from palpate.api.report import Picture, Table
from palpate_report.answer.result import Report
from palpate_report.data.tables import TITLES, printed


def tables(report: Report, *names: str) -> Iterator[Table]:
    """Show tables of the report by their names, those that are there."""
    for name in names:
        if name in report.tables:
            yield Table.of(TITLES[name], printed(name, report.tables[name]))


def picture(report: Report, name: str, label: str) -> Iterator[Picture]:
    """Show a figure of the report by its name, where it was drawn."""
    if name in report.pictures:
        yield Picture(label=label, content=report.pictures[name])
