"""A channel map guessed from names, units, numbers and directions, for a person to look over."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column
from palpate_robot_log.reading.channel_map import NO_COLUMN
from palpate_robot_log.reading.clock import repeats_time, time_of
from palpate_robot_log.reading.names import COMMANDED, factor_of, pick, words_of
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.reading.vectors import (
    KINDS,
    QUANTITIES,
    WORDS,
    WRENCH_WORDS,
    Group,
    Guess,
    complete_rows,
    extent,
    groups_of,
    possible,
)

_NONE = {"columns": [NO_COLUMN] * 3}
_SHARED_TABLE = 0.2
_CLEARLY = 1.0


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
    clocks: str = "own"

    def used_streams(self) -> tuple[str, ...]:
        """Streams that the guesses come from."""
        return tuple(dict.fromkeys(guess.stream for guess in self.guesses.values()))


def propose(log: RawLog) -> Proposal:
    """Proposal of which columns are time, pose and wrench: of a robot, or of a machine of one axis."""
    found: dict[str, list[Guess]] = {quantity: [] for quantity in QUANTITIES}
    groups = [group for stream in log.streams for group in groups_of(stream)]
    turned = {
        (group.stream, group.words[:-1]) for group in groups if WORDS["orientation"] & {*group.words[-1:]}
    }
    has_moment = any(
        (WORDS["moment"] - {"t"}) & {*group.words}
        or (len(group.columns) == 6 and WRENCH_WORDS & {*group.words})
        for group in groups
    )
    for group in groups:
        for quantity, guess in possible(
            group, is_turned=(group.stream, group.words) in turned, t_is_moment=not has_moment
        ):
            found[quantity].append(replace(guess, is_commanded=bool(COMMANDED & {*group.words})))
    ranked = {quantity: _ranked(quantity, guesses) for quantity, guesses in found.items() if guesses}
    if "position" in ranked and "force" not in ranked:
        ranked |= _of_load_cell(log, ranked["position"][0].stream, groups)
    if "force" in ranked and "moment" not in ranked:
        none = Guess(entry=_NONE, stream=ranked["force"][0].stream)
        ranked["moment"] = [none.with_check("no moment is found: there is none")]
    force_extent = extent(complete_rows(_columns(log, ranked["force"][0]))) if "force" in ranked else 0.0
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
    order = sorted(guesses, key=lambda one: (one.is_commanded and one.score >= _CLEARLY, -one.score))
    measured = [one for one in order if not one.is_commanded and one.score >= _CLEARLY]
    commanded = [one for one in order if one.is_commanded]
    if commanded and not measured:
        check = f"{quantity}: these columns are commanded, not measured; log the measured ones"
        order = [one.with_check(check) for one in commanded]
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
        senses = _senses(travel.column.values, force.column.values)
        guesses = {
            quantity: with_unit(
                log,
                quantity,
                Guess(
                    entry={"columns": [NO_COLUMN, NO_COLUMN, "-" * (sense > 0.0) + one.column.name]},
                    stream=stream.name,
                    to_check=one.remarks,
                ),
                0.0,
            )
            for quantity, one, sense in zip(("position", "force"), (travel, force), senses, strict=True)
        }
        still = {"form": "fixed", "value": [1.0, 0.0, 0.0, 0.0]}
        guesses["orientation"] = Guess(entry=still, stream=stream.name)
        guesses["moment"] = Guess(entry=_NONE, stream=stream.name)
        reason = "machine: depth grows as the tool moves while the force does, and the tissue pushes it back"
        return Proposal(
            guesses=guesses,
            time={stream.name: time},
            repeats_time=repeats_time(stream),
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


def _lacks(log: RawLog, guess: Guess) -> bool:
    """Whether more rows have no value than a few that are damaged, as where topics share a table."""
    lacking = [~np.isfinite(column.values) for column in _columns(log, guess)]
    return float(np.mean(np.any(lacking, axis=0))) > _SHARED_TABLE


def with_unit(log: RawLog, quantity: str, guess: Guess, force_extent: float) -> Guess:
    """Guess with a unit judged by magnitude, where the file shows none."""
    columns, has_unit = _columns(log, guess), quantity != "orientation" or "sequence" in guess.entry
    has_unit = has_unit or guess.entry.get("form") == "axis_angle"
    if not has_unit or guess.unit or not columns:
        return guess
    if shown := columns[0].shown_unit:
        known = factor_of(columns[0], KINDS[quantity]) is not None
        check = f"the unit of {quantity}: the file gives '{shown}', no unit of {KINDS[quantity]}; write unit"
        return guess if known else guess.with_check(check)
    unit = _likely_unit(quantity, complete_rows(columns), force_extent)
    check = f"the unit of {quantity}: {unit} is judged from the size of the numbers alone"
    return guess.with_check(check, unit=unit)


def _columns(log: RawLog, guess: Guess) -> list[Column]:
    return log.columns(guess.stream, guess.names)


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
