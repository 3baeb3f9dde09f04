"""Place, direction and times of a recording's press: what is known before the wrench is clean.

Mistakes that would leave curves which look fine are refused here, named by what gives them away.
"""

from dataclasses import dataclass, replace

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate.api.mesh import SpotWrench, spot_axes
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
from palpate_robot_log.processing.strokes import Stroke
from palpate_robot_log.recording import (
    Recording,
    angle_between_deg,
    cross,
    noise_std,
    rotated,
    rows_between,
)

LARGEST_FRICTION_ANGLE_DEG = 50.0  # of the contact force to the normal; 45 where a tool sticks at friction 1
LARGEST_PATH_ANGLE_DEG = 30.0  # between a given normal and the path of the press
LARGEST_TURN_AXIS_ANGLE_DEG = 15.0  # of the twist's axis to the normal; curves are then off by 4 %
LEAST_TILT_DEG = 2.0  # tilt of the tool that any robot may have
LEAST_CORRELATION = 0.3  # of torque and rotation over a twist
DEPTHS_MM = (0.02, 300.0)  # depths that a press on a limb can have
LEAST_TORQUE_NMM = 1.0  # torque that may come and go without a twist
_OTHER = {"tool": "tissue", "tissue": "tool", "sensor": "base", "base": "sensor"}
_LESS_LIKELY_DEG = 3.0  # by which another frame has to explain the push better than the other body
_CLEARLY_ALONG_DEG = 20.0
_FREE_MARGIN_MM = 0.05
_ORIENTED_ALIKE_DEG = 2.0
_CLOSE_SHARE = 0.9
_REST_PARTS = 30
_LONGEST_GAP_ROWS = 25.0
_LONGEST_GAP_S = 0.05


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
    _check_gaps(recording, contact)
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
        _check_path(recording, contact, normal, path)
    motion = motion_about(recording, contact, normal.vector)
    _check_depth(recording, motion, contact)
    _check_direction(recording, contact, normal)
    strokes = find_strokes(recording, motion, contact)
    if strokes.twists:
        _check_turn_axis(recording, motion, strokes.twists)
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


# ------------------------------------------------------------------------------- checks


def _check_gaps(recording: Recording, contact: ContactRows) -> None:
    """Refuse a log that lacks rows while the tool presses."""
    steps = np.diff(recording.time_s[contact.rows])
    allowed = max(_LONGEST_GAP_ROWS * float(np.median(np.diff(recording.time_s))), _LONGEST_GAP_S)
    worst = int(np.argmax(steps)) if steps.size else 0
    if steps.size and steps[worst] > allowed:
        raise recording.fault(
            f"a gap of {steps[worst]:.3f} s while the tool presses (rows come every "
            f"{1.0 / recording.rate_hz:.4f} s); log the press again without dropped rows",
            contact.first + worst,
        )


def _check_depth(recording: Recording, motion: ToolMotion, contact: ContactRows) -> None:
    """Refuse a depth that no limb has, as of a position in another unit."""
    depth = float(np.ptp(motion.travel_mm[contact.rows]))
    if not DEPTHS_MM[0] <= depth <= DEPTHS_MM[1]:
        raise recording.fault(
            f"the tool travels {depth:.3g} mm while it presses, which is no depth of a limb "
            f"({DEPTHS_MM[0]:g} to {DEPTHS_MM[1]:g} mm); check the unit of the position",
            contact.first,
        )


def _check_direction(recording: Recording, contact: ContactRows, normal: Normal) -> None:
    """Refuse a contact force that does not push the tool out of the limb: another side, frame or axes."""
    force = rotated(recording.quaternion, recording.force_N)
    push = _push(force, contact)
    angle = angle_between_deg(push, normal.vector)
    if angle <= LARGEST_FRICTION_ANGLE_DEG:
        return
    is_in_sensor = recording.wrench_frame == "sensor"
    in_other_frame = recording.force_N if is_in_sensor else rotated(recording.quaternion, force)
    otherwise = angle_between_deg(_push(in_other_frame, contact), normal.vector)
    side = f'acts_on = "{_OTHER[recording.acts_on]}"'
    frame = f'wrench_frame = "{_OTHER[recording.wrench_frame]}"'
    causes = [
        (180.0 - angle, "it is the force on the other body", side),
        (otherwise + _LESS_LIKELY_DEG, "it is written in the other frame", frame),
        (
            180.0 - otherwise + 2.0 * _LESS_LIKELY_DEG,
            "it is of the other body, in the other frame",
            f"{side} and {frame}",
        ),
    ]
    off, cause, setting = min(causes)
    if angle > 180.0 - LARGEST_FRICTION_ANGLE_DEG or off <= _CLEARLY_ALONG_DEG:
        what = "pulls the tool into the limb" if angle > 90.0 else "is off the line of the press"
        raise recording.fault(
            f"the force {what} ({angle:.0f} degrees from the outward normal): {cause}; set {setting} in the "
            "channel map",
            contact.first,
        )
    middle = (contact.first + contact.last) // 2
    axes = []
    for vector in (push, normal.vector):
        inside = rotated(recording.quaternion[middle : middle + 1], vector, inverse=True)[0]
        nearest = int(np.argmax(np.abs(inside)))
        axes.append(f"{'+' if inside[nearest] > 0.0 else '-'}{'xyz'[nearest]}")
    raise recording.fault(
        f"the contact force is {angle:.0f} degrees off the normal of the path, where friction explains "
        f"{LARGEST_FRICTION_ANGLE_DEG:g} at most: axes are swapped, or the quaternion turns the other "
        f"way. In the sensor's frame the force goes along {axes[0]} and the normal along {axes[1]}; "
        "correct the column map",
        contact.first,
    )


