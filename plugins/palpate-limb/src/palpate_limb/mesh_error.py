"""How far force and torque are off because of the mesh, as measured on the forearm phantom.

``benchmarks/study_mesh_size.py`` presses and twists the phantom's spot p2 on meshes of
several sizes and extrapolates y(h) = y₀ + c hᵖ to h = 0. Its results are here, and in the
note of every mesh. ``study_real_mesh.py`` does so on real limbs, where the torque is off by more.
"""

from typing import Any

import numpy as np

RATIOS = (0.233, 0.301, 0.409)
"""Mean edge under the sphere over its radius, of the meshes studied."""
FORCE = (0.0042, 0.0075, 0.0158)
"""Largest force over its limit, less one."""
TORQUE = (0.0144, 0.0255, 0.0641)
"""Half the width of the torque's loop over its limit, less one."""
MEASURED_ON = (
    "forearm phantom, spot p2, Yeoh's material, sphere of 7.5 mm pressed 10 mm deep and twisted by 22.5 "
    "degrees both ways, friction 1; three meshes. On a real forearm and a residual limb (one spot each) the "
    "torque of a mesh with edges of 0.3 radii is off by 4 to 7 %, the force by up to 1 %"
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
        "force": float(np.interp(ratio, RATIOS, FORCE)) if studied else None,
        "torque": float(np.interp(ratio, RATIOS, TORQUE)) if studied else None,
        "measured_on": MEASURED_ON,
    }
