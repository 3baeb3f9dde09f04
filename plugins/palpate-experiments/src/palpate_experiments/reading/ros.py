"""Bags of ROS 1 and ROS 2, by rosbags: one stream for each topic of a known type."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import CurveError
from palpate_experiments.reading.limits import Limits
from palpate_experiments.reading.raw import Column, RawLog, Stream, listed
from palpate_experiments.reading.ros_messages import LAYOUTS, Layout, byte_order, stream_name, take_apart

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

MCAP_MAGIC = b"\x89MCAP0\r\n"
SQLITE_MAGIC = b"SQLite format 3\0"
BAG1_MAGIC = b"#ROSBAG V"
_STORAGE = (".mcap", ".db3")
_MOST_STREAMS = 200


def read_bag(path: Path, limits: Limits, topics: Sequence[str] | None = None) -> RawLog:
    """Read a ROS 1 ``.bag``, a ROS 2 bag folder, or one ``.mcap`` or ``.db3`` of it.

    Each stream has the columns ``received`` (when the message was recorded) and, for
    messages with a header, ``stamp``: seconds since the first message of the bag.

    Parameters
    ----------
    path : Path
    limits : Limits
    topics : sequence of str, optional
        Streams to read; all of known types when left out.

    Raises
    ------
    CurveError
        The bag is cut off, damaged, too large, or has no topic of a known type.
    """
    try:
        reader, is_ros2 = _reader(path)
        reader.open()
        try:
            collected = _collect(path, reader, limits, topics, is_ros2=is_ros2)
        finally:
            reader.close()
    except (CurveError, MemoryError, PermissionError):
        raise
    except Exception as error:  # rosbags raises whatever the damaged bytes lead it to
        first_line = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise CurveError(
            f"{path}: the bag is damaged or cut off ({first_line}); repair it with "
            "'rosbag reindex' or 'ros2 bag reindex', or record anew"
        ) from None
    return collected


def _reader(path: Path) -> tuple[Any, bool]:
    """Reader of the bag, not yet open, and whether it is of ROS 2."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError:
        raise CurveError(
            f"{path}: ROS bags need rosbags; run: pip install 'palpate-experiments[ros]'"
        ) from None
    if path.is_dir():
        for file in sorted(path.iterdir()):
            _check_storage(path, file)
        return rosbag2.Reader(path), True
    with path.open("rb") as stream:
        if stream.read(len(BAG1_MAGIC)) == BAG1_MAGIC:
            return rosbag1.Reader(path), False
    if path.suffix not in _STORAGE:
        raise CurveError(
            f"{path}: a recording of ROS 2 that ends in '{path.suffix}'; rename it to .mcap or .db3"
        )
    _check_storage(path.parent, path)
    return rosbag2.Reader(path), True


def _check_storage(folder: Path, file: Path) -> None:
    """Refuse a file that leads elsewhere, or that was not closed: its reader would pass over the loss."""
    if not file.resolve().is_relative_to(folder.resolve()):
        raise CurveError(f"{file}: it links to a place outside of the bag; copy the data into the bag")
    if any(mark in str(file) for mark in "?#%"):
        raise CurveError(f"{file}: rename it without ? # %, which its reader takes for something else")
    if file.name.endswith("-wal") and file.stat().st_size:
        raise CurveError(
            f"{file}: the recording was not closed; open the .db3 once with sqlite3 to finish it"
        )
    if file.suffix not in _STORAGE:
        return
    with file.open("rb") as stream:
        head, size = stream.read(100), file.stat().st_size
        stream.seek(max(0, size - len(MCAP_MAGIC)))
        tail = stream.read()
    if file.suffix == ".mcap" and not (head.startswith(MCAP_MAGIC) and tail == MCAP_MAGIC and size > 16):
        raise CurveError(f"{file}: cut off, it has no end mark; run 'mcap recover', or record anew")
    if file.suffix == ".db3":
        _check_sqlite(file, head, size)


def _check_sqlite(file: Path, head: bytes, size: int) -> None:
    page = int.from_bytes(head[16:18], "big")
    n_pages = int.from_bytes(head[28:32], "big")
    page_bytes = 65536 if page == 1 else page
    if not head.startswith(SQLITE_MAGIC) or len(head) < 100 or size < page_bytes * n_pages:
        raise CurveError(
            f"{file}: cut off, {size} bytes where {page_bytes * n_pages} belong; copy it anew, or record anew"
        )


@dataclass(slots=True)
class _Gathered:
    """What has been read of one stream."""

    layout: Layout
    msgtype: str
    frame: str
    order: str
    numbers: list[int] = field(default_factory=list)
    received_ns: list[int] = field(default_factory=list)
    stamp_ns: list[int] = field(default_factory=list)
    doubles: list[bytes] = field(default_factory=list)


