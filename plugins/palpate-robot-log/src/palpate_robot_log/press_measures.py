"""Measures of a press, its contact and its load, for the table of checks; called as measures of a log are."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter

from palpate.api import FloatArray, IntArray
from palpate_robot_log.measures import Found, found
from palpate_robot_log.recording import (
    Recording,
    angle_between_deg,
    gravity_in_sensor,
    noise_std,
    rotated,
    rows_between,
)

if TYPE_CHECKING:
    from palpate.api.mesh import SpotWrench
    from palpate_robot_log.processing.chain import Located, Processed
    from palpate_robot_log.processing.contact import ContactRows, Normal, ToolMotion
    from palpate_robot_log.processing.corrections import ToolLoad
    from palpate_robot_log.processing.strokes import Stroke

LARGEST_JUMP_SHARE = 0.3  # share of the largest change of force by which no contact jumps
LARGEST_FRICTION_ANGLE_DEG = 50.0  # of the contact force to the normal; 45 where a tool sticks at friction 1
LEAST_CORRELATION = 0.3  # of torque and rotation over a twist
LEAST_TORQUE_NMM = 1.0  # torque that may come and go without a twist
LEAST_TILT_DEG = 2.0  # tilt of the tool that any robot may have
LARGEST_LAG_S = 0.5  # a lag beyond this is no delay of a device but a mistake in a clock
STRIDES = 50  # parts of the path that give the normal
LARGEST_ACROSS = float(np.sin(np.radians(5.0)) * np.sqrt(STRIDES))  # where the normal's error is 5 degrees
_WINDOW = 5
_REST_PARTS = 30
OTHER_SIDE = {"tool": "tissue", "tissue": "tool", "sensor": "base", "base": "sensor"}
_LESS_LIKELY_DEG = 3.0  # by which another frame has to explain the push better than the other body

# -------------------------------------------------------------------------------- contact and path


def is_back(track: Recording) -> bool:
    """Whether the tool ends where it began, so that the sensor shows the same if its zero is the same."""
    position = track.position_mm
    n_ends = max(track.n_rows // 50, 3)
    begin, end = position[:n_ends].mean(axis=0), position[-n_ends:].mean(axis=0)
    farthest = float(np.linalg.norm(position - begin, axis=1).max())
    return float(np.linalg.norm(end - begin)) <= 0.05 * farthest


def jump_of_zero(track: Recording, force_N: FloatArray, least_N: float) -> Iterator[Found]:
    """Jump of the force (n, 3) in the base frame while the tip rests, as a share of the largest change.

    Jumps below ``least_N`` are noise. Where the tool comes back to its height, a jump counts by which the
    force is off there, from a tenth of the share on, as drift explains no jump.
    """
    n_rows = track.n_rows
    if n_rows < 4 * _WINDOW:
        return
    level = median_filter(force_N, size=(_WINDOW, 1), mode="nearest")
    half, before = _WINDOW // 2, np.arange(_WINDOW - 1, n_rows - _WINDOW)
    steps = np.diff(force_N, axis=0)
    trend = median_filter(steps, size=(2 * _WINDOW + 1, 1), mode="nearest")[before]
    jumps = np.linalg.norm(level[before + half + 1] - level[before - half] - _WINDOW * trend, axis=1)
    moved_mm = track.position_mm[before + _WINDOW] - track.position_mm[before - _WINDOW + 1]
    # A jump to another level, within one step.
    jumps = np.minimum(jumps, np.linalg.norm(steps[before] - trend, axis=1))
    is_still, ends_back = np.linalg.norm(moved_mm, axis=1) < 0.03, is_back(track)
    n_ends = max(n_rows // 50, _WINDOW)
    begin, end = (np.median(part, axis=0) for part in (force_N[:n_ends], force_N[-n_ends:]))
    off_N = float(np.linalg.norm(end - begin))
    at = int(np.argmin(np.abs(jumps - off_N)) if ends_back else np.argmax(jumps * is_still))
    jump_N = float(jumps[at])
    if jump_N >= least_N and (not ends_back or abs(off_N - jump_N) <= 0.2 * jump_N):
        largest = float(np.linalg.norm(force_N - begin, axis=1).max())
        yield found(
            jump_N / max(largest, 1e-300) * (10.0 if ends_back else 1.0),
            int(before[at]) + 1,
            jump_N=jump_N,
            off=f", and is {off_N:.3g} N off when the tool is back at its height" if ends_back else "",
            moves="rests" if is_still[at] else "moves",
        )


def longest_step(recording: Recording, contact: "ContactRows") -> Iterator[Found]:
    """Longest time from row to row while the tool presses, over the longest that is allowed."""
    steps = np.diff(recording.time_s[contact.rows])
    allowed = max(25.0 * float(np.median(np.diff(recording.time_s))), 0.05)
    for worst in [int(np.argmax(steps))] if steps.size else []:
        words = {"seconds": steps[worst], "usual": 1.0 / recording.rate_hz}
        yield found(float(steps[worst]) / allowed, contact.first + worst, **words)


def _push(force: FloatArray, contact: "ContactRows") -> FloatArray:
    """Median force (3,) while the tool presses hardest, above the one before."""
    pressed = force[contact.rows] - force[: max(contact.first // 2, 1)].mean(axis=0)
    size = np.linalg.norm(pressed, axis=1)
    return np.median(pressed[size > 0.8 * np.median(size)], axis=0)


def other_side_deg(recording: Recording, contact: "ContactRows", normal: "Normal") -> Iterator[Found]:
    """Angle of the contact force to the normal where another side or frame of the wrench explains it."""
    force = rotated(recording.quaternion, recording.force_N)
    angle = angle_between_deg(_push(force, contact), normal.vector)
    is_in_sensor = recording.wrench_frame == "sensor"
    in_other_frame = recording.force_N if is_in_sensor else rotated(recording.quaternion, force)
    otherwise = angle_between_deg(_push(in_other_frame, contact), normal.vector)
    side = f'acts_on = "{OTHER_SIDE[recording.acts_on]}"'
    frame = f'wrench_frame = "{OTHER_SIDE[recording.wrench_frame]}"'
    off, cause, setting = min(
        (180.0 - angle, "it is the force on the other body", side),
        (otherwise + _LESS_LIKELY_DEG, "it is written in the other frame", frame),
        (
            180.0 - otherwise + 2.0 * _LESS_LIKELY_DEG,
            "it is of the other body, in the other frame",
            f"{side} and {frame}",
        ),
    )
    if angle > 180.0 - LARGEST_FRICTION_ANGLE_DEG or off <= 20.0:
        way = "pulls the tool into the limb" if angle > 90.0 else "is off the line of the press"
        yield found(angle, contact.first, way=way, cause=cause, setting=setting)


def off_normal_deg(recording: Recording, contact: "ContactRows", normal: "Normal") -> Iterator[Found]:
    """Angle of the contact force to the normal."""
    push = _push(rotated(recording.quaternion, recording.force_N), contact)
    middle = (contact.first + contact.last) // 2
    axes = []
    for vector in (push, normal.vector):
        inside = rotated(recording.quaternion[middle : middle + 1], vector, inverse=True)[0]
        nearest = int(np.argmax(np.abs(inside)))
        axes.append(f"{'+' if inside[nearest] > 0.0 else '-'}{'xyz'[nearest]}")
    yield found(angle_between_deg(push, normal.vector), contact.first, axes=axes)


# ------------------------------------------------------------------------------- strokes and phases


def n_into_limb(_: Recording, travels: "Sequence[Stroke]") -> Iterator[Found]:
    """Count of strokes into the limb; none where the first stroke is none of them."""
    rising = [stroke for stroke in travels if stroke.to_value > stroke.from_value]
    spans = ", ".join(f"{s.start.time_s:.2f} to {s.stop.time_s:.2f} s" for s in rising) or "none"
    yield found(len(rising) if rising[:1] == [*travels[:1]] else 0, n=len(rising), spans=spans)


def is_cut(recording: Recording, travels: "Sequence[Stroke]") -> Iterator[Found]:
    """1 where the log ends amid the press."""
    yield found(int(travels[0].stop.kind == "cut"), recording.n_rows - 1)


def moved_at_end(recording: Recording, contact: "ContactRows", motion: "ToolMotion") -> Iterator[Found]:
    """Movement of the tool in the last rows over one that noise explains."""
    rows = slice(-max(20, motion.time_s.size // 200), None)
    for moves, values, unit in (("travels", motion.travel_mm, "mm"), ("twists", motion.turn_deg, "degrees")):
        time, last = motion.time_s[rows] - motion.time_s[rows].mean(), values[rows]
        slope = float(time @ last / (time @ time))
        moved = abs(slope) * float(np.ptp(time))
        noise = float(np.std(last - last.mean() - slope * time))
        allowed = max(4.0 * noise, 0.002 * float(np.ptp(values[contact.first :])), 1e-300)
        yield found(moved / allowed, recording.n_rows - 1, moves=moves, slope=slope, unit=unit)


def early_s(_: Recording, press: "Stroke", twists: "Sequence[Stroke]", dwell_s: float) -> Iterator[Found]:
    """Time [s] by which the twist begins clearly before the press ends."""
    for twist in twists[:1]:
        begin_s, end_s = twist.start.time_s, press.stop.time_s
        margin_s = max(3.0 * press.stop.std_s, dwell_s)
        yield found(end_s - margin_s - begin_s, begin_s=begin_s, end_s=end_s)


def turn_axis_deg(_: Recording, motion: "ToolMotion", twists: "Sequence[Stroke]") -> Iterator[Found]:
    """Angle of the axis of a twist to the normal, where the tool tilts more than any robot may."""
    if not twists:
        return
    rows = rows_between(motion.time_s, twists[0].start.time_s, twists[-1].stop.time_s)
    turned = np.abs(np.sin(np.radians(motion.turn_deg[rows]) / 2.0))
    tilt = np.radians(motion.tilt_deg[rows])
    far = turned > 0.5 * turned.max()
    angle = float(np.degrees(np.median(np.arctan2(np.tan(tilt[far] / 2.0), turned[far]))))
    if np.degrees(tilt.max()) > LEAST_TILT_DEG:
        yield found(angle, rows.start)


def largest_shift_mm(_: Recording, first: int, inside: FloatArray) -> Iterator[Found]:
    """Largest tangential shift (n, 3) from a first row on."""
    yield found(float(np.linalg.norm(inside, axis=1).max(initial=0.0)), first)


def off_line(_: Recording, first: int, inside: FloatArray) -> Iterator[Found]:
    """Distance of a slide (n, 3) from its line over its length."""
    sizes = np.linalg.norm(inside, axis=1)
    farthest = int(np.argmax(sizes))
    along, length = inside[farthest] / sizes[farthest], float(sizes[farthest])
    lateral = float(np.linalg.norm(inside - np.outer(inside @ along, along), axis=1).max())
    yield found(lateral / length, first + farthest, lateral=lateral, length=length)


def n_both(_: Recording, twists: "Sequence[Stroke]", slides: "Sequence[Stroke]") -> Iterator[Found]:
    """Count of slides during each twist."""
    for twist in twists:
        begin_s, end_s = twist.start.time_s, twist.stop.time_s
        n_slides = sum(one.start.time_s < end_s and begin_s < one.stop.time_s for one in slides)
        yield found(n_slides, begin_s=begin_s)


# --------------------------------------------------------------------------- weight, drift and torque


def weight_over_shown(recording: Recording, tool: "ToolLoad", free: IntArray) -> Iterator[Found]:
    """Weight over all that the sensor shows: a larger bias could hide any weight."""
    shown = float(np.linalg.norm(recording.force_N[free].mean(axis=0)))
    span = float(np.ptp(recording.force_N, axis=0).max())
    weight = tool.weight_N
    yield found(weight / max(shown + span, 1e-300), int(free[0]), shown=shown, weight=weight)


def correlation(first: FloatArray, second: FloatArray) -> float:
    """Correlation of two signals; 0 where one of them is constant."""
    spread = float(first.std() * second.std())
    return float(np.mean((first - first.mean()) * (second - second.mean()))) / spread if spread > 0.0 else 0.0


def _twists(located: "Located", wrench: "SpotWrench") -> Iterator[tuple[slice, FloatArray, float]]:
    """Rows from the first twist to the last, their turn, and its correlation with the torque."""
    if twists := located.strokes.twists:
        rows = rows_between(located.motion.time_s, twists[0].start.time_s, twists[-1].stop.time_s)
        turn = located.motion.turn_deg[rows]
        yield rows, turn, correlation(turn, wrench.twisting[rows])


def torque_at_rest(_: Recording, located: "Located", wrench: "SpotWrench", weighed: bool) -> Iterator[Found]:
    """Torque that comes and goes while the logged pose rests, over one that may."""
    motion, strokes = located.motion, located.strokes
    end = min([strokes.retract_s(motion.time_s), *(slide.start.time_s for slide in strokes.slides)])
    rows = rows_between(motion.time_s, strokes.press.stop.time_s, end)
    torque = wrench.twisting[rows]
    if strokes.twists or torque.size < _REST_PARTS:
        return
    means = np.array([part.mean() for part in np.array_split(torque, _REST_PARTS)])
    noise = noise_std(torque) / np.sqrt(torque.size / _REST_PARTS)
    # What relaxes goes one way; only what goes both ways needs a motion.
    there_and_back = float(np.abs(np.diff(means)).sum() - abs(means[-1] - means[0])) / 2.0
    yield found(
        there_and_back / max(LEAST_TORQUE_NMM, _REST_PARTS * 3.0 * noise), rows.start, torque=there_and_back
    )


def likeness(_: Recording, located: "Located", wrench: "SpotWrench", *__: bool) -> Iterator[Found]:
    """Correlation of torque and rotation over a twist."""
    for rows, _turn, alike in _twists(located, wrench):
        yield found(alike, rows.start)


def silent_moment(log: Recording, located: "Located", wrench: "SpotWrench", *__: bool) -> Iterator[Found]:
    """1 where no axis of the moment answers a twist."""
    for rows, _turn, alike in _twists(located, wrench):
        largest = float(np.std(log.moment_Nmm[rows], axis=0).max())
        is_silent = largest < LEAST_TORQUE_NMM and alike < LEAST_CORRELATION
        yield found(int(is_silent), rows.start, largest=largest)


def other_moments(_: Recording, located: "Located", wrench: "SpotWrench", weighed: bool) -> Iterator[Found]:
    """Answer of tangential moments to a twist over the largest that the torque about the normal allows.

    Once the tool's weight is out (``weighed``) they follow the rotation less.
    """
    for rows, turn, alike in _twists(located, wrench):
        moments = wrench.moment_Nmm[rows].T
        *across, torque = (abs(correlation(turn, column)) * float(column.std()) for column in moments)
        others = float(np.linalg.norm(across))
        allowed = (1.5 if weighed else 4.0) * torque if alike >= LEAST_CORRELATION else 0.0
        value = others / allowed if allowed > 0.0 else np.inf
        yield found(value, rows.start, torque=torque, likeness=alike, others=others)


def _peak(press: "Processed") -> float:
    return float(np.abs(press.curves["force"].ordinate).max())


def drift_share(recording: Recording, press: "Processed") -> Iterator[Found]:
    """Drift over the log as a share of the peak force: its departure from a straight line matters."""
    if press.cleaned.drift is not None:
        change_N = float(np.linalg.norm(press.cleaned.drift.force_N_per_s)) * float(np.ptp(recording.time_s))
        yield found(change_N / _peak(press), change_N=change_N)


def weight_share(recording: Recording, press: "Processed") -> Iterator[Found]:
    """Force that may be a weight times the tool's tilt, as a share of the peak force."""
    gravity, peak_N = press.settings.gravity, _peak(press)
    if gravity.method != "off" or press.cleaned.bias is None:
        return
    down = gravity_in_sensor(recording, np.array(gravity.direction))
    change = float(np.linalg.norm(down - down[0], axis=1).max())
    offset_N = float(np.linalg.norm(press.cleaned.bias.force_N))
    tilt_deg = np.degrees(2.0 * np.arcsin(min(change / 2.0, 1.0)))
    words = {"offset_share": offset_N / peak_N, "left_N": offset_N * change, "tilt_deg": tilt_deg}
    yield found(offset_N * change / peak_N, offset_N=offset_N, **words)
