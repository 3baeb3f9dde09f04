"""A channel map guessed from names, units and numbers, as text for study.toml that a person looks over."""

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, Kind, kind_of, unit_in
from palpate_robot_log.reading.raw import RawLog, Stream

QUANTITIES = ("position", "orientation", "force", "moment")

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zäöüß]+|\d+")
_AXES = ("x", "y", "z", "w")
_SHORT = ("f", "t", "m", "q", "p", "r", "pos", "rot", "quat", "force", "torque", "moment", "tcp")
_TURNS = {"roll": "x", "pitch": "y", "yaw": "z", "alpha": "x", "beta": "y", "gamma": "z"}
_ANGLES = ("abc", "wpr")
"""Letters of three angles in degrees: A, B, C of KUKA, Doosan and others, and W, P, R of Fanuc."""

_WORDS: Mapping[str, frozenset[str]] = {
    "position": frozenset(("p", "pos", "position", "translation", "tcp", "tip", "tool", "point", "lage")),
    "orientation": frozenset(
        ("q", "quat", "quaternion", "orientation", "rotation", "rot", "r", "euler", *_ANGLES)
    ),
    "force": frozenset(("f", "force", "forces", "kraft")),
    "moment": frozenset(("t", "torque", "torques", "moment", "moments", "m", "tau", "drehmoment")),
}
_MEASURES: Mapping[Kind, str] = {
    "length": "position",
    "force": "force",
    "moment": "moment",
    "angle": "orientation",
}
_WRENCH_WORDS = frozenset(("wrench", "ft", "force", "f", "sensor"))
_POSE_WORDS = frozenset(("pose", "tcp", "transform"))
_TIME_WORDS = frozenset(("time", "t", "timestamp", "stamp", "zeit", "clock", "seconds", "secs", "received"))
_STAMPS = {"sec": "nanosec", "secs": "nsecs"}
"""Fields of a time stamp in ROS 2 and 1: whole seconds, and nanoseconds to add."""
_NOT_MEASURED = frozenset(
    ("target", "desired", "d", "cmd", "command", "ref", "reference", "setpoint", "goal", "setp")
)
_IN_BASE = frozenset(("base", "o", "world", "actual"))
"""Words of a wrench in the base frame: O_F_ext_hat_K of Franka, actual_TCP_force of Universal Robots."""
_SHARED_TABLE = 0.2
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
    named = {words_of(column.name): column for column in stream.columns.values()}
    groups = []
    for before, letters in product(dict.fromkeys(words[:-1] for words in named), _ANGLES):
        keys = [(*before, letter) for letter in letters]
        if {*keys} <= {*named}:
            angles = tuple(named[key] for key in keys)
            words = (*before, letters)
            groups.append(Group(stream=stream.name, words=words, columns=angles, is_indexed=False))
    taken = {column.name for group in groups for column in group.columns}
    for column in stream.columns.values():
        if column.name in taken:
            continue
        words, axis = _split(words_of(column.name))
        if axis is not None:
            found.setdefault((axis.isdigit(), words), {})[axis] = column
    for (is_indexed, words), members in sorted(found.items(), key=lambda item: item[0][0]):
        if is_indexed:
            order = sorted(members, key=int) if len(members) in (3, 4, 6, 7, 9, 16) else []
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
    if last in _TURNS:
        return (*before, "euler"), _TURNS[last]
    if last[-1] in _AXES and last[:-1] in _SHORT:
        return (*before, last[:-1]), last[-1]
    # A frame may follow the axis: fx_sensor.
    if len(before) == 1 and before[0][-1] in _AXES and before[0][:-1] in _SHORT:
        return (before[0][:-1], last), before[0][-1]
    return words, None


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Entry of the map for one quantity.

    Parameters
    ----------
    form : str
        Of an orientation; else empty.
    sequence : str
        Axes of Euler angles.
    unit : str
        Written into the map only where the file shows none.
    is_in_base : bool
        A wrench whose name states that it is in the base frame.
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
    to_check: tuple[str, ...] = ()
    score: float = 0.0
    also: tuple["Guess", ...] = ()


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
    files: Mapping[str, str] | None = None

    def used_streams(self) -> tuple[str, ...]:
        """Streams that the guesses come from."""
        return tuple(dict.fromkeys(guess.stream for guess in self.guesses.values()))


