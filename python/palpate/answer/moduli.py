"""Initial moduli of the materials that a run has found."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from palpate import mechanics
from palpate.domain import ParameterSpace
from palpate.domain.material import IsotropicMaterial
from palpate.errors import PalpateError
from palpate.units import convert

MODULI = ("initial shear modulus", "Young's modulus")


def every_value(
    space: ParameterSpace, row: Mapping[str, Any], factors: Mapping[str, float]
) -> dict[str, float]:
    """Values of all parameters in the units of their materials, from a row in others by these factors."""
    names = (name for name in space.names if row.get(name) is not None)
    return space.complete({name: row[name] / factors.get(name, 1.0) for name in names})


def initial_moduli(
    space: ParameterSpace, row: Mapping[str, Any], factors: Mapping[str, float], unit: str
) -> Iterator[tuple[str, float]]:
    """Initial shear and Young's modulus of each searched region by name, where its material has them.

    A material with directions has none: it is not as stiff along its fibres as across.

    Parameters
    ----------
    row : mapping
        Searched values among others, by full name; None where it differs from spot to spot.
    factors : mapping of full name to float
        From the unit of the material to the unit of the row, where they differ.
    unit : str
        Of the moduli.
    """
    per_unit, every = convert(f"1 {unit}", "MPa"), every_value(space, row, factors)
    for region in (each for each in space.regions if isinstance(each.material, IsotropicMaterial)):
        values = {p.name: every[region.name_of(p.name)] for p in region.material.parameters}
        if space.columns_of(region.region) and np.isfinite(list(values.values())).all():
            try:
                mu, kappa = mechanics.initial_moduli(region.material, region.theta(values))
            except PalpateError:
                continue
            found = (mu, 9.0 * kappa * mu / (3.0 * kappa + mu))
            yield from zip(names_of_moduli(space, region.region), (m / per_unit for m in found), strict=True)


def names_of_moduli(space: ParameterSpace, region: str) -> tuple[str, str]:
    """Names of the initial shear modulus and Young's modulus of a region; without it where there is one."""
    of = f" of {region.replace('_', ' ')}" if len(space.regions) > 1 else ""
    return f"{MODULI[0]}{of}", f"{MODULI[1]}{of}"
