"""A channel map guessed from names, units and numbers, as text for study.toml that a person looks over."""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, Kind, kind_of, unit_in
from palpate_robot_log.reading.raw import RawLog, Stream

QUANTITIES = ("position", "orientation", "force", "moment")

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zäöüß]+|\d+")
_AXES = ("x", "y", "z", "w")
_SHORT = ("f", "t", "m", "q", "p", "r", "pos", "rot", "quat", "force", "torque", "moment", "tcp")
_ROLL_PITCH_YAW = {"roll": "x", "pitch": "y", "yaw": "z"}

_WORDS: Mapping[str, frozenset[str]] = {
    "position": frozenset(("p", "pos", "position", "translation", "tcp", "tip", "tool", "point", "lage")),
    "orientation": frozenset(("q", "quat", "quaternion", "orientation", "rotation", "rot", "r", "euler")),
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
_NOT_MEASURED = frozenset(("target", "desired", "cmd", "command", "ref", "reference", "setpoint", "goal"))
_EULER = 'the order of the angles: sequence "xyz" (fixed axes) is assumed'
_AXIS_ANGLE = "three angles: axis_angle is assumed, as Universal Robots logs it; other makes log euler"
_ORDER = "the order of the columns of {}: x, y, z by their numbers is assumed"
_W_LAST = "the order of the quaternion: x, y, z, w is assumed, not w first"


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Entry of the map for one quantity.

    Parameters
    ----------
    form : str
        Of an orientation; else empty.
    unit : str
        Written into the map only where the file shows none.
    to_check : tuple of str
        What a person has to decide.
    """

    columns: tuple[str, ...]
    stream: str
    form: str = ""
    unit: str = ""
    to_check: tuple[str, ...] = ()
    score: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Guesses by quantity, those of time by stream; what was not found is absent."""

    guesses: Mapping[str, Guess]
    time: Mapping[str, Guess]
    others: Mapping[str, tuple[Guess, ...]] = field(default_factory=dict)

    def used_streams(self) -> tuple[str, ...]:
        """Streams that the guesses come from."""
        return tuple(dict.fromkeys(guess.stream for guess in self.guesses.values()))


def propose(log: RawLog) -> Proposal:
    """Proposal of which columns are time, pose and wrench."""
    found: dict[str, list[Guess]] = {quantity: [] for quantity in QUANTITIES}
    for stream in log.streams:
        for group in groups_of(stream):
            penalty = 2.0 if _NOT_MEASURED & set(group.words) else 0.0
            for quantity, guess in _possible(group):
                found[quantity].append(replace(guess, score=guess.score - penalty))
    ranked = {
        quantity: sorted(guesses, key=lambda guess: -guess.score)
        for quantity, guesses in found.items()
        if guesses
    }
    force_extent = _extent(_values(_columns(log, ranked["force"][0]))) if "force" in ranked else 0.0
    return Proposal(
        guesses={name: _with_unit(log, name, guesses[0], force_extent) for name, guesses in ranked.items()},
        time={stream.name: time for stream in log.streams if (time := time_of(stream)) is not None},
        others={name: tuple(guesses[1:4]) for name, guesses in ranked.items() if len(guesses) > 1},
    )


def _possible(group: Group) -> Iterable[tuple[str, Guess]]:
    """What a group may be, each with a score."""
    n_columns, words = len(group.columns), set(group.words)

    def guess(part: slice, form: str, score: float, *to_check: str) -> Guess:
        names = tuple(column.name for column in group.columns[part])
        return Guess(columns=names, stream=group.stream, form=form, to_check=to_check, score=score)

    every, first, second = slice(None), slice(0, 3), slice(3, None)
    w_last = (_W_LAST,) if group.is_indexed else ()
    if n_columns == 3:
        kind = kind_of(group.columns[0].shown_unit)
        for quantity in QUANTITIES:
            score = 2.0 * bool(_WORDS[quantity] & words)
            if kind is not None:
                score = score + 3.0 if _MEASURES.get(kind) == quantity else -1.0
            elif quantity == "position" and not words:
                score = 1.0
            if score <= 0.0:
                continue
            if quantity != "orientation":
                yield quantity, guess(every, "", score)
            elif {"euler", "rpy"} & words:
                yield quantity, guess(every, "euler", score, _EULER)
            else:
                yield quantity, guess(every, "axis_angle", score - 0.5, _AXIS_ANGLE)
    elif n_columns == 4 and _is_unit(group.columns):
        yield "orientation", guess(every, "quaternion", 4.0, *w_last)
    elif n_columns == 6 and words & _WRENCH_WORDS:
        yield "force", guess(first, "", 2.0, _ORDER.format("force"))
        yield "moment", guess(second, "", 2.0, _ORDER.format("moment"))
    elif n_columns == 6 and words & _POSE_WORDS:
        yield "position", guess(first, "", 1.5, _ORDER.format("position"))
        yield "orientation", guess(second, "axis_angle", 1.5, _AXIS_ANGLE)
    elif n_columns == 7 and _is_unit(group.columns[3:]):
        yield "position", guess(first, "", 2.0, _ORDER.format("position"))
        yield "orientation", guess(second, "quaternion", 4.0, *w_last)
    elif n_columns == 9:
        matrices = _values(group.columns).reshape(-1, 3, 3)
        off = np.abs(np.einsum("nij,nkj->nik", matrices, matrices) - np.eye(3)).max(axis=(1, 2))
        if off.size and np.median(off) < 0.01:
            yield "orientation", guess(every, "rotation_matrix", 3.0)


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
    if guess.form in ("quaternion", "rotation_matrix") or kind_of(columns[0].shown_unit):
        return guess
    values = _values(columns)
    unit = _likely_unit(quantity, values, force_extent)
    check = f"the unit of {quantity}: {unit} is judged from the size of the numbers alone"
    return replace(guess, unit=unit, to_check=(*guess.to_check, check))


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


def time_of(stream: Stream) -> Guess | None:
    """Column of time of a stream, with its unit; None where no column increases."""
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
    """How much a column looks like time: it goes up, in steps that are much alike."""
    values = column.values[np.isfinite(column.values)]
    if values.size < 2 or 2 * values.size < column.values.size:
        return 0.0
    steps = np.diff(values)
    if np.mean(steps > 0.0) < 0.9:
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
        chosen["time"] = {"column": time.columns[0], "unit": time.unit} if time.unit else time.columns[0]
    for quantity in QUANTITIES:
        if (guess := proposal.guesses.get(quantity)) is not None:
            chosen[quantity] = _entry(guess, time, proposal)
    return chosen


def _time(proposal: Proposal) -> Guess | None:
    """Time of the first stream that guesses come from and that has one."""
    streams = [*proposal.used_streams(), *proposal.time]
    return next((proposal.time[stream] for stream in streams if stream in proposal.time), None)


def _entry(guess: Guess, time: Guess | None, proposal: Proposal) -> dict[str, object]:
    entry: dict[str, object] = {}
    if guess.form and guess.form != "quaternion":
        entry["form"] = guess.form
    entry["columns"] = list(guess.columns)
    if guess.form == "euler":
        entry["sequence"] = "xyz"
    if guess.unit:
        entry["unit"] = guess.unit
    if guess.stream and len(proposal.used_streams()) > 1:
        entry["stream"] = guess.stream
    own = proposal.time.get(guess.stream)
    if own is not None and time is not None and own.columns != time.columns:
        entry["time"] = own.columns[0]
    return entry


def study_text(log: RawLog, proposal: Proposal) -> str:
    """Tables of study.toml that read this file, ready to be pasted."""
    lines = ["[experiment]", 'loader = "robot_log"', ""]
    if log.layout:
        lines += ["[experiment.settings.text]", *_pairs(log.layout), ""]
    lines.append("[experiment.settings.channels]")
    chosen = channel_map(proposal)
    time = _time(proposal)
    lines += _commented("time", chosen, time)
    for quantity in QUANTITIES:
        lines += _commented(quantity, chosen, proposal.guesses.get(quantity))
    lines += [
        'acts_on = "tool"  # or "tissue": the wrench is that of the tissue on the tool, or its reaction',
        'wrench_frame = "sensor"  # or "base"',
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
