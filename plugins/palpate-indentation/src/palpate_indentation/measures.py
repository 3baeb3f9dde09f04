"""Measures of strain and stress of homogeneous tests, and the stretch and nominal stress that they are.

With F = diag(λ, …) and no change of volume, P = σ/λ = λ S for the nominal stress P, the true stress σ and the
second Piola-Kirchhoff stress S along the stretch. Nothing changes the area under confined compression, so
P = σ there; in simple shear P₁₂ = σ₁₂, and S needs a normal stress that the test does not measure.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from palpate.api import FloatArray

Strain = Literal["stretch", "log", "green"]
Stress = Literal["nominal", "true", "pk2"]


class Measure(NamedTuple):
    """Conversion of a strain to stretch and back."""

    to_stretch: Callable[[FloatArray], FloatArray]
    from_stretch: Callable[[FloatArray], FloatArray]


STRAINS: Mapping[str, Measure] = MappingProxyType(
    {
        "stretch": Measure(np.asarray, np.asarray),
        "log": Measure(np.exp, np.log),
        "green": Measure(lambda e: np.sqrt(1.0 + 2.0 * e), lambda stretch: (stretch**2 - 1.0) / 2.0),
    }
)
"""Measures of strain by their word in the settings."""

_POWERS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        **{
            mode: {"nominal": 0.0, "true": -1.0, "pk2": 1.0}
            for mode in ("uniaxial", "equibiaxial", "pure_shear")
        },
        "confined_compression": {"nominal": 0.0, "true": 0.0, "pk2": 1.0},
        "simple_shear": {"nominal": 0.0, "true": 0.0},
    }
)
"""Power of the stretch that makes a stress nominal, by the channel of the test."""


def problem_of(channel: str, strain: Strain, stress: Stress) -> str:
    """Reason why a channel has no such measures; empty where it has."""
    powers = _POWERS.get(channel)
    if powers is None and (strain, stress) != ("stretch", "nominal"):
        key, word = ("strain", strain) if strain != "stretch" else ("stress", stress)
        return f'{key} = "{word}" is for homogeneous tests ({", ".join(_POWERS)}); remove it'
    if channel == "simple_shear" and strain != "stretch":
        return f'strain = "{strain}" is of a stretch; give the amount of shear and leave strain out'
    if powers is not None and stress not in powers:
        return (
            f'stress = "{stress}" in simple shear needs the normal stress; give true or nominal shear stress'
        )
    return ""


def nominal_factor(channel: str, stress: Stress, stretch: FloatArray) -> FloatArray:
    """Factors (n,) from a stress to the nominal one at the stretches (n,) of a channel's test."""
    power = _POWERS[channel][stress] if channel in _POWERS else 0.0
    return np.power(stretch, power) if power else np.ones_like(stretch)
