"""A channel map of a robot's log, guessed from names, units, numbers and directions."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import HEXADECIMAL, Column
from palpate_robot_log.press_measures import OTHER_SIDE
from palpate_robot_log.reading.channel_map import NO_COLUMN
from palpate_robot_log.reading.names import ROLES, WORDS, Picked, factor_of, pick, words_of
from palpate_robot_log.reading.proposal import Entry, Proposal
from palpate_robot_log.reading.quantities import (
    QUANTITIES,
    WRENCH_WORDS,
    Group,
    Guess,
    complete_rows,
    extent,
    groups_of,
    possible,
    pressed_rows,
    repeats_time,
    rest_of,
    time_of,
)
from palpate_robot_log.reading.raw import RawLog, Stream

_NONE = {"columns": [NO_COLUMN] * 3}
_DOWN: Mapping[str, Any] = {"form": "fixed", "value": [1.0, 0.0, 0.0, 0.0]}
"""Entry of an orientation that never turns, and whose axis points down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogGuess:
    """Guesses by quantity, for time by stream; a quantity that was not found is absent.

    ``unused`` has the reason why a column of a known quantity is left out, by its name.
    """

    guesses: Mapping[str, Guess]
    time: Mapping[str, Guess]
    others: Mapping[str, tuple[Guess, ...]] = field(default_factory=dict)
    acts_on: str = "tool"
    wrench_frame: str = "sensor"
    wrench_reason: str = ""
    skips_missing: bool = False
    repeats_time: bool = False
    ends_in_contact: bool = False
    unused: Mapping[str, str] = field(default_factory=dict)
    files: Mapping[str, str] | None = None
    clocks: str = "own"

    def used_streams(self) -> tuple[str, ...]:
        """Streams that the guesses come from."""
        return tuple(dict.fromkeys(guess.stream for guess in self.guesses.values()))


def propose(log: RawLog) -> LogGuess:
    """Guess of which columns are time, pose and wrench: of a robot, or of a machine of one axis."""
    found: dict[str, list[Guess]] = {quantity: [] for quantity in QUANTITIES}
    groups = [group for stream in log.streams for group in groups_of(stream)]
    turned = {
        (group.stream, group.words[:-1])
        for group in groups
        if ROLES["orientation"].vector & {*group.words[-1:]}
    }
    named, six = ({*chain(*(group.words for group in groups if len(group.columns) == n))} for n in (3, 6))
    has_force = bool((ROLES["force"].vector | WORDS["wrench"]) & named)
    has_moment = bool((ROLES["moment"].vector - {"t"}) & named or WRENCH_WORDS & six)
    for group in groups:
        is_turned = (group.stream, group.words) in turned
        for quantity, guess in possible(group, is_turned=is_turned, t_is_moment=has_force and not has_moment):
            found[quantity].append(guess)
    ranked = {quantity: _ranked(quantity, guesses) for quantity, guesses in found.items() if guesses}
    if "position" in ranked and "force" not in ranked:
        ranked |= _of_load_cell(log, ranked["position"][0].stream, groups)
    if "force" in ranked and "moment" not in ranked:
        none = Guess(entry=_NONE, stream=ranked["force"][0].stream)
        ranked["moment"] = [none.with_check("no moment is found: there is none")]
    if {"position", "force"} <= {*ranked} and "orientation" not in ranked and not ranked["moment"][0].names:
        stage = Guess(entry=_DOWN, stream=ranked["position"][0].stream)
        ranked["orientation"] = [stage.with_check("no orientation is found: the tool never turns")]
    force = ranked["force"][0] if "force" in ranked else None
    arm = words_of(force.names[0])[0] if force else ""

    def order(one: Guess) -> tuple[object, ...]:  # of two arms, the one whose force is there: right_fx
        return (one.rank or ())[:4], all(arm not in words_of(n) for n in one.names)

    for poses in (ranked.get("position", []), ranked.get("orientation", [])) if arm else ():
        poses.sort(key=order)
    if places := ranked.get("position"):
        places[0] = _or_asked(log, [one for one in places if order(one) == order(places[0])])
    force_extent = extent(complete_rows(log.columns(force.stream, force.names))) if force else 0.0
    guesses = {name: with_unit(log, name, guesses[0], force_extent) for name, guesses in ranked.items()}
    return LogGuess(
        guesses=guesses,
        time={stream.name: time for stream in log.streams if (time := time_of(stream)) is not None},
        others={name: tuple(guesses[1:4]) for name, guesses in ranked.items() if len(guesses) > 1},
        skips_missing=any(_lacks(log, guess) for guess in guesses.values()),
        repeats_time=any(repeats_time(log.stream(one.stream)) for one in guesses.values()),
        wrench_frame="base" if "force" in guesses and guesses["force"].is_in_base else "sensor",
    )


