"""Vectors among the columns of a log, and the quantities that each may be by its names, units and numbers."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, kind_of
from palpate_robot_log.measures import LARGEST_DEVIATION, off_turn, off_unit
from palpate_robot_log.reading.channel_map import NO_COLUMN
from palpate_robot_log.reading.names import MEASURED, ROLES, factor_of, word_set, words_of
from palpate_robot_log.reading.raw import Stream

QUANTITIES = ("position", "orientation", "force", "moment")

_AXES = ("x", "y", "z", "w")
_SHORT = ("f", "t", "m", "q", "p", "r", "o", "pos", "rot", "quat", "force", "torque", "moment", "tcp")
_TURNS = {"roll": "x", "pitch": "y", "yaw": "z", "alpha": "x", "beta": "y", "gamma": "z"}
_ANGLES = ("abc", "wpr")
"""Letters of three angles in degrees: A, B, C of KUKA, Doosan and others, and W, P, R of Fanuc."""

WRENCH_WORDS = word_set("wrench ft force f sensor")
_POSE_WORDS = word_set("pose tcp transform")
_OF_MOTION = word_set("vel velocity speed twist acc accel acceleration omega gyro jerk error")
"""Words of vectors that a press has no use for."""
_IN_BASE = word_set("base o world actual")
"""Words of a wrench in the base frame: O_F_ext_hat_K of Franka, actual_TCP_force of Universal Robots."""
_ORDER = "the order of the columns of {}: x, y, z by their numbers is assumed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Columns of one vector, in the order x, y, z, w, or by their index."""

    stream: str
    words: tuple[str, ...]  # that their names share, in small letters
    columns: tuple[Column, ...]
    is_indexed: bool  # distinguished by numbers, so that what each is has to be guessed


def groups_of(stream: Stream) -> list[Group]:
    """Vectors among the columns of a stream: angles by letters, then those by axes, then those by numbers.

    The axis is the last word, or any other: ``x_meas``, ``cam_px_rel``.
    """
    found: dict[tuple[int, bool, tuple[str, ...]], dict[str, Column]] = defaultdict(dict)
    for column in stream.columns.values():
        for rank, words, axis in _splits(words_of(column.name)):
            found[rank, axis.isdigit(), words].setdefault(axis, column)
    groups, taken = [], set[str]()
    for (_, is_indexed, words), named in sorted(found.items(), key=lambda item: item[0][:2]):
        members = {axis: column for axis, column in named.items() if column.name not in taken}
        order: Sequence[str]
        if words[-1:] in [(letters,) for letters in _ANGLES]:
            order = words[-1] if {*words[-1]} <= {*members} else ""
        elif is_indexed:
            order = sorted(members, key=int) if len(members) in (3, 4, 6, 7, 9, 16) else []
        else:
            order = [axis for axis in _AXES if axis in members] if {*"xyz"} <= {*members} else []
        columns = [members[key] for key in order]
        if columns and "w" not in members and not is_indexed:
            # The scalar of a quaternion may have another mark: Q0, qs.
            scalars = [one for k in (0, 1) if (one := found.get((k, True, words), {}).get("0"))]
            columns += [one for one in scalars[:1] if _are_units(complete_rows([*columns, one]))]
        if columns:
            taken |= {column.name for column in columns}
            groups.append(
                Group(stream=stream.name, words=words, columns=tuple(columns), is_indexed=is_indexed)
            )
    return groups


