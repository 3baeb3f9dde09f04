"""Base of nearly incompressible materials: Ψ = Ψ̃(λ̃) + κ/2 (ln J)²."""

import sys
from abc import abstractmethod

from palpate.api import IsotropicMaterial, Parameter, SettingsT
from palpate.api.mechanics import Array

POSITIVE = sys.float_info.min
"""Lower physical limit of a positive parameter."""


class Uncoupled(IsotropicMaterial[SettingsT]):
    """A material whose energy is the sum of an isochoric and a volumetric part.

    Ψ = Ψ̃(λ̃1, λ̃2, λ̃3) + κ/2 (ln J)², with λ̃ = J^(−1/3) λ. (The paper prints
    J^(1/3), a misprint.) κ is the last parameter and the initial bulk modulus.
    """

    @abstractmethod
    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Ψ̃ [MPa] of isochoric stretches (..., 3), for all parameters but κ: (...,)."""

    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume [MPa], (..., 3) → (...,)."""
        xp = stretches.__array_namespace__()
        log_J = log_volume_ratio(stretches)
        isochoric = stretches * xp.exp(log_J / -3.0)[..., None]
        return self.isochoric_energy(isochoric, theta[:-1]) + 0.5 * theta[-1] * log_J**2


# Sums of three terms in place of sums over an axis: XLA compiles these into one loop with all around them.


def total(values: Array) -> Array:
    """Sum over the three principal directions, (..., 3) → (...,)."""
    return values[..., 0] + values[..., 1] + values[..., 2]


def first_invariant(stretches: Array) -> Array:
    """I1 = λ1² + λ2² + λ3², (..., 3) → (...,)."""
    return total(stretches * stretches)


def log_volume_ratio(stretches: Array) -> Array:
    """Compute ln J = ln(λ1 λ2 λ3), (..., 3) → (...,)."""
    return stretches.__array_namespace__().log(stretches[..., 0] * stretches[..., 1] * stretches[..., 2])


def bulk_modulus(lower: float = 0.25, upper: float = 2.5) -> Parameter:
    """Parameter κ; its default range is the paper's for Ogden."""
    return Parameter(
        name="kappa",
        unit="MPa",
        lower=lower,
        upper=upper,
        kind="modulus",
        description="bulk modulus",
        physical_lower=POSITIVE,
    )


def modulus(name: str, lower: float, upper: float, description: str, least: float = POSITIVE) -> Parameter:
    """Parameter in MPa that scales with stiffness; greater than zero by default (``least``)."""
    return Parameter(
        name=name,
        unit="MPa",
        lower=lower,
        upper=upper,
        kind="modulus",
        description=description,
        physical_lower=least,
    )


def shape(name: str, lower: float, upper: float, description: str, least: float = POSITIVE) -> Parameter:
    """Dimensionless parameter; greater than zero by default (``least``)."""
    return Parameter(
        name=name,
        unit="",
        lower=lower,
        upper=upper,
        kind="shape",
        description=description,
        physical_lower=least,
    )
