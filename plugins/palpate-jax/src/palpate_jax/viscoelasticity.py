"""Quasi-linear viscoelasticity: stresses that relax at the quadrature points of a block.

The second Piola–Kirchhoff stress relaxes by g(t) = 1 - Σ γ_i (1 - e^(-t/τ_i)):

    S = Sᵉ - Σ γ_i (Sʳ - H_i),    H_i(t) = ∫ e^(-(t - s)/τ_i) dSʳ(s)

where Sʳ is Sᵉ, the stress of the energy Ψ or of its isochoric part Ψ(J^(-1/3) F) (Simo 1987; Simo &
Hughes, Computational Inelasticity, 1998, section 10.3). It is objective: stresses that relax turn with the
tissue. Sʳ is straight in time within a load step of duration Δt, so that with k_i = e^(-Δt/τ_i) and
a_i = (1 - k_i) τ_i / Δt

    H_i ← k_i H_i + a_i ΔSʳ,    S = Sᵉ - (1 - c) Sʳ + S⁰,    c = 1 - Σ γ_i (1 - a_i)

and S⁰ = Σ γ_i (k_i H_i - a_i Sʳ) of the beginning of the step. Forces and tangent therefore follow from
the energy Ψ - (1 - c) Ψʳ and from the constant S⁰: a matrix times the positions of the nodes, and this
geometric stiffness itself.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.sparse import csr_array

from palpate.api import NO_FIELDS, AnisotropicMaterial, FloatArray, IntArray, IsotropicMaterial, Material
from palpate.api.mechanics import Array
from palpate_jax.autodiff import AutodiffKernel


@dataclass(frozen=True, slots=True, eq=False)
class Stresses:
    """History variables of a block at an equilibrium state [MPa]; leading axes: one per parameter in slopes.

    Parameters
    ----------
    now : (..., e, q, 3, 3) array
        Sʳ.
    relaxed : (n_times, ..., e, q, 3, 3) array
        H_i.
    """

    now: FloatArray
    relaxed: FloatArray

    def after(self, now: FloatArray, weights: "Weights") -> "Stresses":
        """History at the end of a load step with this Sʳ there."""
        pairs = zip(weights.kept, weights.added, self.relaxed, strict=True)
        change = now - self.now
        return Stresses(now, np.array([k * H + a * change for k, a, H in pairs]))

    def lost(self, shares: FloatArray) -> FloatArray:
        """Stress Sᵉ - S (e, q, 3, 3) that has relaxed, of shares γ_i (n_times,)."""
        return np.asarray(np.einsum("t,t...->...", shares, self.now - self.relaxed))

    def held(self, i: int, weights: "Weights") -> FloatArray:
        """Part k_i H_i - a_i Sʳ (..., e, q, 3, 3) of S⁰."""
        return np.asarray(weights.kept[i] * self.relaxed[i] - weights.added[i] * self.now)


@dataclass(frozen=True, slots=True, eq=False)
class Weights:
    """Weights k_i (n_times,) and a_i (n_times,) of a load step."""

    kept: FloatArray
    added: FloatArray

    @classmethod
    def of(cls, duration_s: float, times_s: FloatArray) -> "Weights":
        """Weights of a duration; without one, of a jump."""
        steps = duration_s / times_s
        added = -np.expm1(-steps) / steps if duration_s > 0.0 else np.ones_like(steps)
        return cls(np.exp(-steps), added)


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A block in one load step: history before it, and weights; the matrix (n_nodes, n_nodes) of S⁰ [N/mm].

    ``theta`` has the values of the weighted material.
    """

    before: Stresses
    weights: Weights
    theta: FloatArray
    matrix: csr_array


class InLoadStep(Mapping[str, FloatArray]):
    """Values of the materials by region, in a load step; ``held`` by number of the blocks that relax."""

    def __init__(self, values: Mapping[str, FloatArray], held: Mapping[int, Held]) -> None:
        self.values_alone, self.held = values, held

    def __getitem__(self, region: str) -> FloatArray:
        return self.values_alone[region]

    def __iter__(self) -> Iterator[str]:
        return iter(self.values_alone)

    def __len__(self) -> int:
        return len(self.values_alone)