def propose(log: RawLog) -> Proposal:
    """Proposal of which columns are time, pose and wrench."""
    found: dict[str, list[Guess]] = {quantity: [] for quantity in QUANTITIES}
    for stream in log.streams:
        groups = groups_of(stream)
        turned = {group.words[:-1] for group in groups if _WORDS["orientation"] & {*group.words[-1:]}}
        for group in groups:
            penalty = 2.0 if _NOT_MEASURED & set(group.words) else 0.0
            for quantity, guess in _possible(group, is_turned=group.words in turned):
                found[quantity].append(replace(guess, score=guess.score - penalty))
    ranked = {
        quantity: sorted(guesses, key=lambda guess: -guess.score)
        for quantity, guesses in found.items()
        if guesses
    }
    force_extent = _extent(_values(_columns(log, ranked["force"][0]))) if "force" in ranked else 0.0
    guesses = {name: _with_unit(log, name, guesses[0], force_extent) for name, guesses in ranked.items()}
    return Proposal(
        guesses=guesses,
        time={stream.name: time for stream in log.streams if (time := time_of(stream)) is not None},
        others={name: tuple(guesses[1:4]) for name, guesses in ranked.items() if len(guesses) > 1},
        skips_missing=any(_lacks(log, guess) for guess in guesses.values()),
        wrench_frame="base" if "force" in guesses and guesses["force"].is_in_base else "sensor",
    )


def _lacks(log: RawLog, guess: Guess) -> bool:
    """Whether more rows have no value than a few that are damaged, as where topics share a table."""
    lacking = [~np.isfinite(column.values) for column in _columns(log, guess)]
    return float(np.mean(np.any(lacking, axis=0))) > _SHARED_TABLE


def _possible(group: Group, *, is_turned: bool) -> Iterable[tuple[str, Guess]]:
    """Possible meanings of a group, with scores; ``is_turned`` where angles are named as its x, y, z."""
    n_columns, words = len(group.columns), set(group.words)

    def guess(part: slice | list[int], score: float, *to_check: str) -> Guess:
        names = tuple(column.name for column in np.array(group.columns, dtype=object)[part])
        is_in_base = bool(words & _IN_BASE)
        return Guess(
            columns=names, stream=group.stream, to_check=to_check, score=score, is_in_base=is_in_base
        )

    every, first, second = slice(None), slice(0, 3), slice(3, None)
    if n_columns == 3:
        kind = kind_of(group.columns[0].shown_unit)
        for quantity in QUANTITIES:
            # A place may be a word of any vector: tcp_force, POS_ACT.A.
            is_another = quantity == "position" and any(_WORDS[other] & words for other in QUANTITIES[1:])
            score = (1.0 if is_another else 2.0) * bool(_WORDS[quantity] & words)
            if kind is not None:
                score = score + 3.0 if _MEASURES.get(kind) == quantity else -1.0
            elif quantity == "position" and is_turned:
                score = 2.0
            elif quantity == "position" and not any(_WORDS[other] & words for other in QUANTITIES):
                score = 0.5 if words else 1.0
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
    if guess.form in ("quaternion", "rotation_matrix") or guess.unit or kind_of(columns[0].shown_unit):
        return guess
    values = _values(columns)
    unit = _likely_unit(quantity, values, force_extent)
    check = f"the unit of {quantity}: {unit} is judged from the size of the numbers alone"
    also = tuple(replace(one, unit=unit) for one in guess.also)
    return replace(guess, unit=unit, also=also, to_check=(*guess.to_check, check))


def _columns(log: RawLog, guess: Guess) -> list[Column]:
    return [log.stream(guess.stream).columns[name] for name in guess.columns]


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
"""Share of steps of a time that go up, at least."""


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
        return None
    shown = column.shown_unit
    if kind_of(shown) == "time":
        return Guess(columns=(column.name,), stream=stream.name, score=score)
    usual = float(np.median(np.diff(column.values[np.isfinite(column.values)])))
    unit = next((u for u, most in (("s", 0.2), ("ms", 200.0), ("us", 2e5)) if usual <= most), "ns")
    check = f"the unit of time: {unit} is judged from the size of the steps alone"
    return Guess(columns=(column.name,), stream=stream.name, unit=unit, to_check=(check,), score=score)


def _time_score(column: Column) -> float:
    """Likeness of a column to time: it goes up, in steps that are much alike."""
    values = column.values[np.isfinite(column.values)]
    if values.size < 2 or 2 * values.size < column.values.size:
        return 0.0
    steps = np.diff(values)
    if np.mean(steps > 0.0) < RISING:
        return 0.0
    usual = float(np.median(steps))
    evenness = float(np.mean(np.abs(steps - usual) < 0.5 * usual))
    words = set(words_of(column.name))
    is_named = 2.0 * bool(words & _TIME_WORDS) + 2.0 * (kind_of(column.shown_unit) == "time")
    return is_named + evenness if is_named or evenness > 0.99 else 0.0