def _splits(words: tuple[str, ...]) -> Iterator[tuple[int, tuple[str, ...], str]]:
    """Ways to part a name into words that a vector's columns share and its axis, the likeliest first.

    They begin with their rank: 0 for three angles, 1 where the axis is the last word, 2 elsewhere.
    """
    for at in reversed(range(len(words))):
        before, word, after = words[:at], words[at], words[at + 1 :]
        rank = 1 if not after else 2
        yield from ((0, (*before, *after, letters), word) for letters in _ANGLES if word in letters)
        if word in _AXES or (word.isdigit() and not after):
            yield rank, (*before, *after), word
        elif word in _TURNS:
            yield rank, (*before, *after, "euler"), _TURNS[word]
        elif word[-1] in _AXES and word[:-1] in _SHORT:
            yield rank, (*before, word[:-1], *after), word[-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Entry of the map for one quantity, and what is not sure about it."""

    entry: Mapping[str, Any]  # as in the channel map; a unit only where the file shows none
    stream: str
    is_in_base: bool = False  # a wrench whose name states that it is in the base frame
    is_commanded: bool = False  # the name states that the columns are not measured
    is_counter: bool = False  # counts rows, whose rate has to be given
    to_check: tuple[str, ...] = ()  # what a person has to decide
    score: float = 0.0
    also: tuple["Guess", ...] = ()  # what an orientation may be instead, the likeliest first

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its columns in the file."""
        names = self.entry.get(
            "columns", [self.entry.get(key, NO_COLUMN) for key in ("column", "nanoseconds")]
        )
        return tuple(name.removeprefix("-") for name in names if name != NO_COLUMN)

    @property
    def unit(self) -> str:
        """Unit that the map gives; empty where it gives none."""
        return str(self.entry.get("unit", ""))

    def with_check(self, check: str, **entry: object) -> "Guess":
        """Guess with one more thing to check, and changes of its entry and of all that it may be instead."""
        also = tuple(replace(one, entry={**one.entry, **entry}) for one in self.also)
        return replace(self, entry={**self.entry, **entry}, also=also, to_check=(*self.to_check, check))


class Part(NamedTuple):
    """Columns of a group that are one quantity."""

    quantity: str
    columns: slice
    score: float
    form: str = ""


class Shape(NamedTuple):
    """Number of columns of a group, words of which it has one, the test of its last part, and its parts."""

    n_columns: int
    words: frozenset[str]
    holds: Callable[[FloatArray], bool] | None
    parts: tuple[Part, ...]

    def fits(self, group: "Group") -> bool:
        """Whether a group has this shape."""
        if self.n_columns != len(group.columns) or not (self.words & {*group.words} or not self.words):
            return False
        return self.holds is None or self.holds(complete_rows(group.columns[self.parts[-1].columns]))


def _are_small(deviations: FloatArray) -> bool:
    return deviations.size > 0 and bool(np.median(deviations) < LARGEST_DEVIATION)


def _are_units(rows: FloatArray) -> bool:
    return _are_small(off_unit(rows))


def _are_turns(rows: FloatArray) -> bool:
    return _are_small(off_turn(rows))


_ALL, _HEAD, _TAIL = slice(None), slice(0, 3), slice(3, None)
_ANY = frozenset[str]()
SHAPES = (
    Shape(4, _ANY, _are_units, (Part("orientation", _ALL, 4.0, "quaternion"),)),
    Shape(6, WRENCH_WORDS, None, (Part("force", _HEAD, 2.0), Part("moment", _TAIL, 2.0))),
    Shape(6, _POSE_WORDS, None, (Part("position", _HEAD, 1.5), Part("orientation", _TAIL, 1.5, "angles"))),
    Shape(7, _ANY, _are_units, (Part("position", _HEAD, 2.0), Part("orientation", _TAIL, 4.0, "quaternion"))),
    Shape(9, _ANY, _are_turns, (Part("orientation", _ALL, 3.0, "rotation_matrix"),)),
)
"""Patterns of vectors that are not three columns; the first that fits counts."""


def possible(group: Group, *, is_turned: bool, t_is_moment: bool) -> Iterator[tuple[str, Guess]]:
    """Possible meanings of a group, with scores; ``is_turned`` where angles are named as its x, y, z."""
    n_columns, words = len(group.columns), {*group.words}
    if words & _OF_MOTION:
        return
    parts: Iterable[Part] = ()
    if n_columns == 3:
        if "t" in words and not t_is_moment:  # a tracker's translation, next to a moment M
            words = words - {"t"} | {"translation"}
        parts = _of_three(group.columns[0], words, is_turned=is_turned)
    elif n_columns == 16:
        yield from _of_transform(group)
    else:
        parts = next((shape.parts for shape in SHAPES if shape.fits(group)), ())
    for quantity, chosen, score, form in parts:
        columns = group.columns[chosen]
        check = (_ORDER.format(quantity),) if n_columns > 4 and not form else ()
        guesses = [
            Guess(
                entry=entry,
                stream=group.stream,
                score=score,
                is_in_base=bool(words & _IN_BASE),
                to_check=check,
            )
            for entry in _entries(group, columns, form)
        ]
        yield quantity, replace(guesses[0], also=tuple(guesses[1:]))


def _of_three(column: Column, words: Set[str], *, is_turned: bool) -> Iterator[Part]:
    """Quantities of three columns by their words and the unit of the first, with scores."""
    unit = column.shown_unit
    is_other = any(ROLES[other].vector & words for other in QUANTITIES[1:])
    for quantity in QUANTITIES:
        # A place may be a word of any vector: tcp_force, POS_ACT.A.
        score = (1.0 if quantity == "position" and is_other else 2.0) * bool(ROLES[quantity].vector & words)
        if unit and (kind := kind_of(unit)) is not None:
            # A sensor in volts is asked about.
            odd = min(score, 1.0) if kind == "other" else -1.0
            score = score + 3.0 if factor_of(column, ROLES[quantity].kind) is not None else odd
        elif quantity == "position" and is_turned:
            score = 2.0
        elif quantity == "position" and not is_other and not ROLES[quantity].vector & words:
            score = 1.5 if words & MEASURED else 0.5 if words else 1.0
        if score > 0.0:
            yield Part(quantity, _ALL, score, "angles" if quantity == "orientation" else "")


def _entries(group: Group, columns: Sequence[Column], form: str) -> list[dict[str, Any]]:
    """Entries of the map that columns may be as a form, the likeliest first."""
    names, words, shown = [column.name for column in columns], {*group.words}, columns[-1].shown_unit
    if form == "quaternion":  # w is last, or first where they are only numbered and called q
        orders = [names, [*names[1:], names[0]]] if group.is_indexed else [names]
        if {"wxyz", "xyzw"} & words:
            orders = [orders["wxyz" in words]]
        return [{"columns": order} for order in (orders[::-1] if group.words[-1:] == ("q",) else orders)]
    if form != "angles":
        return [{"form": form, "columns": names} if form else {"columns": names}]
    largest = np.abs(complete_rows(columns)).max(initial=0.0)
    is_in_degrees = shown == "deg" or (not kind_of(shown) and largest > 2.0 * np.pi)
    axes = ["", "xyz", "XYZ", "ZYX"]  # none: a rotation vector
    if "abc" in words:  # KUKA; Doosan and Stäubli
        axes = ["ZYX", "ZYZ", "XYZ"]
    elif {"euler", "rpy", "wpr"} & words or is_in_degrees:
        axes = [*axes[1:], ""]
    unit = {"unit": "deg"} if {"abc", "wpr"} & words and is_in_degrees and not kind_of(shown) else {}
    return [
        {"form": "euler", "columns": names, "sequence": each, **unit}
        if each
        else {"form": "axis_angle", "columns": names, **unit}
        for each in axes
    ]


def _of_transform(group: Group) -> Iterator[tuple[str, Guess]]:
    """Position and turn of a homogeneous transform (4, 4), by columns as Franka logs it, or by rows."""
    table, rows = complete_rows(group.columns), np.arange(16).reshape(4, 4)
    names = np.array([column.name for column in group.columns], dtype=object)
    for order in (rows.T, rows):
        turn = order[:3, :3].ravel()
        if np.allclose(table[:, order[3]], (0.0, 0.0, 0.0, 1.0)) and _are_turns(table[:, turn]):
            moves = 1.0 * (extent(table) > 0.0)
            place = {"columns": names[order[:3, 3]].tolist()}
            yield "position", Guess(entry=place, stream=group.stream, score=3.0 + moves)
            matrix = {"form": "rotation_matrix", "columns": names[turn].tolist()}
            yield "orientation", Guess(entry=matrix, stream=group.stream, score=4.0 + moves)
            return


def complete_rows(columns: Iterable[Column]) -> FloatArray:
    """Values (n, k) of k columns in the rows where all have one."""
    table = np.column_stack([column.values for column in columns])
    complete: FloatArray = table[np.isfinite(table).all(axis=1)]
    return complete


def rest_of(values: FloatArray) -> FloatArray:
    """Median (k,) of the first hundredth of some rows (n, k), at least five: of a force in free air."""
    rest: FloatArray = np.median(values[: max(len(values) // 100, 5)], axis=0)
    return rest


def pressed_rows(push: FloatArray) -> tuple[int, int]:
    """Last row in free air and first row of nearly the largest push, among sizes (n,) of the push."""
    loaded = int(np.argmax(push >= 0.9 * push.max()))
    before = np.flatnonzero(push[:loaded] <= 0.1 * push.max())
    return int(before[-1]) if before.size else 0, loaded


def extent(values: FloatArray) -> float:
    """Largest range of a column (n, k); 0 without rows."""
    return float(np.ptp(values, axis=0).max()) if len(values) else 0.0
