"""Outward normal of the spot, from the path on which the tool pressed."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.contact import Contact
from palpate_robot_log.processing.rotation import angle_between_deg, mean_orientation, rotated
from palpate_robot_log.recording import Recording

_LARGEST_STD_DEG = 5.0
_STRIDES = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Normal:
    """Unit outward normal (3,) in the base frame, its standard deviation, and the tool's axis to it."""

    vector: FloatArray
    std_deg: float
    to_tool_axis_deg: float


def spot_normal(recording: Recording, contact: Contact) -> Normal:
    """Direction opposite to the one in which the tool moved while the force rose.

    The principal direction of the displacements over strides of the contact; a dwell adds no
    displacement and so has no effect.

    Raises
    ------
    CurveError
        The tool does not move along a line while it presses.
    """
    rows = slice(contact.first, contact.last + 1)
    position = recording.position_mm[rows]
    stride = max(1, position.shape[0] // _STRIDES)
    steps = position[stride:] - position[:-stride]
    _, lengths, directions = np.linalg.svd(steps[:: max(1, stride // 4)], full_matrices=False)
    if not lengths[0] > 0.0:
        raise recording.fault("the tool never moves while the force changes; check the position columns")
    across = float(np.hypot(*lengths[1:]) / lengths[0])
    std_deg = float(np.degrees(across / np.sqrt(_STRIDES)))
    if across > np.sin(np.radians(_LARGEST_STD_DEG)) * np.sqrt(_STRIDES):
        raise recording.fault(
            f"the tool leaves its line by {across:.0%} of its travel while it presses, so the path gives no "
            "normal; check the position columns, or give slide.enabled if it slides after the press",
            contact.first,
        )
    inward = directions[0] * _sense(recording, rows, directions[0])
    return described(recording, contact, -inward, std_deg)


def described(recording: Recording, contact: Contact, vector: FloatArray, std_deg: float) -> Normal:
    """A normal (3,) scaled to length 1, with the angle from the tool's axis to it."""
    unit = vector / np.linalg.norm(vector)
    return Normal(
        vector=unit,
        std_deg=std_deg,
        to_tool_axis_deg=angle_between_deg(tool_axis(recording, contact), -unit),
    )


def tool_axis(recording: Recording, contact: Contact) -> FloatArray:
    """Mean direction (3,) of the sensor's z axis over the press, in the base frame."""
    rows = slice(contact.first, contact.last + 1)
    orientation = mean_orientation(recording.quaternion[rows])
    axis: FloatArray = rotated(orientation[None, :], np.array([0.0, 0.0, 1.0]))[0]
    return axis


def _sense(recording: Recording, rows: slice, direction: FloatArray) -> float:
    """+1 where the tool moves along ``direction`` as the force grows, else -1."""
    before = max(rows.start // 4, 1)
    start = recording.position_mm[rows.start]
    travel = (recording.position_mm[rows] - start) @ direction
    force = rotated(recording.quaternion[rows], recording.force_N[rows])
    rest = rotated(recording.quaternion[:before], recording.force_N[:before]).mean(axis=0)
    change = np.linalg.norm(force - rest, axis=1)
    return 1.0 if float(travel @ (change - change[0])) >= 0.0 else -1.0
