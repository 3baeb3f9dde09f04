"""Strokes of a signal: from rest to rest, or from turn to turn, without settings."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.change_points import (
    TooFewRowsError,
    Transition,
    is_turning,
    stroke_end,
    turning,
)
from palpate_robot_log.recording import block_means, noise_std, rows_between

_TRACK_ROWS = 20_000
_REST_SHARE = 0.01
_LEAST_REST_S = 0.02
_WINDOW_SHARE = 0.65
_TURN_SHARE = 0.25
_EARLY_SHARE = 0.15
_BRIEF_SHARE = 0.02
_TAIL_ROWS = 20
_MOVING_SHARE = 0.001
_BAND = (0.02, 0.1)
_FEWEST_IN_BAND = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Stroke:
    """A movement one way: when it starts and stops, and between which values."""

    start: Transition
    stop: Transition
    from_value: float
    to_value: float


@dataclass(frozen=True, slots=True)
class _Rough:
    """Rows of the extremes, and rows at which the signal has clearly left or not yet reached them."""

    first: int
    last: int
    left: int
    reached: int

    def moving_s(self, time: FloatArray) -> float:
        return float(time[self.reached] - time[self.left])


def strokes_of(time_s: FloatArray, values: FloatArray, least: float) -> tuple[Stroke, ...]:
    """Strokes in the order travelled.

    Parameters
    ----------
    time_s, values : (n,) array
    least : float
        Movements smaller than this, in the unit of ``values``, are no strokes.
    """
    block = -(-time_s.size // _TRACK_ROWS)
    time, value = block_means(time_s, block), block_means(values, block)
    noise = noise_std(value)
    rough = [_rough(value, a, b, noise) for a, b in _runs(value, max(least, 25.0 * noise))]
    # A start is the end of the stroke that runs backwards.
    end = value.size - 1
    mirrored = [_Rough(end - r.last, end - r.first, end - r.reached, end - r.left) for r in reversed(rough)]
    n = len(rough)
    starts = [_stop(-time[::-1], value[::-1], mirrored, n - 1 - k).mirrored() for k in range(n)]
    stops = [_stop(time, value, rough, k) for k in range(n)]
    for k, (before, after) in enumerate(pairwise(rough)):
        low, high = float(time[before.reached]), float(time[after.left])
        reach = _TURN_SHARE * min(low - float(time[before.left]), float(time[after.reached]) - high)
        rows, margin = rows_between(time, low - reach, high + reach), (high - low) / 4.0
        between_s = (low - margin, high + margin)
        brief_s = _BRIEF_SHARE * min(before.moving_s(time), after.moving_s(time))
        brief = starts[k + 1].time_s - stops[k].time_s < brief_s
        if (
            _no_rest(time, stops[k], starts[k + 1])
            or _meet(time, value, before, after)
            or (brief and is_turning(time[rows], value[rows], between_s))
        ):
            stops[k] = starts[k + 1] = turning(time[rows], value[rows], between_s)
    return tuple(
        Stroke(
            start=start,
            stop=stop,
            from_value=float(np.median(value[max(r.first - 2, 0) : r.first + 3])),
            to_value=float(np.median(value[max(r.last - 2, 0) : r.last + 3])),
        )
        for r, start, stop in zip(rough, starts, stops, strict=True)
    )


def _runs(values: FloatArray, least: float) -> list[tuple[int, int]]:
    """Rows (start, stop) of successive extremes that differ by more than ``least``."""
    numbers = values.tolist()
    low = high = going = 0
    extremes: list[int] = []
    for k, number in enumerate(numbers):
        if number > numbers[high]:
            high = k
        if number < numbers[low]:
            low = k
        if going <= 0 and number > numbers[low] + least:
            extremes.append(low)
            going, high = 1, k
        elif going >= 0 and number < numbers[high] - least:
            extremes.append(high)
            going, low = -1, k
    if going:
        extremes.append(high if going > 0 else low)
    return list(pairwise(extremes))


def _rough(values: FloatArray, first: int, last: int, noise: float) -> _Rough:
    inside = values[first : last + 1]
    span = abs(float(inside[-1] - inside[0]))
    # The extreme of a long rest is some five standard deviations from its mean.
    margin = max(_REST_SHARE * span, 12.0 * noise)
    left = first + int(np.flatnonzero(np.abs(inside - inside[0]) <= margin)[-1])
    reached = first + int(np.flatnonzero(np.abs(inside - inside[-1]) > margin)[-1])
    return _Rough(first, last, min(left, reached), reached)


def _stop(time: FloatArray, values: FloatArray, rough: list[_Rough], k: int) -> Transition:
    here, following = rough[k], rough[k + 1] if k + 1 < len(rough) else None
    until = following.left if following else values.size - 1
    if until - here.reached < 4 or (following is None and _still_moves(values, here)):
        return Transition(time_s=float(time[here.last]), std_s=0.0, kind="cut")
    moving, begin = here.moving_s(time), float(time[here.reached])
    rest = float(time[until]) - begin
    if following:
        # Strokes of one shape leave a turn for the same share of their durations.
        rest *= moving / max(moving + following.moving_s(time), 1e-12)
    rows = rows_between(time, begin - _WINDOW_SHARE * moving, begin + min(rest, moving))
    if not time[rows].size:
        raise TooFewRowsError
    between = (begin - _EARLY_SHARE * moving, float(time[rows][-1]))
    return stroke_end(time[rows], values[rows], between, moving)


def _still_moves(values: FloatArray, last: _Rough) -> bool:
    """Whether the signal ends amid its last stroke: its very last rows still go on."""
    if last.last < values.size - 3:
        return False
    tail = values[last.left :][-_TAIL_ROWS:]
    gone = abs(float(np.median(tail[-5:]) - np.median(tail[:5])))
    return gone > float(
        max(6.0 * noise_std(values), _MOVING_SHARE * abs(values[last.last] - values[last.first]))
    )


def _no_rest(time: FloatArray, stop: Transition, start: Transition) -> bool:
    """Whether stop and start are too close to distinguish a rest from a turn."""
    row_s = float(np.median(np.diff(time)))
    # A fit without rows at rest is of no use, however it judges itself.
    spread = min(4.0 * float(np.hypot(stop.std_s, start.std_s)), 2.0 * _LEAST_REST_S)
    return start.time_s - stop.time_s < max(spread, 3.0 * row_s, _LEAST_REST_S)


def _meet(time: FloatArray, values: FloatArray, before: _Rough, after: _Rough) -> bool:
    """Whether straight lines through both sides of a turn meet at it: then nothing rests there."""
    extreme = values[before.last]
    span = min(abs(values[rough.last] - values[rough.first]) for rough in (before, after))
    instants = []
    for rows in (slice(before.left, before.last + 1), slice(after.first, after.reached + 1)):
        off = np.abs(values[rows] - extreme)
        near = (off > _BAND[0] * span) & (off < _BAND[1] * span)
        if np.count_nonzero(near) < _FEWEST_IN_BAND:
            return False
        instants.append(float(np.polyfit(off[near], time[rows][near], 1)[1]))
    row_s = float(np.median(np.diff(time)))
    return instants[1] - instants[0] < max(3.0 * row_s, _LEAST_REST_S)
