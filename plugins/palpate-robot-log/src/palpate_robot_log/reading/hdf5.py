"""HDF5 and MATLAB 7.3, by h5py: the arrays that are in the file itself."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from palpate.api import CurveError
from palpate_robot_log.reading.arrays import log_of_arrays, matlab_name, numpy_name
from palpate_robot_log.reading.raw import RawLog

_MATLAB_OWN = ("#refs#", "#subsystem#")


def read_hdf5(path: Path) -> RawLog:
    """Read vectors and matrices, also those inside groups.

    Links, virtual data sets and external storage are not followed: the run's record covers this file alone.

    Raises
    ------
    CurveError
        The file is damaged, or holds no numbers.
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
            found = dict(_arrays(item, name.replace("/", "."), notes, is_matlab=is_matlab))
            arrays.update(found)
            unit = item.attrs.get("units", item.attrs.get("unit", ""))
            if isinstance(unit, str) and unit:
                units.update(dict.fromkeys(found, unit))

    try:
        with h5py.File(path, "r", locking=False) as file:
            file.visititems(visit)
    except MemoryError:
        raise
    except Exception as error:  # h5py raises OSError, RuntimeError, KeyError, ValueError … on damaged bytes
        first_line = (str(error).splitlines() or [type(error).__name__])[0]
        raise CurveError(
            f"{path}: the HDF5 file is damaged or cut off ({first_line}); save it again"
        ) from None
    naming = matlab_name if is_matlab else numpy_name
    return log_of_arrays(path, "MATLAB 7.3" if is_matlab else "HDF5", arrays, naming, notes, units)


def _arrays(
    data: Any,  # noqa: ANN401 - h5py is untyped
    name: str,
    notes: list[str],
    *,
    is_matlab: bool,
) -> Iterator[tuple[str, np.ndarray]]:
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
        yield name, _as_in_matlab(data[()]) if is_matlab else data[()]
    else:
        notes.append(f"'{name}' holds no numbers")


def _as_in_matlab(values: np.ndarray) -> np.ndarray:
    """Array as MATLAB shows it: its files hold the dimensions in reverse."""
    turned = values.T
    return turned.reshape(-1) if turned.ndim == 2 and 1 in turned.shape else turned
