"""Reader that a file needs, by its first bytes, and the process with limits that it works in."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated
from zipfile import is_zipfile

from pydantic import Field

from palpate.api import CurveError, Quantity, Settings
from palpate.api.files import ProcessLimits, TextFormat, TextTable, refuse_binary, run_function
from palpate_robot_log.reading import column_files
from palpate_robot_log.reading.raw import RawLog, Stream

_HDF5_MAGIC = b"\x89HDF\r\n\x1a\n"
_BINARY = (".mat", ".npz", ".npy", ".parquet", ".bag", ".mcap", ".db3", ".h5", ".hdf5", ".tdms")

Megabytes = Annotated[float, Quantity("MB")]


class ReadingLimits(Settings):
    """Limits on reading one file. A log of an hour at 1 kHz needs a tenth of them."""

    file_size: Megabytes = Field(default=2000.0, gt=0.0, description="Largest file, or bag folder.")
    memory: Megabytes = Field(
        default=6000.0, ge=300.0, description="Most memory of the process that reads; kept on Linux alone."
    )
    time_limit: Annotated[float, Quantity("s")] = Field(
        default=120.0, gt=0.0, description="Longest time that reading may take."
    )


def read_log(
    path: Path,
    columns: Sequence[str] | None = None,
    streams: Sequence[str] | None = None,
    text: TextFormat | None = None,
    limits: ReadingLimits | None = None,
) -> RawLog:
    """Content of a file, by a process with limits: a damaged one can neither hang nor end this one.

    Parameters
    ----------
    columns, streams : sequence of str, optional
        Columns of a table, and topics of a bag; all when left out.

    Raises
    ------
    CurveError
        It is missing, too large, damaged or of no known format, or reading exceeds the limits.
    """
    own = limits or ReadingLimits()
    _check_size(path, own)
    process = ProcessLimits(time_s=own.time_limit, memory_mb=own.memory, output_bytes=10_000_000_000)
    with _or_failed(path):
        return run_function(process, read_here, path, columns, streams, text, own)


@contextmanager
def _or_failed(path: Path) -> Iterator[None]:
    """Turn too little memory, or the end of the process that reads, into an error that names the file."""
    try:
        yield
    except (ChildProcessError, MemoryError) as error:
        how = "too little memory" if isinstance(error, MemoryError) else str(error)
        raise CurveError(
            f"{path}: reading failed ({how}); the file is damaged or too large: save it again, export fewer "
            "columns, or raise memory and time_limit under limits in the loader's settings"
        ) from None


def read_here(
    path: Path,
    columns: Sequence[str] | None = None,
    streams: Sequence[str] | None = None,
    text: TextFormat | None = None,
    limits: ReadingLimits | None = None,
) -> RawLog:
    """Content of a file, read in this very process as by :func:`read_log`."""
    _check_size(path, limits or ReadingLimits())
    with _or_failed(path):
        return _read(path, columns, streams, text)


def _read(
    path: Path, columns: Sequence[str] | None, streams: Sequence[str] | None, text: TextFormat | None
) -> RawLog:
    """Log by the format that the first bytes show; each library is imported where its format is found."""
    head = b""
    if not path.is_dir():
        refuse_binary(path)
        with path.open("rb") as stream:
            head = stream.read(1024)
    if path.is_dir() or head.startswith((b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\0")):
        from palpate_robot_log.reading.ros import read_bag

        return read_bag(path, streams)
    if head.startswith(b"PAR1"):
        return column_files.read_parquet(path, columns)
    if head.startswith(b"PK\x03\x04") and is_zipfile(path) and b".npy" not in head:
        raise CurveError(f"{path}: an archive of other files; unpack it, and give the log in it")
    if head.startswith((b"\x93NUMPY", b"PK\x03\x04")):
        return column_files.read_numpy(path)
    if _HDF5_MAGIC in (head[:8], head[512:520]):
        return column_files.read_hdf5(path)
    if head[126:128] in (b"IM", b"MI") and head.startswith(b"MATLAB"):
        return column_files.read_matlab5(path)
    if head.startswith(b"TDSm"):
        return column_files.read_tdms(path)
    if head.lstrip().startswith((b"{", b"[{")):
        return column_files.read_json(path)
    is_markup = head.lstrip().lower().startswith((b"<?xml", b"<!doctype", b"<html", b"<table"))
    if is_markup or path.suffix.lower() in (".yaml", ".yml"):
        raise CurveError(f"{path}: XML or YAML is not read; save its fields as JSON, or its table as CSV")
    if head and path.suffix.lower() in _BINARY:
        raise CurveError(
            f"{path}: the {path.suffix} file is damaged or cut off at its beginning; save it again"
        )
    table = TextTable(path, text)
    rows, found = table.read(columns)
    return RawLog(
        source=str(path),
        format="delimited text",
        row_word="line",
        streams=(Stream.of(found.values(), rows=rows),),
        notes=table.notes(),
        layout=table.settings(),
        preamble=table.preamble,
    )


def _check_size(path: Path, limits: ReadingLimits) -> None:
    """Refuse what is not there, is no regular file, or is too large to be opened."""
    try:
        if path.is_dir():
            if not (path / "metadata.yaml").is_file():
                raise CurveError(
                    f"{path}: a folder without metadata.yaml, so no ROS 2 bag; give the file of the log"
                )
            n_bytes = sum(file.lstat().st_size for file in path.iterdir())
        elif path.exists() and not path.is_file():
            raise CurveError(f"{path}: not a regular file; give a log, or the folder of a ROS 2 bag")
        else:
            n_bytes = path.stat().st_size
            if not os.access(path, os.R_OK):
                raise CurveError(f"{path}: cannot be read (Permission denied); check its permissions")
    except OSError as error:
        raise CurveError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    if n_bytes > limits.file_size * 1e6:
        raise CurveError(
            f"{path}: {n_bytes / 1e6:.0f} MB where at most {limits.file_size:g} MB are read; cut the log, "
            "or raise file_size under limits in the loader's settings"
        )
