"""Tables and figures of the report as blocks of a section."""

from collections.abc import Iterator

import polars as pl

from palpate.api.report import Picture, Table
from palpate_report.result import Report
from palpate_report.tables import TITLES, printed


def table(report: Report, name: str, frame: pl.DataFrame | None = None) -> Iterator[Table]:
    """Show a table of the report by its name, where it is there, or rows in its place."""
    frame = report.tables.get(name) if frame is None else frame
    if frame is not None:
        yield Table.of(TITLES[name], printed(name, frame))


def picture(report: Report, name: str, label: str) -> Iterator[Picture]:
    """Show a figure of the report by its name, where it was drawn."""
    if name in report.pictures:
        yield Picture(label=label, content=report.pictures[name])
