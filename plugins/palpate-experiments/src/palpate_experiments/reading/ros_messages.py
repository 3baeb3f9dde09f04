"""Messages of ROS taken apart by their published layout.

The definitions that a bag carries are not used: turning them into code is what a
bag from a stranger must not be able to ask for. The types below have had the same
fields since they were first released.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import MappingProxyType

Fields = tuple[tuple[str, str], ...]


def _axes(prefix: str, unit: str, axes: str = "xyz") -> Fields:
    return tuple((f"{prefix}.{axis}", unit) for axis in axes)


@dataclass(frozen=True, slots=True)
class Layout:
    """Fields of a message in order.

    Parameters
    ----------
    doubles : tuple of (name, unit)
        The numbers that are read; they stand in one block.
    n_after : int
        Doubles after them that are not read.
    is_stamped : bool
        The message begins with a header: stamp and frame.
    n_names : int
        Texts between the header and the numbers.
    is_list : bool
        The message is a list of these.
    """

    doubles: Fields
    n_after: int = 0
    is_stamped: bool = True
    n_names: int = 0
    is_list: bool = False


_WRENCH = (*_axes("wrench.force", "N"), *_axes("wrench.torque", "N m"))
_POSE = (*_axes("pose.position", "m"), *_axes("pose.orientation", "", "xyzw"))
_TRANSFORM = (*_axes("transform.translation", "m"), *_axes("transform.rotation", "", "xyzw"))


def _bare(fields: Fields) -> Fields:
    return tuple((name.split(".", 1)[1], unit) for name, unit in fields)


LAYOUTS: MappingProxyType[str, Layout] = MappingProxyType(
    {
        "geometry_msgs/msg/WrenchStamped": Layout(_WRENCH),
        "geometry_msgs/msg/Wrench": Layout(_bare(_WRENCH), is_stamped=False),
        "geometry_msgs/msg/PoseStamped": Layout(_POSE),
        "geometry_msgs/msg/Pose": Layout(_bare(_POSE), is_stamped=False),
        "geometry_msgs/msg/PoseWithCovarianceStamped": Layout(
            tuple((f"pose.{name}", unit) for name, unit in _POSE), n_after=36
        ),
        "nav_msgs/msg/Odometry": Layout(
            tuple((f"pose.{name}", unit) for name, unit in _POSE), n_after=36 + 6 + 36, n_names=1
        ),
        "geometry_msgs/msg/TransformStamped": Layout(_TRANSFORM, n_names=1),
        "tf2_msgs/msg/TFMessage": Layout(_TRANSFORM, n_names=1, is_list=True),
        "geometry_msgs/msg/PointStamped": Layout(_axes("point", "m")),
        "geometry_msgs/msg/Vector3Stamped": Layout(_axes("vector", "")),
        "geometry_msgs/msg/QuaternionStamped": Layout(_axes("quaternion", "", "xyzw")),
        "std_msgs/msg/Float64": Layout((("data", ""),), is_stamped=False),
    }
)
"""Layout by message type, in the names of ROS 2."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message taken apart.

    Parameters
    ----------
    stamp_ns : int or None
        None without a header.
    frames : tuple of str
        Frame of the header, and names after it.
    doubles : bytes
        Numbers in the byte order of the message.
    """

    stamp_ns: int | None
    frames: tuple[str, ...]
    doubles: bytes


class _Cursor:
    """Place in the bytes of one message; in ROS 2 fields stand ``aligned`` to multiples of their size."""

    def __init__(self, raw: bytes, order: str, *, aligned: bool) -> None:
        self._raw = raw
        self._origin = self._at = 4 if aligned else 0
        self._aligned = aligned
        self._int = struct.Struct(order + "I")
        self._stamp = struct.Struct(order + ("iI" if aligned else "II"))

    def integer(self) -> int:
        self._align(4)
        (value,) = self._int.unpack(self._take(4))
        return int(value)

    def stamp_ns(self) -> int:
        self._align(4)
        seconds, nanoseconds = self._stamp.unpack(self._take(8))
        return int(seconds) * 1_000_000_000 + int(nanoseconds)

    def text(self) -> str:
        content = self._take(self.integer())
        return content.rstrip(b"\0").decode("utf-8", "replace")

    def doubles(self, n_doubles: int) -> bytes:
        self._align(8)
        return self._take(8 * n_doubles)

    def rest(self) -> int:
        return len(self._raw) - self._at

    def _align(self, size: int) -> None:
        if self._aligned:
            self._at += -(self._at - self._origin) % size

    def _take(self, n_bytes: int) -> bytes:
        end = self._at + n_bytes
        if end > len(self._raw):
            raise ValueError(f"it ends after {len(self._raw)} bytes where {end} are needed")
        taken = self._raw[self._at : end]
        self._at = end
        return taken


def byte_order(raw: bytes, *, is_ros2: bool) -> str:
    """Byte order of a message, ``<`` or ``>``.

    Raises
    ------
    ValueError
        A ROS 2 message is not in plain CDR.
    """
    if not is_ros2:
        return "<"
    if len(raw) < 4 or raw[0] != 0 or raw[1] not in (0, 1):
        raise ValueError("it is not in plain CDR")
    return "<" if raw[1] else ">"


def take_apart(raw: bytes, layout: Layout, order: str, *, is_ros2: bool) -> Iterator[Message]:
    """Parts of a message: one, or as many as its list has.

    Raises
    ------
    ValueError
        Its length is not that of its type.
    """
    cursor = _Cursor(raw, order, aligned=is_ros2)
    n_parts = cursor.integer() if layout.is_list else 1
    for _ in range(n_parts):
        yield _part(cursor, layout, is_ros2=is_ros2)
    # CDR may fill up the last four or eight bytes.
    if cursor.rest() > (7 if is_ros2 else 0):
        raise ValueError(f"it has {cursor.rest()} bytes more than its type")


def _part(cursor: _Cursor, layout: Layout, *, is_ros2: bool) -> Message:
    stamp, frames = None, []
    if layout.is_stamped:
        if not is_ros2:
            cursor.integer()  # the sequence number, which ROS 2 has no more
        stamp = cursor.stamp_ns()
        frames.append(cursor.text())
    frames += [cursor.text() for _ in range(layout.n_names)]
    doubles = cursor.doubles(len(layout.doubles))
    if layout.n_after:
        cursor.doubles(layout.n_after)
    return Message(stamp_ns=stamp, frames=tuple(frames), doubles=doubles)


def stream_name(topic: str, layout: Layout, frames: Sequence[str]) -> str:
    """Name of the stream that a message belongs to: the topic, of transforms also the two frames."""
    return f"{topic} {frames[0]}>{frames[1]}" if layout.is_list else topic
