"""What a report shows, and where it is."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import polars as pl

from palpate_report.report_data import ReportData
from palpate_report.verdict import Verdict, make_verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What the report shows, and where it is.

    Parameters
    ----------
    tables : mapping of name to DataFrame
    verdict : Verdict
        What the run amounts to, and its warnings.
    files : tuple of Path
        Everything that was written.
    """

    tables: Mapping[str, pl.DataFrame]
    verdict: Verdict
    files: tuple[Path, ...] = ()

    @classmethod
    def of(cls, data: ReportData) -> Self:
        """Report of these data that is not written."""
        from palpate_report.tables import make_tables

        tables = make_tables(data)
        return cls(tables=tables, verdict=make_verdict(data, tables))