def _or_asked(log: RawLog, places: Sequence[Guess]) -> Guess:
    """First of the likeliest positions, with a question where another one moves too, but not alike."""
    first, *others = places
    ways = list[FloatArray]()
    for one in (first, *(other for other in others if other.stream == first.stream)):
        columns = log.columns(one.stream, one.names)
        unit_mm = factor_of(columns[0], "length") or (1.0 if extent(complete_rows(columns)) > 0.8 else 1e3)
        ways.append(unit_mm * np.column_stack([of.values for of in columns]))
        known = np.isfinite(ways[0] + ways[-1]).all(axis=1)
        mine, its, off = (extent(way[known]) for way in (ways[0], ways[-1], ways[-1] - ways[0]))
        if off > 0.02 * mine and 0.5 < its / max(mine, 1e-300) < 2.0:
            ask = f"{first} or {one}? both show the tool, and differ: write one as position"
            return replace(first, question=ask)
    return first


def _ranked(quantity: str, guesses: Iterable[Guess]) -> list[Guess]:
    """Guesses, the likeliest first: one that is commanded only where nothing clearly is measured."""
    order = sorted(guesses, key=lambda one: one.rank or ())
    if order[0].rank and order[0].rank.is_elsewhere:
        order[0] = order[0].with_check(
            f"the {quantity}: its columns are of a joint, which may not be the tool"
        )
    commanded = [one for one in order if one.is_commanded]
    if commanded and all(one.is_commanded or one.rank.unlikeness > -1.0 for one in order if one.rank):
        check = f"{quantity}: these columns are commanded, not measured; log the measured ones"
        return [one.with_check(check) for one in commanded]
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
    force = Guess(entry={"columns": places}, stream=stream, to_check=cell.remarks)
    return {"force": [force.with_check(check)], "moment": [Guess(entry=_NONE, stream=stream)]}


def with_one_angle(log: RawLog, guess: LogGuess) -> LogGuess | None:
    """Guess with the one angle of a log as the turn about the tool's axis; None without one, or with several.

    The axis is z, unless the name has another one.
    """
    taken = {name for one in guess.guesses.values() for name in one.names}
    stream = log.stream(guess.guesses["position"].stream)
    columns = [column for column in stream.columns.values() if column.name not in taken]
    angle = pick(columns, "angle")
    if angle is None or any(factor_of(one, "angle") for one in columns if one is not angle.column):
        return None
    name = angle.column.name
    axis = next((word[-1] for word in words_of(name) if word in ("rx", "ry", "rz", "x", "y")), "z")
    entries = [
        {"form": "axis_angle", "columns": [sign + name if each == on else NO_COLUMN for each in "xyz"]}
        for on in sorted("xyz", key=lambda each: (each != axis, each != "z"))
        for sign in ("", "-")
    ]
    alone = (
        f"{name} is taken for the turn of the tool about its own axis, which is taken to be along the press"
    )
    first, *others = (Guess(entry=entry, stream=stream.name, to_check=(alone,)) for entry in entries)
    turn = with_unit(log, "orientation", replace(first, also=tuple(others)), 0.0)
    return replace(guess, guesses={**guess.guesses, "orientation": turn})