def held_in(thetas: Mapping[str, FloatArray]) -> Mapping[int, Held]:
    """Blocks that relax in this load step, by number."""
    return thetas.held if isinstance(thetas, InLoadStep) else {}


class _Weighted:
    """A material whose energy is b (Ψ - Ψʳ) + c Ψʳ; c and b are its last two values."""

    def __init__(self, material: Material) -> None:
        self._material: Any = material
        self.settings, self.fields = material.settings, material.fields

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Weighted) and self._material == other._material

    def __hash__(self) -> int:
        return hash(self._material)


class _WeightedIsotropic(_Weighted, IsotropicMaterial):
    def energy(self, stretches: Array, theta: Array) -> Array:
        energy, own = self._material.energy, theta[:-2]
        if not self._material.relaxes_isochoric:
            return theta[-2] * energy(stretches, own)
        J = stretches[..., 0] * stretches[..., 1] * stretches[..., 2]
        isochoric = energy(stretches * J[..., None] ** (-1.0 / 3.0), own)
        return theta[-1] * (energy(stretches, own) - isochoric) + theta[-2] * isochoric


class _WeightedAnisotropic(_Weighted, AnisotropicMaterial):
    def energy_from_F(  # noqa: N802
        self, F: Array, theta: Array, fields: Mapping[str, Array] = NO_FIELDS
    ) -> Array:
        energy, own = self._material.energy_from_F, theta[:-2]
        given = (fields,) if fields else ()
        if not self._material.relaxes_isochoric:
            return theta[-2] * energy(F, own, *given)
        isochoric = energy(F * jnp.linalg.det(F) ** (-1.0 / 3.0), own, *given)
        return theta[-1] * (energy(F, own, *given) - isochoric) + theta[-2] * isochoric


def weighted(material: Material) -> Material:
    """The material with weights of its energy Ψ - Ψʳ and Ψʳ as two more values."""
    if isinstance(material, IsotropicMaterial):
        return _WeightedIsotropic(material)
    return _WeightedAnisotropic(material)


