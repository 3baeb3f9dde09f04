"""Column of time of a stream: what rises evenly and is no other quantity; a counter of rows is none."""

from itertools import product

import numpy as np

from palpate.api import FloatArray
from palpate.api.files import Column, kind_of
from palpate_robot_log.reading.names import COUNTERS, TIME_WORDS, has_role, words_of
from palpate_robot_log.reading.raw import Stream
from palpate_robot_log.reading.vectors import Guess

_STAMPS = {"sec": "nanosec", "secs": "nsecs"}
"""Fields of a time stamp in ROS 2 and 1: whole seconds, and nanoseconds to add."""
_COARSE_CLOCK = 0.01
_USUAL_LENGTH_S = 20.0
_LONGEST_STEP_S = 2.0

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
        seconds = stream.column(name).values + 1e-9 * stream.column(stamp + part).values
        steps = np.diff(seconds[np.isfinite(seconds)])
        if steps.size and np.mean(steps > 0.0) >= RISING:
            entry = {"column": name, "nanoseconds": stamp + part, "unit": "s"}
            return Guess(entry=entry, stream=stream.name, score=4.0)
    candidates = [
        (_time_score(column), -index, column) for index, column in enumerate(stream.columns.values())
    ]
    score, _, column = max(candidates, key=lambda candidate: candidate[:2], default=(0.0, 0, None))
    if column is None or score <= 0.0:
        return next(filter(None, (_counter(stream, column) for column in stream.columns.values())), None)
    shown = column.shown_unit
    if kind_of(shown) == "time":
        return Guess(entry={"column": column.name}, stream=stream.name, score=score)
    unit = _likely_clock(column.values[np.isfinite(column.values)])
    checks = [f"the unit of time: {unit} is judged from the length of the log alone"]
    if score < 2.0:
        checks.insert(
            0, f"time: {column.name} is taken for it, as it rises evenly and its name says nothing else"
        )
    entry = {"column": column.name, "unit": unit}
    return Guess(entry=entry, stream=stream.name, to_check=tuple(checks), score=score)


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
    return Guess(entry={"column": column.name}, stream=stream.name, is_counter=True, to_check=(check,))


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
    return (
        evenness
        if evenness > 0.99 and not is_counter and not has_role([*words]) and not words & {*"xyz"}
        else 0.0
    )


def repeats_time(stream: Stream) -> bool:
    """Whether the clock of a stream is coarser than its rows, so that not only a few repeat their time."""
    time = time_of(stream)
    if time is None or time.is_counter or len(time.names) > 1:
        return False
    return float(np.mean(np.diff(stream.column(time.names[0]).values) == 0.0)) > _COARSE_CLOCK
