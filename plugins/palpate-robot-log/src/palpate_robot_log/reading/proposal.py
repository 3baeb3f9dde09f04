"""A channel map guessed from names, units and numbers, for a person to look over."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.api import FloatArray
from palpate.delimited import Column, Kind, kind_of
from palpate_robot_log.reading.grouping import Group, groups_of, words_of
from palpate_robot_log.reading.raw import RawLog, Stream

QUANTITIES = ("position", "orientation", "force", "moment")

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """Entry of the map for one quantity.

    Parameters
    ----------
    columns : tuple of str
    stream : str
    form : str
        Of an orientation; else empty.
    unit : str
        Written into the map only where the file shows none.
    to_check : tuple of str
        What a person has to decide.
    score : float
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
    """Guess which columns are time, pose and wrench."""
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
    if n_columns == 3:
        yield from _vectors(group)
    elif n_columns == 4 and _is_unit(group.columns):
        yield "orientation", _quaternion(group, group.names)
    elif n_columns == 6 and words & _WRENCH_WORDS:
        yield "force", _part(group, slice(0, 3), "force", 2.0)
        yield "moment", _part(group, slice(3, 6), "moment", 2.0)
    elif n_columns == 6 and words & _POSE_WORDS:
        yield "position", _part(group, slice(0, 3), "position", 1.5)
        turned = _part(group, slice(3, 6), "orientation", 1.5)
        yield "orientation", replace(turned, form="axis_angle", to_check=(_AXIS_ANGLE,))
    elif n_columns == 7 and _is_unit(group.columns[3:]):
        yield "position", _part(group, slice(0, 3), "position", 2.0)
        yield "orientation", _quaternion(group, group.names[3:])
    elif n_columns == 9 and _is_turn(group.columns):
        turned = Guess(columns=group.names, stream=group.stream, form="rotation_matrix", score=3.0)
        yield "orientation", turned


def _vectors(group: Group) -> Iterable[tuple[str, Guess]]:
    kind = kind_of(group.columns[0].shown_unit)
    for quantity in QUANTITIES:
        score = 2.0 * bool(_WORDS[quantity] & set(group.words))
        if kind is not None:
            score = score + 3.0 if _MEASURES.get(kind) == quantity else -1.0
        elif quantity == "position" and not group.words:
            score = 1.0
        if score <= 0.0:
            continue
        guess = Guess(columns=group.names, stream=group.stream, score=score)
        if quantity == "orientation" and {"euler", "rpy"} & set(group.words):
            guess = replace(guess, form="euler", to_check=(_EULER,))
        elif quantity == "orientation":
            guess = replace(guess, form="axis_angle", to_check=(_AXIS_ANGLE,), score=score - 0.5)
        yield quantity, guess


def _part(group: Group, part: slice, quantity: str, score: float) -> Guess:
    check = f"the order of the columns of {quantity}: x, y, z by their numbers is assumed"
    return Guess(columns=group.names[part], stream=group.stream, score=score, to_check=(check,))


def _quaternion(group: Group, names: Sequence[str]) -> Guess:
    guess = Guess(columns=tuple(names), stream=group.stream, form="quaternion", score=4.0)
    if not group.is_indexed:
        return guess
    return replace(guess, to_check=("the order of the quaternion: x, y, z, w is assumed, not w first",))


def _values(columns: Iterable[Column]) -> FloatArray:
    table = np.column_stack([column.values for column in columns])
    complete: FloatArray = table[np.isfinite(table).all(axis=1)]
    return complete


def _is_unit(columns: Iterable[Column]) -> bool:
    lengths = np.linalg.norm(_values(columns), axis=1)
    return lengths.size > 0 and bool(abs(np.median(lengths) - 1.0) < 0.01)


def _is_turn(columns: Iterable[Column]) -> bool:
    matrices = _values(columns).reshape(-1, 3, 3)
    if not matrices.size:
        return False
    off = np.abs(np.einsum("nij,nkj->nik", matrices, matrices) - np.eye(3)).max(axis=(1, 2))
    return bool(np.median(off) < 0.01)


# -------------------------------------------------------------------------- units


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


# --------------------------------------------------------------------------- time


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
    unit = _likely_time_unit(column.values)
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


def _likely_time_unit(values: FloatArray) -> str:
    usual = float(np.median(np.diff(values[np.isfinite(values)])))
    for unit, most in (("s", 0.2), ("ms", 200.0), ("us", 2e5)):
        if usual <= most:
            return unit
    return "ns"
