"""Element forces and tangents of isotropic materials, compiled except for the energy.

An isotropic energy is a function of three principal stretches, so its first and
second derivatives at the quadrature points are all that a material provides.
JAX differentiates that small function; :class:`palpate._core.ElementBlock` does
the rest.
"""

import hashlib
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
import platformdirs
from numpy.typing import NDArray

from palpate.api import FloatArray, IntArray, IsotropicMaterial, Material
from palpate.api.files import write_atomically
from palpate.api.mechanics import Array, Deformation, ElementBlock, SparseFactor, principal_derivatives

Order = NDArray[np.uint32]

CHECKSUM = hashlib.sha256


def order_file(indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> Path:
    """Path of the file that keeps the order of a pattern."""
    name = CHECKSUM(_searching_code() + indptr.tobytes() + indices.tobytes()).hexdigest()[:32]
    return platformdirs.user_cache_path("palpate") / "orders" / name


def kept_order(file: Path) -> Order | None:
    """The order in a file; None where there is none, or it is not what was written."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, numbers = content[: CHECKSUM().digest_size], content[CHECKSUM().digest_size :]
    sound = CHECKSUM(numbers).digest() == digest
    return np.frombuffer(numbers, dtype="<u4").astype(np.uint32) if sound else None


def keep_order(file: Path, order: Order) -> None:
    """Write an order; without a folder for it, the next process searches again."""
    numbers = order.astype("<u4").tobytes()
    with suppress(OSError):
        write_atomically(file, CHECKSUM(numbers).digest() + numbers)


@cache
def _searching_code() -> bytes:
    """Hash of the extension module: another one may order otherwise, and results follow to the last bit."""
    return CHECKSUM(Path(str(sys.modules[SparseFactor.__module__].__file__)).read_bytes()).digest()


POINTS = 4096
"""Quadrature points differentiated at a time: one size, so that every mesh shares the compilation."""


def serves(material: Material) -> TypeGuard[IsotropicMaterial]:
    """Whether the compiled kernels support a material on JAX's device."""
    return isinstance(material, IsotropicMaterial) and jax.default_backend() == "cpu"


@partial(jax.jit, static_argnums=0)
def _first(material: IsotropicMaterial, stretches: Array, theta: Array) -> tuple[Array]:
    return (jax.grad(lambda s: jnp.sum(material.energy(s, theta)))(stretches),)


@partial(jax.jit, static_argnums=0)
def _both(material: IsotropicMaterial, stretches: Array, theta: Array) -> tuple[Array, Array]:
    return principal_derivatives(material, stretches, theta)


@partial(jax.jit, static_argnums=0)
def _by_parameter(material: IsotropicMaterial, stretches: Array, theta: Array) -> tuple[Array]:
    return (jax.jacfwd(lambda t: _first(material, stretches, t)[0])(theta),)


def _at_points(
    derivatives: Callable[[Array], tuple[Array, ...]], stretches: FloatArray
) -> tuple[FloatArray, ...]:
    """Evaluate at stretches (e, q, 3), some points at a time."""
    n_points = stretches.shape[0] * stretches.shape[1]
    padded = np.ones((-(-n_points // POINTS), POINTS, 3))
    padded.reshape(-1, 3)[:n_points] = stretches.reshape(-1, 3)
    # All are dispatched before the first result is needed.
    chunks = [derivatives(chunk) for chunk in padded]
    arrays = (np.concatenate([np.asarray(a) for a in parts]) for parts in zip(*chunks, strict=True))
    return tuple(a[:n_points].reshape(*stretches.shape[:2], *a.shape[1:]) for a in arrays)


class CompiledKernel:
    """Forces and stiffness of a block.

    Parameters
    ----------
    nodes : (e, n) array
    gradients : (e, q, n, 3) array
        [1/mm]
    volumes : (e, q) array
        [mm³]
    """

    def __init__(
        self,
        material: IsotropicMaterial,
        nodes: IntArray,
        gradients: FloatArray,
        volumes: FloatArray,
        mean_dilatation: bool,
    ) -> None:
        self._material = material
        self._make = partial(ElementBlock, nodes, gradients, volumes, mean_dilatation=mean_dilatation)
        self._block = self._make()
        self._last: tuple[FloatArray, Deformation] | None = None

    def bind(self, places: IntArray) -> None:
        """Take the places (e, 3n, 3n) of stiffness entries in the values of a sparse matrix."""
        self._block, self._last = self._make(places=places), None

    def add_force(self, displacements: FloatArray, theta: FloatArray, total: FloatArray) -> float:
        """Add nodal forces to ``total`` (n_nodes, 3) [N]; the least J."""
        deformation, (psi_i,) = self._differentiated(_first, displacements, theta)
        deformation.add_force(psi_i, total)
        return deformation.least_jacobian

    def add_rates(self, displacements: FloatArray, theta: FloatArray, totals: FloatArray) -> None:
        """Add the derivatives of the nodal forces in the parameters to ``totals`` (m, n_nodes, 3)."""
        deformation, (slopes,) = self._differentiated(_by_parameter, displacements, theta)
        for k, total in enumerate(totals):
            deformation.add_force(np.ascontiguousarray(slopes[..., k]), total)

    def add_tangent(
        self, displacements: FloatArray, theta: FloatArray, total: FloatArray, values: FloatArray
    ) -> float:
        """Add nodal forces, and stiffness to ``values`` [N/mm] at the places; the least J."""
        deformation, (psi_i, psi_ij) = self._differentiated(_both, displacements, theta)
        deformation.add_force(psi_i, total)
        deformation.add_stiffness(psi_i, psi_ij, values)
        return deformation.least_jacobian

    def _differentiated(
        self,
        derivatives: Callable[[Material, Array, Array], tuple[Array, ...]],
        displacements: FloatArray,
        theta: FloatArray,
    ) -> tuple[Deformation, tuple[FloatArray, ...]]:
        deformation = self._deformed(displacements)
        at_theta = partial(derivatives, self._material)
        theta = np.asarray(theta, dtype=np.float64)
        return deformation, _at_points(lambda s: at_theta(s, theta), deformation.stretches)

    def _deformed(self, displacements: FloatArray) -> Deformation:
        """The deformation, kept for the tangent of a state whose forces were asked for."""
        if self._last is None or not np.array_equal(self._last[0], displacements):
            self._last = displacements.copy(), self._block.deform(displacements)
        return self._last[1]
