"""How far force and torque are off because of the mesh: the largest of what was measured.

``benchmarks/study_mesh_size.py`` presses and twists the phantom's spot p2 on meshes of several sizes, and
``study_real_mesh.py`` spots of real limbs. Both extrapolate y(h) = y₀ + c hᵖ to h = 0. The note of every
mesh has the largest result of each channel.
"""

from typing import Any

import numpy as np

RATIOS = (0.233, 0.301, 0.409)
"""Mean edge under the sphere over its radius, of the meshes studied."""
FORCE = (
    (0.0042, 0.0075, 0.0158),  # phantom
    (0.004, 0.007, 0.013),  # forearm
    (0.0057, 0.0102, 0.0181),  # residual limb: two meshes, order 2
)
"""Largest force over its limit, less one; a row for each limb."""
TORQUE = (
    (0.0144, 0.0255, 0.0641),  # phantom
    (0.050, 0.066, 0.082),  # forearm: order 1, since none is seen
    (0.0374, 0.0665, 0.1183),  # residual limb: two meshes, order 2
)
"""Half the width of the torque's loop over its limit, less one."""
MEASURED_ON = (
    "the largest of three limbs, one spot each: forearm phantom, real forearm, residual limb; Yeoh's "
    "material, sphere of 7.5 mm pressed 10 mm deep and twisted by 22.5 degrees both ways, friction 1. At "
    "edges of 0.3 radii the torque of real limbs is off by 4 to 7 %, that of the phantom by 3 %"
)


def mesh_error(edge_mm: float, radius_mm: float, kind: str) -> dict[str, Any]:
    """What a mesh with such edges under the sphere adds to force and torque.

    Parameters
    ----------
    edge_mm, radius_mm : float
        Mean edge under the indenter, and the indenter's radius.
    kind : str
        Of the elements.

    Returns
    -------
    dict
        ``force`` and ``torque`` as shares of themselves, interpolated between the sizes studied, and what
        they were measured on; both None for sizes or elements outside of the study.
    """
    ratio = edge_mm / radius_mm
    studied = kind == "tet10" and 0.9 * RATIOS[0] <= ratio <= 1.1 * RATIOS[-1]
    return {
        "edge_over_radius": ratio,
        "force": float(np.interp(ratio, RATIOS, np.max(FORCE, axis=0))) if studied else None,
        "torque": float(np.interp(ratio, RATIOS, np.max(TORQUE, axis=0))) if studied else None,
        "measured_on": MEASURED_ON,
    }
