"""A channel map guessed from names, units, numbers and directions, for a person to look over."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, Kind, kind_of
from palpate_robot_log.reading.channel_map import NO_COLUMN
from palpate_robot_log.reading.names import (
    COMMANDED,
    COUNTERS,
    MEASURED,
    TIME_WORDS,
    factor_of,
    has_role,
    pick,
    words_of,
)
from palpate_robot_log.reading.raw import RawLog, Stream

QUANTITIES = ("position", "orientation", "force", "moment")
NONE = (NO_COLUMN,) * 3

_AXES = ("x", "y", "z", "w")
_SHORT = ("f", "t", "m", "q", "p", "r", "o", "pos", "rot", "quat", "force", "torque", "moment", "tcp")
_TURNS = {"roll": "x", "pitch": "y", "yaw": "z", "alpha": "x", "beta": "y", "gamma": "z"}
_ANGLES = ("abc", "wpr")
"""Letters of three angles in degrees: A, B, C of KUKA, Doosan and others, and W, P, R of Fanuc."""

_WORDS: Mapping[str, frozenset[str]] = {
    "position": frozenset(("p", "pos", "position", "translation", "tcp", "tip", "tool", "point", "lage")),
    "orientation": frozenset(
        ("q", "o", "quat", "quaternion", "orientation", "rotation", "rot", "r", "euler", *_ANGLES)
    ),
    "force": frozenset(("f", "force", "forces", "kraft")),
    "moment": frozenset(("t", "torque", "torques", "moment", "moments", "m", "tau", "drehmoment")),
}
_KINDS: Mapping[str, Kind] = {
    "position": "length",
    "force": "force",
    "moment": "moment",
    "orientation": "angle",
}
_WRENCH_WORDS = frozenset(("wrench", "ft", "force", "f", "sensor"))
_POSE_WORDS = frozenset(("pose", "tcp", "transform"))
_OF_MOTION = frozenset(
    ("vel", "velocity", "speed", "twist", "acc", "accel", "acceleration", "omega", "gyro", "jerk", "error")
)
"""Words of vectors that a press has no use for."""
_STAMPS = {"sec": "nanosec", "secs": "nsecs"}
"""Fields of a time stamp in ROS 2 and 1: whole seconds, and nanoseconds to add."""
_IN_BASE = frozenset(("base", "o", "world", "actual"))
"""Words of a wrench in the base frame: O_F_ext_hat_K of Franka, actual_TCP_force of Universal Robots."""
_SHARED_TABLE = 0.2
_COARSE_CLOCK = 0.01
_CLEARLY = 1.0
_USUAL_LENGTH_S = 20.0
_LONGEST_STEP_S = 2.0
_ORDER = "the order of the columns of {}: x, y, z by their numbers is assumed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Columns of one vector, in the order x, y, z, w, or by their index.

    ``words`` are what their names share, in small letters; ``is_indexed`` ones are distinguished by
    numbers, so that what each is has to be guessed.
    """

    stream: str
    words: tuple[str, ...]
    columns: tuple[Column, ...]
    is_indexed: bool


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
            columns += [one for one in scalars[:1] if _is_unit([*columns, one])]
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
    """Entry of the map for one quantity.

    Parameters
    ----------
    columns : tuple of str
        A minus before a name turns its sign; "0" is no column.
    form : str
        Of an orientation; else empty.
    sequence : str
        Axes of Euler angles.
    unit : str
        Written into the map only where the file shows none.
    is_in_base : bool
        A wrench whose name states that it is in the base frame.
    value : tuple of float
        Quaternion of a fixed orientation.
    is_commanded : bool
        Of columns whose name states that they are not measured.
    is_counter : bool
        Of a column that counts rows, whose rate has to be given.
    to_check : tuple of str
        What a person has to decide.
    also : tuple of Guess
        What an orientation of these columns may be instead, the likeliest first.
    """

    columns: tuple[str, ...]
    stream: str
    form: str = ""
    sequence: str = ""
    unit: str = ""
    is_in_base: bool = False
    is_commanded: bool = False
    value: tuple[float, ...] = ()
    is_counter: bool = False
    to_check: tuple[str, ...] = ()
    score: float = 0.0
    also: tuple["Guess", ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its columns in the file."""
        return tuple(name.removeprefix("-") for name in self.columns if name != NO_COLUMN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Guesses by quantity, those of time by stream; what was not found is absent."""

    guesses: Mapping[str, Guess]
    time: Mapping[str, Guess]
    others: Mapping[str, tuple[Guess, ...]] = field(default_factory=dict)
    acts_on: str = "tool"
    wrench_frame: str = "sensor"
    wrench_reason: str = ""
    skips_missing: bool = False
    repeats_time: bool = False
    ends_in_contact: bool = False
    files: Mapping[str, str] | None = None

    def used_streams(self) -> tuple[str, ...]:
        """Streams that the guesses come from."""
        return tuple(dict.fromkeys(guess.stream for guess in self.guesses.values()))


def propose(log: RawLog) -> Proposal:
    """Proposal of which columns are time, pose and wrench: of a robot, or of a machine of one axis."""
    found: dict[str, list[Guess]] = {quantity: [] for quantity in QUANTITIES}
    groups = [group for stream in log.streams for group in groups_of(stream)]
    turned = {
        (group.stream, group.words[:-1]) for group in groups if _WORDS["orientation"] & {*group.words[-1:]}
    }
    has_moment = any(
        (_WORDS["moment"] - {"t"}) & {*group.words}
        or (len(group.columns) == 6 and _WRENCH_WORDS & {*group.words})
        for group in groups
    )
    for group in groups:
        for quantity, guess in _possible(
            group, is_turned=(group.stream, group.words) in turned, t_is_moment=not has_moment
        ):
            found[quantity].append(replace(guess, is_commanded=bool(COMMANDED & {*group.words})))
    ranked = {quantity: _ranked(quantity, guesses) for quantity, guesses in found.items() if guesses}
    if "position" in ranked and "force" not in ranked:
        ranked |= _of_load_cell(log, ranked["position"][0].stream, groups)
    if "force" in ranked and "moment" not in ranked:
        none = Guess(
            columns=NONE, stream=ranked["force"][0].stream, to_check=("no moment is found: there is none",)
        )
        ranked["moment"] = [none]
    force_extent = _extent(_values(_columns(log, ranked["force"][0]))) if "force" in ranked else 0.0
    guesses = {name: _with_unit(log, name, guesses[0], force_extent) for name, guesses in ranked.items()}
    return Proposal(
        guesses=guesses,
        time={stream.name: time for stream in log.streams if (time := time_of(stream)) is not None},
        others={name: tuple(guesses[1:4]) for name, guesses in ranked.items() if len(guesses) > 1},
        skips_missing=any(_lacks(log, guess) for guess in guesses.values()),
        repeats_time=any(_repeats(log, stream) for stream in {g.stream for g in guesses.values()}),
        wrench_frame="base" if "force" in guesses and guesses["force"].is_in_base else "sensor",
    )


def _ranked(quantity: str, guesses: Iterable[Guess]) -> list[Guess]:
    """Guesses, the likeliest first: one that is commanded only where nothing clearly is measured."""
    order = sorted(guesses, key=lambda one: (one.is_commanded and one.score >= _CLEARLY, -one.score))
    measured = [one for one in order if not one.is_commanded and one.score >= _CLEARLY]
    commanded = [one for one in order if one.is_commanded]
    if commanded and not measured:
        check = f"{quantity}: these columns are commanded, not measured; log the measured ones"
        order = [replace(one, to_check=(*one.to_check, check)) for one in commanded]
    return order


def _of_load_cell(log: RawLog, stream: str, groups: Sequence[Group]) -> dict[str, list[Guess]]:
    """Force of the one axis that a sensor has, and no moment."""
    taken = {column.name for group in groups for column in group.columns}
    columns = [column for column in log.stream(stream).columns.values() if column.name not in taken]
    if (cell := pick(columns, "force")) is None:
        return {}
    axis = next((word[-1] for word in words_of(cell.column.name) if word in ("fx", "fy", "fz")), "z")
    places = [NO_COLUMN] * 3
    places["xyz".index(axis)] = cell.column.name
    check = f"the force has one axis, {axis} of the sensor; without a moment a twist gives no torque"
    to_check = (*cell.remarks, check)
    return {
        "force": [Guess(columns=tuple(places), stream=stream, to_check=to_check)],
        "moment": [Guess(columns=NONE, stream=stream)],
    }


def machine_of(log: RawLog) -> Proposal | None:
    """Proposal of a testing machine: a time, one length along its axis and one force; None without them.

    The travel and the force that grow together press; depth and contact are found later, as in a robot's log.
    """
    for stream in log.streams:
        columns = [*stream.columns.values()]
        travel, force, time = pick(columns, "travel"), pick(columns, "force"), time_of(stream)
        if travel is None or force is None or time is None:
            continue
        senses = _senses(travel.column.values, force.column.values)
        guesses = {
            quantity: _with_unit(
                log,
                quantity,
                Guess(
                    columns=(NO_COLUMN, NO_COLUMN, "-" * (sense > 0.0) + one.column.name),
                    stream=stream.name,
                    to_check=one.remarks,
                ),
                0.0,
            )
            for quantity, one, sense in zip(("position", "force"), (travel, force), senses, strict=True)
        }
        guesses["orientation"] = Guess(
            columns=(), stream=stream.name, form="fixed", value=(1.0, 0.0, 0.0, 0.0)
        )
        guesses["moment"] = Guess(columns=NONE, stream=stream.name)
        reason = "machine: depth grows as the tool moves while the force does, and the tissue pushes it back"
        return Proposal(
            guesses=guesses,
            time={stream.name: time},
            repeats_time=_repeats(log, stream.name),
            wrench_reason=reason,
        )
    return None


def _senses(travel: FloatArray, force: FloatArray) -> tuple[float, float]:
    """Signs of the changes of travel and of force from free air to the largest force."""
    is_there = np.isfinite(travel) & np.isfinite(force)
    travel, force = travel[is_there], force[is_there]
    rest = float(np.median(force[: max(force.size // 100, 3)])) if force.size else 0.0
    if not force.size or not np.ptp(force):
        return 1.0, 1.0
    size = np.abs(force - rest)
    loaded = int(np.argmax(size >= 0.9 * size.max()))
    before = np.flatnonzero(size[:loaded] <= 0.1 * size.max())
    free = int(before[-1]) if before.size else 0
    return float(np.sign(travel[loaded] - travel[free])), float(np.sign(force[loaded] - rest))


def _repeats(log: RawLog, stream: str) -> bool:
    """Whether the clock of a stream is coarser than its rows, so that not only a few repeat their time."""
    time = time_of(log.stream(stream))
    if time is None or time.is_counter or len(time.columns) > 1:
        return False
    values = log.stream(stream).columns[time.columns[0]].values
    return float(np.mean(np.diff(values) == 0.0)) > _COARSE_CLOCK


def _lacks(log: RawLog, guess: Guess) -> bool:
    """Whether more rows have no value than a few that are damaged, as where topics share a table."""
    lacking = [~np.isfinite(column.values) for column in _columns(log, guess)]
    return float(np.mean(np.any(lacking, axis=0))) > _SHARED_TABLE


def _possible(group: Group, *, is_turned: bool, t_is_moment: bool) -> Iterable[tuple[str, Guess]]:
    """Possible meanings of a group, with scores; ``is_turned`` where angles are named as its x, y, z."""
    n_columns, words = len(group.columns), set(group.words)
    if words & _OF_MOTION:
        return
    if n_columns == 3 and "t" in words and not t_is_moment:  # a tracker's translation, next to a moment M
        words = words - {"t"} | {"translation"}

    def guess(part: slice | list[int], score: float, *to_check: str) -> Guess:
        names = tuple(column.name for column in np.array(group.columns, dtype=object)[part])
        is_in_base = bool(words & _IN_BASE)
        return Guess(
            columns=names, stream=group.stream, to_check=to_check, score=score, is_in_base=is_in_base
        )

    every, first, second = slice(None), slice(0, 3), slice(3, None)
    if n_columns == 3:
        unit = group.columns[0].shown_unit
        for quantity in QUANTITIES:
            # A place may be a word of any vector: tcp_force, POS_ACT.A.
            is_another = quantity == "position" and any(_WORDS[other] & words for other in QUANTITIES[1:])
            score = (1.0 if is_another else 2.0) * bool(_WORDS[quantity] & words)
            if unit and kind_of(unit) is not None:
                is_of = factor_of(group.columns[0], _KINDS[quantity]) is not None
                score = score + 3.0 if is_of else -1.0
            elif quantity == "position" and is_turned:
                score = 2.0
            elif quantity == "position" and not any(_WORDS[other] & words for other in QUANTITIES):
                score = 1.5 if words & MEASURED else 0.5 if words else 1.0
            if score > 0.0:
                found = guess(every, score)
                yield quantity, _of_angles(group, found) if quantity == "orientation" else found
    elif n_columns == 4 and _is_unit(group.columns):
        yield "orientation", _of_quaternion(group, guess(every, 4.0))
    elif n_columns == 6 and words & _WRENCH_WORDS:
        yield "force", guess(first, 2.0, _ORDER.format("force"))
        yield "moment", guess(second, 2.0, _ORDER.format("moment"))
    elif n_columns == 6 and words & _POSE_WORDS:
        yield "position", guess(first, 1.5, _ORDER.format("position"))
        yield "orientation", _of_angles(group, guess(second, 1.5))
    elif n_columns == 7 and _is_unit(group.columns[3:]):
        yield "position", guess(first, 2.0, _ORDER.format("position"))
        yield "orientation", _of_quaternion(group, guess(second, 4.0))
    elif n_columns == 9 and _are_turns(_values(group.columns)):
        yield "orientation", replace(guess(every, 3.0), form="rotation_matrix")
    elif n_columns == 16:
        yield from _of_transform(group, guess)


def _of_angles(group: Group, guess: Guess) -> Guess:
    """Three angles with the forms that robots log, the likeliest first."""
    words, shown = set(group.words), group.columns[-1].shown_unit
    columns = [column for column in group.columns if column.name in guess.columns]
    largest = np.abs(_values(columns)).max(initial=0.0)
    is_in_degrees = shown == "deg" or (not kind_of(shown) and largest > 2.0 * np.pi)
    forms = [("axis_angle", ""), ("euler", "xyz"), ("euler", "XYZ"), ("euler", "ZYX")]
    if "abc" in words:  # KUKA; Doosan and Stäubli
        forms = [("euler", "ZYX"), ("euler", "ZYZ"), ("euler", "XYZ")]
    elif {"euler", "rpy", "wpr"} & words or is_in_degrees:
        forms = [*forms[1:], forms[0]]
    unit = "deg" if {"abc", "wpr"} & words and is_in_degrees and not kind_of(shown) else ""
    return _first_of([replace(guess, form=form, sequence=axes, unit=unit) for form, axes in forms])


def _of_quaternion(group: Group, guess: Guess) -> Guess:
    """Four numbers with w last, or first where they are only numbered and called q."""
    names = guess.columns
    last = replace(guess, form="quaternion")
    if not group.is_indexed:
        return last
    first = replace(last, columns=(*names[1:], names[0]))
    return _first_of([first, last] if group.words[-1:] == ("q",) else [last, first])


def _of_transform(group: Group, guess: Callable[[list[int], float], Guess]) -> Iterable[tuple[str, Guess]]:
    """Position and turn of a homogeneous transform (4, 4), by columns as Franka logs it, or by rows."""
    table, rows = _values(group.columns), np.arange(16).reshape(4, 4)
    for order in (rows.T, rows):
        turn = order[:3, :3].ravel()
        if np.allclose(table[:, order[3]], (0.0, 0.0, 0.0, 1.0)) and _are_turns(table[:, turn]):
            moves = 1.0 * (_extent(table) > 0.0)
            yield "position", guess(order[:3, 3].tolist(), 3.0 + moves)
            yield "orientation", replace(guess(turn.tolist(), 4.0 + moves), form="rotation_matrix")
            return


def _first_of(guesses: Sequence[Guess]) -> Guess:
    return replace(guesses[0], also=tuple(guesses[1:]))


def _are_turns(rows: FloatArray) -> bool:
    """Whether rows (n, 9) are rotation matrices, row by row."""
    matrices = rows.reshape(-1, 3, 3)
    off = np.abs(np.einsum("nij,nkj->nik", matrices, matrices) - np.eye(3)).max(axis=(1, 2))
    return off.size > 0 and bool(np.median(off) < 0.01)


def _values(columns: Iterable[Column]) -> FloatArray:
    table = np.column_stack([column.values for column in columns])
    complete: FloatArray = table[np.isfinite(table).all(axis=1)]
    return complete


def _is_unit(columns: Iterable[Column]) -> bool:
    lengths = np.linalg.norm(_values(columns), axis=1)
    return lengths.size > 0 and bool(abs(np.median(lengths) - 1.0) < 0.01)


def _with_unit(log: RawLog, quantity: str, guess: Guess, force_extent: float) -> Guess:
    """Guess with a unit judged by magnitude, where the file shows none."""
    columns = _columns(log, guess)
    if guess.form in ("quaternion", "rotation_matrix", "fixed") or guess.unit or not columns:
        return guess
    if shown := columns[0].shown_unit:
        known = factor_of(columns[0], _KINDS[quantity]) is not None
        check = f"the unit of {quantity}: the file gives '{shown}', no unit of {_KINDS[quantity]}; write unit"
        return guess if known else replace(guess, to_check=(*guess.to_check, check))
    values = _values(columns)
    unit = _likely_unit(quantity, values, force_extent)
    check = f"the unit of {quantity}: {unit} is judged from the size of the numbers alone"
    also = tuple(replace(one, unit=unit) for one in guess.also)
    return replace(guess, unit=unit, also=also, to_check=(*guess.to_check, check))


def _columns(log: RawLog, guess: Guess) -> list[Column]:
    return [log.stream(guess.stream).columns[name] for name in guess.names]


def _extent(values: FloatArray) -> float:
    """Largest range of a column (n, k); 0 without rows."""
    return float(np.ptp(values, axis=0).max()) if len(values) else 0.0


def _likely_unit(quantity: str, values: FloatArray, force_extent: float) -> str:
    extent = _extent(values)
    if quantity == "position":
        return "m" if extent < 0.8 else "mm"
    if quantity == "orientation":
        return "rad" if not len(values) or np.abs(values).max() <= 2.0 * np.pi else "deg"
    if quantity == "force":
        return "N" if extent < 500.0 else "mN"
    # A lever of a metre is longer than any tool, one of a millimetre shorter than most.
    return "N m" if force_extent > 0.0 and extent / force_extent < 0.5 else "N·mm"


RISING = 0.9
"""Share of steps of a time that do not go back, at least …"""

LEAST_RISING = 0.25
"""… and that go up: a clock that is coarser than the rows repeats."""


def time_of(stream: Stream) -> Guess | None:
    """Column of time of a stream, with its unit; None where no column increases."""
    for name, (whole, part) in product(stream.columns, _STAMPS.items()):
        stamp = name.removesuffix(whole)
        if stamp == name or stamp + part not in stream.columns:
            continue
        seconds = stream.columns[name].values + 1e-9 * stream.columns[stamp + part].values
        steps = np.diff(seconds[np.isfinite(seconds)])
        if steps.size and np.mean(steps > 0.0) >= RISING:
            return Guess(columns=(name, stamp + part), stream=stream.name, unit="s", score=4.0)
    candidates = [
        (_time_score(column), -index, column) for index, column in enumerate(stream.columns.values())
    ]
    score, _, column = max(candidates, key=lambda candidate: candidate[:2], default=(0.0, 0, None))
    if column is None or score <= 0.0:
        return next(filter(None, (_counter(stream, column) for column in stream.columns.values())), None)
    shown = column.shown_unit
    if kind_of(shown) == "time":
        return Guess(columns=(column.name,), stream=stream.name, score=score)
    unit = _likely_clock(column.values[np.isfinite(column.values)])
    check = f"the unit of time: {unit} is judged from the length of the log alone"
    return Guess(columns=(column.name,), stream=stream.name, unit=unit, to_check=(check,), score=score)


def _likely_clock(values: FloatArray) -> str:
    """Unit by which a log lasts about as long as a press, and its rows are not too far apart."""
    step, length = float(np.median(np.diff(values))), float(np.ptp(values))
    usual = {
        unit: abs(np.log(factor * length / _USUAL_LENGTH_S))
        for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
        if factor * step <= _LONGEST_STEP_S
    }
    return min(usual, key=lambda unit: usual[unit], default="ns")


def _counter(stream: Stream, column: Column) -> Guess | None:
    """Guess of a column that counts rows: whole numbers, in steps of 1."""
    values = column.values[np.isfinite(column.values)]
    if values.size < 2 or column.shown_unit or np.mean(np.diff(values) == 1.0) < RISING:
        return None
    check = f"{column.name} counts rows and is no time: give the rate at which they were logged"
    return Guess(columns=(column.name,), stream=stream.name, is_counter=True, to_check=(check,))


def _time_score(column: Column) -> float:
    """Likeness of a column to time: it goes up, in steps that are much alike, and is nothing else."""
    values = column.values[np.isfinite(column.values)]
    shown, words = column.shown_unit, {*words_of(column.name)}
    if values.size < 2 or 2 * values.size < column.values.size or (shown and kind_of(shown) != "time"):
        return 0.0
    steps = np.diff(values)
    if np.mean(steps >= 0.0) < RISING or not np.mean(steps > 0.0) > LEAST_RISING:
        return 0.0
    usual = float(np.median(steps[steps > 0.0]))
    evenness = float(np.mean(np.abs(steps - usual) < 0.5 * usual))
    is_named = 2.0 * bool(words & TIME_WORDS) + 2.0 * bool(shown)
    if is_named or any(word.endswith(("time", "zeit")) for word in words):
        return is_named + 1.0 + evenness
    is_counter = bool(words & COUNTERS) or bool(np.all(steps == 1.0))
    return evenness if evenness > 0.99 and not is_counter and not has_role([*words]) else 0.0
