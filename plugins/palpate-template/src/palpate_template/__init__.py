"""Gent's material: rubber whose chains cannot be stretched beyond a limit."""

from palpate import Material, Parameter, hookimpl
from palpate.interfaces import Array


class Gent(Material):
    """Ψ = −μ Jm/2 ln(1 − (Ĩ1 − 3)/Jm) + κ/2 (ln J)²; initial moduli μ and κ."""

    name = "gent"
    summary = "Gent: stiffens without bound as the first invariant nears its limit"
    parameters = (
        Parameter(name="mu", unit="MPa", lower=0.015, upper=0.1, kind="modulus", description="shear modulus"),
        Parameter(name="Jm", unit="", lower=10.0, upper=100.0, kind="shape", description="limit of I1 - 3"),
        Parameter(
            name="kappa", unit="MPa", lower=0.25, upper=2.5, kind="modulus", description="bulk modulus"
        ),
    )

    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume [MPa], (..., 3) → (...,)."""
        xp = stretches.__array_namespace__()
        mu, limit, kappa = theta
        J = xp.prod(stretches, axis=-1)
        excess = xp.sum(stretches**2, axis=-1) * J ** (-2 / 3) - 3
        return -mu * limit / 2 * xp.log1p(-excess / limit) + kappa / 2 * xp.log(J) ** 2


@hookimpl
def palpate_materials() -> list[type[Material]]:
    """Provide the material."""
    return [Gent]
