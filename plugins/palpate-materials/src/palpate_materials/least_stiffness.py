"""Least stiffness of a material over many states, by which a filter judges Drucker stability."""

from functools import partial
from itertools import permutations
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

from palpate.api import AnisotropicMaterial, IsotropicMaterial, Material, mechanics
from palpate.api.mechanics import Array


@runtime_checkable
class LimitedMaterial(Protocol):
    """An isotropic material whose energy is unbounded where its chains are fully stretched."""

    def in_reach(self, stretches: Array, theta: Array) -> Array:
        """Mask (...,) of the stretches (..., 3) that a finite energy reaches; no other is checked."""


@partial(jax.jit, static_argnums=0)
def least_stiffness(material: Material, stretches: Array, thetas: Array) -> Array:
    """Least eigenvalue of ∂²Ψ/∂ε∂ε over all states, for each set.

    Parameters
    ----------
    stretches : (n_states, 3) array
        Principal stretches.
    thetas : (n_sets, n_parameters) array
        Textbook values.

    Returns
    -------
    (n_sets,) array
        [MPa]; NaN where the energy is undefined in some state.
    """

    def least(theta: Array) -> Array:
        if isinstance(material, IsotropicMaterial):
            hessians = _principal_hessians(material, stretches, theta)
        else:
            hessians = _tensor_hessians(material, stretches, theta)
        stiffness = jnp.linalg.eigvalsh(hessians)
        if isinstance(material, LimitedMaterial):
            in_reach = material.in_reach(stretches, theta)
            stiffness = jnp.where(in_reach[:, None], stiffness, jnp.inf)
        return jnp.min(stiffness)

    # Sets whose Hessians are in memory together.
    return jax.lax.map(least, thetas, batch_size=256)


def _principal_hessians(material: IsotropicMaterial, stretches: Array, theta: Array) -> Array:
    """∂²Ψ/∂ε_i∂ε_j = λ_i λ_j ψ_ij + δ_ij λ_i ψ_i, (n_states, 3, 3)."""
    psi_i, psi_ij = mechanics.principal_derivatives(material, stretches, theta)
    diagonal = jnp.eye(3) * (stretches * psi_i)[..., None]
    return stretches[..., :, None] * stretches[..., None, :] * psi_ij + diagonal


def _tensor_hessians(material: AnisotropicMaterial, stretches: Array, theta: Array) -> Array:
    """Hessian in all six components of the logarithmic strain, (6 n_states, 6, 6)."""
    basis = np.zeros((6, 3, 3))
    basis[range(3), range(3), range(3)] = 1.0
    for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), start=3):
        basis[k, i, j] = basis[k, j, i] = 0.5**0.5

    def energy(components: Array) -> Array:
        strain = jnp.tensordot(components, basis, axes=1)
        return material.energy_from_F(jax.scipy.linalg.expm(strain), theta)

    orders = np.array(list(permutations(range(3))))
    principal = jnp.log(stretches)[:, orders].reshape((-1, 3))
    states = jnp.concatenate([principal, jnp.zeros_like(principal)], axis=-1)
    return jax.vmap(jax.hessian(energy))(states)
