"""Mooney–Rivlin material."""

from palpate.api.mechanics import Array
from palpate_materials.uncoupled import Uncoupled, bulk_modulus, first_invariant, modulus


class MooneyRivlin(Uncoupled):
    """Mooney–Rivlin, uncoupled.

    Ψ = c10 (Ĩ1 − 3) + c01 (Ĩ2 − 3) + κ/2 (ln J)²

    Initial shear modulus 2 (c10 + c01), bulk modulus κ. The ranges give the
    initial shear moduli of the paper's Ogden region, 0.015…0.1 MPa.

    >>> import numpy as np
    >>> theta = np.array([0.02, 0.01, 1.0])
    >>> float(MooneyRivlin().energy(np.array([2.0, 0.5**0.5, 0.5**0.5]), theta).round(6))
    0.0525
    """

    name = "mooney_rivlin"
    summary = "Mooney-Rivlin: first and second invariant, nearly incompressible"
    parameters = (
        modulus("c10", 5e-3, 4e-2, "coefficient of (I1 - 3)"),
        modulus("c01", 2.5e-3, 1e-2, "coefficient of (I2 - 3)", 0.0),
        bulk_modulus(),
    )

    def isochoric_energy(self, stretches: Array, theta: Array) -> Array:
        """c10 (Ĩ1 − 3) + c01 (Ĩ2 − 3) [MPa], with Ĩ2 = Σ λ̃^−2 since J̃ = 1."""
        first, second = first_invariant(stretches), first_invariant(1.0 / stretches)
        return theta[0] * (first - 3.0) + theta[1] * (second - 3.0)
