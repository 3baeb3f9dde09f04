"""Measures of a log as it was read, for the table of checks: what each finds, and the words of its message.

A measure is called with the series or recording that a message is about, and with what it is compared to.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from palpate_robot_log.reading.channel_map import ChannelMap
    from palpate_robot_log.reading.raw import Series

TWO_PI = 2.0 * np.pi
LARGEST_DEVIATION = 0.01  # of an orientation's numbers from the numbers of a rotation
_PLATEAU_ROWS = 8


class Found(NamedTuple):
    """Value of a measure, the row and the column where it is, and words of the message."""

    value: float
    row: int | None
    column: int | None
    words: Mapping[str, object]


def found(value: float, row: int | None = None, column: int | None = None, **words: object) -> Found:
    """Value with its place and its words."""
    return Found(value, row, column, words)


def given(
    _: object, value: float, row: int | None = None, column: int | None = None, **words: object
) -> Iterator[Found]:
    """Value that the caller has measured."""
    yield Found(value, row, column, words)


# --------------------------------------------------------------------------------------- time


def steps_back(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Count of rows whose time is before the time of the previous row."""
    is_back = np.diff(series.time_s) < 0.0
    for row in np.flatnonzero(is_back)[:1] + 1:
        yield found(int(is_back.sum()), int(row), to=series.time_s[row], before=series.time_s[row - 1])


