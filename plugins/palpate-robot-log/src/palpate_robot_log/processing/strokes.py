"""Strokes of a signal: from rest to rest, or from turn to turn, without settings."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.checks import LEAST_SLIDE_MM, LEAST_TWIST_DEG, check, errors_of
from palpate_robot_log.processing.change_points import (
    TooFewRowsError,
    Transition,
    is_turning,
    speed_change,
    stroke_end,
    turning,
)
from palpate_robot_log.processing.contact import ContactRows, Onset, ToolMotion
from palpate_robot_log.recording import Recording, block_means, noise_std, rows_between

_TRACK_ROWS = 20_000
_LEAST_REST_S = 0.02
_BAND = (0.02, 0.1)


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
        reach = 0.25 * min(low - float(time[before.left]), float(time[after.reached]) - high)
        rows, margin = rows_between(time, low - reach, high + reach), (high - low) / 4.0
        between_s = (low - margin, high + margin)
        brief_s = 0.02 * min(before.moving_s(time), after.moving_s(time))
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
    margin = max(0.01 * span, 12.0 * noise)
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
    rows = rows_between(time, begin - 0.65 * moving, begin + min(rest, moving))
    if not time[rows].size:
        raise TooFewRowsError
    between = (begin - 0.15 * moving, float(time[rows][-1]))
    return stroke_end(time[rows], values[rows], between, moving)


def _still_moves(values: FloatArray, last: _Rough) -> bool:
    """Whether the signal ends amid its last stroke: its very last rows still go on."""
    if last.last < values.size - 3:
        return False
    tail = values[last.left :][-20:]
    gone = abs(float(np.median(tail[-5:]) - np.median(tail[:5])))
    return gone > float(max(6.0 * noise_std(values), 0.001 * abs(values[last.last] - values[last.first])))


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
        if np.count_nonzero(near) < 4:
            return False
        instants.append(float(np.polyfit(off[near], time[rows][near], 1)[1]))
    row_s = float(np.median(np.diff(time)))
    return instants[1] - instants[0] < max(3.0 * row_s, _LEAST_REST_S)


# ----------------------------------------------------------------------------------- phases of a press

_LEAST_SHARE = 0.05
_LEAST_DWELL_S = 0.02

_AT_SURFACE_MM = 0.1  # a change of speed so near the onset is where the press was meant to begin


@dataclass(frozen=True, slots=True, kw_only=True)
class Phase:
    """A part of the log between two transitions."""

    name: str
    start: Transition
    stop: Transition

    def rows(self, time_s: FloatArray) -> slice:
        """Rows of the phase among increasing time stamps (n,)."""
        return rows_between(time_s, self.start.time_s - 1e-9, self.stop.time_s + 1e-9)


@dataclass(frozen=True, slots=True, kw_only=True)
class Strokes:
    """The press, the branches of twist and slide, and the retract; none where the log ends before it."""

    press: Stroke
    twists: tuple[Stroke, ...]
    retract: Stroke | None
    slides: tuple[Stroke, ...] = ()

    def retract_s(self, time_s: FloatArray) -> float:
        """Time when the retract starts, or the log ends before it."""
        return float(time_s[-1]) if self.retract is None else self.retract.start.time_s


def _strokes(
    recording: Recording, rows: slice, values: FloatArray, least: float, stage: str
) -> tuple[Stroke, ...]:
    """Strokes of a signal in some rows, or the error of the stage where they are too few."""
    try:
        return strokes_of(recording.time_s[rows], values, least)
    except TooFewRowsError:
        words = {"n_rows": recording.n_rows, "rate_hz": recording.rate_hz}
        raise next(errors_of(recording, stage, 1, **words)) from None


def find_strokes(recording: Recording, motion: ToolMotion, contact: ContactRows) -> Strokes:
    """Strokes of the travel and of the turn while the tool presses."""
    rows = slice(max(contact.first - (contact.last - contact.first) // 20, 0), None)
    # What the tool does above the limb is of no concern: the travel there counts as none.
    depth = np.maximum(motion.travel_mm[rows], 0.0)
    travels = _strokes(recording, rows, depth, _LEAST_SHARE * float(np.ptp(depth)), "rate")
    check(recording, "strokes", travels)
    press, retract = travels[0], travels[1] if len(travels) > 1 else None
    if contact.ends_in_contact:
        check(recording, "rest", contact, motion)
    turn, twists = motion.turn_deg[contact.rows], tuple[Stroke, ...]()
    if (span := float(np.ptp(turn))) >= LEAST_TWIST_DEG:
        least = max(_LEAST_SHARE * span, LEAST_TWIST_DEG / 2.0)
        twists = _strokes(recording, contact.rows, turn, least, "rate")
    check(recording, "order", press, twists, _LEAST_DWELL_S)
    return Strokes(press=press, twists=twists, retract=retract)


def contact_instants(
    motion: ToolMotion, contact: ContactRows, strokes: Strokes, onset: Onset
) -> tuple[Transition, Transition | None]:
    """Times when the tool passes the onset on its way in, and on its way out."""
    time, travel, retract = motion.time_s, motion.travel_mm, strokes.retract
    touch = _passage(time, travel, contact.first, strokes.press.stop.time_s, onset)
    if retract is None or not np.any((time > retract.start.time_s) & (travel < onset.travel_mm)):
        return touch, None
    first = time.size - 1 - contact.last
    return touch, _passage(-time[::-1], travel[::-1], first, -retract.start.time_s, onset).mirrored()


def _passage(time: FloatArray, travel: FloatArray, first: int, until_s: float, onset: Onset) -> Transition:
    """Time when the travel passes the onset before row ``first``, sharpened by a change of speed there."""

    def last_below(level: float) -> int:
        rows = np.flatnonzero(travel[: first + 1] < level)
        return int(rows[-1]) if rows.size else 0

    margin = max(3.0 * onset.std_mm, _AT_SURFACE_MM)
    below, at = last_below(onset.travel_mm - margin), last_below(onset.travel_mm)
    above = last_below(onset.travel_mm + margin) + 1
    low, high = float(time[below]), float(time[min(above, time.size - 1)])
    reach = 0.25 * (until_s - float(time[at]))
    rows = rows_between(time, low - reach, max(high, low + reach))
    row_s = (high - low) / max(above - below, 1)
    bend = speed_change(time[rows], travel[rows], (low - 2.0 * row_s, high))
    if bend is not None and low - row_s <= bend.time_s <= high:
        return bend
    std_s = onset.std_mm * (high - low) / (2.0 * margin)
    return Transition(time_s=float(time[at]) + row_s / 2.0, std_s=std_s, kind="crossing")


def name_phases(
    time_s: FloatArray, strokes: Strokes, touch: Transition, leave: Transition | None
) -> tuple[Phase, ...]:
    """All phases, in order and without gaps, from the first time stamp to the last."""
    start, end = (Transition(time_s=float(time_s[k]), std_s=0.0, kind="cut") for k in (0, -1))
    phases = [
        Phase(name="approach", start=start, stop=touch),
        Phase(name="press", start=touch, stop=strokes.press.stop),
    ]
    n_dwells = 0
    moves = [(f"twist_{k}", twist) for k, twist in enumerate(strokes.twists, start=1)]
    moves += [(f"slide_{k}", slide) for k, slide in enumerate(strokes.slides, start=1)]
    moves.sort(key=lambda move: move[1].start.time_s)
    moves += [("retract", strokes.retract)] if strokes.retract is not None else []
    for name, stroke in moves:
        if stroke.start.time_s - phases[-1].stop.time_s > _LEAST_DWELL_S:
            n_dwells += 1
            phases.append(Phase(name=f"dwell_{n_dwells}", start=phases[-1].stop, stop=stroke.start))
        stop = stroke.stop if name != "retract" else (leave or end)
        phases.append(Phase(name=name, start=phases[-1].stop, stop=stop))
    if phases[-1].stop.time_s < end.time_s:
        name = "departure" if leave is not None else f"dwell_{n_dwells + 1}"
        phases.append(Phase(name=name, start=phases[-1].stop, stop=end))
    return tuple(phases)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slide:
    """A slide to and fro on one line."""

    along: FloatArray  # (3,), unit direction of its first stroke in the base frame, tangential
    shift_mm: FloatArray  # (n,), along it since the press ended
    strokes: tuple[Stroke, ...]


def find_slide(recording: Recording, motion: ToolMotion, strokes: Strokes, normal: FloatArray) -> Slide:
    """Slide between the press and the retract."""
    time = motion.time_s
    rows = rows_between(time, strokes.press.stop.time_s, strokes.retract_s(time))
    offset = recording.position_mm - recording.position_mm[rows.start]
    offset -= np.outer(offset @ normal, normal)
    inside = offset[rows]
    check(recording, "slide", rows.start, inside)
    farthest = inside[int(np.argmax(np.linalg.norm(inside, axis=1)))]
    along = farthest / np.linalg.norm(farthest)
    shift = inside @ along
    least = max(_LEAST_SHARE * float(np.ptp(shift)), LEAST_SLIDE_MM / 2.0)
    found = _strokes(recording, rows, shift, least, "slide rate")
    if found[0].to_value < found[0].from_value:
        along = -along
    check(recording, "slide or twist", strokes.twists, found)
    return Slide(along=along, shift_mm=offset @ along, strokes=found)
