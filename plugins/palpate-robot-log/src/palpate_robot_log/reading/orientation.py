"""Orientations in the forms that robots log, as unit quaternions x y z w."""

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.api import FloatArray


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
    if form == "euler":
        rotation = Rotation.from_euler(sequence, values)
    elif form == "axis_angle":
        rotation = Rotation.from_rotvec(values)
    else:
        rotation = Rotation.from_matrix(values.reshape(-1, 3, 3))
    q: FloatArray = rotation.as_quat()
    return q
