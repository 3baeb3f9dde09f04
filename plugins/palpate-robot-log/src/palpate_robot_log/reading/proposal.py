"""A channel map guessed from names, units, numbers and directions, for a person to look over."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, toml_value
from palpate_robot_log.reading.channel_map import NO_COLUMN
from palpate_robot_log.reading.names import ROLES, Picked, factor_of, pick, words_of
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
class Proposal:
    """Guesses by quantity, for time by stream; a quantity that was not found is absent."""

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
    clocks: str = "own"

    def used_streams(self) -> tuple[str, ...]:
        """Streams that the guesses come from."""
        return tuple(dict.fromkeys(guess.stream for guess in self.guesses.values()))


def propose(log: RawLog) -> Proposal:
    """Proposal of which columns are time, pose and wrench: of a robot, or of a machine of one axis."""
    found: dict[str, list[Guess]] = {quantity: [] for quantity in QUANTITIES}
    groups = [group for stream in log.streams for group in groups_of(stream)]
    turned = {
        (group.stream, group.words[:-1])
        for group in groups
        if ROLES["orientation"].vector & {*group.words[-1:]}
    }
    has_moment = any(
        (ROLES["moment"].vector - {"t"}) & {*group.words}
        or (len(group.columns) == 6 and WRENCH_WORDS & {*group.words})
        for group in groups
    )
    for group in groups:
        is_turned = (group.stream, group.words) in turned
        for quantity, guess in possible(group, is_turned=is_turned, t_is_moment=not has_moment):
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
    force_extent = extent(complete_rows(log.columns(force.stream, force.names))) if force else 0.0
    guesses = {name: with_unit(log, name, guesses[0], force_extent) for name, guesses in ranked.items()}
    return Proposal(
        guesses=guesses,
        time={stream.name: time for stream in log.streams if (time := time_of(stream)) is not None},
        others={name: tuple(guesses[1:4]) for name, guesses in ranked.items() if len(guesses) > 1},
        skips_missing=any(_lacks(log, guess) for guess in guesses.values()),
        repeats_time=any(
            repeats_time(log.stream(name)) for name in {each.stream for each in guesses.values()}
        ),
        wrench_frame="base" if "force" in guesses and guesses["force"].is_in_base else "sensor",
    )


def _ranked(quantity: str, guesses: Iterable[Guess]) -> list[Guess]:
    """Guesses, the likeliest first: one that is commanded only where nothing clearly is measured."""
    order = sorted(guesses, key=lambda one: one.rank or ())
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


def machine_of(log: RawLog) -> Proposal | None:
    """Proposal of a testing machine: a time, one length along its axis and one force; None without them.

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
        return Proposal(
            guesses=guesses,
            time={stream.name: time},
            repeats_time=repeats_time(stream),
            wrench_reason=reason,
        )
    return None


def _twist_of(log: RawLog, stream: Stream, columns: Sequence[Column]) -> dict[str, Guess]:
    """Turn of a machine about its axis, and the moment of the tissue against it; empty without either."""
    angle, moment = pick(columns, "angle"), pick(columns, "moment")
    if angle is None or moment is None or not np.ptp(angle.column.values) > 0.0:
        return {}
    known = np.isfinite(angle.column.values) & np.isfinite(moment.column.values)
    sense = np.corrcoef(angle.column.values[known], moment.column.values[known])[0, 1]
    turn = _along_axis(log, stream, "orientation", angle, -1.0, form="axis_angle")
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
        known = factor_of(columns[0], ROLES[quantity].kind) is not None
        check = (
            f"the unit of {quantity}: the file gives '{shown}', no unit of {ROLES[quantity].kind}; write unit"
        )
        return guess if known else guess.with_check(check)
    unit = _likely_unit(quantity, complete_rows(columns), force_extent)
    check = f"the unit of {quantity}: {unit} is judged from the size of the numbers alone"
    return guess.with_check(check, unit=unit)


def _likely_unit(quantity: str, values: FloatArray, force_extent: float) -> str:
    size = extent(values)
    if quantity == "position":
        return "m" if size < 0.8 else "mm"
    if quantity == "orientation":
        return "rad" if not len(values) or np.abs(values).max() <= 2.0 * np.pi else "deg"
    if quantity == "force":
        return "N" if size < 500.0 else "mN"
    # A lever of a metre is longer than any tool, one of a millimetre shorter than most.
    return "N m" if force_extent > 0.0 and size / force_extent < 0.5 else "N·mm"


# ------------------------------------------------------------------- tables of study.toml


def channel_map(proposal: Proposal) -> dict[str, object]:
    """Proposed map as plain values, without the quantities that were not found."""
    time = _first_time(proposal)
    chosen: dict[str, object] = {}
    if time is not None and not time.is_counter:
        chosen["time"] = _time_entry(time)
    chosen |= {
        quantity: _entry(proposal.guesses[quantity], time, proposal)
        for quantity in QUANTITIES
        if quantity in proposal.guesses
    }
    if {"force", "moment"} <= {*chosen}:
        chosen |= {"acts_on": proposal.acts_on, "wrench_frame": proposal.wrench_frame}
    chosen |= {"missing": "skip"} if proposal.skips_missing else {}
    chosen |= {"repeated_time": "keep_first"} if proposal.repeats_time else {}
    return chosen | ({"clocks": proposal.clocks} if proposal.files else {})