def machine_of(log: RawLog) -> LogGuess | None:
    """Guess of a testing machine: a time, one length along its axis and one force; None without them.

    The travel and the force that grow together press; depth and contact are found later, as in a robot's log.
    """
    for stream in log.streams:
        columns = [*stream.columns.values()]
        travel, force, time = pick(columns, "travel"), pick(columns, "force"), time_of(stream)
        if travel is None or force is None or time is None:
            continue
        twist = _twist_of(log, stream, columns)
        senses = _senses(travel.column.values, force.column.values)
        # The axis of a tool that only presses points down, and of one that turns about it up.
        senses = (senses[0], -senses[1] if twist else senses[1])
        picked = zip(("position", "force"), (travel, force), senses, strict=True)
        guesses = {name: _along_axis(log, stream, name, one, sense) for name, one, sense in picked}
        guesses |= twist or {
            "orientation": Guess(entry=_DOWN, stream=stream.name),
            "moment": Guess(entry=_NONE, stream=stream.name),
        }
        reason = "machine: depth grows as the tool moves while the force does, and the tissue pushes it back"
        return LogGuess(
            guesses=guesses,
            time={stream.name: time},
            repeats_time=repeats_time(stream),
            wrench_reason=reason,
            unused={} if twist else _unused(columns),
        )
    return None


def _unused(columns: Sequence[Column]) -> dict[str, str]:
    """Reason why the moment of a machine without a twist, or its turn, is left out, by the column."""
    angle, moment = pick(columns, "angle"), pick(columns, "moment")
    if moment is None:
        lacks = "no column of torque; add one, or no twist is compared"
        return {} if angle is None else {angle.column.name: lacks}
    lacks = "no column of rotation; add one in deg, or no twist is compared"
    return {moment.column.name: lacks if angle is None else f"{angle.column.name} does not turn"}


def _twist_of(log: RawLog, stream: Stream, columns: Sequence[Column]) -> dict[str, Guess]:
    """Turn of a machine about its axis, and the moment of the tissue against it; empty without either."""
    angle, moment = pick(columns, "angle"), pick(columns, "moment")
    if angle is None or moment is None or not np.ptp(angle.column.values) > 0.0:
        return {}
    known = np.isfinite(angle.column.values) & np.isfinite(moment.column.values)
    turn = _along_axis(log, stream, "orientation", angle, -1.0, form="axis_angle")
    factor = angle.factor or {"rad": 1.0, "deg": np.radians(1.0)}.get(turn.entry.get("unit", ""))
    turned = angle.column.values[known]
    turned = np.unwrap(turned, period=2.0 * np.pi / factor) if factor else turned
    sense = np.corrcoef(turned, moment.column.values[known])[0, 1]
    return {"orientation": turn, "moment": _along_axis(log, stream, "moment", moment, sense)}


def _along_axis(
    log: RawLog, stream: Stream, quantity: str, one: Picked, sense: float, **entry: object
) -> Guess:
    """Guess of a column that is the component z of a quantity, turned where it has the sense of z."""
    columns = [NO_COLUMN, NO_COLUMN, "-" * bool(sense > 0.0) + one.column.name]
    guess = Guess(entry={**entry, "columns": columns}, stream=stream.name, to_check=one.remarks)
    return with_unit(log, quantity, guess, 0.0)


def _senses(travel: FloatArray, force: FloatArray) -> tuple[float, float]:
    """Signs of the changes of travel and of force from free air to the largest force."""
    is_there = np.isfinite(travel) & np.isfinite(force)
    travel, force = travel[is_there], force[is_there]
    if not force.size or not np.ptp(force):
        return 1.0, 1.0
    rest = rest_of(force)
    free, loaded = pressed_rows(np.abs(force - rest))
    return float(np.sign(travel[loaded] - travel[free])), float(np.sign(force[loaded] - rest))


def _lacks(log: RawLog, guess: Guess) -> bool:
    """Whether more rows have no value than a few that are damaged, as where topics share a table."""
    lacking = [~np.isfinite(column.values) for column in log.columns(guess.stream, guess.names)]
    return float(np.mean(np.any(lacking, axis=0))) > 0.2


