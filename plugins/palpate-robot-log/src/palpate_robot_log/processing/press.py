"""Place, direction and times of a recording's press: what is known before the wrench is clean."""

from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate.api.mesh import SpotWrench, spot_axes
from palpate_robot_log.checks import check
from palpate_robot_log.processing.change_points import Transition
from palpate_robot_log.processing.contact import (
    ContactRows,
    Normal,
    Onset,
    ToolMotion,
    described,
    find_onset,
    motion_about,
    rough_contact,
    spot_normal,
)
from palpate_robot_log.processing.corrections import Lag, estimate_lag, shifted
from palpate_robot_log.processing.phases import Strokes, contact_instants, find_strokes
from palpate_robot_log.processing.settings import NormalChoice, OnsetChoice, ProcessingSettings
from palpate_robot_log.recording import Recording, cross, rotated

_FREE_MARGIN_MM = 0.05
_ORIENTED_ALIKE_DEG = 2.0
_CLOSE_SHARE = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Located:
    """A recording, its contact, normal, motion and strokes."""

    recording: Recording
    contact: ContactRows
    normal: Normal
    motion: ToolMotion
    strokes: Strokes


def locate(recording: Recording, choice: NormalChoice, *, slides: bool = False) -> Located:
    """Contact, normal, motion and strokes, once they can be those of a press.

    Of a log that ``slides`` the path gives the normal only while the force rises.
    """
    contact = rough_contact(recording)
    check(recording, "gaps", contact)
    pressed = contact
    if slides:
        pushed = recording.force_N[contact.rows] - recording.force_N[: contact.first].mean(axis=0)
        force = np.linalg.norm(pushed, axis=1)
        close = int(np.argmax(force >= _CLOSE_SHARE * force.max()))
        pressed = replace(contact, last=contact.first + close)
    normal = path = spot_normal(recording, pressed)
    if choice.method != "path":
        given = None if choice.vector is None else np.array(choice.vector)
        normal = described(recording, pressed, given, 0.0)
        check(recording, "path", contact, normal, path)
    motion = motion_about(recording, contact, normal.vector)
    check(recording, "depth", contact, motion)
    check(recording, "direction", contact, normal)
    strokes = find_strokes(recording, motion, contact)
    check(recording, "twist", motion, strokes.twists)
    return Located(recording=recording, contact=contact, normal=normal, motion=motion, strokes=strokes)


def aligned(located: Located, settings: ProcessingSettings) -> tuple[Located, Lag]:
    """The press without the wrench's lag, the known one or the estimated one where it is significant."""
    choice = settings.alignment
    if not choice.enabled:
        return located, Lag()
    if choice.lag is not None:
        lag = Lag(seconds=choice.lag, std_s=0.0, taken_out=choice.lag != 0.0)
    else:
        recording = located.recording
        torque = -rotated(recording.quaternion, recording.moment_Nmm) @ located.normal.vector
        lag = estimate_lag(recording.time_s, torque, located.strokes.twists)
        lag = replace(lag, taken_out=lag.significant)
    if not lag.taken_out:
        return located, lag
    late = shifted(located.recording, lag.seconds)
    return locate(late, settings.normal, slides=settings.slide.enabled), lag


def wrench_at_spot(
    recording: Recording, spot_mm: FloatArray, normal: FloatArray, tip_mm: FloatArray
) -> SpotWrench:
    """Wrench rotated into the spot's frame, with its moment moved: M(c) = M(o) + (o - c) × F.

    Parameters
    ----------
    spot_mm : (3,) array
        A point of the contact axis, in the base frame; or (n, 3), one for each row.
    normal : (3,) array
        Unit outward normal in the base frame.
    tip_mm : (3,) array
        Tool tip in the sensor's frame; zero where the sensor reports about the tip.
    """
    axes = spot_axes(normal)
    force = rotated(recording.quaternion, recording.force_N)
    sensor = recording.position_mm - rotated(recording.quaternion, tip_mm)
    moment = rotated(recording.quaternion, recording.moment_Nmm) + cross(sensor - spot_mm, force)
    return SpotWrench(force_N=force @ axes, moment_Nmm=moment @ axes)


def onset_of(
    located: Located, choice: OnsetChoice, pressing_N: FloatArray | None = None
) -> tuple[Onset, Transition, Transition | None]:
    """Onset from the pressing force (n,) or at a given time stamp, and when the tool touches and leaves.

    Without ``pressing_N`` the force along the normal is that of the log.
    """
    recording, contact, motion = located.recording, located.contact, located.motion
    if choice.time is not None:
        travel = float(np.interp(choice.time, recording.time_s, motion.travel_mm))
        n_free = int(np.searchsorted(recording.time_s, choice.time))
        onset = Onset(travel_mm=travel, std_mm=0.0, spread_mm=0.0, baseline_rows=n_free)
    else:
        if pressing_N is None:
            pressing_N = rotated(recording.quaternion, recording.force_N) @ located.normal.vector
        # From where the tool comes nearer for the last time as it is oriented in contact.
        turned = ~_oriented_alike(motion)[: contact.first + 1]
        start = int(np.flatnonzero(turned).max(initial=-1)) + 1
        stop = int(np.searchsorted(recording.time_s, located.strokes.press.stop.time_s)) + 1
        onset = find_onset(recording, motion.travel_mm, pressing_N, slice(start, stop), choice.exponent)
    return onset, *contact_instants(motion, contact, located.strokes, onset)


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
        clear &= _oriented_alike(motion)
    before = np.flatnonzero(clear & (motion.time_s < touch.time_s))
    if leave is None:
        return before, np.array([], dtype=np.int64)
    return before, np.flatnonzero(clear & (motion.time_s > leave.time_s))


def _oriented_alike(motion: ToolMotion) -> np.ndarray:
    """Whether the tool is oriented in each row as when the press begins."""
    alike: np.ndarray = np.hypot(motion.turn_deg, motion.tilt_deg) < _ORIENTED_ALIKE_DEG
    return alike
