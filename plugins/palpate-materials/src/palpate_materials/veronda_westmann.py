"""Veronda–Westmann material."""

from palpate.api.mechanics import Array
from palpate_materials.uncoupled import Uncoupled, bulk_modulus, first_invariant, modulus, shape


class VerondaWestmann(Uncoupled):
    """Veronda–Westmann (1970, skin), uncoupled.

    Ψ = c1 (exp(c2 (Ĩ1 − 3)) − 1) − c1 c2 / 2 (Ĩ2 − 3) + κ/2 (ln J)²

    Initial shear modulus c1 c2, bulk modulus κ. The ranges give initial shear
    moduli of 0.01…0.15 MPa, around the paper's Ogden region.

    >>> import numpy as np
    >>> theta = np.array([0.04, 1.0, 1.0])
    >>> float(VerondaWestmann().energy(np.array([1.5, 1.5**-0.5, 1.5**-0.5]), theta).round(6))
    0.022791
    """

    name = "veronda_westmann"
    summary = "Veronda-Westmann: exponential in the first invariant, for skin"
    parameters = (
        modulus("c1", 2e-2, 5e-2, "scale of the exponential"),
        shape("c2", 0.5, 3.0, "exponent per unit of (I1 - 3)"),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """c1 (exp(c2 (Ĩ1 − 3)) − 1) − c1 c2 / 2 (Ĩ2 − 3) [MPa], with Ĩ2 = Σ λ̃^−2 since J̃ = 1."""
        xp = stretches.__array_namespace__()
        c1, c2 = theta[0], theta[1]
        first, second = first_invariant(stretches), first_invariant(1.0 / stretches)
        return c1 * xp.expm1(c2 * (first - 3.0)) - 0.5 * c1 * c2 * (second - 3.0)