def _collect(
    path: Path,
    reader: Any,  # noqa: ANN401 - one of two unrelated classes
    limits: Limits,
    topics: Sequence[str] | None,
    *,
    is_ros2: bool,
) -> RawLog:
    known = [c for c in reader.connections if c.msgtype in LAYOUTS]
    if topics is not None:
        known = [c for c in known if any(t == c.topic or t.startswith(f"{c.topic} ") for t in topics)]
    notes = [
        f"{c.topic}: {c.msgcount} messages of {c.msgtype}, a type that is not read"
        for c in reader.connections
        if c.msgtype not in LAYOUTS
    ]
    if not known:
        found = listed(f"{c.topic} ({c.msgtype})" for c in reader.connections)
        raise CurveError(
            f"{path}: no topic {'of a type that is read' if topics is None else listed(topics)} "
            f"(topics there: {found}); types that are read: {listed(LAYOUTS)}"
        )
    streams, n_read = _gather(path, reader, known, limits, is_ros2=is_ros2)
    n_listed = sum(int(c.msgcount) for c in known)
    if n_read != n_listed:
        raise CurveError(
            f"{path}: {n_read} messages found where the bag lists {n_listed}; it is damaged or cut off, "
            "reindex it or record anew"
        )
    start_ns = min((s.received_ns[0] for s in streams.values()), default=0)
    notes += [f"{name}: {s.msgtype} in frame '{s.frame}'" for name, s in streams.items() if s.frame]
    return RawLog(
        source=str(path),
        format="ROS 2 bag" if is_ros2 else "ROS 1 bag",
        row_word="message",
        streams=tuple(_stream(name, s, start_ns) for name, s in streams.items()),
        notes=tuple(notes),
        layout={},
    )


def _gather(
    path: Path,
    reader: Any,  # noqa: ANN401 - one of two unrelated classes
    known: Iterable["Connection"],
    limits: Limits,
    *,
    is_ros2: bool,
) -> tuple[dict[str, _Gathered], int]:
    streams: dict[str, _Gathered] = {}
    n_read = n_bytes = 0
    for connection, received_ns, data in reader.messages(connections=list(known)):
        raw = bytes(data)
        n_read += 1
        n_bytes += len(raw)
        limits.check_bytes(str(path), n_bytes, "the bag")
        layout = LAYOUTS[connection.msgtype]
        try:
            order = byte_order(raw, is_ros2=is_ros2)
            for part in take_apart(raw, layout, order, is_ros2=is_ros2):
                name = stream_name(connection.topic, layout, part.frames)
                frame = part.frames[0] if part.frames else ""
                stream = streams.setdefault(name, _Gathered(layout, connection.msgtype, frame, order))
                _check_same(path, name, n_read, stream, (connection.msgtype, frame, order))
                stream.numbers.append(n_read - 1)
                stream.received_ns.append(received_ns)
                stream.doubles.append(part.doubles)
                if part.stamp_ns is not None:
                    stream.stamp_ns.append(part.stamp_ns)
        except ValueError as error:
            if isinstance(error, CurveError):
                raise
            raise CurveError(
                f"{path}: message {n_read - 1}, topic '{connection.topic}' ({connection.msgtype}): {error}; "
                "record anew"
            ) from None
        if len(streams) > _MOST_STREAMS:
            raise CurveError(f"{path}: more than {_MOST_STREAMS} streams; record only wrench and pose")
    return streams, n_read


def _check_same(path: Path, name: str, n_read: int, stream: _Gathered, now: tuple[str, str, str]) -> None:
    before = (stream.msgtype, stream.frame, stream.order)
    if now != before:
        raise CurveError(
            f"{path}: message {n_read - 1}, topic '{name}': type, frame or byte order change from "
            f"{before} to {now}; record one sensor per topic"
        )


def _stream(name: str, gathered: _Gathered, start_ns: int) -> Stream:
    numbers = np.frombuffer(b"".join(gathered.doubles), dtype=f"{gathered.order}f8").astype(np.float64)
    table = numbers.reshape(-1, len(gathered.layout.doubles))
    columns = [Column(name="received", values=_seconds(gathered.received_ns, start_ns), unit="s")]
    if gathered.stamp_ns:
        columns.insert(0, _stamp_column(gathered.stamp_ns, start_ns))
    columns += [
        Column(name=field_name, values=np.ascontiguousarray(table[:, index]), unit=unit)
        for index, (field_name, unit) in enumerate(gathered.layout.doubles)
    ]
    return Stream(
        name=name,
        rows=np.array(gathered.numbers, dtype=np.int64),
        columns={column.name: column for column in columns},
    )


def _stamp_column(stamp_ns: Sequence[int], start_ns: int) -> Column:
    if not any(stamp_ns):
        nothing = np.full(len(stamp_ns), math.nan)
        return Column(name="stamp", values=nothing, unit="s", note="never set by the sender; use received")
    return Column(name="stamp", values=_seconds(stamp_ns, start_ns), unit="s")


def _seconds(times_ns: Sequence[int], start_ns: int) -> np.ndarray:
    # Whole numbers first: seconds since 1970 would leave a double a quarter of a microsecond.
    return np.array([time - start_ns for time in times_ns], dtype=np.float64) * 1e-9
