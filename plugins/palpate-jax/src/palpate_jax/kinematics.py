"""Poses of the rigid indenter, and the loads that do work as they change.

A position is six numbers, as the columns of :data:`palpate.api.experiment.POSE` [mm, degrees]: depth,
two shifts, the rotation vector of the axis from the normal, and the rotation about that axis. The loads
are the columns of ``WRENCH``, of the indenter on the tissue, with moments about the indenter's origin.
"""

import numpy as np

from palpate.api import FloatArray
from palpate_jax.contact import Answer, Motion, Pose

REST = np.zeros(6)


def tip_at(position: FloatArray) -> FloatArray:
    """Origin of the indenter (3,) [mm] at a position (6,)."""
    return np.array([position[1], position[2], -position[0]])


def pose(position: FloatArray) -> Pose:
    """The indenter at a position (6,)."""
    angle = np.deg2rad(position[5])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    if position[3:5].any():
        turn = _tilt(position) @ turn
    return Pose(tip_at(position), turn)


def motion(position: FloatArray, way: FloatArray) -> Motion:
    """The indenter's velocity at a position (6,) that changes by ``way`` (6,)."""
    spin = np.array([0.0, 0.0, np.deg2rad(way[5])])
    if position[3:5].any() or way[3:5].any():
        vector = np.deg2rad([*position[3:5], 0.0])
        spin = _tilt(position) @ spin + _spin_per_vector(vector) @ np.deg2rad([*way[3:5], 0.0])
    return Motion(tip_at(way), spin)


def _tilt(position: FloatArray) -> FloatArray:
    """Rotation (3, 3) that tilts the axis: the exponential of a cross product."""
    vector = np.deg2rad([*position[3:5], 0.0])
    return np.asarray(np.eye(3) + _cross(vector) @ _spin_per_vector(vector))


def _spin_per_vector(vector: FloatArray) -> FloatArray:
    """Spin (3, 3) per rate of a rotation vector: the left Jacobian of rotations."""
    angle, cross = float(np.linalg.norm(vector)), _cross(vector)
    # 1 - cos and angle - sin by series where they would cancel.
    first = 0.5 - angle**2 / 24.0 if angle < 1e-3 else (1.0 - np.cos(angle)) / angle**2
    second = 1.0 / 6.0 - angle**2 / 120.0 if angle < 1e-3 else (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def _cross(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def wrench(answer: Answer, tip: FloatArray) -> FloatArray:
    """Loads (6,) of the indenter on the tissue."""
    moment = answer.moment_Nmm + np.cross(tip, answer.force_N)
    return np.array([answer.force_N[2], -answer.force_N[0], -answer.force_N[1], *moment])


def wrench_rates(
    force_N: FloatArray, moment_Nmm: FloatArray, answer: Answer, tip: FloatArray, way: FloatArray
) -> FloatArray:
    """Change of the loads (..., 6) for those of force and moment (..., 3) and of the position (..., 6)."""
    tips = np.stack([way[..., 1], way[..., 2], -way[..., 0]], axis=-1)
    moment = moment_Nmm + np.cross(tip, force_N) + np.cross(tips, answer.force_N)
    return np.concatenate([force_N[..., 2:], -force_N[..., :2], moment], axis=-1)
