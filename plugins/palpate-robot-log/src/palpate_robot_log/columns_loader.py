"""Loader of processed curves in files of columns: MATLAB, HDF5, NumPy, Parquet and TDMS."""

from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from pydantic import Field

from palpate.api import CurveError, ExperimentLoader, IntArray, Response
from palpate.api.files import Column
from palpate_indentation.api import CurveSettings, read_curves
from palpate_robot_log.reading.formats import ReadingLimits, Request, read_log


class ColumnsSettings(CurveSettings):
    """Settings of :class:`ColumnsLoader`."""

    limits: ReadingLimits = Field(
        default_factory=ReadingLimits, description="Largest file, memory and time of reading."
    )


class ColumnTable:
    """Columns of every length in a file.

    Parameters
    ----------
    limits : ReadingLimits
        Of size, memory and time.

    Raises
    ------
    CurveError
        The file has no columns of numbers, or cannot be read.
    """

    row_word: ClassVar[str] = "row"

    def __init__(self, path: Path, limits: ReadingLimits) -> None:
        self.path, self._log = path, read_log(path, Request(limits=limits))
        if self._log.row_word == "line":
            raise CurveError(f'{path}: the file is delimited text; set loader = "csv"')

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns."""
        return tuple(name for stream in self._log.streams for name in stream.frame.columns)

    def read(self, wanted: Sequence[str]) -> tuple[IntArray, dict[str, Column]]:
        """Rows counted from 0, and the wanted columns; a CurveError where they are not of one stream."""
        stream = self._log.stream_of(wanted, choose="save one of them in a file of its own")
        return stream.rows, {name: stream.column(name) for name in wanted}


class ColumnsLoader(ExperimentLoader[ColumnsSettings]):
    """Processed curves in a file of columns.

    Columns, units, strains and stresses have the rules of the loader ``csv``. A vector in a MATLAB
    structure is named as MATLAB does, ``test.force_N``; a column of a matrix is ``data(:,2)``.
    """

    name = "columns"
    summary = "processed curves in MATLAB, HDF5, NumPy, Parquet or TDMS files"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file; a CurveError with file, row and column where it cannot be read."""
        return read_curves(ColumnTable(path, self.settings.limits), self.settings.channels, channel)
