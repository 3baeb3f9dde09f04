"""Excess of the force where FEBio has displacement elements, which lock in nearly incompressible tissue.

FEBio has one volume change per element for hex8 and tet10 of its uncoupled materials. Elements of coupled
materials, and all tet4, are displacement elements.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from palpate.api import FloatArray, Limb, Material
from palpate.api.mesh import contact_edge_mm
from palpate_febio.spelling import written


class Excess(NamedTuple):
    """Relative excess of the force, a (κ/μ)^p (h/R)^q: h is the edge under an indenter of radius R."""

    scale: float
    ratio_power: float
    edge_power: float

    def at(self, ratio: float, edge_over_radius: float) -> float:
        """Relative excess of the force."""
        return float(self.scale * ratio**self.ratio_power * edge_over_radius**self.edge_power)


EXCESS: Mapping[str, Excess] = MappingProxyType(
    {"hex8": Excess(0.129, 0.76, 1.67), "tet10": Excess(0.057, 0.34, 0.82), "tet4": Excess(0.165, 0.78, 1.44)}
)
"""The embedded solver without mean dilatation, against itself with it: a sphere pressed 0.4 R deep with
friction 1 into blocks of 405 to 2,601 nodes (tet10: also 1.3 R into a forearm of 1,497 nodes), κ/μ of 5 to
100, h/R of 0.27 to 1.2. The fit is within 6 % of the excess of hex8 and tet4, and within a factor of 1.7 of
the excess of tet10."""


def locking_parts(
    limb: Limb, materials: Mapping[str, Material], thetas: Mapping[str, FloatArray], radius_mm: float
) -> dict[tuple[str, str], float]:
    """Relative excess of the force by region and element kind, if the whole limb were of that part.

    Parts whose elements have one volume change each are left out.
    """
    from palpate.api.mechanics import moduli_at_rest

    mesh, found = limb.mesh, {}
    edge = contact_edge_mm(limb, radius_mm) / radius_mm
    for number, region in enumerate(mesh.regions):
        material, theta = materials[region], thetas[region]
        uncoupled = written(material, theta, "textbook").uncoupled
        shear, bulk = map(float, moduli_at_rest(material, np.asarray(theta)))
        # Below the first ratio nothing locks; above the second the excess is taken as there.
        ratio = float(np.clip(bulk / shear, 1.0, 1000.0))
        for kind in mesh.cells:
            if (kind == "tet4" or not uncoupled) and (mesh.cell_regions[kind] == number).any():
                found[region, kind] = EXCESS[kind].at(ratio, edge)
    return found
