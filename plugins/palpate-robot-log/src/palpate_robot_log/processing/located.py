"""Where, along what and when a recording presses: what is known before the wrench is clean."""

from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate_robot_log.processing import checks
from palpate_robot_log.processing.alignment import Lag, estimate_lag, shifted
from palpate_robot_log.processing.contact import Contact, rough_contact
from palpate_robot_log.processing.motion import Motion, motion_about
from palpate_robot_log.processing.normal import Normal, described, spot_normal, tool_axis
from palpate_robot_log.processing.onset import Onset, find_onset
from palpate_robot_log.processing.phases import Strokes, contact_instants, find_strokes
from palpate_robot_log.processing.rotation import rotated
from palpate_robot_log.processing.settings import NormalChoice, OnsetChoice, ProcessingSettings
from palpate_robot_log.processing.spot_frame import wrench_at_spot
from palpate_robot_log.processing.transitions import Transition
from palpate_robot_log.recording import Recording

_FREE_MARGIN_MM = 0.05
_ORIENTED_ALIKE_DEG = 2.0
_CLOSE_SHARE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Located:
    """A recording, its contact, normal, motion and strokes."""

    recording: Recording
    contact: Contact
    normal: Normal
    motion: Motion
    strokes: Strokes


def locate(recording: Recording, choice: NormalChoice, *, slides: bool = False) -> Located:
    """Find contact, normal, motion and strokes, and check that they can be a press.

    Of a log that ``slides`` the path gives the normal only while the force rises.

    Raises
    ------
    CurveError
        Naming what is wrong with the log.
    """
    contact = rough_contact(recording)
    checks.check_gaps(recording, contact)
    normal = _normal(recording, _rising(recording, contact) if slides else contact, choice)
    motion = motion_about(recording, contact, normal.vector)
    checks.check_depth(recording, motion, contact)
    checks.check_direction(recording, contact, normal)
    strokes = find_strokes(recording, motion, contact)
    checks.check_turn_axis(recording, motion, strokes.twists)
    return Located(recording=recording, contact=contact, normal=normal, motion=motion, strokes=strokes)


def aligned(located: Located, settings: ProcessingSettings) -> tuple[Located, Lag, bool]:
    """Take the wrench's lag out: the known one, or the estimated one where it is significant."""
    choice = settings.alignment
    if not choice.enabled:
        return located, Lag(seconds=0.0, std_s=float("inf"), n_bends=0), False
    if choice.lag is not None:
        lag = Lag(seconds=choice.lag, std_s=0.0, n_bends=0)
        taken = choice.lag != 0.0
    else:
        lag = _estimated_lag(located)
        taken = lag.significant
    if not taken:
        return located, lag, False
    recording, slides = shifted(located.recording, lag.seconds), settings.slide.enabled
    return locate(recording, settings.normal, slides=slides), lag, True


def onset_of(located: Located, pressing_N: FloatArray, choice: OnsetChoice) -> Onset:
    """Onset from the pressing force (n,), or at a given time stamp."""
    recording, motion = located.recording, located.motion
    if choice.time is not None:
        travel = float(np.interp(choice.time, recording.time_s, motion.travel_mm))
        n_free = int(np.searchsorted(recording.time_s, choice.time))
        return Onset(travel_mm=travel, std_mm=0.0, spread_mm=0.0, baseline_rows=n_free)
    # From where the tool comes nearer for the last time as it is oriented in contact.
    before = slice(located.contact.first + 1)
    turned = np.hypot(motion.turn_deg[before], motion.tilt_deg[before]) >= _ORIENTED_ALIKE_DEG
    start = int(np.flatnonzero(turned).max(initial=-1)) + 1
    stop = int(np.searchsorted(recording.time_s, located.strokes.press.stop.time_s)) + 1
    press = slice(start, stop)
    return find_onset(recording, motion.travel_mm, pressing_N, press, choice.exponent)


def raw_pressing(located: Located) -> FloatArray:
    """Force (n,) along the outward normal, as logged."""
    recording = located.recording
    along: FloatArray = rotated(recording.quaternion, recording.force_N) @ located.normal.vector
    return along


def free_rows(
    located: Located, onset: Onset, touch: Transition, leave: Transition | None, *, any_orientation: bool
) -> tuple[IntArray, IntArray]:
    """Rows in free air before and after the press.

    Without ``any_orientation`` (the weight is unknown) only those in which the tool is as it
    does when it touches.
    """
    motion = located.motion
    clear = motion.travel_mm < onset.travel_mm - max(3.0 * onset.std_mm, _FREE_MARGIN_MM)
    if not any_orientation:
        clear &= np.hypot(motion.turn_deg, motion.tilt_deg) < _ORIENTED_ALIKE_DEG
    before = np.flatnonzero(clear & (motion.time_s < touch.time_s))
    if leave is None:
        return before, np.array([], dtype=np.int64)
    return before, np.flatnonzero(clear & (motion.time_s > leave.time_s))


def instants(located: Located, onset: Onset) -> tuple[Transition, Transition | None]:
    """When the tool touches and when it leaves."""
    return contact_instants(located.motion, located.contact, located.strokes, onset)


def _rising(recording: Recording, contact: Contact) -> Contact:
    """The contact up to where its force is first close to its largest."""
    rows = slice(contact.first, contact.last + 1)
    pushed = np.linalg.norm(recording.force_N[rows] - recording.force_N[: contact.first].mean(axis=0), axis=1)
    return replace(contact, last=contact.first + int(np.argmax(pushed >= _CLOSE_SHARE * pushed.max())))


def _normal(recording: Recording, contact: Contact, choice: NormalChoice) -> Normal:
    path = spot_normal(recording, contact)
    if choice.method == "path":
        return path
    vector = -tool_axis(recording, contact) if choice.vector is None else np.array(choice.vector)
    normal = described(recording, contact, vector, 0.0)
    checks.check_path(recording, contact, normal, path)
    return normal


def _estimated_lag(located: Located) -> Lag:
    recording = located.recording
    wrench = wrench_at_spot(
        recording, located.motion.origin_mm, located.normal.vector, np.zeros(3), transport=False
    )
    return estimate_lag(recording.time_s, wrench.twisting, located.strokes.twists)
