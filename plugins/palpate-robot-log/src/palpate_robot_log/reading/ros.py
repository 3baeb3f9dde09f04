"""Bags of ROS 1 and ROS 2, by rosbags: one stream for each topic of a known type."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from palpate.api import CurveError, FloatArray
from palpate.api.files import Column, listed
from palpate_robot_log.reading.raw import RawLog, Stream, or_damaged

Fields = tuple[tuple[str, str], ...]


def _axes(vector: str, unit: str, axes: str = "xyz") -> Fields:
    return tuple((f"{vector}.{axis}", unit) for axis in axes)


def _in(member: str, fields: Fields) -> Fields:
    return tuple((f"{member}.{name}", unit) for name, unit in fields)


_WRENCH = (*_axes("force", "N"), *_axes("torque", "N m"))
_POSE = (*_axes("position", "m"), *_axes("orientation", "", "xyzw"))
_TRANSFORM = (*_axes("transform.translation", "m"), *_axes("transform.rotation", "", "xyzw"))
_TRANSFORMS = "tf2_msgs/msg/TFMessage"
"""Type of a message of several transforms, each of which is a stream of its two frames."""

FIELDS: MappingProxyType[str, Fields] = MappingProxyType(
    {
        "geometry_msgs/msg/WrenchStamped": _in("wrench", _WRENCH),
        "geometry_msgs/msg/Wrench": _WRENCH,
        "geometry_msgs/msg/PoseStamped": _in("pose", _POSE),
        "geometry_msgs/msg/Pose": _POSE,
        "geometry_msgs/msg/PoseWithCovarianceStamped": _in("pose.pose", _POSE),
        "nav_msgs/msg/Odometry": _in("pose.pose", _POSE),
        "geometry_msgs/msg/TransformStamped": _TRANSFORM,
        _TRANSFORMS: _TRANSFORM,
        "geometry_msgs/msg/PointStamped": _axes("point", "m"),
        "geometry_msgs/msg/Vector3Stamped": _axes("vector", ""),
        "geometry_msgs/msg/QuaternionStamped": _axes("quaternion", "", "xyzw"),
        "std_msgs/msg/Float64": (("data", ""),),
    }
)
"""Numbers that are read of each message, with their units."""


class _Gathered(NamedTuple):
    """Values read from one stream: a row has its number, two times [ns], and the values of fields."""

    msgtype: str
    frame: str
    values_of: Callable[[Any], tuple[float, ...]]
    rows: list[tuple[Any, ...]]


def read_bag(path: Path, topics: Sequence[str] | None = None) -> RawLog:
    """Streams of a ROS 1 ``.bag``, a ROS 2 bag folder, or one ``.mcap`` or ``.db3`` of it.

    Each stream has the columns ``received`` (when the message was recorded) and, for
    messages with a header, ``stamp``: seconds since the first message of the bag. Without ``topics``
    all of known types are read.
    """
    advice = "repair it with 'rosbag reindex', 'ros2 bag reindex' or 'mcap recover', or record again"
    with or_damaged(path, "the bag is damaged or cut off", advice):
        reader, deserialise = _reader(path)
        with reader:
            return _collected(path, reader, deserialise, topics)


def bag_file(path: Path) -> Path | None:
    """File of a ROS 2 bag in its folder, which a study names; None where there is not one alone."""
    files = [each for each in path.iterdir() if each.suffix in (".mcap", ".db3")] if path.is_dir() else []
    return files[0] if len(files) == 1 else None


def _reader(path: Path) -> tuple[Any, Callable[[bytes, str], Any]]:
    """Reader of the bag, not yet open, and what makes messages of its bytes."""
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise CurveError(
            f"{path}: ROS bags need rosbags; run: pip install 'palpate-robot-log[ros]'"
        ) from None
    # The bag's own definitions are not used: a topic that is not read may have any.
    if path.is_file():
        with path.open("rb") as stream:
            if stream.read(9) == b"#ROSBAG V":
                return rosbag1.Reader(path), get_typestore(Stores.ROS1_NOETIC).deserialize_ros1
    if path.is_file() and path.suffix not in (".mcap", ".db3"):
        raise CurveError(
            f"{path}: a recording of ROS 2 that ends in '{path.suffix}'; rename it to .mcap or .db3"
        )
    for log in path.glob("*-wal") if path.is_dir() else [path.with_name(f"{path.name}-wal")]:
        if log.is_file() and log.stat().st_size:
            raise CurveError(
                f"{log}: the recording was not closed; open the .db3 once with sqlite3 to finish it"
            )
    return rosbag2.Reader(path), get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr


def _collected(
    path: Path,
    reader: Any,  # noqa: ANN401 - one of two unrelated classes
    deserialise: Callable[[bytes, str], Any],
    topics: Sequence[str] | None,
) -> RawLog:
    known = [c for c in reader.connections if c.msgtype in FIELDS]
    if topics is not None:
        # A pose of transforms may be a chain over several topics.
        has_frames = any(" " in topic for topic in topics)
        known = [c for c in known if c.topic in topics or (has_frames and c.msgtype == _TRANSFORMS)]
    if not known:
        found = listed(f"{c.topic} ({c.msgtype})" for c in reader.connections)
        raise CurveError(
            f"{path}: no topic {'of a type that is read' if topics is None else listed(topics)} "
            f"(topics there: {found}); types that are read: {listed(FIELDS)}"
        )
    streams: dict[str, _Gathered] = {}
    n_read = 0
    for n_read, (connection, received_ns, raw) in enumerate(reader.messages(connections=known), start=1):
        message = deserialise(raw, connection.msgtype)
        for part in getattr(message, "transforms", (message,)):
            _gather(path, streams, connection, part, n_read - 1, received_ns)
    n_listed = sum(int(c.msgcount) for c in known)
    if n_read != n_listed:
        raise CurveError(
            f"{path}: {n_read} messages found where the bag lists {n_listed}; it is damaged or cut off, "
            "reindex it or record again"
        )
    notes = [
        f"{c.topic}: {c.msgcount} messages of {c.msgtype}, a type that is not read"
        for c in reader.connections
        if c.msgtype not in FIELDS
    ]
    notes += [f"{name}: {s.msgtype} in frame '{s.frame}'" for name, s in streams.items() if s.frame]
    notes += [f"{name}: one message, so no motion" for name, s in streams.items() if len(s.rows) == 1]
    moving = {name for name, s in streams.items() if len(s.rows) > 1} or {*streams}
    start_ns = min((streams[name].rows[0][2] for name in moving), default=0)
    read = {name: _stream(name, s, start_ns) for name, s in streams.items()}
    transforms = (name for name, s in streams.items() if s.msgtype == _TRANSFORMS)
    frames = {name: name.rpartition(" ")[2].split(">", 1) for name in transforms}
    composed = [*chains({(parent, child): read[name] for name, (parent, child) in frames.items()})]
    notes += [f"{one.name}: composed of a chain of transforms" for one in composed]
    return RawLog(
        source=str(path),
        format="ROS 2 bag" if "rosbag2" in type(reader).__module__ else "ROS 1 bag",
        row_word="message",
        streams=(*composed, *(one for name, one in read.items() if name in moving)),
        notes=tuple(notes),
    )


def _gather(
    path: Path,
    streams: dict[str, _Gathered],
    connection: Any,  # noqa: ANN401 - rosbags may be missing
    part: Any,  # noqa: ANN401 - a message
    number: int,
    received_ns: int,
) -> None:
    """Add a message to the stream of its topic, a transform to the stream of its two frames."""
    header = getattr(part, "header", None)
    frame = header.frame_id if header else ""
    name = connection.topic
    if connection.msgtype == _TRANSFORMS:
        name = f"{name} {frame}>{part.child_frame_id}"
    stream = streams.get(name)
    if stream is None:
        values_of = attrgetter(*(field_name for field_name, _ in FIELDS[connection.msgtype]))
        stream = streams[name] = _Gathered(connection.msgtype, frame, values_of, [])
    if (connection.msgtype, frame) != (stream.msgtype, stream.frame):
        raise CurveError(
            f"{path}: message {number}, topic '{name}': type or frame change from {stream.msgtype}, "
            f"'{stream.frame}' to {connection.msgtype}, '{frame}'; record one sensor per topic"
        )
    stamp_ns = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec if header else None
    values = stream.values_of(part)
    values = values if isinstance(values, tuple) else (values,)
    stream.rows.append((number, stamp_ns, received_ns, *values))


def _stream(name: str, gathered: _Gathered, start_ns: int) -> Stream:
    import polars as pl

    fields = dict(FIELDS[gathered.msgtype])
    whole = dict.fromkeys(("number", "stamp", "received"), pl.Int64)
    schema = {**whole, **dict.fromkeys(fields, pl.Float64)}
    frame = pl.DataFrame(gathered.rows, schema=schema, orient="row")
    notes, is_stamped = dict[str, str](), frame["stamp"].null_count() == 0
    if is_stamped and not (frame["stamp"] != 0).any():
        frame, notes = frame.with_columns(stamp=None), {"stamp": "never set by the sender; use received"}
    # Whole numbers first: seconds since 1970 would leave a double a quarter of a microsecond.
    since = (pl.col("stamp", "received") - start_ns).cast(float).fill_null(math.nan) * 1e-9
    return Stream(
        name=name,
        frame=frame.select(since, *fields).drop([] if is_stamped else ["stamp"]),
        rows=frame["number"].to_numpy(),
        units={one: unit for one, unit in {"stamp": "s", "received": "s", **fields}.items() if unit},
        notes=notes,
    )


# -------------------------------------------------------------------------------- chains of transforms

PLACE = tuple(f"transform.translation.{axis}" for axis in "xyz")
TURN = tuple(f"transform.rotation.{axis}" for axis in "xyzw")
_CLOCKS = ("stamp", "received")


def chains(edges: Mapping[tuple[str, str], Stream]) -> Iterator[Stream]:
    """Streams of the poses of frames in their root, the longest chain first; edges are by parent and child.

    A transform of one message is static. The times of the one that comes most often are kept.
    """
    parents = {child: parent for parent, child in edges}
    found = []
    for child in parents:
        way = [child]
        while way[-1] in parents and way.count(way[-1]) == 1:
            way.append(parents[way[-1]])
        parts = [edges[pair] for pair in zip(way[:0:-1], way[-2::-1], strict=True)]
        if len(parts) > 1 and way[-1] not in parents and any(part.rows.size > 1 for part in parts):
            found.append((way[-1], child, parts))
    for root, child, parts in sorted(found, key=lambda one: -len(one[2])):
        if (pose := _composed(parts, f"{root}>{child}")) is not None:
            yield pose


def _composed(parts: Sequence[Stream], name: str) -> Stream | None:
    """Product of transforms, the root's first; None where their times do not overlap."""
    moving = [part for part in parts if part.rows.size > 1]
    times = [
        name
        for name in _CLOCKS
        if all(name in one.frame.columns and np.all(np.diff(one.column(name).values) > 0.0) for one in moving)
    ]
    if not times:
        return None
    clocks = [part.column(times[0]).values for part in moving]
    kept, time = max(zip(moving, clocks, strict=True), key=lambda one: one[1].size)
    begin, end = max(clock[0] for clock in clocks), min(clock[-1] for clock in clocks)
    rows = np.flatnonzero((time >= begin) & (time <= end))
    if rows.size < 2:
        return None
    place, turn = np.zeros((rows.size, 3)), Rotation.identity(rows.size)
    for part in parts:
        offset, rotation = _at(part, times[0], time[rows])
        place, turn = place + turn.apply(offset), turn * rotation
    columns = [Column(name=one, values=kept.column(one).values[rows], unit="s") for one in times]
    columns += [Column(name=one, values=v, unit="m") for one, v in zip(PLACE, place.T, strict=True)]
    columns += [Column(name=one, values=v) for one, v in zip(TURN, turn.as_quat().T, strict=True)]
    return Stream.of(columns, f"{kept.name.rpartition(' ')[0]} {name}", kept.rows[rows])


def _at(part: Stream, clock: str, time_s: FloatArray) -> tuple[FloatArray, Rotation]:
    """Translation (n, 3) and rotation of a transform at some times, between the times of its messages."""
    place, turn = (part.frame.select(names).to_numpy() for names in (PLACE, TURN))
    if part.rows.size == 1:
        return np.tile(place, (time_s.size, 1)), Rotation.from_quat(np.tile(turn, (time_s.size, 1)))
    own = np.array(part.column(clock).values)
    offset = np.column_stack([np.interp(time_s, own, column) for column in place.T])
    return offset, Slerp(own, Rotation.from_quat(turn))(time_s)