def channel_map(proposal: Proposal) -> dict[str, object]:
    """Proposed map as plain values, without the quantities that were not found."""
    time = _time(proposal)
    chosen: dict[str, object] = {}
    if time is not None:
        chosen["time"] = _time_entry(time)
    for quantity in QUANTITIES:
        if (guess := proposal.guesses.get(quantity)) is not None:
            chosen[quantity] = _entry(guess, time, proposal)
    if {"force", "moment"} <= {*chosen}:
        chosen |= {"acts_on": proposal.acts_on, "wrench_frame": proposal.wrench_frame}
    if proposal.skips_missing:
        chosen["missing"] = "skip"
    if proposal.files:
        chosen["clocks"] = "own"
    return chosen


def _time_entry(time: Guess) -> object:
    if len(time.columns) > 1:
        return {"column": time.columns[0], "nanoseconds": time.columns[1], "unit": time.unit}
    return {"column": time.columns[0], "unit": time.unit} if time.unit else time.columns[0]


def _time(proposal: Proposal) -> Guess | None:
    """Time of the first stream that guesses come from and that has one."""
    streams = [*proposal.used_streams(), *proposal.time]
    return next((proposal.time[stream] for stream in streams if stream in proposal.time), None)


def _entry(guess: Guess, time: Guess | None, proposal: Proposal) -> dict[str, object]:
    entry: dict[str, object] = {}
    if guess.form and guess.form != "quaternion":
        entry["form"] = guess.form
    entry["columns"] = list(guess.columns)
    if guess.sequence:
        entry["sequence"] = guess.sequence
    if guess.unit:
        entry["unit"] = guess.unit
    if guess.stream and len(proposal.used_streams()) > 1:
        entry["stream"] = guess.stream
    own = proposal.time.get(guess.stream)
    if own is not None and time is not None and _time_entry(own) != _time_entry(time):
        entry["time"] = _time_entry(own)
    return entry


def study_text(log: RawLog, proposal: Proposal) -> str:
    """Tables of study.toml that read this file, ready to be pasted."""
    lines = ["[experiment]", 'loader = "robot_log"', ""]
    if log.layout:
        lines += ["[experiment.settings.text]", *_pairs(log.layout), ""]
    if proposal.files:
        lines += ["[experiment.settings.files]  # {} is what the names of each press have alike"]
        lines += [*_pairs(proposal.files), ""]
    lines.append("[experiment.settings.channels]")
    chosen = channel_map(proposal)
    time = _time(proposal)
    lines += _commented("time", chosen, time)
    for quantity in QUANTITIES:
        guess = proposal.guesses.get(quantity)
        lines += _commented(quantity, chosen, guess)
        for other in guess.also if guess else ():
            lines.append(f"# or {quantity} = {_value(_entry(other, time, proposal))}")
    other_side = {"tool": "tissue", "tissue": "tool"}[proposal.acts_on]
    other_frame = {"sensor": "base", "base": "sensor"}[proposal.wrench_frame]
    lines += [
        f"# check {proposal.wrench_reason or 'whose wrench it is, and in which frame: nothing tells'}",
        f'acts_on = "{proposal.acts_on}"  # or "{other_side}": tool is the wrench of the tissue on the tool',
        f'wrench_frame = "{proposal.wrench_frame}"  # or "{other_frame}"',
    ]
    if proposal.skips_missing:
        lines.append('missing = "skip"  # rows of one topic have no values of another')
    if proposal.files:
        lines.append('clocks = "own"  # or "common": one clock stamped both files')
    lines += [
        "",
        "[experiment.settings.gravity]",
        'method = "off"  # or "fit" from poses in air, or "known" with the weight that the sensor carries:',
        '# weight = "1 N"',
        '# centre = ["0 mm", "0 mm", "-30 mm"]',
    ]
    return "\n".join(lines) + "\n"


def _commented(quantity: str, chosen: Mapping[str, object], guess: Guess | None) -> Iterable[str]:
    if quantity not in chosen or guess is None:
        empty = ", ".join(['"…"'] * (4 if quantity == "orientation" else 3))
        form = f"{{ columns = [{empty}] }}" if quantity != "time" else '"…"'
        yield f"# {quantity} = {form}  # no column looks like it: name them"
        return
    for check in guess.to_check:
        yield f"# check {check}"
    yield f"{quantity} = {_value(chosen[quantity])}"


def _pairs(table: Mapping[str, object]) -> Iterable[str]:
    return (f"{key} = {_value(value)}" for key, value in table.items())


def _value(value: object) -> str:
    match value:
        case Mapping():
            return f"{{ {', '.join(_pairs(value))} }}"
        case list():
            return f"[{', '.join(map(_value, value))}]"
        case _:
            return json.dumps(value, ensure_ascii=False)
