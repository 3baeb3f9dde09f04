"""Energies that most finite element programs have: what a material declares to be written as their card."""

from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from palpate.domain import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyForm:
    """Energy as a sum of standard terms, with isochoric stretches λ̃ = J^(−1/3) λ and Ĩ1 = Σ λ̃².

    W = Σ_k c_k (Ĩ1 − 3)^k + Σ_j c_j/m_j² (Σ_a λ̃_a^m_j − 3) − μ Jm/2 ln(1 − (Ĩ1 − 3)/Jm) + U(J)

    Parameters
    ----------
    powers : tuple of float
        c_k [MPa] for k = 1, 2, …
    stretches : tuple of (float, float)
        c_j [MPa] and m_j.
    gent : (float, float), optional
        μ [MPa] and Jm of Gent's energy.
    bulk_MPa : float
        Initial bulk modulus K.
    volume : {"log", "coupled"}
        ``log``: U = K/2 (ln J)². ``coupled``: neo-Hookean, whose only power c_1 = μ/2 is of I1 = Σ λ²
        instead, and U = λ/2 (ln J)² − μ ln J with λ = K − 2μ/3.
    """

    powers: tuple[float, ...] = ()
    stretches: tuple[tuple[float, float], ...] = ()
    gent: tuple[float, float] | None = None
    bulk_MPa: float
    volume: Literal["log", "coupled"] = "log"

    @property
    def shear_MPa(self) -> float:  # noqa: N802 -- the unit keeps its case
        """Initial shear modulus."""
        chains = self.gent[0] if self.gent else 0.0
        return 2.0 * sum(self.powers[:1]) + 0.5 * sum(c for c, _ in self.stretches) + chains

    @property
    def poisson(self) -> float:
        """Initial Poisson's ratio."""
        return (3.0 * self.bulk_MPa - 2.0 * self.shear_MPa) / (2.0 * (3.0 * self.bulk_MPa + self.shear_MPa))

    def energy(self, stretches: FloatArray) -> FloatArray:
        """Energy [MPa] (...,) of principal stretches (..., 3)."""
        J = np.prod(stretches, axis=-1)
        isochoric = stretches if self.volume == "coupled" else stretches * J[..., None] ** (-1.0 / 3.0)
        x = (isochoric**2).sum(axis=-1) - 3.0
        shape = sum((c * x**k for k, c in enumerate(self.powers, start=1)), np.zeros_like(J))
        shape += sum(c / m**2 * ((isochoric**m).sum(axis=-1) - 3.0) for c, m in self.stretches)
        if self.gent:
            mu, limit = self.gent
            shape -= 0.5 * mu * limit * np.log1p(-x / limit)
        if self.volume == "log":
            return np.asarray(shape + 0.5 * self.bulk_MPa * np.log(J) ** 2)
        lame = self.bulk_MPa - 2.0 / 3.0 * self.shear_MPa
        return np.asarray(shape + 0.5 * lame * np.log(J) ** 2 - self.shear_MPa * np.log(J))


@runtime_checkable
class StandardMaterial(Protocol):
    """A material that other programs have too: it has the method, and inherits nothing for it."""

    def energy_form(self, theta: FloatArray) -> EnergyForm:
        """Its energy as standard terms, for textbook values (n_parameters,)."""
