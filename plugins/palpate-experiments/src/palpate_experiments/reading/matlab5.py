"""MATLAB 5 to 7.2 files, by SciPy, once their size and completeness are known."""

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from palpate.errors import CurveError
from palpate_experiments.reading.arrays import log_of_arrays, matlab_name
from palpate_experiments.reading.limits import Limits
from palpate_experiments.reading.raw import RawLog

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15
_PIECE = 1 << 20
_DEEPEST = 8
_MOST_STRUCTS = 32


def read_matlab5(path: Path, limits: Limits) -> RawLog:
    """Read vectors and matrices, also those inside structures.

    Raises
    ------
    CurveError
        The file is cut off, damaged, too large once unpacked, or holds no numbers.
    """
    from scipy.io import loadmat

    _check_elements(path, limits)
    try:
        variables = loadmat(
            path, mat_dtype=True, struct_as_record=True, verify_compressed_data_integrity=True
        )
    except (MemoryError, PermissionError):
        raise
    except Exception as error:  # SciPy's parser raises whatever the damaged bytes lead it to
        raise _damaged(path, f"{type(error).__name__}: {error}") from None
    notes: list[str] = []
    arrays = {
        found: array
        for name, value in variables.items()
        if not name.startswith("__")
        for found, array in _walk(name, value, notes, 0)
    }
    return log_of_arrays(path, "MATLAB 5", arrays, matlab_name, notes)


def _damaged(path: Path, why: str) -> CurveError:
    return CurveError(f"{path}: the MATLAB file is damaged or cut off ({why}); save it anew")


def _check_elements(path: Path, limits: Limits) -> None:
    """Follow the file's elements to its end, and add up what they unpack to."""
    size, n_unpacked = path.stat().st_size, 0
    with path.open("rb") as stream:
        header = stream.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES or size == _HEADER_BYTES:
            raise _damaged(path, f"only {size} bytes")
        order = "<" if header[126:128] == b"IM" else ">"
        while stream.tell() < size:
            begin, tag = stream.tell(), stream.read(8)
            if len(tag) < 8:
                raise _damaged(path, f"{len(tag)} bytes left over at byte {begin}")
            kind, n_bytes = struct.unpack(order + "II", tag)
            if kind not in (_MATRIX, _COMPRESSED):
                raise _damaged(path, f"no variable at byte {begin}")
            if begin + 8 + n_bytes > size:
                missing = begin + 8 + n_bytes - size
                raise _damaged(path, f"the variable at byte {begin} lacks its last {missing} bytes")
            n_unpacked += (
                _unpacked(path, stream, n_bytes, order, limits, n_unpacked)
                if kind == _COMPRESSED
                else n_bytes
            )
            limits.check_bytes(str(path), n_unpacked, "the file")
            stream.seek(begin + 8 + n_bytes)


def _unpacked(path: Path, stream: IO[bytes], n_bytes: int, order: str, limits: Limits, n_before: int) -> int:
    """Size of a compressed variable, unpacked piece by piece and thrown away."""
    begin, unpacker, total, left, head = stream.tell(), zlib.decompressobj(), 0, n_bytes, b""
    try:
        while not unpacker.eof:
            packed = unpacker.unconsumed_tail
            if not packed:
                packed = stream.read(min(_PIECE, left))
                left -= len(packed)
            piece = unpacker.decompress(packed, _PIECE)
            if not piece and not packed:
                raise _damaged(path, f"the variable at byte {begin} ends early")
            head = head or piece[:8]
            total += len(piece)
            limits.check_bytes(str(path), n_before + total, "the file")
    except zlib.error as error:
        raise _damaged(path, f"the variable at byte {begin}: {error}") from None
    if len(head) == 8 and struct.unpack(order + "II", head)[1] + 8 > total:
        raise _damaged(path, f"the variable at byte {begin} is shorter than it says")
    return total


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
