"""The wrench of a recording in the frame of the spot (:mod:`palpate.mesh.spot_frame`)."""

from palpate.api import FloatArray
from palpate.mesh.spot_frame import SpotWrench, spot_axes
from palpate_robot_log.processing.rotation import cross, rotated
from palpate_robot_log.processing.slides import Slide
from palpate_robot_log.recording import Recording


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
        A point of the contact axis, in the base frame; or (n, 3), one for each row.
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
    return SpotWrench(force_N=force @ axes, moment_Nmm=moment @ axes)


def lateral_force(wrench: SpotWrench, slide: Slide, normal: FloatArray) -> FloatArray:
    """Force (n,) of the tool on the tissue along a slide."""
    along: FloatArray = -wrench.force_N @ (spot_axes(normal).T @ slide.along)
    return along
