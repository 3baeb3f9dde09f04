"""Sections of the page that palpate-report makes, and their blocks."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.plugins.sections import (
        Block as Block,
        Cell as Cell,
        Choice as Choice,
        Drawing as Drawing,
        Figure as Figure,
        Fold as Fold,
        Heading as Heading,
        Lines as Lines,
        Listing as Listing,
        Paragraph as Paragraph,
        Picture as Picture,
        ReportWarning as ReportWarning,
        Section as Section,
        Table as Table,
        Word as Word,
        heading as heading,
        rounded as rounded,
        rounded_rows as rounded_rows,
        shown as shown,
    )
    from palpate.simulation.processor_time import COST_HEADS as COST_HEADS, cost_rows as cost_rows

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
