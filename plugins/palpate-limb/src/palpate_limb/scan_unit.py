"""The unit of a surface's coordinates: given, or the only one in which it is of a limb's size."""

import numpy as np

from palpate.api import MeshError, convert
from palpate_limb.surface_checks import LIMB_MM
from palpate_limb.surfaces import Surface

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}
THICK_MM = (15.0, 260.0)
"""Diameter of a cylinder of the limb's length and volume, between a child's wrist and a thigh."""


def mm_per_unit(unit: str) -> float:
    """Millimetres of a unit, which may be a length such as "365 mm" for a normalised model.

    Raises
    ------
    ValueError
        It is none of length.
    """
    return convert(unit if unit.strip()[:1].isdigit() else f"1 {unit}", "mm")


def guessed_unit(surface: Surface) -> tuple[str, str]:
    """Unit of a closed surface of unknown scale, and why.

    Parameters
    ----------
    surface : Surface
        Its coordinates as in the file.

    Raises
    ------
    MeshError
        No unit makes it a limb, or more than one does.
    """
    long = float(np.ptp(surface.points_mm, axis=0).max())
    thick = float(np.sqrt(4.0 * abs(surface.volume_mm3) / (np.pi * max(long, 1e-300))))
    fits = [
        unit
        for unit, factor in UNITS.items()
        if LIMB_MM[0] <= long * factor <= LIMB_MM[1] and THICK_MM[0] <= thick * factor <= THICK_MM[1]
    ]
    size = f"it is {long:.4g} long and about {thick:.3g} thick"
    if len(fits) != 1:
        plausible = " and ".join(fits) or "no unit"
        raise MeshError(
            f"{surface.name}: {size}, which is a limb in {plausible}; give the unit with --unit, such as mm, "
            'or "365 mm" for a model whose unit is that long'
        )
    return fits[0], size
