"""Quantities that the columns of a log may be, by their names, units and numbers: vectors, and the time."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, kind_of
from palpate_robot_log.measures import LARGEST_DEVIATION, off_turn, off_unit
from palpate_robot_log.reading.channel_map import NO_COLUMN
from palpate_robot_log.reading.names import ROLES, TURNS, WORDS, Rank, has_role, rank_of, words_of
from palpate_robot_log.reading.raw import Stream

QUANTITIES = ("position", "orientation", "force", "moment")

_AXES = ("x", "y", "z", "w")
_SHORT = ("f", "t", "m", "q", "p", "r", "o", "pos", "rot", "quat", "force", "torque", "moment", "tcp")
_ANGLES = ("abc", "wpr")
"""Letters of three angles in degrees: A, B, C of KUKA, Doosan and others, and W, P, R of Fanuc."""

WRENCH_WORDS = WORDS["wrench"] | WORDS["six"]
ORDER = "the order of the columns of {}: x, y, z by their numbers is assumed"

_STAMPS = (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec"), ("sek", "nsek"))
"""Fields of a time stamp, as of ROS and KUKA's Sunrise: whole seconds, and nanoseconds to add."""
_COARSE_CLOCK, _USUAL_LENGTH_S, _LONGEST_STEP_S = 0.01, 20.0, 2.0
_RISING, _LEAST_RISING = 0.9, 0.25
"""Shares of steps of a time that do not go back, and that go up: a clock coarser than the rows repeats."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Entry of the map for one quantity, and what is not sure about it."""

    entry: Mapping[str, Any]  # as in the channel map; a unit only where the file shows none
    stream: str
    rank: Rank | None = None
    is_in_base: bool = False  # a wrench whose name states that it is in the base frame
    is_commanded: bool = False  # the name states that the columns are not measured
    is_counter: bool = False  # counts rows, whose rate has to be given
    to_check: tuple[str, ...] = ()  # what a person has to decide
    question: str = ""  # for a unit of which there are several
    also: tuple["Guess", ...] = ()  # what an orientation may be instead, the likeliest first

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its columns in the file."""
        entry = self.entry
        names = entry.get("columns", [entry.get(key, NO_COLUMN) for key in ("column", "nanoseconds")])
        return tuple(name.removeprefix("-") for name in names if name != NO_COLUMN)

    def __str__(self) -> str:
        stream = f" of stream '{self.stream}'" if self.stream else ""
        return ", ".join(self.entry["columns"]) + stream

    def with_check(self, check: str, **entry: object) -> "Guess":
        """Guess with one more thing to check, and changes of its entry and of all that it may be instead."""
        also = tuple(replace(one, entry={**one.entry, **entry}) for one in self.also)
        return replace(self, entry={**self.entry, **entry}, also=also, to_check=(*self.to_check, check))


# ------------------------------------------------------------------------------------ vectors


class Group(NamedTuple):
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
    axes = {words_of(name)[-1:]: column for name, column in stream.columns.items()}
    of_turn = [axes.get((f"{of}{on}",)) for on in "xyz" for of in "noa"]  # axes of a tool, row by row
    if None not in of_turn:
        groups.append(Group(stream.name, (), tuple(filter(None, of_turn)), is_indexed=True))
        taken = {column.name for column in groups[0].columns}
    for (_, is_indexed, words), named in sorted(found.items(), key=lambda item: item[0][:2]):
        members = {axis: column for axis, column in named.items() if column.name not in taken}
        order: Sequence[str]
        if words[-1:] in [(letters,) for letters in _ANGLES]:
            order = words[-1] if {*words[-1]} <= {*members} else ""
        elif is_indexed:
            order = sorted(members, key=int) if len(members) in (3, 4, 6, 7, 9, 12, 16) else []
        else:
            order = [axis for axis in _AXES if axis in members] if {*"xyz"} <= {*members} else []
        columns = [members[key] for key in order]
        if columns and "w" not in members and not is_indexed:
            # The scalar of a quaternion may have another mark: Q0, qs.
            numbered = (found.get((k, True, words), {}) for k in (0, 1))
            scalars = [named["0"] for named in numbered if [*named] == ["0"]]
            columns += [one for one in scalars[:1] if _are_units(complete_rows([*columns, one]))]
        if columns:
            taken |= {column.name for column in columns}
            groups.append(Group(stream.name, words, tuple(columns), is_indexed))
    return [_or_moment(group, groups) for group in groups]


def _or_moment(group: Group, groups: Sequence[Group]) -> Group:
    """Group, or the moment that turns of a force are: TCPForce_rx next to TCPForce_x, and ft_a to ft_x.

    KUKA's A is about z, B about y and C about x.
    """
    *words, last = group.words or ("",)
    are_of_force = last in ("r", "abc") and bool({*words} & (ROLES["force"].vector | WORDS["wrench"]))
    if not are_of_force or all(each.words != (*words,) for each in groups):
        return group
    return group._replace(words=("moment",), columns=group.columns[:: -1 if last == "abc" else 1])


def _splits(words: tuple[str, ...]) -> Iterator[tuple[int, tuple[str, ...], str]]:
    """Ways to part a name into words that a vector's columns share and its axis, the likeliest first.

    They begin with their rank: 0 for three angles, 1 where the axis is the last word, 2 elsewhere.
    """
    for at in reversed(range(len(words))):
        before, word, after = words[:at], words[at], words[at + 1 :]
        rank = 1 if not after else 2
        yield from ((0, (*before, *after, letters), word) for letters in _ANGLES if word in letters)
        is_turn = bool({*before[-1:]} & ROLES["orientation"].vector)  # q0_meas
        if word in _AXES or (word.isdigit() and (not after or is_turn)):
            yield rank, (*before, *after), word
        elif word in TURNS:
            yield rank, (*before, *after, "euler"), TURNS[word]
        elif word[:-1] == "v" and word[-1] in _AXES and before[-1:] == ("force",):  # force_vx of OpenSim
            yield rank, (*before, *after), word[-1]
        elif word[-1] in _AXES and word[:-1] in _SHORT:
            yield rank, (*before, word[:-1], *after), word[-1]


_Part = tuple[str, slice, float, str]
"""Quantity, its columns in a group, a score by words and shape, and the form of an orientation."""


def _are_units(rows: FloatArray) -> bool:
    return len(rows) > 0 and bool(np.median(off_unit(rows)) < LARGEST_DEVIATION)


def _are_turns(rows: FloatArray) -> bool:
    return len(rows) > 0 and bool(np.median(off_turn(rows)) < LARGEST_DEVIATION)


_ALL, _HEAD, _TAIL = slice(None), slice(0, 3), slice(3, None)
_ANY = frozenset[str]()
SHAPES: tuple[tuple[int, frozenset[str], Callable[[FloatArray], bool] | None, tuple[_Part, ...]], ...] = (
    (4, _ANY, _are_units, (("orientation", _ALL, 4.0, "quaternion"),)),
    (6, WRENCH_WORDS, None, (("force", _HEAD, 2.0, ""), ("moment", _TAIL, 2.0, ""))),
    (6, WORDS["pose"], None, (("position", _HEAD, 1.5, ""), ("orientation", _TAIL, 1.5, "angles"))),
    (7, _ANY, _are_units, (("position", _HEAD, 2.0, ""), ("orientation", _TAIL, 4.0, "quaternion"))),
    (9, _ANY, _are_turns, (("orientation", _ALL, 3.0, "rotation_matrix"),)),
)
"""Patterns of vectors that are not three columns; the first that fits counts.

