"""Physical checks: mistakes that leave curves which look fine, named by what gives them away.

Each check raises a CurveError that says what is wrong and what to change.
"""

import numpy as np

from palpate.api import FloatArray
from palpate.mesh.spot_frame import SpotWrench
from palpate_robot_log.processing.contact import Contact
from palpate_robot_log.processing.motion import Motion
from palpate_robot_log.processing.noise import noise_std
from palpate_robot_log.processing.normal import Normal
from palpate_robot_log.processing.phases import Strokes
from palpate_robot_log.processing.rotation import angle_between_deg, rotated, unrotated
from palpate_robot_log.processing.strokes import Stroke
from palpate_robot_log.recording import Recording, rows_between

LARGEST_FRICTION_ANGLE_DEG = 50.0
"""Between the contact force and the normal; a tool that sticks at friction 1 reaches 45 degrees."""

LARGEST_PATH_ANGLE_DEG = 30.0
"""Between a given normal and the path of the press."""

LARGEST_TURN_AXIS_ANGLE_DEG = 15.0
"""Between the axis about which the tool twists and the normal; curves are then off by 4 %."""

LEAST_TILT_DEG = 2.0
"""Tilt of the tool that any robot may have."""

LEAST_CORRELATION = 0.3
"""Of torque and rotation over a twist."""

DEPTHS_MM = (0.02, 300.0)
"""Depths that a press on a limb can have."""

LEAST_TORQUE_NMM = 1.0
"""Torque that may come and go without a twist."""

_REST_PARTS = 30
_LONGEST_GAP_ROWS = 25.0
_LONGEST_GAP_S = 0.05


def check_gaps(recording: Recording, contact: Contact) -> None:
    """Refuse a log that lacks rows while the tool presses."""
    steps = np.diff(recording.time_s[contact.first : contact.last + 1])
    allowed = max(_LONGEST_GAP_ROWS * float(np.median(np.diff(recording.time_s))), _LONGEST_GAP_S)
    worst = int(np.argmax(steps)) if steps.size else 0
    if steps.size and steps[worst] > allowed:
        raise recording.fault(
            f"a gap of {steps[worst]:.3f} s while the tool presses (rows come every "
            f"{1.0 / recording.rate_hz:.4f} s); log the press again without dropped rows",
            contact.first + worst,
        )


def check_depth(recording: Recording, motion: Motion, contact: Contact) -> None:
    """Refuse a depth that no limb has, as of a position in another unit."""
    depth = float(np.ptp(motion.travel_mm[contact.first : contact.last + 1]))
    if not DEPTHS_MM[0] <= depth <= DEPTHS_MM[1]:
        raise recording.fault(
            f"the tool travels {depth:.3g} mm while it presses, which is no depth of a limb "
            f"({DEPTHS_MM[0]:g} to {DEPTHS_MM[1]:g} mm); check the unit of the position",
            contact.first,
        )