def repeated_times(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """Count of rows with the time of the row before, where they are not to be left out."""
    is_same = np.diff(series.time_s) == 0.0
    for row in np.flatnonzero(is_same)[:1] + 1 if channels.repeated_time == "refuse" else ():
        yield found(int(is_same.sum()), int(row))


def usual_step(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Median time from row to row [s]."""
    yield found(float(np.median(np.diff(series.time_s))), unit=series.units[0])


def longest_step_s(usual_s: float) -> float:
    """Step [s] beyond which rows are missing, by the usual step [s]."""
    return max(10.0 * usual_s, 0.02)


def long_steps(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """Count of steps in which rows are missing."""
    steps = np.diff(series.time_s)
    usual = float(np.median(steps))
    longest = channels.max_gap or longest_step_s(usual)
    gaps = np.flatnonzero(steps > longest)
    for row in map(int, gaps[:1]):
        to = series.at(row + 1)
        yield found(gaps.size, row, seconds=steps[row], to=to, usual=usual, longest=longest)


# ------------------------------------------------------------------------ sensor: stuck, saturated


def _columns(series: "Series") -> list[int]:
    """Axes that the sensor has."""
    return [index for index, name in enumerate(series.names) if name != "0"]


def _same(series: "Series", pose: Sequence["Series"]) -> BoolArray:
    """Whether each axis has the value of the row before; it tells nothing of a coarse load cell at rest."""
    same: BoolArray = series.values[1:] == series.values[:-1]
    if len(real := _columns(series)) == 1:
        columns = ((each.time_s, column) for each in pose for column in each.values.T)
        steps = [np.diff(np.interp(series.time_s, time, column)) for time, column in columns]
        is_free = series.values[1:, real[0]] == series.values[0, real[0]]
        same &= (np.any(steps, axis=0) & ~is_free)[:, None]
    return same


def _runs(same: BoolArray) -> tuple[IntArray, IntArray]:
    """First row and number of rows of each run of equal rows."""
    starts = np.concatenate([[0], np.flatnonzero(~same) + 1])
    return starts, np.diff(np.concatenate([starts, [same.size + 1]]))


def _longest_run(series: "Series", same: BoolArray) -> tuple[int, int, float]:
    """First and last row of the longest run of equal rows, and its length [s]."""
    starts, lengths = _runs(same)
    longest = int(np.argmax(lengths))
    first, last = int(starts[longest]), int(starts[longest] + lengths[longest] - 1)
    return first, last, float(series.time_s[last] - series.time_s[first])


def changing_rows(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Count of rows in which each axis differs from the row before."""
    for column in _columns(series):
        values = series.values[:, column]
        yield found(int(np.count_nonzero(np.diff(values))), 0, column, number=values[0])


def stuck_s(series: "Series", _: "ChannelMap", pose: Sequence["Series"]) -> Iterator[Found]:
    """Longest time [s] for which all axes repeat themselves."""
    same = np.logical_and.reduce(_same(series, pose)[:, _columns(series)], axis=1)
    first, last, seconds = _longest_run(series, same)
    # A wrench that is updated less often than rows are written repeats in every run.
    if last - first + 1 > 5 * np.median(_runs(same)[1]):
        yield found(seconds, first, until=series.at(last))


def axis_stuck_s(series: "Series", channels: "ChannelMap", pose: Sequence["Series"]) -> Iterator[Found]:
    """Longest time [s] for which one axis repeats itself and shows noise at other times."""
    step_s = float(np.median(np.diff(series.time_s)))
    for column, same in ((column, _same(series, pose)[:, column]) for column in _columns(series)):
        if np.count_nonzero(same) * step_s < channels.stuck:
            continue
        first, last, seconds = _longest_run(series, same)
        values = series.values[:, column]
        # A value of few digits repeats by chance.
        is_long = last - first + 1 >= _PLATEAU_ROWS
        if is_long and _is_noisy(np.concatenate([values[:first], values[last + 1 :]])):
            yield found(seconds, first, column, number=values[first], until=series.at(last))


def _is_noisy(values: FloatArray) -> bool:
    """Whether most rows differ from their neighbours, and by chance: of a smooth signal bends are small."""
    steps = np.diff(values)
    bends = np.diff(steps)
    return bends.size > 0 and bool(np.median(np.abs(bends)) >= np.median(np.abs(steps)) > 0.0)


def plateau_rows(series: "Series", _: "ChannelMap", pose: Sequence["Series"]) -> Iterator[Found]:
    """Count of rows on end at which an axis is cut, at the largest or the least of its values."""
    for column in _columns(series):
        values = series.values[:, column]
        ends = float(values.max()), float(values.min())
        for extreme in ends:
            is_near_rest = abs(extreme) < 0.3 * max(map(abs, ends))
            if is_near_rest or np.count_nonzero(values == extreme) < _PLATEAU_ROWS:
                continue
            starts, lengths = _runs(_same(series, pose)[:, column])
            at_extreme = values[starts] == extreme
            longest = int(np.argmax(np.where(at_extreme, lengths, 0)))
            first, size = int(starts[longest]), int(lengths[longest])
            # A coarse sensor repeats itself at every value; one that is cut repeats itself at the end only.
            if size >= max(_PLATEAU_ROWS, 4 * int(lengths[~at_extreme].max(initial=1))):
                yield found(size, first, column, number=extreme, until=series.at(first + size - 1))


def rows_beyond_range(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """Count of rows that reach the range of the sensor, where the map gives it."""
    known = {"force": (channels.force_limit, "N"), "moment": (channels.moment_limit, "N·mm")}
    limit, unit = known[series.what]
    beyond = np.abs(series.values) >= (np.inf if limit is None else limit)
    for row, column in np.argwhere(beyond)[:1].tolist():
        number = series.values[row, column]
        words: dict[str, Any] = {"name": series.what, "unit": unit, "limit": limit}
        yield found(int(beyond.any(axis=1).sum()), row, column, number=number, **words)


# ------------------------------------------------------------------ units by magnitude, orientations


def span(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """Largest range of the axes of a position or a force."""
    limits = channels.plausible.travel if series.what == "position" else channels.plausible.force
    value = float(np.ptp(series.values, axis=0).max())
    yield found(value, hint=_hint(value, limits), unit=series.units[1])


def lever_mm(series: "Series", channels: "ChannelMap", force: "Series") -> Iterator[Found]:
    """Range of the moment over the range of the force, where there is a moment."""
    force_range, moment_range = (float(np.ptp(each.values, axis=0).max()) for each in (force, series))
    lever = moment_range / max(force_range, 1e-300)
    hint, unit = _hint(lever, channels.plausible.lever), series.units[1]
    if moment_range > 0.0:
        yield found(lever, moment=moment_range, force=force_range, hint=hint, unit=unit)


def _hint(value: float, limits: tuple[float, float]) -> str:
    """Unit a thousand times off that would be plausible."""
    factors = {"larger": 1e3, "smaller": 1e-3}
    fitting = [word for word, factor in factors.items() if limits[0] <= value * factor <= limits[1]]
    return f" (a unit 1000 times {fitting[0]} would do)" if fitting else ""


def reach_mm(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Largest distance of a coordinate of the tip from the base."""
    reach = np.abs(series.values).max(axis=1)
    yield found(float(reach.max()), int(reach.argmax()), unit=series.units[1])


def noise_of_rest_mm(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """Way of a tip that rests in all rows, whose steps are as long."""
    way, steps = (
        float(np.std(each, axis=0).max()) for each in (series.values, np.diff(series.values, axis=0))
    )
    largest = float(np.ptp(series.values, axis=0).max())
    if largest < channels.plausible.travel[0] and steps > way:
        yield found(largest)


def jump_mm(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Longest step of the tip, where it is far faster than all but one and a large part of the way."""
    steps = np.linalg.norm(np.diff(series.values, axis=0), axis=1)
    speeds = steps / np.diff(series.time_s)
    at, others = int(speeds.argmax()), np.partition(speeds, -3)[-3]
    if speeds[at] > 20.0 * others and steps[at] > 0.1 * float(np.ptp(series.values, axis=0).max()):
        yield found(float(steps[at]), at + 1)


def jump_after_stop_mm(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """Jump of a pose that did not change to the last digit: its stream was interrupted."""
    starts, lengths = _runs(np.all(series.values[1:] == series.values[:-1], axis=1))
    ends = starts + lengths - 1
    held_s = series.time_s[ends] - series.time_s[starts]
    for index in np.flatnonzero((held_s > channels.stuck) & (lengths > 5 * np.median(lengths))):
        after = int(ends[index]) + 1
        if after < series.time_s.size:
            jump = float(np.linalg.norm(series.values[after] - series.values[after - 1]))
            yield found(jump, int(starts[index]), seconds=held_s[index], to=series.at(after))


def off_unit(quaternions: FloatArray) -> FloatArray:
    """Deviation (n,) of the length of quaternions (n, 4) from 1."""
    return np.abs(np.sqrt(np.einsum("ij,ij->i", quaternions, quaternions)) - 1.0)


def off_turn(rows: FloatArray) -> FloatArray:
    """Largest deviation (n,) of matrices, rows of nine numbers (n, 9), from right angles and unit length."""
    matrices = rows.reshape(-1, 3, 3)
    products = np.einsum("nij,nkj->nik", matrices, matrices)
    return np.abs(products - np.eye(3)).max(axis=(1, 2))


def off_unit_length(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Deviation of a quaternion's length from 1."""
    lengths, off = np.linalg.norm(series.values, axis=1), off_unit(series.values)
    bad = np.flatnonzero(off > LARGEST_DEVIATION)
    for row in [*map(int, bad[:1])] or [int(off.argmax())]:
        yield found(float(off.max()), row, length=lengths[row], n_rows=bad.size)


def off_rotation(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Deviation of nine numbers from a rotation."""
    off = off_turn(series.values)
    yield found(float(off.max()), int(off.argmax()))


def determinant(series: "Series", _: "ChannelMap") -> Iterator[Found]:
    """Least determinant of rotation matrices."""
    determinants = np.linalg.det(series.values.reshape(-1, 3, 3))
    yield found(float(determinants.min()), int(determinants.argmin()))


def angles_like_radians(series: "Series", channels: "ChannelMap") -> Iterator[Found]:
    """1 where all of some degrees are as small as radians."""
    largest = float(np.degrees(np.abs(series.values).max()))
    are_degrees = series.units[1] in ("deg", "°", "degree", "degrees")
    is_small = are_degrees and 0.0 < largest <= TWO_PI and not channels.plausible.small_angles
    yield found(int(is_small), largest=largest)
