"""Which of several readings of a log agrees with the motion: the press and the twist decide.

A twist turns the tool about the line of the press, and tissue pushes the tool back along it. A
quaternion read in another order, angles about other axes or a wrench in another frame do not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from palpate.api import CurveError, FloatArray
from palpate_robot_log.processing.press import LARGEST_TURN_AXIS_ANGLE_DEG
from palpate_robot_log.reading.assembly import assemble
from palpate_robot_log.reading.channel_map import ChannelMap
from palpate_robot_log.reading.proposal import QUANTITIES, Guess, Proposal, channel_map
from palpate_robot_log.reading.raw import RawLog
from palpate_robot_log.recording import Recording, rotated

_LEAST_TURN_DEG = 3.0
_LEAST_PRESS_MM = 0.3
_ALONG = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class _Motion:
    """Press and twist of a recording by one reading, and its push as written and in the base frame.

    ``tilt_deg`` is between twist and press, NaN where the tool hardly turns. Pushes are cosines to the press.
    """

    tilt_deg: float
    push_as_written: float
    push_turned: float


def judged(log: RawLog, proposal: Proposal) -> Proposal:
    """Proposal with the orientation, the frame and the side of the wrench that the motion agrees with.

    What it does not tell, such as without a twist, stays as the names have it.
    """
    if not {*QUANTITIES} <= {*proposal.guesses}:
        return proposal
    first = proposal.guesses["orientation"]
    readings = [replace(first, also=()), *first.also]
    motions = [_motion(log, _with_orientation(proposal, one)) for one in readings]
    tilts = {k: motion.tilt_deg for k, motion in enumerate(motions) if motion is not None}
    fitting = [k for k, tilt_deg in tilts.items() if tilt_deg <= LARGEST_TURN_AXIS_ANGLE_DEG]
    # Of two that fit alike the likelier one is taken.
    best = min(fitting, key=lambda k: (round(tilts[k] / 5.0), k), default=0)
    others = tuple(one for k, one in enumerate(readings) if k != best)
    reason = "the order and the axes of the orientation: those are taken about which the tool twists"
    if first.also and not fitting:
        reason = "the order and the axes of the orientation: no twist tells"
    to_check = (*first.to_check, reason) if first.also else first.to_check
    chosen = _with_orientation(proposal, replace(readings[best], also=others, to_check=to_check))
    return chosen if (motion := motions[best]) is None else _with_side(chosen, motion)


def _with_orientation(proposal: Proposal, orientation: Guess) -> Proposal:
    return replace(proposal, guesses={**proposal.guesses, "orientation": orientation})


def _with_side(proposal: Proposal, motion: _Motion) -> Proposal:
    pushes: Mapping[str, float] = {"sensor": motion.push_turned, "base": motion.push_as_written}
    frames = sorted(pushes, key=lambda frame: frame != proposal.wrench_frame)
    frame = next((name for name in frames if abs(pushes[name]) >= _ALONG), None)
    if frame is None:
        return proposal
    is_alone = min(map(abs, pushes.values())) < _ALONG
    how = "the push is along the press in this frame alone" if is_alone else "the names, or no name, say so"
    return replace(
        proposal,
        wrench_frame=frame,
        acts_on="tool" if pushes[frame] < 0.0 else "tissue",
        wrench_reason=f"whose wrench it is (by its direction against the press) and its frame ({how})",
    )


def _motion(log: RawLog, proposal: Proposal) -> _Motion | None:
    """Motion by this reading; None where it cannot be read, or has no press."""
    neutral = channel_map(replace(proposal, acts_on="tool", wrench_frame="sensor"))
    try:
        recording = assemble(log, ChannelMap.model_validate(neutral)).recording
    except (CurveError, ValidationError):
        return None
    air = np.median(recording.force_N[: max(recording.n_rows // 100, 5)], axis=0)
    push = np.linalg.norm(recording.force_N - air, axis=1)
    loaded = int(np.argmax(push >= 0.9 * push.max()))
    before = np.flatnonzero(push[:loaded] <= 0.1 * push.max())
    free = int(before[-1]) if before.size else 0
    press = recording.position_mm[loaded] - recording.position_mm[free]
    if (length := float(np.linalg.norm(press))) < _LEAST_PRESS_MM:
        return None
    press = press / length
    force = np.mean(recording.force_N[loaded : loaded + 5], axis=0) - air
    force = force / np.linalg.norm(force)
    turned = rotated(recording.quaternion[[loaded]], force)[0]
    return _Motion(
        tilt_deg=_tilt_deg(recording, loaded, press),
        push_as_written=float(force @ press),
        push_turned=float(turned @ press),
    )


def _tilt_deg(recording: Recording, loaded: int, press: FloatArray) -> float:
    """Angle [deg] between the largest turn under the press and the line of the press."""
    pose = Rotation.from_quat(recording.quaternion[loaded:])
    turns = (pose * pose[0].inv()).as_rotvec(degrees=True)
    sizes = np.linalg.norm(turns, axis=1)
    largest = int(np.argmax(sizes))
    if sizes[largest] < _LEAST_TURN_DEG:
        return float("nan")
    return float(np.degrees(np.arccos(min(abs(turns[largest] @ press) / sizes[largest], 1.0))))
