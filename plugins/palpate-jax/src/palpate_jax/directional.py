"""Homogeneous tests of a material with directions, such as fibres.

Such a specimen shears when it is pulled, so its stretches do not describe it. The driven lines
keep their direction and have the prescribed length; the other entries of F minimise the energy
(F e1 = t e1 fixes the rotation):

===========  ==================  ============================================  ===================
mode         driven lines        F                                             stress
===========  ==================  ============================================  ===================
uniaxial     e1 by t             [[t, a, b], [0, exp u, c], [0, 0, exp v]]     P11 = dΨ/dt
equibiaxial  e1 and e2 by t      [[t, 0, b], [0, t, c], [0, 0, exp v]]         mean of P11 and P22
pure_shear   e1 by t, e2 held    [[t, 0, b], [0, 1, c], [0, 0, exp v]]         P11 = dΨ/dt
===========  ==================  ============================================  ===================

At constant volume exp v follows from det F = 1.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from palpate.api import AnisotropicMaterial, FloatArray, mechanics
from palpate.api.mechanics import Array

STEP_LENGTHS = (4.0, 2.0, 1.0, 0.5, 0.25, 0.1, 0.02, 0.0)
"""Tried shares of a Newton step; the one with the least energy is used."""

NEAR = 1e-5
"""Smaller steps are used in full: differences of energy are rounding there."""

STEP_TOLERANCE = 1e-11
"""The free entries have converged when none moves by more."""


class _Search(NamedTuple):
    free: Array
    step: Array
    least_bend: Array
    n_steps: Array | int


@dataclass(frozen=True, slots=True)
class _Test:
    """One mode of one material; x (1 + n_free,) is the prescribed stretch, shears, then logarithms."""

    material: AnisotropicMaterial
    mode: str
    incompressible: bool

    @property
    def n_shears(self) -> int:
        return 3 if self.mode == "uniaxial" else 2

    @property
    def n_logs(self) -> int:
        return self.n_shears - 1 - self.incompressible

    def start(self, t: Array) -> Array:
        """Free entries as if there were no directions, at constant volume."""
        power = {"uniaxial": -0.5, "equibiaxial": -2.0, "pure_shear": -1.0}[self.mode]
        return jnp.concatenate([jnp.zeros(self.n_shears), jnp.full(self.n_logs, power * jnp.log(t))])

    def gradient(self, x: Array) -> Array:
        """F (3, 3)."""
        t, zero = x[0], jnp.zeros_like(x[0])
        shears, logs = x[1 : 1 + self.n_shears], x[1 + self.n_shears :]
        a, b, c = shears if self.mode == "uniaxial" else (zero, *shears)
        held = {"equibiaxial": t, "pure_shear": jnp.ones_like(t)}
        second = held[self.mode] if self.mode in held else jnp.exp(logs[0])
        third = 1.0 / (t * second) if self.incompressible else jnp.exp(logs[-1])
        return jnp.stack([t, a, b, zero, second, c, zero, zero, third]).reshape(3, 3)

    def energy(self, x: Array, theta: Array) -> Array:
        return self.material.energy_from_F(self.gradient(x), theta)

    def slope(self, x: Array, theta: Array) -> Array:
        """Slope of the energy in x."""
        P = mechanics.stress(self.material, self.gradient(x), theta)
        return jnp.einsum("iJ,iJm->m", P, jax.jacfwd(self.gradient)(x))

    def derivatives(self, x: Array, theta: Array) -> tuple[Array, Array]:
        """Slope and curvature of the energy in x.

        By the chain rule through P and A: JAX takes several times as long to compile the
        derivatives of the composed function.
        """
        P, A = mechanics.stress_and_tangent(self.material, self.gradient(x), theta)
        along = jax.jacfwd(self.gradient)
        D, D2 = along(x), jax.jacfwd(along)(x)
        curvature = jnp.einsum("iJm,iJkL,kLn->mn", D, A, D) + jnp.einsum("iJ,iJmn->mn", P, D2)
        return jnp.einsum("iJ,iJm->m", P, D), curvature


def _newton(test: _Test, t: Array, free: Array, theta: Array) -> tuple[Array, Array]:
    """Newton step with the modulus of the curvature, and the least curvature."""
    slope, curvature = test.derivatives(jnp.concatenate([t[None], free]), theta)
    bends, axes = jnp.linalg.eigh(curvature[1:, 1:])
    return -axes @ ((axes.T @ slope[1:]) / jnp.abs(bends)), bends.min()


def _least(test: _Test, t: Array, theta: Array) -> tuple[Array, Array]:
    """Free entries of least energy, and 1 where they were found."""

    def unfinished(state: _Search) -> Array:
        return (jnp.abs(state.step).max() > STEP_TOLERANCE) & (state.n_steps < 60)

    def advance(state: _Search) -> _Search:
        step, least_bend = _newton(test, t, state.free, theta)
        longest = jnp.abs(step).max()
        # Largest change of a free entry, or of the logarithm of a free stretch, in one Newton step.
        moves = jnp.array(STEP_LENGTHS)[:, None] * step * jnp.minimum(1.0, 0.3 / longest)
        tried = jnp.concatenate([jnp.broadcast_to(t, (len(STEP_LENGTHS), 1)), state.free + moves], axis=1)
        energies = jax.vmap(lambda x: test.energy(x, theta))(tried)
        best = moves[jnp.argmin(jnp.where(jnp.isfinite(energies), energies, jnp.inf))]
        move = jnp.where(longest < NEAR, step, best)
        return _Search(state.free + move, step, least_bend, state.n_steps + 1)

    start = test.start(t)
    begin = _Search(start, jnp.full_like(start, jnp.inf), jnp.zeros_like(t), 0)
    found = jax.lax.while_loop(unfinished, advance, begin)
    converged = (jnp.abs(found.step).max() <= STEP_TOLERANCE) & (found.least_bend > 0.0)
    return found.free, jnp.where(converged, 1.0, 0.0)


def nominal_stress(
    material: AnisotropicMaterial, mode: str, incompressible: bool, theta: Array, path: Array
) -> Array:
    """Nominal stress of ``uniaxial``, ``equibiaxial`` or ``pure_shear`` along a path.

    Parameters
    ----------
    material : AnisotropicMaterial
        Its directions are in the frame e1, e2, e3 of the specimen.
    theta : (n_parameters,) array
        Textbook values.
    path : (n,) array
        Stretches.

    Returns
    -------
    (n,) array
        [MPa]; NaN where no equilibrium was found.
    """
    test = _Test(material, mode, incompressible)

    def at(t: Array) -> Array:
        # The derivatives of the free entries are those of an implicit function.
        free, found = jax.lax.custom_root(
            lambda x: test.slope(jnp.concatenate([t[None], x]), theta)[1:],
            test.start(t),
            lambda _, start: _least(test, t, theta),
            lambda linear, y: jnp.linalg.solve(jax.jacobian(linear)(y), y),
            has_aux=True,
        )
        slope, _ = test.derivatives(jnp.concatenate([t[None], free]), theta)
        return jnp.where(found > 0.0, slope[0], jnp.nan)

    return jax.vmap(at)(path) * (0.5 if mode == "equibiaxial" else 1.0)


def isochoric_slopes(material: AnisotropicMaterial, theta: FloatArray) -> FloatArray:
    """Derivatives (n_parameters, n) of the energy in the parameters, at deformations of constant volume."""
    raw = np.eye(3) + np.random.default_rng(0).uniform(-0.4, 0.4, (12, 3, 3))
    raw = raw[np.linalg.det(raw) > 0.1]
    F = jnp.asarray(raw / np.cbrt(np.linalg.det(raw))[:, None, None])
    slope = jax.jit(jax.jacfwd(lambda theta: jax.vmap(lambda f: material.energy_from_F(f, theta))(F)))
    return np.asarray(slope(jnp.asarray(theta))).T
