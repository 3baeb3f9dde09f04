"""Element forces and tangents in JAX alone, for any material and any device.

Legend: H = F^−T, s = (θ/J)^(1/3) with θ the element's mean of J, P̄ and Ā first
Piola–Kirchhoff stress and tangent at F̄ = s F; index letters i k space, J L
reference, a b nodes.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from palpate.api import NO_FIELDS, FloatArray, IntArray, Material
from palpate.api.mechanics import stress, stress_and_tangent

Jax = Any
T = TypeVar("T", bound=np.generic)

_Geometry = tuple[Jax, Jax, Jax, dict[str, Jax]]
"""Gradients, volumes, the deformation at rest (3, 3) and fields of a block."""

CHUNK = 512
"""Elements evaluated at a time: one size, so that every mesh shares the compilation."""


def _cofactor_inverse(F: Jax) -> tuple[Jax, Jax]:
    """J and H = F^−T by cofactors, which stay finite and cheap in a batch."""
    r0, r1, r2 = F[..., 0, :], F[..., 1, :], F[..., 2, :]
    cofactor = jnp.stack([jnp.cross(r1, r2), jnp.cross(r2, r0), jnp.cross(r0, r1)], axis=-2)
    J = jnp.sum(r0 * cofactor[..., 0, :], axis=-1)
    return J, cofactor / J[..., None, None]


def _dot(a: Jax, b: Jax) -> Jax:
    return jnp.sum(a * b, axis=(-2, -1))


@dataclass(frozen=True, slots=True, eq=False)
class _Kinematics:
    F: Jax
    J: Jax
    H: Jax
    theta: Jax  # (e, 1): element mean of J
    s: Jax  # (e, q)
    volume: Jax  # (e, 1)


def _kinematics(displacements: Jax, gradients: Jax, volumes: Jax, rest: Jax) -> _Kinematics:
    # F = R + Σ_a u_a ⊗ ∇N_a, shape (e, q, 3, 3), where R turns the reference frame into the spatial one.
    F = rest + jnp.einsum("eai,eqaJ->eqiJ", displacements, gradients)
    J, H = _cofactor_inverse(F)
    volume = volumes.sum(axis=1, keepdims=True)
    theta = (volumes * J).sum(axis=1, keepdims=True) / volume
    return _Kinematics(F, J, H, theta, jnp.cbrt(theta / J), volume)


def _mean_dilatation_stress(k: _Kinematics, P: Jax, volumes: Jax) -> tuple[Jax, Jax, Jax]:
    """Stress conjugate to F with θ free, pressure-like π per element, and P̄:F."""
    trace = _dot(P, k.F)
    Q = P - (trace / 3.0)[..., None, None] * k.H
    pressure = (volumes * trace * k.s / (3.0 * k.theta)).sum(axis=1, keepdims=True) / k.volume
    return Q, pressure, trace


def _outer(a: Jax, b: Jax) -> Jax:
    return a[..., :, :, None, None] * b[..., None, None, :, :]


def _mean_dilatation_tangent(k: _Kinematics, P: Jax, A: Jax, volumes: Jax) -> tuple[Jax, Jax, Jax, Jax]:
    """Tangent at fixed θ (e,q,3,3,3,3), stress, ∂²W/∂F∂θ (e,q,3,3) and Σ w ∂²W/∂θ² (e,1)."""
    Q, pressure, trace = _mean_dilatation_stress(k, P, volumes)
    s, H = k.s[..., None, None], k.H
    M = jnp.einsum("eqiJkL,eqkL->eqiJ", A, k.F)
    m = _dot(M, k.F)
    four = (..., None, None, None, None)
    swap = jnp.einsum("eqiL,eqkJ->eqiJkL", H, H)
    HH = _outer(H, H)
    half = s * s * M + s * P  # symmetric part pairs with H
    coefficient = k.s * k.s * m / 9.0 + k.s * trace / 9.0 + pressure * k.J
    tangent = (
        (k.s * k.s)[four] * A
        - (_outer(half, H) + _outer(H, half)) / 3.0
        + coefficient[four] * HH
        + (k.s * trace / 3.0 - pressure * k.J)[four] * swap
    )
    mixed = (s / (3.0 * k.theta[..., None, None])) * (Q + s * M - s * (m / 3.0)[..., None, None] * H)
    curvature = (volumes * k.s / (9.0 * k.theta**2) * (m * k.s - 2.0 * trace)).sum(axis=1, keepdims=True)
    total = s * Q + (pressure * k.J)[..., None, None] * H
    return tangent, total, mixed, curvature


def _block_stress(
    material: Material, mean: bool, displacements: Jax, geometry: _Geometry, parameters: Jax
) -> tuple[Jax, _Kinematics]:
    """First Piola–Kirchhoff stress (e, q, 3, 3), conjugate to F, and the kinematics."""
    gradients, volumes, rest, fields = geometry
    k = _kinematics(displacements, gradients, volumes, rest)
    if not mean:
        return stress(material, k.F, parameters, fields), k
    P = stress(material, k.s[..., None, None] * k.F, parameters, fields)
    Q, pressure, _ = _mean_dilatation_stress(k, P, volumes)
    return k.s[..., None, None] * Q + (pressure * k.J)[..., None, None] * k.H, k


def _block_force(
    material: Material, mean: bool, displacements: Jax, geometry: _Geometry, parameters: Jax
) -> tuple[Jax, Jax]:
    """Nodal forces (e, n, 3) [N] and the least J (e,) of each element."""
    P, k = _block_stress(material, mean, displacements, geometry, parameters)
    force = jnp.einsum("eq,eqiJ,eqaJ->eai", geometry[1], P, geometry[0])
    return force, k.J.min(axis=1)


def _block_second_stress(
    material: Material, mean: bool, displacements: Jax, geometry: _Geometry, parameters: Jax
) -> tuple[Jax]:
    """Second Piola–Kirchhoff stress F⁻¹P (e, q, 3, 3)."""
    P, k = _block_stress(material, mean, displacements, geometry, parameters)
    return (jnp.einsum("eqiI,eqiJ->eqIJ", k.H, P),)


def _block_second_stress_rates(
    material: Material, mean: bool, displacements: Jax, geometry: _Geometry, parameters: Jax, ways: Jax
) -> tuple[Jax]:
    """Its rates (e, m, q, 3, 3), as displacements (e, n, 3) and parameters (p,) go m ``ways``.

    ``ways`` are rates of the displacements (e, m, n, 3), and of the parameters (m, p).
    """

    def rate(moved: Jax, changed: Jax) -> Jax:
        def second_stress(u: Jax, p: Jax) -> Jax:
            return _block_second_stress(material, mean, u, geometry, p)[0]

        return jax.jvp(second_stress, (displacements, parameters), (moved, changed))[1]

    return (jax.vmap(rate, in_axes=(1, 0), out_axes=1)(*ways),)


def _block_tangent(
    material: Material, mean: bool, displacements: Jax, geometry: _Geometry, parameters: Jax
) -> tuple[Jax, Jax, Jax]:
    """Nodal forces (e, n, 3), stiffness (e, 3n, 3n) [N/mm] and the least J (e,) of each element."""
    gradients, volumes, rest, fields = geometry
    k = _kinematics(displacements, gradients, volumes, rest)
    n = gradients.shape[2]
    if not mean:
        P, A = stress_and_tangent(material, k.F, parameters, fields)
        return _contract(gradients, volumes, P), _stiffness(gradients, volumes, A), k.J.min(axis=1)
    P, A = stress_and_tangent(material, k.s[..., None, None] * k.F, parameters, fields)
    tangent, total, mixed, curvature = _mean_dilatation_tangent(k, P, A, volumes)
    stiffness = _stiffness(gradients, volumes, tangent)
    b = _contract(gradients, volumes, mixed).reshape(-1, 3 * n)
    g = _contract(gradients, volumes, k.J[..., None, None] * k.H).reshape(-1, 3 * n) / k.volume
    stiffness = (
        stiffness
        + b[:, :, None] * g[:, None, :]
        + g[:, :, None] * b[:, None, :]
        + curvature[..., None] * g[:, :, None] * g[:, None, :]
    )
    return _contract(gradients, volumes, total), stiffness, k.J.min(axis=1)


def _contract(gradients: Jax, volumes: Jax, P: Jax) -> Jax:
    """Σ_q w P ∇N_a, shape (e, n, 3)."""
    return jnp.einsum("eqiJ,eqaJ->eai", volumes[..., None, None] * P, gradients)


def _stiffness(gradients: Jax, volumes: Jax, A: Jax) -> Jax:
    """Σ_q w ∇N_a A ∇N_b, shape (e, 3n, 3n)."""
    n = gradients.shape[2]
    half = jnp.einsum("eqaJ,eqiJkL->eqaikL", gradients, volumes[..., None, None, None, None] * A)
    return jnp.einsum("eqaikL,eqbL->eaibk", half, gradients).reshape(-1, 3 * n, 3 * n)


def _block_rates(
    material: Material, mean: bool, displacements: Jax, geometry: _Geometry, parameters: Jax
) -> tuple[Jax]:
    """Derivatives (e, n, 3, m) of the nodal forces in the parameters."""

    def force(p: Jax) -> Jax:
        return _block_force(material, mean, displacements, geometry, p)[0]

    return (jax.jacfwd(force)(parameters),)


_force_kernel = jax.jit(_block_force, static_argnums=(0, 1))
_tangent_kernel = jax.jit(_block_tangent, static_argnums=(0, 1))
_rates_kernel = jax.jit(_block_rates, static_argnums=(0, 1))
_second_stress_kernel = jax.jit(_block_second_stress, static_argnums=(0, 1))
_second_stress_rates_kernel = jax.jit(_block_second_stress_rates, static_argnums=(0, 1))


def _chunks(array: NDArray[T]) -> NDArray[T]:
    """Chunks (c, e, …) of a block; the last element is repeated to fill the last one."""
    missing = -len(array) % CHUNK
    padded = np.concatenate([array, np.repeat(array[-1:], missing, axis=0)])
    return padded.reshape(-1, CHUNK, *array.shape[1:])


class AutodiffKernel:
    """Forces and stiffness of a block, differentiated and compiled by JAX.

    Kernels are compiled once per material and element kind, for chunks of one
    size, and parameters are arguments, so that every set of a sweep and every
    mesh shares the compilation.

    Parameters
    ----------
    nodes : (e, n) array
    gradients : (e, q, n, 3) array
        [1/mm]
    volumes : (e, q) array
        [mm³]
    axes : (3, 3) array, optional
        Axes of the spatial frame, as columns in the frame that the material's directions are in; F then
        goes from that frame to this one, which changes no energy.
    fields : mapping of name to (e, q) or (e, q, 3) array, optional
        Cell data for the material, in that frame too.
    """

    def __init__(
        self,
        material: Material,
        nodes: IntArray,
        gradients: FloatArray,
        volumes: FloatArray,
        mean_dilatation: bool,
        axes: FloatArray | None = None,
        fields: Mapping[str, FloatArray] = NO_FIELDS,
    ) -> None:
        axes = np.eye(3) if axes is None else axes
        self._nodes = nodes
        arrays = (gradients @ axes.T, volumes, *fields.values())
        self._chunks = [
            (own, (own_gradients, own_volumes, jnp.asarray(axes.T), dict(zip(fields, values, strict=True))))
            for own, own_gradients, own_volumes, *values in zip(
                _chunks(nodes), *(jnp.asarray(_chunks(array)) for array in arrays), strict=True
            )
        ]
        self._force = partial(_force_kernel, material, mean_dilatation)
        self._tangent = partial(_tangent_kernel, material, mean_dilatation)
        self._rates = partial(_rates_kernel, material, mean_dilatation)
        self._second_stress = partial(_second_stress_kernel, material, mean_dilatation)
        self._second_stress_rates = partial(_second_stress_rates_kernel, material, mean_dilatation)
        self._places: IntArray = np.empty(0, dtype=np.int64)

    def bind(self, places: IntArray) -> None:
        """Take the places (e, 3n, 3n) of stiffness entries in the values of a sparse matrix."""
        self._places = places.ravel()

    def add_force(self, displacements: FloatArray, theta: FloatArray, total: FloatArray) -> float:
        """Add nodal forces to ``total`` (n_nodes, 3) [N]; the least J."""
        forces, least = self._evaluate(self._force, displacements, theta)
        self.scatter(forces, total)
        return float(least.min())

    def add_rates(self, displacements: FloatArray, theta: FloatArray, totals: FloatArray) -> None:
        """Add the derivatives of the nodal forces in the parameters to ``totals`` (m, n_nodes, 3)."""
        (rates,) = self._evaluate(self._rates, displacements, np.asarray(theta))
        for k, total in enumerate(totals):
            self.scatter(rates[..., k], total)

    def add_tangent(
        self, displacements: FloatArray, theta: FloatArray, total: FloatArray, values: FloatArray
    ) -> float:
        """Add nodal forces, and stiffness to ``values`` [N/mm] at the places; the least J."""
        forces, stiffness, least = self._evaluate(self._tangent, displacements, theta)
        self.scatter(forces, total)
        values += np.bincount(self._places, stiffness.ravel(), minlength=len(values))
        return float(least.min())

    def second_stress(self, displacements: FloatArray, theta: FloatArray) -> FloatArray:
        """Second Piola–Kirchhoff stress (e, q, 3, 3) [MPa] in the frame of the material's directions."""
        (found,) = self._evaluate(self._second_stress, displacements, np.asarray(theta))
        return found

    def second_stress_rates(
        self, displacements: FloatArray, theta: FloatArray, moved: FloatArray, changed: FloatArray
    ) -> FloatArray:
        """Its rates (m, e, q, 3, 3), as displacements and parameters change by rows of these two."""
        theta = np.asarray(theta)
        parts = [
            self._second_stress_rates(
                displacements[nodes], geometry, theta, (moved[:, nodes].swapaxes(0, 1), changed)
            )
            for nodes, geometry in self._chunks
        ]
        found: FloatArray = np.concatenate([np.asarray(rates) for (rates,) in parts])[: len(self._nodes)]
        return found.swapaxes(0, 1)

    def _evaluate(
        self, kernel: Callable[..., tuple[Jax, ...]], displacements: FloatArray, theta: FloatArray
    ) -> tuple[FloatArray, ...]:
        """Evaluate at every element; all chunks are dispatched before the first result is needed."""
        parts = [kernel(displacements[nodes], geometry, theta) for nodes, geometry in self._chunks]
        arrays = (np.concatenate([np.asarray(a) for a in column]) for column in zip(*parts, strict=True))
        return tuple(a[: len(self._nodes)] for a in arrays)

    def scatter(self, forces: FloatArray, total: FloatArray) -> None:
        """Add forces (e, n, 3) of the elements' nodes to ``total`` (n_nodes, 3)."""
        flat, columns = self._nodes.ravel(), forces.reshape(-1, 3)
        for k in range(3):
            total[:, k] += np.bincount(flat, columns[:, k], minlength=len(total))
