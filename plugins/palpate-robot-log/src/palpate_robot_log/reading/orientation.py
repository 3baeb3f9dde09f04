"""Orientations in the forms that robots log, as unit quaternions x y z w."""

import numpy as np

from palpate.domain import FloatArray


def quaternions(form: str, values: FloatArray, sequence: str = "xyz") -> FloatArray:
    """Unit quaternions of orientations in another form.

    Parameters
    ----------
    form : {"quaternion", "euler", "axis_angle", "rotation_matrix"}
    values : (n, k) array
        Angles in radians; quaternions of about unit length.
    sequence : str
        Axes of Euler angles, small letters about fixed axes.

    Returns
    -------
    (n, 4) array
    """
    if form == "quaternion":
        unit: FloatArray = values / np.sqrt(np.einsum("ij,ij->i", values, values))[:, None]
        return unit
    from scipy.spatial.transform import Rotation

    if form == "euler":
        return _quat(Rotation.from_euler(sequence, values))
    if form == "axis_angle":
        return _quat(Rotation.from_rotvec(values))
    return _quat(Rotation.from_matrix(values.reshape(-1, 3, 3)))


def _quat(rotation: object) -> FloatArray:
    values: FloatArray = rotation.as_quat()  # type: ignore[attr-defined]
    return values


def conjugate(q: FloatArray) -> FloatArray:
    """Inverse turns of unit quaternions (n, 4)."""
    turned: FloatArray = q * np.array([-1.0, -1.0, -1.0, 1.0])
    return turned


def product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternions of the turns ``q`` followed by ``p``, both (n, 4) or (4,)."""
    u, v = p[..., :3], q[..., :3]
    a, b = p[..., 3:], q[..., 3:]
    vector = a * v + b * u + np.cross(u, v)
    scalar = a * b - np.sum(u * v, axis=-1, keepdims=True)
    together: FloatArray = np.concatenate([vector, scalar], axis=-1)
    return together


def turned(q: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (n, 3) or (3,) turned by unit quaternions (n, 4): v + 2 w (u × v) + 2 u × (u × v)."""
    u, w = q[:, :3], q[:, 3:]
    once = 2.0 * np.cross(u, np.broadcast_to(vectors, u.shape))
    result: FloatArray = vectors + w * once + np.cross(u, once)
    return result


def slerp(times: FloatArray, q: FloatArray, at: FloatArray) -> FloatArray:
    """Interpolate orientations at constant angular speed between neighbours (Shoemake 1985).

    Parameters
    ----------
    times : (n,) array
        Strictly increasing.
    q : (n, 4) array
        Unit quaternions; q and -q are the same turn.
    at : (m,) array
        Between the first and the last of ``times``.

    Returns
    -------
    (m, 4) array
    """
    index = np.clip(np.searchsorted(times, at, side="right") - 1, 0, times.size - 2)
    share = ((at - times[index]) / (times[index + 1] - times[index]))[:, None]
    begin, end = q[index], q[index + 1]
    cosine = np.einsum("ij,ij->i", begin, end)[:, None]
    end = np.where(cosine < 0.0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    sine = np.sin(angle)
    near = sine < 1e-6
    safe = np.where(near, 1.0, sine)
    first = np.where(near, 1.0 - share, np.sin((1.0 - share) * angle) / safe)
    second = np.where(near, share, np.sin(share * angle) / safe)
    mixed = first * begin + second * end
    result: FloatArray = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
    return result