def with_unit(log: RawLog, quantity: str, guess: Guess, force_extent: float) -> Guess:
    """Guess with a unit judged by magnitude, where the file shows none."""
    columns, is_turn = log.columns(guess.stream, guess.names), guess.entry.get("form") == "axis_angle"
    has_unit = quantity != "orientation" or "sequence" in guess.entry or is_turn
    if not has_unit or "unit" in guess.entry or not columns:
        return guess
    if shown := columns[0].shown_unit:
        kind = ROLES[quantity].kind
        check = f"the unit of {quantity}: the file gives '{shown}', no unit of {kind}; write unit"
        return guess if factor_of(columns[0], kind) is not None else guess.with_check(check)
    values = complete_rows(columns)
    if (size := extent(values)) > 5e4 and np.array_equal(values, np.round(values)):
        counts = f"the {quantity}: whole numbers over {size:.3g} without a unit, as of counts"
        return guess.with_check(f"{counts}; calibrate the columns, and write unit")
    unit, *others = _likely_units(quantity, values, force_extent)
    if others:
        spans = f"{', '.join(guess.names)} span {size:.3g} and show no unit"
        ask = f"{spans}: {unit}, {' or '.join(others)}? write unit next to {quantity}"
        return replace(guess, question="; ".join(filter(None, (guess.question, ask))))
    check = f"the unit of {quantity}: {unit} is judged from the size of the numbers alone"
    return guess.with_check(check, unit=unit)


def _likely_units(quantity: str, values: FloatArray, force_extent: float) -> list[str]:
    """Units in which the numbers of a quantity have a usual size; a person decides between several."""
    size = extent(values)
    if quantity == "position":  # a press with its way in free air is longer than 3 mm
        return ["m"] if size < 0.8 else ["cm", "mm", "m"] if size < 3.0 else ["mm"]
    if quantity == "orientation":
        return ["rad"] if not len(values) or np.abs(values).max() <= 2.0 * np.pi else ["deg"]
    if quantity == "force":
        return ["N"] if size < 500.0 else ["mN"]
    # A lever of 100 mm is longer than most tools, one of half a millimetre shorter.
    lever = size / force_extent if force_extent > 0.0 else np.inf
    return ["N m"] if lever < 0.1 else ["N cm", "N m", "N·mm"] if lever < 0.5 else ["N·mm"]


# ------------------------------------------------------------------- settings of the loader


def proposal_of(log: RawLog, guess: LogGuess) -> Proposal:
    """Settings of the loader ``robot_log`` for a guess, with all that a person has to check or to answer."""
    kind = "a testing machine of one axis: depth and first contact are found from the force"
    guesses = [*guess.guesses.values(), *guess.time.values()]
    checks = dict.fromkeys(f"check {check}" for one in guesses for check in one.to_check)
    taken = {name for one in guess.guesses.values() for name in one.names}
    others = (
        f"{quantity} might also be: {'; '.join(map(str, free))}"
        for quantity, of in guess.others.items()
        if (free := [one for one in of if taken.isdisjoint(one.names)])
    )
    unused = (f"{name} is not used: {why}" for name, why in guess.unused.items())
    return Proposal(
        loader="robot_log",
        entries=tuple(_entries(log, guess)),
        remarks=(*([kind] if is_machine(guess) else []), *unused, *checks, *others),
        questions=tuple(_questions(log, guess)),
    )


def _entries(log: RawLog, guess: LogGuess) -> Iterator[Entry]:
    """Settings in the order of study.toml."""
    time, of_machine, channel = _first_time(guess), is_machine(guess), partial(Entry, "channels")
    yield from (Entry("text", key, value) for key, value in log.layout.items())
    share = ("{} is the part that both names of a press share",)
    for key, name in (guess.files or {}).items():
        yield Entry("files", key, name, above=share if key == "pose" else ())
    yield from (_channel(quantity, guess, time) for quantity in ("time", *QUANTITIES))
    if not of_machine:
        reason = guess.wrench_reason or "acts_on and wrench_frame: the log does not decide them"
        side, frame = OTHER_SIDE[guess.acts_on], OTHER_SIDE[guess.wrench_frame]
        remark = f'or "{side}": tool is the wrench of the tissue on the tool'
        yield channel("acts_on", guess.acts_on, remark, above=(f"check {reason}",))
        yield channel("wrench_frame", guess.wrench_frame, f'or "{frame}"')
    if guess.skips_missing:
        yield channel("missing", "skip", "rows of one topic have no values of another")
    if guess.repeats_time:
        yield channel("repeated_time", "keep_first", "the clock is coarser than the rows")
    if guess.files:
        clocks = {"own": '"common": one clock stamped both files', "common": '"own": each file has its clock'}
        yield channel("clocks", guess.clocks, f"or {clocks[guess.clocks]}")
    if guess.ends_in_contact:
        yield Entry("drift", "enabled", value=False, remark="no free air after the press shows it")
    if not of_machine:
        remark = 'or "fit" from poses in air, or "known" with the weight that the sensor carries:'
        yield Entry("gravity", "method", "off", remark)
        yield Entry("gravity", "weight", "1 N", is_open=True)
        yield Entry("gravity", "centre", ["0 mm", "0 mm", "-30 mm"], is_open=True)


