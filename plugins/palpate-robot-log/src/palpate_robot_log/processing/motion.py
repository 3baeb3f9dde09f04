"""Travel along the inward normal and turn about the outward one, from the pose."""

from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.contact import Contact
from palpate_robot_log.processing.rotation import mean_orientation, turn_and_tilt
from palpate_robot_log.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """How the tool moved about a spot; arrays of shape (n,).

    Parameters
    ----------
    time_s : array
    travel_mm : array
        Along the inward normal, from the first row that clearly presses.
    lateral_mm : array
        Distance from the line along the normal through that row's position.
    turn_deg, tilt_deg : array
        Turn about the outward normal since the press began, and what is left of the rotation.
    origin_mm : (3,) array
        Tool tip at ``travel_mm`` 0, in the base frame.
    """

    time_s: FloatArray
    travel_mm: FloatArray
    lateral_mm: FloatArray
    turn_deg: FloatArray
    tilt_deg: FloatArray
    origin_mm: FloatArray


def motion_about(recording: Recording, contact: Contact, normal: FloatArray) -> Motion:
    """Motion along and about a unit normal (3,) of the base frame."""
    origin = recording.position_mm[contact.first]
    offset = recording.position_mm - origin
    travel = -offset @ normal
    lateral = np.linalg.norm(offset + travel[:, None] * normal, axis=1)
    n_head = max((contact.last - contact.first) // 20, 1)
    head = recording.quaternion[contact.first : contact.first + n_head]
    turn, tilt = turn_and_tilt(recording.quaternion, mean_orientation(head), normal)
    return Motion(
        time_s=recording.time_s,
        travel_mm=travel,
        lateral_mm=lateral,
        turn_deg=turn,
        tilt_deg=tilt,
        origin_mm=origin,
    )