class BlockRelaxation:
    """Relaxation of the stresses of one block.

    Parameters
    ----------
    kernel : AutodiffKernel
        Of the weighted material; gives Sʳ.
    nodes : (e, n) array
    gradients : (e, q, n, 3) array
        In the frame of the material's directions [1/mm].
    volumes : (e, q) array
        [mm³]
    points : (n_nodes, 3) array
        [mm]
    times_s : (n_times,) array
        The last parameters of the material are their shares.
    """

    def __init__(
        self,
        kernel: AutodiffKernel,
        nodes: IntArray,
        gradients: FloatArray,
        volumes: FloatArray,
        points: FloatArray,
        times_s: FloatArray,
    ) -> None:
        self._kernel, self._nodes, self._points, self.times_s = kernel, nodes, points, times_s
        self._gradients = gradients
        self._weighted = volumes[..., None, None] * gradients
        n_nodes = len(points)
        pairs = nodes[:, :, None] * n_nodes + nodes[:, None, :]
        self._pairs, first, self._pair_of = np.unique(pairs, return_index=True, return_inverse=True)
        self._first_of_pair = np.unravel_index(first, pairs.shape)
        self._row_ends = np.searchsorted(self._pairs, n_nodes * np.arange(n_nodes + 1))
        self._places: IntArray = np.empty(0, dtype=np.int64)

    def bind(self, places: IntArray) -> None:
        """Take the places (e, 3n, 3n) of stiffness entries in the values of a sparse matrix."""
        self._places = np.stack([places[:, i::3, i::3][self._first_of_pair] for i in range(3)])

    def at_rest(self, *leading: int) -> Stresses:
        """History of a body at rest; with leading axes, the state of derivatives."""
        shape = (*leading, *self._gradients.shape[:2], 3, 3)
        return Stresses(np.zeros(shape), np.zeros((self.times_s.size, *shape)))

    def in_step(self, theta: FloatArray, before: Stresses, duration_s: float) -> Held:
        """The block in a load step that begins with this history."""
        weights = Weights.of(duration_s, self.times_s)
        c = 1.0 - float(self.shares(theta) @ (1.0 - weights.added))
        matrix = self._matrix(self._held(self.shares(theta), before, weights))
        return Held(before, weights, np.array([*theta, c, 1.0]), matrix)

    def shares(self, theta: FloatArray) -> FloatArray:
        """Shares γ_i (n_times,) among a material's values."""
        return np.asarray(theta[len(theta) - self.times_s.size :], dtype=np.float64)

    def after(self, displacements: FloatArray, held: Held) -> Stresses:
        """History at the end of the load step, which is in equilibrium there."""
        return held.before.after(self._kernel.second_stress(displacements, _relaxing(held)), held.weights)

    def add_force(self, held: Held, displacements: FloatArray, total: FloatArray) -> None:
        """Add the nodal forces of S⁰ to ``total`` (n_nodes, 3) [N]."""
        total += held.matrix @ (self._points + displacements)

    def _add_force_of(self, stress: FloatArray, displacements: FloatArray, total: FloatArray) -> None:
        """Add the nodal forces of constant stresses (e, q, 3, 3), without their matrix."""
        places = (self._points + displacements)[self._nodes]
        turned = self._gradients.swapaxes(-1, -2) @ places[:, None]  # Fᵀ
        self._kernel.scatter((self._weighted @ (stress @ turned)).sum(axis=1), total)

    def add_stiffness(self, held: Held, values: FloatArray) -> None:
        """Add the stiffness of S⁰ to ``values`` at the places; what has none of its own shares the last."""
        for places in self._places:
            values[places] += held.matrix.data

    def add_rates(self, displacements: FloatArray, held: Held, rates: FloatArray, totals: FloatArray) -> None:
        """Add the rates of the nodal forces in the material's values to ``totals`` (p, n_nodes, 3).

        Parameters
        ----------
        rates : (p + 2, n_nodes, 3) array
            Rates of the weighted material's forces.
        """
        totals += rates[:-2]
        for i, total in enumerate(totals[len(totals) - self.times_s.size :]):
            total -= (1.0 - held.weights.added[i]) * rates[-2]
            self._add_force_of(held.before.held(i, held.weights), displacements, total)

    def add_rates_of_history(
        self, displacements: FloatArray, held: Held, slopes: Stresses, totals: FloatArray
    ) -> None:
        """Add the change of the nodal forces with the history before the step to ``totals`` (m, n_nodes, 3).

        Parameters
        ----------
        slopes : Stresses
            Derivatives of that history in m parameters.
        """
        shares = self.shares(held.theta[:-2])
        for k, total in enumerate(totals):
            own = Stresses(slopes.now[k], slopes.relaxed[:, k])
            self._add_force_of(self._held(shares, own, held.weights), displacements, total)

    def slopes_after(
        self, displacements: FloatArray, held: Held, slopes: Stresses, moved: FloatArray, changed: FloatArray
    ) -> Stresses:
        """Derivatives of the history at the end of the step, from those before it.

        Parameters
        ----------
        moved, changed : (m, n_nodes, 3) and (m, p) arrays
            Derivatives of the displacements and of the material's p values.
        """
        changed = np.pad(changed, ((0, 0), (0, 2)))
        rates = self._kernel.second_stress_rates(displacements, _relaxing(held), moved, changed)
        return slopes.after(rates, held.weights)

    def _held(self, shares: FloatArray, before: Stresses, weights: Weights) -> FloatArray:
        """S⁰ (e, q, 3, 3) [MPa], or the part of its derivative by the history."""
        return np.asarray(sum(share * before.held(i, weights) for i, share in enumerate(shares)))

    def _matrix(self, stress: FloatArray) -> csr_array:
        """Σ_q w ∇N_a · S ∇N_b (n_nodes, n_nodes) [N/mm] of stresses (e, q, 3, 3)."""
        of_elements = (self._weighted @ stress @ self._gradients.swapaxes(-1, -2)).sum(axis=1)
        values = np.bincount(self._pair_of.ravel(), of_elements.ravel())
        n_nodes = len(self._points)
        return csr_array((values, self._pairs % n_nodes, self._row_ends), shape=(n_nodes, n_nodes))


def _relaxing(held: Held) -> FloatArray:
    """Values of the weighted material with which its energy is Ψʳ alone."""
    return np.array([*held.theta[:-2], 1.0, 0.0])
