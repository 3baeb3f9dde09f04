"""Files of named arrays: NumPy's, MATLAB's and HDF5. Arrays of one length are the columns of one stream."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import CurveError, FloatArray
from palpate.api.files import Column, unit_in
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

MOST_COLUMNS = 64  # widest matrix that counts as columns side by side; a wider one is an image or a result
_DEEPEST = 8
_MOST_STRUCTS = 32
_MATLAB_OWN = ("#refs#", "#subsystem#")

_Found = Iterator[tuple[str, np.ndarray]]
_MATLAB_NAME = "{}(:,{})"
_NUMPY_NAME = "{}[:,{}]"


def read_numpy(path: Path) -> RawLog:
    """Array of an .npy file, named ``array``, or every array of an .npz archive."""
    advice = "save plain arrays of numbers again"
    with or_damaged(path, "damaged, cut off, or not of plain numbers", advice), path.open("rb") as stream:
        loaded = np.load(stream, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            found, file_format = {"array": loaded}, "NumPy array"
        else:
            found, file_format = {name: np.asarray(loaded[name]) for name in loaded}, "NumPy archive"
    arrays = dict(field for name, array in found.items() for field in _structured(name, array))
    return _log(path, file_format, arrays, _NUMPY_NAME)


def read_matlab5(path: Path) -> RawLog:
    """Vectors and matrices of a MATLAB 5 to 7.2 file, also those inside structures."""
    from scipy.io import loadmat

    with or_damaged(path, "the MATLAB file is damaged or cut off", "save it again"):
        variables = loadmat(
            path, mat_dtype=True, struct_as_record=True, verify_compressed_data_integrity=True
        )
    notes: list[str] = []
    arrays = {
        found: array
        for name, value in variables.items()
        if not name.startswith("__")
        for found, array in _in_variable(name, value, notes, 0)
    }
    return _log(path, "MATLAB 5", arrays, _MATLAB_NAME, notes)


def read_hdf5(path: Path) -> RawLog:
    """Vectors and matrices of an HDF5 or MATLAB 7.3 file, also those inside groups.

    Links, virtual data sets and external storage are not followed: the run's record covers this file alone.
    """
    try:
        import h5py
    except ImportError:
        raise CurveError(
            f"{path}: MATLAB 7.3 and HDF5 files need h5py; run: pip install 'palpate-robot-log[matlab]', "
            "or save the file with MATLAB's -v7"
        ) from None
    with path.open("rb") as stream:
        is_matlab = stream.read(6) == b"MATLAB"
    notes: list[str] = []
    units: dict[str, str] = {}
    arrays: dict[str, np.ndarray] = {}

    def visit(name: str, item: Any) -> None:  # noqa: ANN401 - h5py is untyped
        if isinstance(item, h5py.Dataset) and not (is_matlab and name.split("/")[0] in _MATLAB_OWN):
            found = dict(_in_data_set(item, name.replace("/", "."), notes, is_matlab=is_matlab))
            arrays.update(found)
            unit = item.attrs.get("units", item.attrs.get("unit", ""))
            if isinstance(unit, str) and unit:
                units.update(dict.fromkeys(found, unit))

    damage = or_damaged(path, "the HDF5 file is damaged or cut off", "save it again")
    with damage, h5py.File(path, "r", locking=False) as file:
        file.visititems(visit)
    if is_matlab:
        return _log(path, "MATLAB 7.3", arrays, _MATLAB_NAME, notes, units)
    return _log(path, "HDF5", arrays, _NUMPY_NAME, notes, units)


def _structured(name: str, array: np.ndarray) -> _Found:
    """Array itself, or the fields of a structured one."""
    if array.dtype.names is None:
        yield name, array
    for field in array.dtype.names or ():
        yield from _structured(f"{name}.{field}", array[field])


def _in_variable(name: str, value: Any, notes: list[str], depth: int) -> _Found:  # noqa: ANN401 - as SciPy returns it
    """Arrays of numbers under a variable, with MATLAB's own names for them."""
    if not isinstance(value, np.ndarray) or type(value).__name__ in ("MatlabOpaque", "MatlabFunction"):
        notes.append(f"'{name}' is a MATLAB object, which only MATLAB reads; save its numbers in a structure")
    elif value.dtype.names is not None:
        elements = value.reshape(-1)
        if depth >= _DEEPEST or elements.size > _MOST_STRUCTS:
            notes.append(f"'{name}' is too deep or too long a structure to look into")
            return
        for index, element in enumerate(elements, start=1):
            prefix = name if elements.size == 1 else f"{name}({index})"
            for field in value.dtype.names:
                yield from _in_variable(f"{prefix}.{field}", element[field], notes, depth + 1)
    elif value.dtype.kind in "fiub":
        yield name, _vector_or_matrix(value)
    elif value.dtype.kind != "U":
        notes.append(f"'{name}' holds no numbers")


