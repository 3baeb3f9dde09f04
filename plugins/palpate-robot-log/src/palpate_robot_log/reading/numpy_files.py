"""NumPy's .npy and .npz: plain arrays and structured ones."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.api import CurveError
from palpate_robot_log.reading.arrays import log_of_arrays, numpy_name
from palpate_robot_log.reading.raw import RawLog


def read_numpy(path: Path) -> RawLog:
    """Read the array of an .npy file, named ``array``, or every array of an .npz archive.

    Raises
    ------
    CurveError
        The file is damaged, or holds pickled objects.
    """
    try:
        with path.open("rb") as stream:
            loaded = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                found, file_format = {"array": loaded}, "NumPy array"
            else:
                found, file_format = {name: np.asarray(loaded[name]) for name in loaded}, "NumPy archive"
    except MemoryError:
        raise
    except Exception as error:  # damaged bytes lead NumPy and zipfile to a dozen kinds
        raise CurveError(
            f"{path}: damaged, cut off, or not of plain numbers ({error}); save plain arrays of numbers again"
        ) from None
    arrays = dict(field for name, array in found.items() for field in _fields(name, array))
    return log_of_arrays(path, file_format, arrays, numpy_name)


def _fields(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Array itself, or the fields of a structured one."""
    if array.dtype.names is None:
        yield name, array
        return
    for field in array.dtype.names:
        yield from _fields(f"{name}.{field}", array[field])
