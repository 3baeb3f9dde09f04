"""MATLAB 5 to 7.2 files, by SciPy."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import CurveError
from palpate_robot_log.reading.arrays import log_of_arrays, matlab_name
from palpate_robot_log.reading.raw import RawLog

_DEEPEST = 8
_MOST_STRUCTS = 32


def read_matlab5(path: Path) -> RawLog:
    """Read vectors and matrices, also those inside structures.

    Raises
    ------
    CurveError
        The file is cut off, damaged, or holds no numbers.
    """
    from scipy.io import loadmat

    try:
        variables = loadmat(
            path, mat_dtype=True, struct_as_record=True, verify_compressed_data_integrity=True
        )
    except MemoryError:
        raise
    except Exception as error:  # SciPy's parser raises whatever the damaged bytes lead it to
        raise CurveError(
            f"{path}: the MATLAB file is damaged or cut off ({type(error).__name__}: {error}); save it again"
        ) from None
    notes: list[str] = []
    arrays = {
        found: array
        for name, value in variables.items()
        if not name.startswith("__")
        for found, array in _walk(name, value, notes, 0)
    }
    return log_of_arrays(path, "MATLAB 5", arrays, matlab_name, notes)


def _walk(name: str, value: Any, notes: list[str], depth: int) -> Iterator[tuple[str, np.ndarray]]:  # noqa: ANN401 - as SciPy returns it
    """Arrays of numbers under a variable, with MATLAB's own names for them."""
    if not isinstance(value, np.ndarray) or type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
        notes.append(f"'{name}' is a MATLAB object, which only MATLAB reads; save its numbers in a structure")
    elif value.dtype.names is not None:
        yield from _fields(name, value, notes, depth)
    elif value.dtype.kind in "fiub":
        yield name, value[:, 0] if value.ndim == 2 and value.shape[1] == 1 else _row_or_matrix(value)
    elif value.dtype.kind != "U":
        notes.append(f"'{name}' holds no numbers")


def _row_or_matrix(value: np.ndarray) -> np.ndarray:
    return value[0] if value.ndim == 2 and value.shape[0] == 1 else value


def _fields(name: str, value: np.ndarray, notes: list[str], depth: int) -> Iterator[tuple[str, np.ndarray]]:
    elements = value.reshape(-1)
    if depth >= _DEEPEST or elements.size > _MOST_STRUCTS:
        notes.append(f"'{name}' is too deep or too long a structure to look into")
        return
    for index, element in enumerate(elements, start=1):
        prefix = name if elements.size == 1 else f"{name}({index})"
        for field in value.dtype.names or ():
            yield from _walk(f"{prefix}.{field}", element[field], notes, depth + 1)