def _time_entry(time: Guess) -> object:
    return time.names[0] if len(time.entry) == 1 else dict(time.entry)


def _first_time(proposal: Proposal) -> Guess | None:
    """Time of the first stream that guesses come from and that has one."""
    streams = [*proposal.used_streams(), *proposal.time]
    return next((proposal.time[stream] for stream in streams if stream in proposal.time), None)


def _entry(guess: Guess, time: Guess | None, proposal: Proposal) -> dict[str, object]:
    entry, own = dict(guess.entry), proposal.time.get(guess.stream)
    if "columns" in entry and guess.stream and len(proposal.used_streams()) > 1:
        entry["stream"] = guess.stream
    if "columns" in entry and own and not own.is_counter and time and own.entry != time.entry:
        entry["time"] = _time_entry(own)
    return entry


def is_machine(proposal: Proposal) -> bool:
    """Whether a proposal is for a testing machine, whose tool moves along an axis and turns about it."""
    position = proposal.guesses.get("position")
    return position is not None and len(position.names) < 3


def study_text(log: RawLog, proposal: Proposal) -> str:
    """Tables of study.toml that read this file, ready to be pasted."""
    files = ["# {} is the part that both names of a press share", *pairs(proposal.files or {})]
    gravity = [
        'method = "off"  # or "fit" from poses in air, or "known" with the weight that the sensor carries:',
        '# weight = "1 N"',
        '# centre = ["0 mm", "0 mm", "-30 mm"]',
    ]
    tables = {
        "experiment": ['loader = "robot_log"'],
        "experiment.settings.text": pairs(log.layout),
        "experiment.settings.files": files if proposal.files else [],
        "experiment.settings.channels": [*_channels(proposal)],
        "experiment.settings.drift": ["enabled = false  # no free air after the press shows it"]
        if proposal.ends_in_contact
        else [],
        "experiment.settings.gravity": [] if is_machine(proposal) else gravity,
    }
    return tables_text(tables)


def tables_text(tables: Mapping[str, Sequence[str]]) -> str:
    """Text of the tables that have lines, by their names."""
    return "\n".join("\n".join([f"[{name}]", *lines, ""]) for name, lines in tables.items() if lines)


def pairs(table: Mapping[str, object]) -> list[str]:
    """Lines of a table of values."""
    return [f"{key} = {toml_value(value)}" for key, value in table.items()]


def _channels(proposal: Proposal) -> Iterable[str]:
    """Lines of the channel map, with what is to be checked and what it may be instead."""
    chosen, time = channel_map(proposal), _first_time(proposal)
    for quantity in ("time", *QUANTITIES):
        guess = time if quantity == "time" else proposal.guesses.get(quantity)
        if guess is not None and quantity in chosen:
            yield from (f"# check {check}" for check in guess.to_check)
            yield f"{quantity} = {toml_value(chosen[quantity])}"
            yield from (f"# or {quantity} = {toml_value(_entry(o, time, proposal))}" for o in guess.also)
        elif guess is not None:
            entry = f'{{ column = {toml_value(guess.names[0])}, rate = "… Hz" }}'
            yield f"# {quantity} = {entry}  # {guess.to_check[0]}"
        else:
            columns = ", ".join(['"…"'] * (4 if quantity == "orientation" else 3))
            empty = f"{{ columns = [{columns}] }}" if quantity != "time" else '"…"'
            yield f"# {quantity} = {empty}  # no column looks like it: name them"
    yield from [f"# {proposal.wrench_reason}"] if is_machine(proposal) else _sides(proposal)
    if proposal.skips_missing:
        yield 'missing = "skip"  # rows of one topic have no values of another'
    if proposal.repeats_time:
        yield 'repeated_time = "keep_first"  # the clock is coarser than the rows'
    if proposal.files:
        clocks = {"own": '"common": one clock stamped both files', "common": '"own": each file has its clock'}
        yield f'clocks = "{proposal.clocks}"  # or {clocks[proposal.clocks]}'


def _sides(proposal: Proposal) -> Iterable[str]:
    """Side and frame of the wrench, with the other ones."""
    other_side = {"tool": "tissue", "tissue": "tool"}[proposal.acts_on]
    other_frame = {"sensor": "base", "base": "sensor"}[proposal.wrench_frame]
    yield f"# check {proposal.wrench_reason or 'whose wrench it is, and in which frame: nothing tells'}"
    yield f'acts_on = "{proposal.acts_on}"  # or "{other_side}": tool is the wrench of the tissue on the tool'
    yield f'wrench_frame = "{proposal.wrench_frame}"  # or "{other_frame}"'
