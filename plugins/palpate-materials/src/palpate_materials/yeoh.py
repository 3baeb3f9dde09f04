"""Yeoh material, and the two conventions of its coefficients."""

import numpy as np
from pydantic import Field

from palpate.api import FloatArray, Parameter, Settings
from palpate.api.mechanics import Array, EnergyForm
from palpate_materials.uncoupled import POSITIVE, Uncoupled, bulk_modulus, first_invariant, modulus

# The paper's ranges, in FEBio 4's convention: its c_k is k times the textbook's.
PAPER_RANGES = ((1.4e-3, 3e-2), (-3e-3, -4.14e-5), (3e-6, 3e-4))


class YeohSettings(Settings):
    """Settings of :class:`Yeoh`."""

    terms: int = Field(default=3, ge=1, le=6, description="Number of terms; the paper uses three.")


class Yeoh(Uncoupled[YeohSettings]):
    """Yeoh, uncoupled, with n terms.

    Ψ = Σ_k c_k (Ĩ1 − 3)^k + κ/2 (ln J)²

    Initial shear modulus 2 c1, bulk modulus κ.

    FEBio 4 (4.4 to 4.11) computes the stress with ∂Ψ/∂Ĩ1 = Σ c_k (Ĩ1 − 3)^(k−1):
    the factor k is missing. A number written in that convention, ``febio4``, is
    k times the textbook coefficient; the convention's factors convert it.

    The default ranges are the paper's (c1 1.4e-3…3e-2, c2 −3e-3…−4.14e-5, whose
    ends it prints in reverse, c3 3e-6…3e-4 MPa), read as ``febio4`` and hence
    divided by k here. The paper gives no range for κ: the default is the one it
    gives for Ogden, since both describe the same silicone. Terms above the third
    range over ±1e-5 MPa.

    >>> import numpy as np
    >>> paper = np.array([0.0129, -2.016e-3, 2.7623e-4, 0.6])
    >>> [float(c) for c in Yeoh().to_textbook(paper, "febio4").round(9)]
    [0.0129, -0.001008, 9.2077e-05, 0.6]
    """

    name = "yeoh"
    summary = "Yeoh: powers of the first invariant, nearly incompressible"

    def __init__(self, settings: YeohSettings | None = None) -> None:
        super().__init__(settings)
        n_terms = self.settings.terms
        self.parameters = (*(_coefficient(k) for k in range(1, n_terms + 1)), bulk_modulus())
        factors = (*(1.0 / k for k in range(1, n_terms + 1)), 1.0)
        self.conventions = {"febio4": factors}

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """Σ_k c_k (Ĩ1 − 3)^k [MPa]."""
        x = first_invariant(stretches) - 3.0
        return sum(theta[k] * x ** (k + 1) for k in range(self.settings.terms))

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Declare the energy for other programs: powers of Ĩ1 − 3."""
        return EnergyForm(powers=tuple(map(float, theta[:-1])), bulk_MPa=float(theta[-1]))


def _coefficient(k: int) -> Parameter:
    lower, upper = PAPER_RANGES[k - 1] if k <= len(PAPER_RANGES) else (-1e-5 * k, 1e-5 * k)
    least = POSITIVE if k == 1 else -np.inf
    what = "half the initial shear modulus" if k == 1 else f"coefficient of (I1 - 3)^{k}"
    return modulus(f"c{k}", lower / k, upper / k, what, least)
