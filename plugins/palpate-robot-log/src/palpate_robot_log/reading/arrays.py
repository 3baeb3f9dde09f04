"""Columns out of named arrays, as MATLAB, HDF5 and NumPy files hold them."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from palpate.api import CurveError, FloatArray
from palpate.delimited import Column, unit_in
from palpate_robot_log.reading.raw import RawLog, Stream

MOST_COLUMNS = 64
"""Widest matrix that counts as columns side by side; a wider one is an image or a result."""

Naming = Callable[[str, int], str]
"""Name of one column of a matrix, from the matrix's name and the index counted from 0."""


def matlab_name(name: str, index: int) -> str:
    """``wrench(:,1)``, as MATLAB writes it."""
    return f"{name}(:,{index + 1})"


def numpy_name(name: str, index: int) -> str:
    """``wrench[:,0]``, as NumPy writes it."""
    return f"{name}[:,{index}]"


def log_of_arrays(
    path: Path,
    file_format: str,
    arrays: Mapping[str, np.ndarray],
    naming: Naming,
    notes: Iterable[str] = (),
    units: Mapping[str, str] | None = None,
) -> RawLog:
    """Make a log of arrays: those of one length are the columns of one stream.

    A matrix whose rows are fewer than its columns is taken as lying on its side.

    Parameters
    ----------
    path : Path
    file_format : str
        In words.
    arrays : mapping of str to array
        Of any shape; only vectors and matrices of real numbers are kept.
    naming : Naming
    notes : iterable of str
    units : mapping of str to str, optional
        Units that the file gives, by array.

    Raises
    ------
    CurveError
        Nothing in the file is a column of numbers.
    """
    columns: dict[int, list[Column]] = {}
    passed_over = []
    for name, array in arrays.items():
        matrix = _standing(array)
        if matrix is None:
            passed_over.append(f"'{name}' {array.shape} of {array.dtype} is no column of numbers")
            continue
        columns.setdefault(matrix.shape[0], []).extend(
            _columns(name, matrix, naming, (units or {}).get(name, ""))
        )
    if not columns:
        found = "; ".join([*notes, *passed_over]) or "it is empty"
        raise CurveError(f"{path}: no columns of numbers ({found}); save vectors or matrices of doubles")
    return RawLog(
        source=str(path),
        format=file_format,
        row_word="row",
        streams=tuple(_streams(columns)),
        notes=(*notes, *passed_over),
    )


def _streams(columns: Mapping[int, list[Column]]) -> Iterable[Stream]:
    for n_rows, group in columns.items():
        yield Stream(
            name="" if len(columns) == 1 else f"{n_rows} rows",
            rows=np.arange(n_rows, dtype=np.int64),
            columns={column.name: column for column in group},
        )


def _standing(array: np.ndarray) -> FloatArray | None:
    """Matrix (n, k) of doubles; None where the array is no such thing."""
    if array.dtype.kind not in "fiub" or array.dtype.itemsize > 8:
        return None
    shaped = array.reshape(-1, 1) if array.ndim == 1 else array
    if shaped.ndim == 3:
        shaped = _stacked(shaped)
    if shaped.ndim != 2:
        return None
    if shaped.shape[0] < shaped.shape[1]:
        shaped = shaped.T
    if shaped.shape[0] < 2 or shaped.shape[1] > MOST_COLUMNS:
        return None
    return np.asarray(shaped, dtype=np.float64)


def _stacked(matrices: np.ndarray) -> np.ndarray:
    """Rotation matrices or poses, one a row, each written row by row."""
    for size in (3, 4):
        if matrices.shape[1:] == (size, size):
            return matrices.reshape(-1, size * size)
        if matrices.shape[:2] == (size, size):  # as MATLAB stacks them
            return np.moveaxis(matrices, 2, 0).reshape(-1, size * size)
    return matrices


def _columns(name: str, matrix: FloatArray, naming: Naming, unit: str) -> Iterable[Column]:
    if matrix.shape[1] == 1:
        yield Column(name=name, values=np.ascontiguousarray(matrix[:, 0]), unit=unit)
        return
    shared = unit or unit_in(name)[1]
    for index in range(matrix.shape[1]):
        yield Column(name=naming(name, index), values=np.ascontiguousarray(matrix[:, index]), unit=shared)
