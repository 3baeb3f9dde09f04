"""Delimited text (CSV, TSV and the like): a line of names, perhaps one of units, and rows of numbers."""

from palpate.experiment.delimited.characters import refuse_binary
from palpate.experiment.delimited.header_units import (
    BASE_UNITS,
    UNITS,
    Kind,
    bare_unit,
    factor_to_base,
    factors_of,
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
    "bare_unit",
    "close_to",
    "factor_to_base",
    "factors_of",
    "kind_of",
    "listed",
    "refuse_binary",
    "unit_in",
]
