"""A slide along the skin after the press: along which line, how far, and its strokes."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.motion import Motion
from palpate_robot_log.processing.phases import Strokes
from palpate_robot_log.processing.strokes import Stroke, strokes_of
from palpate_robot_log.processing.transitions import TooFewRowsError
from palpate_robot_log.recording import Recording, rows_between

LEAST_SLIDE_MM = 0.5
"""Shifts smaller than this are no slide."""

LARGEST_CURVE = 0.1
"""Distance from a line over the length of the slide beyond which the slide is no line."""

_LEAST_SHARE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Slide:
    """A slide to and fro on one line.

    Parameters
    ----------
    along : (3,) array
        Unit direction of its first stroke in the base frame, tangential.
    shift_mm : (n,) array
        Shift along it since the press ended.
    strokes : tuple of Stroke
    """

    along: FloatArray
    shift_mm: FloatArray
    strokes: tuple[Stroke, ...]


def find_slide(recording: Recording, motion: Motion, strokes: Strokes, normal: FloatArray) -> Slide:
    """Find the slide between the press and the retract.

    Raises
    ------
    CurveError
        There is none, it is no line, or the tool twists while it slides.
    """
    time = motion.time_s
    end = time[-1] if strokes.retract is None else strokes.retract.start.time_s
    rows = rows_between(time, strokes.press.stop.time_s, end)
    offset = recording.position_mm - recording.position_mm[rows.start]
    offset -= np.outer(offset @ normal, normal)
    inside = offset[rows]
    sizes = np.linalg.norm(inside, axis=1)
    if not sizes.max(initial=0.0) >= LEAST_SLIDE_MM:
        raise recording.fault(
            f"the tool shifts by {sizes.max(initial=0.0):.2g} mm after the press, and a slide is at least "
            f"{LEAST_SLIDE_MM:g} mm; log a slide, or leave slide.enabled out",
            rows.start,
        )
    farthest = int(np.argmax(sizes))
    along = inside[farthest] / sizes[farthest]
    aside = float(np.linalg.norm(inside - np.outer(inside @ along, along), axis=1).max())
    if aside > LARGEST_CURVE * sizes[farthest]:
        raise recording.fault(
            f"the slide leaves its line by {aside:.2g} mm of {sizes[farthest]:.3g} mm; slide to and fro on "
            "one line, or give window.start and window.stop",
            rows.start + farthest,
        )
    found = _strokes(recording, time[rows], inside @ along)
    if found[0].to_value < found[0].from_value:
        along = -along
    for twist in strokes.twists:
        if any(s.start.time_s < twist.stop.time_s and twist.start.time_s < s.stop.time_s for s in found):
            raise recording.fault(
                f"the tool twists from {twist.start.time_s:.2f} s on while it slides; do one after the other"
            )
    return Slide(along=along, shift_mm=offset @ along, strokes=found)


def _strokes(recording: Recording, time: FloatArray, shift: FloatArray) -> tuple[Stroke, ...]:
    least = max(_LEAST_SHARE * float(np.ptp(shift)), LEAST_SLIDE_MM / 2.0)
    try:
        return strokes_of(time, shift, least)
    except TooFewRowsError:
        raise recording.fault(
            "too few rows where the slide starts or stops; log it at a higher rate, with its rests"
        ) from None
