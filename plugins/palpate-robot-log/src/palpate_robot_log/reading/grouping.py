"""Columns that belong together by their names: the axes of one vector."""

import re
from dataclasses import dataclass

from palpate.delimited import Column, unit_in
from palpate_robot_log.reading.raw import Stream

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zäöüß]+|\d+")
_AXES = ("x", "y", "z", "w")
_SHORT = ("f", "t", "m", "q", "p", "r", "pos", "rot", "quat", "force", "torque", "moment", "tcp")
_ROLL_PITCH_YAW = {"roll": "x", "pitch": "y", "yaw": "z"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Columns of one vector.

    Parameters
    ----------
    stream : str
    words : tuple of str
        What their names share, in small letters.
    columns : tuple of Column
        In the order x, y, z, w, or by their index.
    is_indexed : bool
        Distinguished by numbers, so that what each is has to be guessed.
    """

    stream: str
    words: tuple[str, ...]
    columns: tuple[Column, ...]
    is_indexed: bool

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)


def words_of(name: str) -> tuple[str, ...]:
    """Words of a column's name, without its unit, in small letters.

    Examples
    --------
    >>> words_of("actual_TCP_force_0"), words_of("wrench.force.x"), words_of("Fx [N]")
    (('actual', 'tcp', 'force', '0'), ('wrench', 'force', 'x'), ('fx',))
    """
    label, _ = unit_in(name)
    return tuple(word.lower() for word in _WORD.findall(label))


def groups_of(stream: Stream) -> list[Group]:
    """Vectors among the columns of a stream: first those by axes, then those by numbers."""
    found: dict[tuple[bool, tuple[str, ...]], dict[str, Column]] = {}
    for column in stream.columns.values():
        words, axis = _split(words_of(column.name))
        if axis is not None:
            found.setdefault((axis.isdigit(), words), {})[axis] = column
    groups = []
    for (is_indexed, words), members in sorted(found.items(), key=lambda item: item[0][0]):
        if is_indexed:
            order = sorted(members, key=int) if len(members) in (3, 4, 6, 7, 9) else []
        else:
            order = [axis for axis in _AXES if axis in members] if {*"xyz"} <= {*members} else []
        if order:
            columns = tuple(members[key] for key in order)
            groups.append(Group(stream=stream.name, words=words, columns=columns, is_indexed=is_indexed))
    return groups


def _split(words: tuple[str, ...]) -> tuple[tuple[str, ...], str | None]:
    """Words that a vector's columns share, and what is its own."""
    if not words:
        return words, None
    *before, last = words
    if last in _AXES or last.isdigit():
        return tuple(before), last
    if last in _ROLL_PITCH_YAW:
        return (*before, "euler"), _ROLL_PITCH_YAW[last]
    if last[-1] in _AXES and last[:-1] in _SHORT:
        return (*before, last[:-1]), last[-1]
    # A frame may follow the axis: fx_sensor.
    if len(before) == 1 and before[0][-1] in _AXES and before[0][:-1] in _SHORT:
        return (before[0][:-1], last), before[0][-1]
    return words, None