def check_direction(recording: Recording, contact: Contact, normal: Normal) -> None:
    """Refuse a contact force that does not push the tool out of the limb: a wrong sign, or wrong axes."""
    force = rotated(recording.quaternion, recording.force_N)
    rest = force[: max(contact.first // 2, 1)].mean(axis=0)
    pressed = force[contact.first : contact.last + 1] - rest
    size = np.linalg.norm(pressed, axis=1)
    push: FloatArray = np.median(pressed[size > 0.8 * np.median(size)], axis=0)
    angle = angle_between_deg(push, normal.vector)
    if angle > 180.0 - LARGEST_FRICTION_ANGLE_DEG:
        raise recording.fault(
            f"the force pulls the tool into the limb ({angle:.0f} degrees from the outward normal): it is "
            'that of the other body; set acts_on = "tool" in the channel map, or "tissue" where it is "tool"',
            contact.first,
        )
    if angle > LARGEST_FRICTION_ANGLE_DEG:
        middle = (contact.first + contact.last) // 2
        raise recording.fault(
            f"the contact force is {angle:.0f} degrees off the normal of the path, where friction explains "
            f"{LARGEST_FRICTION_ANGLE_DEG:g} at most: axes are swapped, or the quaternion turns the other "
            f"way. In the sensor's frame the force goes along {_axis(recording, middle, push)} and the "
            f"normal along {_axis(recording, middle, normal.vector)}; correct the column map",
            contact.first,
        )


def check_path(recording: Recording, contact: Contact, normal: Normal, path: Normal) -> None:
    """Refuse a given normal (or the tool's axis) that is not the direction of the press."""
    angle = angle_between_deg(normal.vector, path.vector)
    if angle > LARGEST_PATH_ANGLE_DEG:
        raise recording.fault(
            f"the tool presses {angle:.0f} degrees off the normal that is given; correct normal.vector "
            "(outward, in the base frame), or give normal.method = 'path'",
            contact.first,
        )


def check_turn_axis(recording: Recording, motion: Motion, twists: tuple[Stroke, ...]) -> None:
    """Refuse a twist whose axis is not the normal."""
    if not twists:
        return
    rows = _rows(motion, twists)
    turned = np.abs(np.sin(np.radians(motion.turn_deg[rows]) / 2.0))
    tilt = np.radians(motion.tilt_deg[rows])
    far = turned > 0.5 * turned.max()
    angle = float(np.degrees(np.median(np.arctan2(np.tan(tilt[far] / 2.0), turned[far]))))
    if np.degrees(tilt.max()) > LEAST_TILT_DEG and angle > LARGEST_TURN_AXIS_ANGLE_DEG:
        raise recording.fault(
            f"the tool twists about an axis {angle:.0f} degrees off the normal, and "
            f"{LARGEST_TURN_AXIS_ANGLE_DEG:g} at most is no mistake: check the order of the position's "
            "columns, and order and sense (tool to base) of the quaternion's; where the press is oblique on "
            "purpose, give normal.method = 'tool_axis'",
            rows.start,
        )


def check_torque(
    recording: Recording, motion: Motion, wrench: SpotWrench, strokes: Strokes, *, weighed: bool
) -> None:
    """Refuse a tared torque that does not resist the rotation, or resists it less than another moment.

    ``weighed`` is whether the tool's weight is out; with it, tangential moments follow the rotation too.
    """
    if not strokes.twists:
        _check_torque_at_rest(recording, motion, wrench, strokes)
        return
    rows = _rows(motion, strokes.twists)
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
    if likeness < LEAST_CORRELATION or others > (1.5 if weighed else 4.0) * answers[2]:
        raise recording.fault(
            f"the torque about the normal answers the rotation by {answers[2]:.3g} N·mm (correlation "
            f"{likeness:.2f}), tangential moments by {others:.3g} N·mm: axes of the moment are swapped, "
            "or the tool's weight is not that of gravity; check the order of the moment's columns",
            rows.start,
        )


def _check_torque_at_rest(recording: Recording, motion: Motion, wrench: SpotWrench, strokes: Strokes) -> None:
    """Refuse a torque that comes and goes while the logged pose rests."""
    end = motion.time_s[-1] if strokes.retract is None else strokes.retract.start.time_s
    end = min([end, *(slide.start.time_s for slide in strokes.slides)])
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
            "logged pose: the orientation is stuck or not that of the tool; check channels.orientation",
            rows.start,
        )


def _rows(motion: Motion, twists: tuple[Stroke, ...]) -> slice:
    return rows_between(motion.time_s, twists[0].start.time_s, twists[-1].stop.time_s)


def _correlation(first: FloatArray, second: FloatArray) -> float:
    spread = float(first.std() * second.std())
    return float(np.mean((first - first.mean()) * (second - second.mean()))) / spread if spread > 0.0 else 0.0


def _axis(recording: Recording, row: int, vector: FloatArray) -> str:
    """Name of the sensor's axis nearest to a vector (3,) of the base frame, with its sign."""
    inside = unrotated(recording.quaternion[row : row + 1], vector)[0]
    best = int(np.argmax(np.abs(inside)))
    return f"{'+' if inside[best] > 0.0 else '-'}{'xyz'[best]}"