def _questions(log: RawLog, guess: LogGuess) -> Iterator[str]:
    """Question for the quantities that are not found, and for the rate of rows that are only counted."""
    time, used = _first_time(guess), guess.used_streams()
    counters = [each for name, each in guess.time.items() if each.is_counter and name in used]
    rate = f'give time = {{ column = "{counters[0].names[0]}", rate = "… Hz" }}' if counters else ""
    missing = [name for name in QUANTITIES if name not in guess.guesses]
    missing = ["time"] * (time is None or time.is_counter) + missing
    yield from (one.question for one in guess.guesses.values() if one.question)
    if not missing:
        if counters:
            yield f"not found: the time of {counters[0].stream}; {rate} next to its columns"
        return
    remedies = ["name their columns", rate]
    if missing == ["orientation"]:
        remedies.append('give orientation = { form = "fixed", value = [1, 0, 0, 0] } if the tool never turns')
    if "time" in missing and not rate:
        remedies.append("add a column of seconds, or of counts")
    counts = [note for note in log.notes if note.endswith(HEXADECIMAL)]
    counts += [c.note for stream in log.streams for c in stream.columns.values() if "thousands" in c.note]
    yield f"not found: {', '.join(missing)}; {counts[0] if counts else '; or '.join(filter(None, remedies))}"


def _first_time(guess: LogGuess) -> Guess | None:
    """Time of the first stream that guesses come from and that has one."""
    streams = [*guess.used_streams(), *guess.time]
    return next((guess.time[stream] for stream in streams if stream in guess.time), None)


def _channel(quantity: str, guess: LogGuess, time: Guess | None) -> Entry:
    """Entry of the map for a quantity; it is open where no column is the quantity."""
    found = time if quantity == "time" else guess.guesses.get(quantity)
    if found is None:
        columns = {"columns": ["…"] * (4 if quantity == "orientation" else 3)}
        empty = "…" if quantity == "time" else columns
        return Entry("channels", quantity, empty, "no column looks like it: name them", is_open=True)
    if found.is_counter:
        rate = {"column": found.names[0], "rate": "… Hz"}
        return Entry("channels", quantity, rate, found.to_check[0], is_open=True)
    first, *others = (_value(one, guess, time) for one in (found, *found.also))
    above = tuple(f"check {check}" for check in found.to_check)
    if quantity == "position" and is_machine(guess):
        above = (*above, guess.wrench_reason)
    return Entry("channels", quantity, first, above=above, others=tuple(others))


def _value(one: Guess, guess: LogGuess, time: Guess | None) -> object:
    """Value of the map, with stream and time where the log has several."""
    if "column" in one.entry:
        return one.names[0] if len(one.entry) == 1 else dict(one.entry)
    entry, own = dict(one.entry), guess.time.get(one.stream)
    if "columns" in entry and one.stream and len(guess.used_streams()) > 1:
        entry["stream"] = one.stream
    if "columns" in entry and own and not own.is_counter and time and own.entry != time.entry:
        entry["time"] = _value(own, guess, None)
    return entry


def is_machine(guess: LogGuess) -> bool:
    """Whether a guess is for a testing machine, whose tool moves along an axis and turns about it."""
    return "position" in guess.guesses and len(guess.guesses["position"].names) < 3