Each has the number of columns, words of which a group has one, the test of its last part, and its parts.
"""


def possible(group: Group, *, is_turned: bool, t_is_moment: bool) -> Iterator[tuple[str, Guess]]:
    """Possible meanings of a group with their ranks; ``is_turned`` where angles are named as its x, y, z."""
    n_columns, words = len(group.columns), {*group.words}
    is_named = any(words & (ROLES[each].vector | WORDS["pose"]) for each in QUANTITIES)
    of_motion = words & WORDS["motion"] - (WORDS["measured"] if is_named else _ANY)
    if not is_named or group.is_indexed:
        of_motion |= words & WORDS["elsewhere"]
    is_place_of_force = group.words[-2:] == ("force", "p")  # the centre of pressure of OpenSim
    if of_motion or is_place_of_force or (group.is_indexed and WORDS["specimen"] & {*group.words[-1:]}):
        return
    if n_columns in (12, 16):
        yield from _of_transform(group)
    parts: Iterable[_Part] = ()
    if n_columns == 3:
        words = words | {"force"} if words & WORDS["wrench"] and not is_named else words
        if "t" in words and not t_is_moment:  # a tracker's translation, next to a moment M
            words = words - {"t"} | {"translation"}
        parts = _of_three(group.columns[0], words, is_turned=is_turned)
    for n_parts, its_words, holds, its_parts in SHAPES:
        if n_columns != n_parts or not (words & its_words or not its_words) or parts:
            continue
        if holds is None or holds(complete_rows(group.columns[its_parts[-1][1]])):
            parts = its_parts
    for quantity, chosen, score, form in parts:
        columns = group.columns[chosen]
        rank = rank_of(group.words, columns[0], quantity, score, has_unit=n_columns == 3)
        if rank is None:
            continue
        check = (ORDER.format(quantity),) if n_columns > 4 and not form else ()
        if quantity == "moment" and words_of(columns[0].name)[-1:] == ("c",):
            check = ("the letters of the moment: C is taken for x, B for y and A for z, as of KUKA",)
        first, *others = (
            Guess(
                entry=entry,
                stream=group.stream,
                rank=rank,
                is_in_base=bool(words & WORDS["base_frame"]),
                is_commanded=bool(words & WORDS["commanded"]),
                to_check=check,
            )
            for entry in _entries(group, columns, form)
        )
        yield quantity, replace(first, also=tuple(others))


def _of_three(column: Column, words: Set[str], *, is_turned: bool) -> Iterator[_Part]:
    """Quantities of three columns by their words, with scores."""
    is_other = any(ROLES[other].vector & words for other in QUANTITIES[1:])
    for quantity in QUANTITIES:
        is_named = bool(ROLES[quantity].vector & words)
        # A place may be a word of any vector: tcp_force, POS_ACT.A.
        score = (1.0 if quantity == "position" and is_other else 2.0) * is_named
        if quantity == "position" and kind_of(column.shown_unit) is None:
            if is_turned:
                score = 2.0
            elif not is_other and not is_named:
                score = 1.5 if words & WORDS["measured"] else 0.5 if words else 1.0
        yield quantity, _ALL, score, "angles" if quantity == "orientation" else ""


def _entries(group: Group, columns: Sequence[Column], form: str) -> list[dict[str, Any]]:
    """Entries of the map that columns may be as a form, the likeliest first."""
    names, words, shown = [column.name for column in columns], {*group.words}, columns[-1].shown_unit
    if form == "quaternion":  # w is last, or first where they are only numbered and called q
        orders = [names, [*names[1:], names[0]]] if group.is_indexed else [names]
        if {"wxyz", "xyzw"} & words:
            orders = [orders["wxyz" in words]]
        return [{"columns": order} for order in (orders[::-1] if "q" in words else orders)]
    if form != "angles":
        return [{"form": form, "columns": names} if form else {"columns": names}]
    largest = np.abs(complete_rows(columns)).max(initial=0.0)
    is_in_degrees = shown == "deg" or (not kind_of(shown) and largest > 2.0 * np.pi)
    axes = ["", "xyz", "XYZ", "ZYX"]  # none: a rotation vector
    if {"abc", "posx"} & words:  # KUKA; Doosan and Stäubli
        axes = ["ZYX", "ZYZ", "XYZ"]
    elif {"euler", "rpy", "wpr"} & words or is_in_degrees:
        axes = [*axes[1:], ""]
    unit = {"unit": "deg"} if {"abc", "wpr"} & words and is_in_degrees and not kind_of(shown) else {}
    kinds = ({"form": "euler", "sequence": each} if each else {"form": "axis_angle"} for each in axes)
    return [{**kind, "columns": names, **unit} for kind in kinds]


def _of_transform(group: Group) -> Iterator[tuple[str, Guess]]:
    """Position and turn of a transform (4, 4) or (3, 4), by columns as Franka logs it, or by rows."""
    table, places = complete_rows(group.columns), np.arange(len(group.columns))
    names = np.array([column.name for column in group.columns], dtype=object)
    for order in (places.reshape(4, -1).T, places.reshape(-1, 4)):
        turn = order[:3, :3].ravel()
        if np.allclose(table[:, order[3:]], (0.0, 0.0, 0.0, 1.0)) and _are_turns(table[:, turn]):
            score = 4.0 + 1.0 * (extent(table) > 0.0)
            rank = rank_of(group.words, group.columns[0], "position", score, has_unit=False)
            place = {"columns": names[order[:3, 3]].tolist()}
            yield "position", Guess(entry=place, stream=group.stream, rank=rank)
            matrix = {"form": "rotation_matrix", "columns": names[turn].tolist()}
            yield "orientation", Guess(entry=matrix, stream=group.stream, rank=rank)
            return


# --------------------------------------------------------------------------------------- time


def time_of(stream: Stream) -> Guess | None:
    """Column of time of a stream, with its unit; None where no column increases."""
    own = {name.lower(): name for name in stream.columns}
    for (lower, name), (whole, part) in product(own.items(), _STAMPS):
        nanoseconds = own.get(lower.removesuffix(whole) + part)
        if not lower.endswith(whole) or nanoseconds is None:
            continue
        seconds = stream.column(name).values + 1e-9 * stream.column(nanoseconds).values
        steps = np.diff(seconds[np.isfinite(seconds)])
        if steps.size and np.mean(steps > 0.0) >= _RISING:
            entry = {"column": name, "nanoseconds": nanoseconds, "unit": "s"}
            return Guess(entry=entry, stream=stream.name)
    columns = [*stream.columns.values()]
    score, _, column = max(
        ((_time_score(column), -index, column) for index, column in enumerate(columns)),
        key=lambda candidate: candidate[:2],
        default=(0.0, 0, None),
    )
    if column is None or score <= 0.0:
        return next(filter(None, (_counter(stream, column) for column in columns)), None)
    if kind_of(column.shown_unit) == "time":
        return Guess(entry={"column": column.name}, stream=stream.name)
    # A log lasts about as long as a press, and its rows are not too far apart.
    values = column.values[np.isfinite(column.values)]
    step, length = float(np.median(np.diff(values))), float(np.ptp(values))
    usual = {
        unit: abs(np.log(factor * length / _USUAL_LENGTH_S))
        for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("day", 86400.0))
        if factor * step <= _LONGEST_STEP_S
    }
    unit = min(usual, key=lambda unit: usual[unit], default="ns")
    taken = f"time: {column.name} is taken for it, as it rises evenly and its name says nothing else"
    checks = (f"the unit of time: {unit} is judged from the length of the log alone",)
    return Guess(
        entry={"column": column.name, "unit": unit},
        stream=stream.name,
        to_check=(taken, *checks) if score < 2.0 else checks,
    )


def _counter(stream: Stream, column: Column) -> Guess | None:
    """Guess of a column that counts rows: whole numbers, in steps of 1."""
    values = column.values[np.isfinite(column.values)]
    if values.size < 2 or column.shown_unit or np.mean(np.diff(values) == 1.0) < _RISING:
        return None
    check = f"{column.name} counts rows and is no time: give the rate at which they were logged"
    return Guess(entry={"column": column.name}, stream=stream.name, is_counter=True, to_check=(check,))


def _time_score(column: Column) -> float:
    """Likeness of a column to time: it goes up, in steps that are much alike, and is nothing else."""
    values = column.values[np.isfinite(column.values)]
    shown, words = column.shown_unit, {*words_of(column.name)}
    if values.size < 2 or 2 * values.size < column.values.size or (shown and kind_of(shown) != "time"):
        return 0.0
    steps = np.diff(values)
    if np.mean(steps >= 0.0) < _RISING or not np.mean(steps > 0.0) > _LEAST_RISING:
        return 0.0
    usual = float(np.median(steps[steps > 0.0]))
    evenness = float(np.mean(np.abs(steps - usual) < 0.5 * usual))
    of_time = words & WORDS["time"]
    if words & WORDS["counter"] and of_time == {"t"}:  # F/T Sequence
        of_time = set()
    is_named = 2.0 * bool(of_time) + 2.0 * bool(shown)
    if is_named or any(word.endswith(("time", "zeit")) for word in words):
        return is_named + 1.0 + evenness
    is_counter = bool(words & WORDS["counter"]) or bool(np.all(steps == 1.0))
    is_other = is_counter or has_role([*words]) or bool(words & {*"xyz"})
    return evenness if evenness > 0.99 and not is_other else 0.0


def repeats_time(stream: Stream) -> bool:
    """Whether the clock of a stream is coarser than its rows, so that not only a few repeat their time."""
    time = time_of(stream)
    if time is None or time.is_counter or len(time.names) > 1:
        return False
    return float(np.mean(np.diff(stream.column(time.names[0]).values) == 0.0)) > _COARSE_CLOCK


# ------------------------------------------------------------------------------------ numbers


def complete_rows(columns: Iterable[Column]) -> FloatArray:
    """Values (n, k) of k columns in the rows where all have one."""
    table = np.column_stack([column.values for column in columns])
    return table[np.isfinite(table).all(axis=1)]


def rest_of(values: FloatArray) -> FloatArray:
    """Median (k,) of the first hundredth of some rows (n, k), at least five: of a force in free air."""
    return np.median(values[: max(len(values) // 100, 5)], axis=0)


def pressed_rows(push: FloatArray) -> tuple[int, int]:
    """Last row in free air and first row of nearly the largest push, among sizes (n,) of the push."""
    loaded = int(np.argmax(push >= 0.9 * push.max()))
    before = np.flatnonzero(push[:loaded] <= 0.1 * push.max())
    return int(before[-1]) if before.size else 0, loaded


def extent(values: FloatArray) -> float:
    """Largest range of a column (n, k); 0 without rows."""
    return float(np.ptp(values, axis=0).max()) if len(values) else 0.0
