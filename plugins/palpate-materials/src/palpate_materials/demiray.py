"""Demiray material."""

from palpate.api.mechanics import Array
from palpate_materials.uncoupled import Uncoupled, bulk_modulus, first_invariant, modulus, shape


class Demiray(Uncoupled):
    """Demiray (1972), the isotropic exponential of the Fung and Holzapfel family, uncoupled.

    Ψ = μ / (2b) (exp(b (Ĩ1 − 3)) − 1) + κ/2 (ln J)²

    Initial shear modulus μ, bulk modulus κ. The range of μ is that of the
    paper's Ogden region, 0.015…0.1 MPa.

    >>> import numpy as np
    >>> theta = np.array([0.04, 1.0, 1.0])
    >>> float(Demiray().energy(np.array([1.5, 1.5**-0.5, 1.5**-0.5]), theta).round(6))
    0.01584
    """

    name = "demiray"
    summary = "Demiray: one exponential of the first invariant, nearly incompressible"
    parameters = (
        modulus("mu", 1.5e-2, 0.1, "initial shear modulus"),
        shape("b", 0.1, 5.0, "exponent per unit of (I1 - 3)"),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """μ / (2b) (exp(b (Ĩ1 − 3)) − 1) [MPa]."""
        xp = stretches.__array_namespace__()
        mu, b = theta[0], theta[1]
        return 0.5 * mu / b * xp.expm1(b * (first_invariant(stretches) - 3.0))
