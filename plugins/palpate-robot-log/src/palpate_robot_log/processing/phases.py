"""Phases of a press: approach, press, dwell, branches of twist and slide, dwell, retract, departure."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.checks import LEAST_SLIDE_MM, LEAST_TWIST_DEG, check, errors_of
from palpate_robot_log.processing.change_points import TooFewRowsError, Transition, speed_change
from palpate_robot_log.processing.contact import ContactRows, Onset, ToolMotion
from palpate_robot_log.processing.strokes import Stroke, strokes_of
from palpate_robot_log.recording import Recording, rows_between

_LEAST_SHARE = 0.05
_LEAST_DWELL_S = 0.02
_WINDOW_SHARE = 0.25

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
    reach = _WINDOW_SHARE * (until_s - float(time[at]))
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
