"""Sections of the page: their blocks, and the data that they read."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.plugins.sections import (
        Bar as Bar,
        Block as Block,
        Facts as Facts,
        Figure as Figure,
        Fold as Fold,
        Heading as Heading,
        Lines as Lines,
        Listing as Listing,
        Paragraph as Paragraph,
        Picture as Picture,
        Section as Section,
        Shares as Shares,
        Step as Step,
        Table as Table,
        Word as Word,
    )
    from palpate_report.report_data import (
        ReportData as ReportData,
    )
    from palpate_report.report_warnings import (
        ReportWarning as ReportWarning,
    )
    from palpate_report.result import (
        Report as Report,
        RunResult as RunResult,
    )
    from palpate_report.style import (
        STYLE as STYLE,
    )
    from palpate_report.table_files import (
        markdown as markdown,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
