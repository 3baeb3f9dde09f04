"""Wrench in the spot's frame, about the contact axis: z is the outward normal."""

from dataclasses import dataclass

import numpy as np

from palpate.domain import FloatArray
from palpate_experiments.processing.rotation import cross, rotated
from palpate_experiments.recording import Recording


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotWrench:
    """Tissue on tool, in a frame at the spot whose z axis is the outward normal; arrays (n, 3)."""

    force_N: FloatArray
    moment_Nmm: FloatArray

    @property
    def pressing(self) -> FloatArray:
        """Force [N] (n,) with which the tool presses on the tissue."""
        force: FloatArray = self.force_N[:, 2]
        return force

    @property
    def twisting(self) -> FloatArray:
        """Torque [N·mm] (n,) of the tool on the tissue about the outward normal."""
        torque: FloatArray = -self.moment_Nmm[:, 2]
        return torque


def spot_axes(normal: FloatArray) -> FloatArray:
    """Rows (3, 3) are the axes of the spot's frame in the base frame.

    x is the base's x axis, or y where the normal is nearly along x, as far as it is tangential.
    """
    helper = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    along = helper - (helper @ normal) * normal
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(normal, along), normal])


def wrench_at_spot(
    recording: Recording,
    spot_mm: FloatArray,
    normal: FloatArray,
    tip_mm: FloatArray,
    *,
    transport: bool = True,
) -> SpotWrench:
    """Rotate the wrench into the spot's frame and move its moment: M(c) = M(o) + (o - c) × F.

    Parameters
    ----------
    recording : Recording
        Tared.
    spot_mm : (3,) array
        A point of the contact axis, in the base frame.
    normal : (3,) array
        Unit outward normal in the base frame.
    tip_mm : (3,) array
        Tool tip in the sensor's frame; zero where the sensor reports about the tip.
    transport : bool
        Whether to move the moment.
    """
    axes = spot_axes(normal)
    force = rotated(recording.quaternion, recording.force_N)
    moment = rotated(recording.quaternion, recording.moment_Nmm)
    if transport:
        sensor = recording.position_mm - rotated(recording.quaternion, tip_mm)
        moment = moment + cross(sensor - spot_mm, force)
    return SpotWrench(force_N=force @ axes.T, moment_Nmm=moment @ axes.T)


def unturned(recording: Recording) -> SpotWrench:
    """Wrench of a sensor whose axes are the spot's already."""
    return SpotWrench(force_N=recording.force_N, moment_Nmm=recording.moment_Nmm)
