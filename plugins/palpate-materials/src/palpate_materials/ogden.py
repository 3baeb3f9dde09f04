"""Ogden material."""

import numpy as np
from pydantic import Field

from palpate.api import FloatArray, MaterialError, Settings
from palpate.api.mechanics import Array, EnergyForm
from palpate_materials.uncoupled import POSITIVE, Uncoupled, bulk_modulus, modulus, shape, total


class OgdenSettings(Settings):
    """Settings of :class:`Ogden`."""

    terms: int = Field(default=1, ge=1, le=6, description="Number of terms; the paper uses one.")


class Ogden(Uncoupled[OgdenSettings]):
    """Ogden, uncoupled, with n terms.

    Ψ = Σ_k c_k/m_k² (λ̃1^m_k + λ̃2^m_k + λ̃3^m_k − 3) + κ/2 (ln J)²

    Initial shear modulus Σ c_k / 2, bulk modulus κ. The ranges of the first term
    and of κ are the paper's region of interest; further terms take the same
    ranges, the even ones with negative exponents, which act in compression.
    A term written μ_k/α_k Σ(λ^α_k − 1), as in Ogden 1972, has m_k = α_k and
    c_k = μ_k α_k.

    >>> import numpy as np
    >>> theta = np.array([0.061, 3.1, 1.3])
    >>> float(Ogden().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), theta).round(6))
    0.039718
    """

    name = "ogden"
    summary = "Ogden: powers of the principal stretches, nearly incompressible"

    def __init__(self, settings: OgdenSettings | None = None) -> None:
        super().__init__(settings)
        n_terms = self.settings.terms
        coefficients = []
        for k in range(1, n_terms + 1):
            low, high = (1.0, 8.0) if k % 2 else (-8.0, -1.0)
            # The sign of one coefficient among several is free; the sum of all must be positive.
            least = POSITIVE if n_terms == 1 else -np.inf
            coefficients += [
                modulus(f"c{k}", 0.03, 0.2, f"twice the initial shear modulus of term {k}", least),
                shape(f"m{k}", low, high, f"exponent of term {k}", -np.inf),
            ]
        self.parameters = (*coefficients, bulk_modulus())

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Σ_k c_k/m_k² (Σ_a λ̃_a^m_k − 3) [MPa]."""
        xp = stretches.__array_namespace__()
        # A power's derivatives are powers again; those of the exponential reuse it.
        logs = xp.log(stretches)
        terms = ((theta[k], theta[k + 1]) for k in range(0, 2 * self.settings.terms, 2))
        return sum(c / m**2 * (total(xp.exp(m * logs)) - 3.0) for c, m in terms)

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs: powers of the stretches."""
        terms = tuple((float(c), float(m)) for c, m in zip(theta[:-1:2], theta[1:-1:2], strict=True))
        return EnergyForm(stretches=terms, bulk_MPa=float(theta[-1]))

    def check(self, theta: FloatArray) -> None:
        """Refuse values outside their physical range, and an exponent of zero."""
        super().check(theta)
        for parameter, value in zip(self.parameters, theta, strict=True):
            if parameter.kind == "shape" and value == 0.0:
                raise MaterialError(
                    f"material 'ogden': exponent {parameter.name} = 0 leaves the energy undefined; "
                    "keep it away from zero"
                )