def _push(force: FloatArray, contact: ContactRows) -> FloatArray:
    """Median force (3,) while the tool presses hardest, above the one before."""
    pressed = force[contact.rows] - force[: max(contact.first // 2, 1)].mean(axis=0)
    size = np.linalg.norm(pressed, axis=1)
    push: FloatArray = np.median(pressed[size > 0.8 * np.median(size)], axis=0)
    return push


def _check_path(recording: Recording, contact: ContactRows, normal: Normal, path: Normal) -> None:
    """Refuse a given normal (or the tool's axis) that is not the direction of the press."""
    angle = angle_between_deg(normal.vector, path.vector)
    if angle > LARGEST_PATH_ANGLE_DEG:
        raise recording.fault(
            f"the tool presses {angle:.0f} degrees off the normal that is given; correct normal.vector "
            "(outward, in the base frame), or give normal.method = 'path'",
            contact.first,
        )


def _check_turn_axis(recording: Recording, motion: ToolMotion, twists: tuple[Stroke, ...]) -> None:
    """Refuse a twist whose axis is not the normal."""
    rows = rows_between(motion.time_s, twists[0].start.time_s, twists[-1].stop.time_s)
    turned = np.abs(np.sin(np.radians(motion.turn_deg[rows]) / 2.0))
    tilt = np.radians(motion.tilt_deg[rows])
    far = turned > 0.5 * turned.max()
    angle = float(np.degrees(np.median(np.arctan2(np.tan(tilt[far] / 2.0), turned[far]))))
    if np.degrees(tilt.max()) > LEAST_TILT_DEG and angle > LARGEST_TURN_AXIS_ANGLE_DEG:
        raise recording.fault(
            f"the tool twists about an axis {angle:.0f} degrees off the normal (more than "
            f"{LARGEST_TURN_AXIS_ANGLE_DEG:g} is refused): check the order of the position's "
            "columns, and order and sense (tool to base) of the quaternion's; where the press is oblique on "
            "purpose, give normal.method = 'tool_axis'",
            rows.start,
        )


def check_torque(located: Located, wrench: SpotWrench, *, weighed: bool) -> None:
    """Refuse a tared torque that does not resist the rotation, or resists it less than another moment.

    Without a twist, one that comes and goes while the logged pose rests. ``weighed`` is whether the
    tool's weight is out; with it, tangential moments follow the rotation too.
    """
    recording, motion, strokes = located.recording, located.motion, located.strokes
    if not strokes.twists:
        end = min([strokes.retract_s(motion.time_s), *(slide.start.time_s for slide in strokes.slides)])
        rows = rows_between(motion.time_s, strokes.press.stop.time_s, end)
        torque = wrench.twisting[rows]
        if torque.size < _REST_PARTS:
            return
        means = np.array([part.mean() for part in np.array_split(torque, _REST_PARTS)])
        noise = noise_std(torque) / np.sqrt(torque.size / _REST_PARTS)
        # What relaxes goes one way; only what goes both ways needs a motion.
        there_and_back = float(np.abs(np.diff(means)).sum() - abs(means[-1] - means[0])) / 2.0
        if there_and_back > max(LEAST_TORQUE_NMM, _REST_PARTS * 3.0 * noise):
            raise recording.fault(
                f"the torque goes up and down by {there_and_back:.3g} N·mm while the tool rests in its "
                "logged pose: the orientation is stuck, or not the tool's; check channels.orientation",
                rows.start,
            )
        return
    rows = rows_between(motion.time_s, strokes.twists[0].start.time_s, strokes.twists[-1].stop.time_s)
    turn = motion.turn_deg[rows]
    likeness = _correlation(turn, wrench.twisting[rows])
    if likeness < -LEAST_CORRELATION:
        raise recording.fault(
            f"torque and rotation are out of phase (correlation {likeness:.2f}): one of them is left-handed; "
            "turn the sign of the moment about the tool's axis, or the sense of the quaternion, in the "
            "column map",
            rows.start,
        )
    answers = [abs(_correlation(turn, column)) * float(column.std()) for column in wrench.moment_Nmm[rows].T]
    others = float(np.hypot(answers[0], answers[1]))
    largest = float(np.std(recording.moment_Nmm[rows], axis=0).max())
    if largest < LEAST_TORQUE_NMM and likeness < LEAST_CORRELATION:
        raise recording.fault(
            f"no moment answers the twist ({largest:.2g} N·mm at most), so the log has none; write "
            '"0" for the three columns of the moment, and weigh the force alone',
            rows.start,
        )
    if likeness < LEAST_CORRELATION or others > (1.5 if weighed else 4.0) * answers[2]:
        raise recording.fault(
            f"the torque about the normal answers the rotation by {answers[2]:.3g} N·mm (correlation "
            f"{likeness:.2f}), tangential moments by {others:.3g} N·mm: axes of the moment are swapped, "
            "or gravity has another weight of the tool; check the order of the moment's columns",
            rows.start,
        )


def _correlation(first: FloatArray, second: FloatArray) -> float:
    spread = float(first.std() * second.std())
    return float(np.mean((first - first.mean()) * (second - second.mean()))) / spread if spread > 0.0 else 0.0
