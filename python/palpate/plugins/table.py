"""Declaration of a table: what a row is, and each column with its unit; everything that shows it follows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import polars as pl
from polars._typing import PolarsDataType

OF_ROW = "unit of the row"
"""Unit of a column whose values have the unit that the column ``unit`` names."""


@dataclass(frozen=True, slots=True)
class TableColumn:
    """A column of a table.

    Parameters
    ----------
    text : str
        A sentence on its values.
    kind : polars data type
    unit : str
        Empty for a number without unit and for text.
    """

    text: str
    kind: PolarsDataType = pl.Float64
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.text} [{self.unit}]" if self.unit else self.text


@dataclass(frozen=True, slots=True)
class StageTable:
    """A table that a stage makes.

    Parameters
    ----------
    text : str
        A sentence on it.
    columns : mapping of name to TableColumn
        Those that it has in every study.
    more : str
        A sentence on the columns that a study adds, such as one for each parameter.
    """

    text: str
    columns: Mapping[str, TableColumn] = field(default_factory=dict)
    more: str = ""

    @property
    def schema(self) -> dict[str, PolarsDataType]:
        """Data type of each declared column."""
        return {name: column.kind for name, column in self.columns.items()}

    def empty(self) -> pl.DataFrame:
        """The table without rows."""
        return pl.DataFrame(schema=self.schema)

    def frame(self, rows: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
        """The table of these rows, with every declared column."""
        if not rows:
            return self.empty()
        given = dict.fromkeys(name for row in rows for name in row)
        kinds = {name: kind for name, kind in self.schema.items() if name in given}
        found = pl.from_dicts(rows, schema_overrides=kinds, infer_schema_length=None)
        lacking = {name: kind for name, kind in self.schema.items() if name not in given}
        return found.with_columns(pl.lit(None, dtype=kind).alias(name) for name, kind in lacking.items())

    def missing(self, frame: pl.DataFrame) -> list[str]:
        """Declared columns that a made table lacks; a table without columns is not there, and lacks none."""
        return [name for name in self.columns if frame.width and name not in frame.columns]
