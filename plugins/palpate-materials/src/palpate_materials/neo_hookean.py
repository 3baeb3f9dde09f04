"""Coupled neo-Hookean material."""

import math

from palpate.api import FloatArray, IsotropicMaterial, Parameter
from palpate.api.mechanics import Array, EnergyForm
from palpate_materials.uncoupled import first_invariant, log_volume_ratio, modulus


class NeoHookean(IsotropicMaterial):
    """Neo-Hookean, coupled.

    Ψ = μ/2 (I1 − 3) − μ ln J + λ/2 (ln J)², with μ = E / (2(1 + ν)) and
    λ = E ν / ((1 + ν)(1 − 2ν))

    Initial shear modulus μ, bulk modulus λ + 2μ/3. The ranges are the paper's.

    >>> import numpy as np
    >>> float(NeoHookean().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), np.array([0.0735, 0.4434])).round(6))
    0.025461
    """

    name = "neo_hookean"
    summary = "neo-Hookean, coupled: Young's modulus and Poisson's ratio"
    parameters = (
        modulus("E", 1e-3, 1.0, "initial Young's modulus"),
        Parameter(
            name="nu",
            unit="",
            lower=0.40,
            upper=0.49,
            kind="shape",
            description="initial Poisson's ratio",
            physical_lower=math.nextafter(-1.0, 0.0),
            physical_upper=math.nextafter(0.5, 0.0),
        ),
    )

    def energy(self, stretches: Array, theta: Array) -> Array:
        """Strain energy per reference volume [MPa], (..., 3) → (...,)."""
        young, poisson = theta[0], theta[1]
        mu = young / (2.0 * (1.0 + poisson))
        lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        log_J = log_volume_ratio(stretches)
        return 0.5 * mu * (first_invariant(stretches) - 3.0) - mu * log_J + 0.5 * lame * log_J**2

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs: coupled, with c_1 = μ/2."""
        young, poisson = map(float, theta)
        mu = young / (2.0 * (1.0 + poisson))
        return EnergyForm(
            powers=(0.5 * mu,), bulk_MPa=young / (3.0 * (1.0 - 2.0 * poisson)), volume="coupled"
        )
