"""NumPy's .npy and .npz: plain arrays only; nothing is ever unpickled."""

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.lib import format as npy

from palpate.errors import CurveError
from palpate_experiments.reading.arrays import log_of_arrays, numpy_name
from palpate_experiments.reading.limits import Limits
from palpate_experiments.reading.raw import RawLog

_MOST_MEMBERS = 1000
_LONGEST_HEADER = 100_000


def read_npz(path: Path, limits: Limits) -> RawLog:
    """Read every plain array of an archive.

    Each array's shape is compared with the bytes that the archive says it has before
    anything is unpacked, and those with the limits.

    Raises
    ------
    CurveError
        A member is pickled, too large, or not what its header says.
    """
    arrays: dict[str, np.ndarray] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            members = _members(path, archive, limits)
            for member in members:
                with archive.open(member) as stream:
                    arrays |= _fields(member.filename.removesuffix(".npy"), _array(path, member, stream))
                    if stream.read(1):
                        raise CurveError(f"{path}: member '{member.filename}' is longer than its header says")
    except (CurveError, MemoryError, PermissionError):
        raise
    except Exception as error:  # damaged bytes lead NumPy and zipfile to a dozen kinds
        raise CurveError(f"{path}: the archive is damaged or cut off ({error}); save it anew") from None
    return log_of_arrays(path, "NumPy archive", arrays, numpy_name)


def read_npy(path: Path, limits: Limits) -> RawLog:
    """Read the one array of an .npy file.

    Raises
    ------
    CurveError
        It is pickled, too large, or not what its header says.
    """
    info = zipfile.ZipInfo("array")
    info.file_size = path.stat().st_size
    limits.check_bytes(str(path), info.file_size, "the array")
    try:
        with path.open("rb") as stream:
            array = _array(path, info, stream)
    except (CurveError, MemoryError, PermissionError):
        raise
    except Exception as error:  # damaged bytes lead NumPy and zipfile to a dozen kinds
        raise CurveError(f"{path}: the file is damaged or cut off ({error}); save it anew") from None
    return log_of_arrays(path, "NumPy array", _fields("array", array), numpy_name)


def _members(path: Path, archive: zipfile.ZipFile, limits: Limits) -> list[zipfile.ZipInfo]:
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS:
        raise CurveError(
            f"{path}: {len(members)} members where at most {_MOST_MEMBERS} are read; save fewer arrays"
        )
    limits.check_bytes(str(path), sum(member.file_size for member in members), "the archive")
    for member in members:
        if not member.filename.endswith(".npy"):
            raise CurveError(
                f"{path}: member '{member.filename}' is no .npy array, so this is no NumPy archive; "
                "save it with numpy.savez"
            )
    return members


def _array(path: Path, member: zipfile.ZipInfo, stream: IO[bytes]) -> np.ndarray:
    """Array of one member, once its header agrees with its size."""
    where = f"{path}: array '{member.filename.removesuffix('.npy')}'"
    version = npy.read_magic(stream)
    read_header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}.get(version)
    if read_header is None:
        raise CurveError(f"{where} is of .npy version {version}; save plain arrays of numbers")
    shape, fortran, dtype = read_header(stream, max_header_size=_LONGEST_HEADER)
    if dtype.hasobject:
        raise CurveError(
            f"{where} is pickled, which could run code and is never read; save plain arrays of numbers"
        )
    n_bytes = int(np.prod([int(n) for n in shape], dtype=object)) * dtype.itemsize
    if n_bytes > member.file_size or any(n < 0 for n in shape):
        raise CurveError(f"{where}: shape {shape} needs {n_bytes} bytes and {member.file_size} are there")
    content = _exactly(stream, n_bytes, where)
    flat: np.ndarray = np.frombuffer(content, dtype=dtype)
    return flat.reshape(shape, order="F" if fortran else "C")


def _exactly(stream: IO[bytes], n_bytes: int, where: str) -> bytes:
    content = io.BytesIO()
    while content.tell() < n_bytes:
        piece = stream.read(min(1 << 22, n_bytes - content.tell()))
        if not piece:
            raise CurveError(f"{where}: cut off after {content.tell()} of {n_bytes} bytes; save it anew")
        content.write(piece)
    return content.getvalue()


def _fields(name: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """Array itself, or the fields of a structured one."""
    return dict(_walk(name, array))


def _walk(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    if array.dtype.names is None:
        yield name, array
        return
    for field in array.dtype.names:
        yield from _walk(f"{name}.{field}", array[field])
