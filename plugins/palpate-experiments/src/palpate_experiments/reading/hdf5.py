"""HDF5 and MATLAB 7.3, by h5py: hard links to plain data in this very file, and nothing else."""

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from palpate.errors import CurveError
from palpate_experiments.reading.arrays import log_of_arrays, matlab_name, numpy_name
from palpate_experiments.reading.limits import Limits
from palpate_experiments.reading.raw import RawLog

_DEEPEST = 16
_MOST_OBJECTS = 10_000
_MATLAB_OWN = ("#refs#", "#subsystem#")


def read_hdf5(path: Path, limits: Limits) -> RawLog:
    """Read vectors and matrices, also those inside groups.

    A soft or external link, a virtual data set and external storage point to other
    places: a file with one of them is refused, and nothing that it points to is opened.

    Raises
    ------
    CurveError
        The file is damaged, too large once unpacked, points elsewhere, or holds no numbers.
    """
    h5py = _h5py(path)
    try:
        with path.open("rb") as stream:
            is_matlab = stream.read(6) == b"MATLAB"
        with h5py.File(path, "r", locking=False) as file:
            visit = _Visit(path, h5py, limits, is_matlab=is_matlab)
            arrays = dict(visit.arrays(file, "", 0))
    except (CurveError, MemoryError, PermissionError):
        raise
    except Exception as error:  # h5py raises OSError, RuntimeError, KeyError, ValueError … on damaged bytes
        first_line = (str(error).splitlines() or [type(error).__name__])[0]
        raise CurveError(
            f"{path}: the HDF5 file is damaged or cut off ({first_line}); save it anew"
        ) from None
    naming = matlab_name if is_matlab else numpy_name
    return log_of_arrays(
        path, "MATLAB 7.3" if is_matlab else "HDF5", arrays, naming, visit.notes, visit.units
    )


def _h5py(path: Path) -> ModuleType:
    try:
        import h5py
    except ImportError:
        raise CurveError(
            f"{path}: MATLAB 7.3 and HDF5 files need h5py; run: pip install 'palpate-experiments[matlab]', "
            "or save the file with MATLAB's -v7"
        ) from None
    module: ModuleType = h5py
    return module


class _Visit:
    """Walk over the objects of one file, each once."""

    def __init__(self, path: Path, h5py: ModuleType, limits: Limits, *, is_matlab: bool) -> None:
        self.notes: list[str] = []
        self.units: dict[str, str] = {}
        self._path = path
        self._h5py = h5py
        self._limits = limits
        self._is_matlab = is_matlab
        self._seen: set[int] = set()
        self._n_bytes = 0

    def arrays(self, group: Any, prefix: str, depth: int) -> Iterator[tuple[str, np.ndarray]]:  # noqa: ANN401 - h5py is untyped
        """Arrays under a group, by their names."""
        for key in group:
            name = f"{prefix}.{key}" if prefix else key
            if self._is_matlab and key in _MATLAB_OWN:
                continue
            if not isinstance(group.get(key, getlink=True), self._h5py.HardLink):
                raise CurveError(
                    f"{self._path}: '{name}' is a link to another place, which is not followed; "
                    "save the data themselves in the file"
                )
            item = group[key]
            if self._is_new(item, name):
                if isinstance(item, self._h5py.Group):
                    self._check_depth(name, depth)
                    yield from self.arrays(item, name, depth + 1)
                elif isinstance(item, self._h5py.Dataset):
                    yield from self._array(item, name)

    def _is_new(self, item: Any, name: str) -> bool:  # noqa: ANN401
        """Whether an object is met for the first time: hard links may lead in circles."""
        address = int(self._h5py.h5o.get_info(item.id).addr)
        if address in self._seen:
            self.notes.append(f"'{name}' is another name of something already read")
            return False
        self._seen.add(address)
        if len(self._seen) > _MOST_OBJECTS:
            raise CurveError(f"{self._path}: more than {_MOST_OBJECTS} objects; export the log alone")
        return True

    def _check_depth(self, name: str, depth: int) -> None:
        if depth >= _DEEPEST:
            raise CurveError(
                f"{self._path}: '{name}' lies deeper than {_DEEPEST} groups; export the log alone"
            )

    def _array(self, data: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:  # noqa: ANN401
        if data.is_virtual or data.external:
            raise CurveError(
                f"{self._path}: '{name}' keeps its numbers in another file, which is not opened; "
                "save the data themselves in the file"
            )
        if data.dtype.names is None and data.dtype.kind not in "fiub":
            if not self._is_text(data):
                self.notes.append(f"'{name}' holds no numbers")
            return
        if data.shape is None or self._is_text(data) or 0 in data.shape:
            return
        self._check_size(data, name)
        unit = data.attrs.get("units", data.attrs.get("unit", ""))
        if isinstance(unit, str) and unit:
            self.units[name] = unit
        values = data[()]
        if values.dtype.names is not None:
            for field in values.dtype.names:
                yield f"{name}.{field}", values[field]
        else:
            yield name, self._as_written(values)

    def _is_text(self, data: Any) -> bool:  # noqa: ANN401
        kind = data.attrs.get("MATLAB_class", b"") if self._is_matlab else b""
        return kind in (b"char", b"cell") or data.dtype.kind in "SU"

    def _check_size(self, data: Any, name: str) -> None:  # noqa: ANN401
        """Refuse before unpacking; one chunk may be larger than the data it serves."""
        chunk = int(np.prod(data.chunks, dtype=object)) if data.chunks else 0
        n_bytes = max(int(data.size), chunk) * data.dtype.itemsize
        self._n_bytes += n_bytes
        self._limits.check_bytes(str(self._path), self._n_bytes, f"'{name}', with what stands before it,")

    def _as_written(self, values: np.ndarray) -> np.ndarray:
        """Array as MATLAB shows it: its files hold the dimensions in reverse."""
        if not self._is_matlab:
            return values
        turned = values.T
        if turned.ndim == 2 and 1 in turned.shape:
            return turned.reshape(-1)
        return turned