def _in_data_set(data: Any, name: str, notes: list[str], *, is_matlab: bool) -> _Found:  # noqa: ANN401 - h5py is untyped
    """Numbers of one data set: itself, or its fields."""
    is_text = data.dtype.kind in "SU" or (
        is_matlab and data.attrs.get("MATLAB_class", b"") in (b"char", b"cell")
    )
    if data.is_virtual or data.external:
        notes.append(f"'{name}' keeps its numbers in another file, which is not read")
    elif is_text or data.shape is None or 0 in data.shape:
        return
    elif data.dtype.names is not None:
        values = data[()]
        yield from ((f"{name}.{field}", values[field]) for field in data.dtype.names)
    elif data.dtype.kind in "fiub":
        # MATLAB's files hold the dimensions in reverse.
        yield name, _vector_or_matrix(data[()].T) if is_matlab else data[()]
    else:
        notes.append(f"'{name}' holds no numbers")


def _vector_or_matrix(value: np.ndarray) -> np.ndarray:
    """A matrix of one row or column as the vector that it is."""
    return value.reshape(-1) if value.ndim == 2 and 1 in value.shape else value


def _log(
    path: Path,
    file_format: str,
    arrays: Mapping[str, np.ndarray],
    pattern: str,
    notes: Iterable[str] = (),
    units: Mapping[str, str] | None = None,
) -> RawLog:
    """Log of the vectors and matrices of real numbers among the arrays, with the units of some."""
    by_length: dict[int, dict[str, Column]] = {}
    passed_over = []
    for name, array in arrays.items():
        matrix = _upright(array)
        if matrix is None:
            passed_over.append(f"'{name}' {array.shape} of {array.dtype} is no column of numbers")
            continue
        unit = (units or {}).get(name, "")
        is_vector = matrix.shape[1] == 1
        for index, values in enumerate(matrix.T):
            column = Column(
                name=name if is_vector else pattern.format(name, index + (pattern is _MATLAB_NAME)),
                values=np.ascontiguousarray(values),
                unit=unit if is_vector else unit or unit_in(name)[1],
            )
            by_length.setdefault(values.size, {})[column.name] = column
    if not by_length:
        found = "; ".join([*notes, *passed_over]) or "it is empty"
        raise CurveError(f"{path}: no columns of numbers ({found}); save vectors or matrices of doubles")
    streams = tuple(
        Stream(name=f"{n_rows} rows" if len(by_length) > 1 else "", rows=np.arange(n_rows), columns=columns)
        for n_rows, columns in by_length.items()
    )
    notes = (*notes, *passed_over)
    return RawLog(source=str(path), format=file_format, row_word="row", streams=streams, notes=notes)


def _upright(array: np.ndarray) -> FloatArray | None:
    """Matrix (n, k) of doubles with n ≥ k; None where the array is no such thing."""
    if array.dtype.kind not in "fiub" or array.dtype.itemsize > 8:
        return None
    shaped = array.reshape(-1, 1) if array.ndim == 1 else array
    # Rotation matrices or poses, one a row, each written row by row.
    for size in (3, 4) if shaped.ndim == 3 else ():
        if shaped.shape[1:] == (size, size):
            shaped = shaped.reshape(-1, size * size)
        elif shaped.shape[:2] == (size, size):  # as MATLAB stacks them
            shaped = np.moveaxis(shaped, 2, 0).reshape(-1, size * size)
    if shaped.ndim != 2:
        return None
    if shaped.shape[0] < shaped.shape[1]:
        shaped = shaped.T
    if shaped.shape[0] < 2 or shaped.shape[1] > MOST_COLUMNS:
        return None
    return np.asarray(shaped, dtype=np.float64)
