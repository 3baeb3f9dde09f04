"""Delimited text (CSV, TSV and the like): a line of names, perhaps one of units, and rows of numbers."""

from palpate.experiment.delimited.header_units import (
    BASE_UNITS,
    UNITS,
    Kind,
    factor_to_base,
    kind_of,
    unit_in,
)
from palpate.experiment.delimited.layout import DELIMITERS, TextFormat
from palpate.experiment.delimited.table import Column, TextTable, close_to, listed

__all__ = [
    "BASE_UNITS",
    "DELIMITERS",
    "UNITS",
    "Column",
    "Kind",
    "TextFormat",
    "TextTable",
    "close_to",
    "factor_to_base",
    "kind_of",
    "listed",
    "unit_in",
]
