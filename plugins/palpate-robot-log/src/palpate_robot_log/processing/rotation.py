"""Orientations over time as unit quaternions (x, y, z, w): rotate vectors, read the turn about an axis."""

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.api import FloatArray


def rotated(quaternion: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (n, 3) or (3,) of the tool's frame in the base frame, shape (n, 3)."""
    # SciPy takes no read-only arrays.
    turned: FloatArray = Rotation.from_quat(np.array(quaternion)).apply(np.array(vectors))
    return turned


def unrotated(quaternion: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (n, 3) or (3,) of the base frame in the tool's frame, shape (n, 3)."""
    turned: FloatArray = Rotation.from_quat(np.array(quaternion)).apply(np.array(vectors), inverse=True)
    return turned


def cross(left: FloatArray, right: FloatArray) -> FloatArray:
    """Cross product of (n, 3) or (3,) arrays, shape (n, 3)."""
    # Column by column: several times faster than numpy.cross on a long log.
    a, b = np.atleast_2d(left).T, np.atleast_2d(right).T
    columns = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return np.stack(columns, axis=1)


def continuous(quaternion: FloatArray) -> FloatArray:
    """The same orientations (n, 4) with signs chosen so that neighbours are close."""
    flips = np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0.0
    if not flips.any():
        return quaternion
    signs = np.where(np.cumsum(np.concatenate([[False], flips])) % 2, -1.0, 1.0)
    signed: FloatArray = quaternion * signs[:, None]
    return signed


def mean_orientation(quaternion: FloatArray) -> FloatArray:
    """Normalised mean (4,) of orientations (n, 4) that are close together."""
    mean = continuous(quaternion).mean(axis=0)
    unit: FloatArray = mean / np.linalg.norm(mean)
    return unit


def turn_and_tilt(
    quaternion: FloatArray, reference: FloatArray, axis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Turn about an axis of the base frame since a reference, and the tilt that is left over.

    The relative rotation q q₀⁻¹ is split into a turn about ``axis`` and a tilt of that axis
    (swing–twist decomposition).

    Parameters
    ----------
    quaternion : (n, 4) array
    reference : (4,) array
    axis : (3,) array
        Of length 1.

    Returns
    -------
    turn_deg : (n,) array
        Right-handed about ``axis``, without jumps of 360 degrees.
    tilt_deg : (n,) array
        0 … 180.
    """
    relative = (
        Rotation.from_quat(np.array(quaternion)) * Rotation.from_quat(np.array(reference)).inv()
    ).as_quat()
    vector, scalar = relative[:, :3], relative[:, 3]
    along = vector @ axis
    # A quaternion and its opposite are one orientation, half a turn apart on this circle.
    half = np.unwrap(np.arctan2(along, scalar), period=np.pi)
    nearest = int(np.argmax(np.abs(scalar)))
    half -= np.pi * np.round(half[nearest] / np.pi)
    across = np.linalg.norm(vector - along[:, None] * axis, axis=1)
    return np.degrees(2.0 * half), np.degrees(2.0 * np.arctan2(across, np.hypot(along, scalar)))


def angle_between_deg(first: FloatArray, second: FloatArray) -> float:
    """Angle of two vectors (3,), 0 … 180 degrees."""
    across = float(np.linalg.norm(np.cross(first, second)))
    return float(np.degrees(np.arctan2(across, float(first @ second))))
