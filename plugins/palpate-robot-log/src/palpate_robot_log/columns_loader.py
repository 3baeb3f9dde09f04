"""Loader of processed curves in files of columns: MATLAB, HDF5, NumPy, Parquet and TDMS."""

from pathlib import Path

from pydantic import Field

from palpate.api import CurveError, ExperimentLoader, Response
from palpate_indentation.api import CurveSettings, read_curves
from palpate_robot_log.reading.formats import ReadingLimits, Request, read_log


class ColumnsSettings(CurveSettings):
    """Settings of :class:`ColumnsLoader`."""

    limits: ReadingLimits = Field(
        default_factory=ReadingLimits, description="Largest file, memory and time of reading."
    )


class ColumnsLoader(ExperimentLoader[ColumnsSettings]):
    """Processed curves in a file of columns.

    Columns, units, strains and stresses have the rules of the loader ``csv``. A vector in a MATLAB
    structure is named as MATLAB does, ``test.force_N``; a column of a matrix is ``data(:,2)``.
    """

    name = "columns"
    summary = "processed curves in MATLAB, HDF5, NumPy, Parquet or TDMS files"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file; a CurveError with file, row and column where it cannot be read."""
        log = read_log(path, Request(limits=self.settings.limits))
        if log.row_word == "line":
            raise CurveError(f'{path}: the file is delimited text; set loader = "csv"')
        return read_curves(log, self.settings.channels, channel)
