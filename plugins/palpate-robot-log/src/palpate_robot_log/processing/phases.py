"""Phases of a press: approach, press, dwell, branches of twist and slide, dwell, retract, departure."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.contact import Contact
from palpate_robot_log.processing.motion import Motion
from palpate_robot_log.processing.onset import Onset
from palpate_robot_log.processing.strokes import Stroke, strokes_of
from palpate_robot_log.processing.transitions import TooFewRowsError, Transition, speed_change
from palpate_robot_log.recording import Recording, rows_between

LEAST_TWIST_DEG = 1.0
"""Turns smaller than this are no twist."""

_LEAST_SHARE = 0.05
_LEAST_DWELL_S = 0.02
_WINDOW_SHARE = 0.25

_LAST_ROWS = 20
_AT_REST_SHARE = 0.002

_AT_SURFACE_MM = 0.1
"""A change of speed so near the onset is where the press was meant to begin."""


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


def _strokes(
    recording: Recording, time_s: FloatArray, values: FloatArray, least: float
) -> tuple[Stroke, ...]:
    try:
        return strokes_of(time_s, values, least)
    except TooFewRowsError:
        raise recording.fault(
            f"too few rows where the tool starts or stops in contact ({recording.n_rows} in all, "
            f"{recording.rate_hz:.3g} Hz); log the press at a higher rate, with its rests, and check that "
            "the force is logged throughout"
        ) from None


def find_strokes(recording: Recording, motion: Motion, contact: Contact) -> Strokes:
    """Strokes of the travel and of the turn while the tool presses.

    Raises
    ------
    CurveError
        The press is not one stroke in and out, the log stops while the tool moves in contact,
        or the twist begins before the press has ended.
    """
    rows = slice(max(contact.first - (contact.last - contact.first) // 20, 0), None)
    # What the tool does above the limb is of no concern: the travel there counts as none.
    depth = np.maximum(motion.travel_mm[rows], 0.0)
    travels = _strokes(recording, motion.time_s[rows], depth, _LEAST_SHARE * float(np.ptp(depth)))
    rising = [stroke for stroke in travels if stroke.to_value > stroke.from_value]
    if len(rising) != 1 or travels[0] is not rising[0]:
        spans = ", ".join(f"{s.start.time_s:.2f} to {s.stop.time_s:.2f} s" for s in rising) or "none"
        raise recording.fault(
            f"{len(rising)} strokes into the limb in one contact ({spans}) where a press is one; give "
            "window.start and window.stop of one press"
        )
    press, retract = travels[0], travels[1] if len(travels) > 1 else None
    if press.stop.kind == "cut":
        raise recording.fault(
            "the log stops half-way: the tool still presses deeper at its end; log the whole press",
            recording.n_rows - 1,
        )
    _check_at_rest(recording, motion, contact)
    twists = _twists(recording, motion, contact)
    if twists and twists[0].start.time_s < press.stop.time_s - max(3.0 * press.stop.std_s, _LEAST_DWELL_S):
        raise recording.fault(
            f"the twist begins at {twists[0].start.time_s:.3f} s, before the press ends at "
            f"{press.stop.time_s:.3f} s; press first and twist then"
        )
    return Strokes(press=press, twists=twists, retract=retract)


def contact_instants(
    motion: Motion, contact: Contact, strokes: Strokes, onset: Onset
) -> tuple[Transition, Transition | None]:
    """When the tool passes the onset on its way in, and on its way out."""
    touch = _passage(motion.time_s, motion.travel_mm, contact.first, strokes.press.stop.time_s, onset)
    retract = strokes.retract
    if retract is None:
        return touch, None
    beyond = np.flatnonzero((motion.time_s > retract.start.time_s) & (motion.travel_mm < onset.travel_mm))
    if beyond.size == 0:
        return touch, None
    last = motion.time_s.size - 1
    mirrored = _passage(
        -motion.time_s[::-1], motion.travel_mm[::-1], last - contact.last, -retract.start.time_s, onset
    )
    return touch, Transition(time_s=-mirrored.time_s, std_s=mirrored.std_s, kind=mirrored.kind)


def name_phases(
    time_s: FloatArray, strokes: Strokes, touch: Transition, leave: Transition | None
) -> tuple[Phase, ...]:
    """All phases, in order and without gaps, from the first time stamp to the last."""
    start = Transition(time_s=float(time_s[0]), std_s=0.0, kind="cut")
    end = Transition(time_s=float(time_s[-1]), std_s=0.0, kind="cut")
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


def _twists(recording: Recording, motion: Motion, contact: Contact) -> tuple[Stroke, ...]:
    rows = slice(contact.first, contact.last + 1)
    turn = motion.turn_deg[rows]
    span = float(np.ptp(turn))
    if span < LEAST_TWIST_DEG:
        return ()
    return _strokes(recording, motion.time_s[rows], turn, max(_LEAST_SHARE * span, LEAST_TWIST_DEG / 2.0))


def _check_at_rest(recording: Recording, motion: Motion, contact: Contact) -> None:
    """Refuse a log that ends in contact while the tool moves."""
    if not contact.ends_in_contact:
        return
    rows = slice(-max(_LAST_ROWS, motion.time_s.size // 200), None)
    for name, values, unit in (("travels", motion.travel_mm, "mm"), ("twists", motion.turn_deg, "degrees")):
        time, last = motion.time_s[rows] - motion.time_s[rows].mean(), values[rows]
        slope = float(time @ last / (time @ time))
        moved = abs(slope) * float(np.ptp(time))
        noise = float(np.std(last - last.mean() - slope * time))
        if moved > max(4.0 * noise, _AT_REST_SHARE * float(np.ptp(values[contact.first :]))):
            raise recording.fault(
                f"the log stops half-way: at its end the tool still {name} at {slope:.3g} {unit}/s and "
                f"presses; log until the tool is clear of the limb",
                recording.n_rows - 1,
            )


def _passage(time: FloatArray, travel: FloatArray, first: int, until_s: float, onset: Onset) -> Transition:
    """When the travel passes the onset before row ``first``, sharpened by a change of speed there."""
    margin = max(3.0 * onset.std_mm, _AT_SURFACE_MM)
    below = _last_below(travel, first, onset.travel_mm - margin)
    above = _last_below(travel, first, onset.travel_mm + margin) + 1
    at = _last_below(travel, first, onset.travel_mm)
    low, high = float(time[below]), float(time[min(above, time.size - 1)])
    moving = until_s - float(time[at])
    reach = _WINDOW_SHARE * moving
    rows = rows_between(time, low - reach, max(high, low + reach))
    row_s = (high - low) / max(above - below, 1)
    bend = speed_change(time[rows], travel[rows], (low - 2.0 * row_s, high))
    if bend is not None and low - row_s <= bend.time_s <= high:
        return bend
    std_s = onset.std_mm * (high - low) / (2.0 * margin)
    return Transition(time_s=float(time[at]) + row_s / 2.0, std_s=std_s, kind="crossing")


def _last_below(travel: FloatArray, first: int, level: float) -> int:
    rows = np.flatnonzero(travel[: first + 1] < level)
    return int(rows[-1]) if rows.size else 0
