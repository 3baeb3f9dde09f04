"""Chains of transforms of ROS: from the root of the frames to each frame that several transforms lead to."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from palpate.api import FloatArray
from palpate.api.files import Column
from palpate_robot_log.reading.raw import Stream

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
    """Translation (n, 3) and rotation of a transform at some times, between those of its messages."""
    place, turn = (part.frame.select(names).to_numpy() for names in (PLACE, TURN))
    if part.rows.size == 1:
        return np.tile(place, (time_s.size, 1)), Rotation.from_quat(np.tile(turn, (time_s.size, 1)))
    own = np.array(part.column(clock).values)
    offset = np.column_stack([np.interp(time_s, own, column) for column in place.T])
    return offset, Slerp(own, Rotation.from_quat(turn))(time_s)
