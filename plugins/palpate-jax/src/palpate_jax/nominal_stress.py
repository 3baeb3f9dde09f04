"""Stresses of homogeneous tests.

The test's stretch t is prescribed, the free faces carry no load. Nominal
(engineering) stress in MPa, force per undeformed area:

======================  =====================  =========================
mode                    principal stretches    stress
======================  =====================  =========================
uniaxial                t, y, y                P = dΨ/dt
equibiaxial             t, t, y                P = ½ dΨ/dt
pure_shear              t, 1, y                P = dΨ/dt
confined_compression    t, 1, 1                P = dΨ/dt
simple_shear            F = 1 + γ e1 ⊗ e2      P12 = dΨ/dγ, at constant volume
======================  =====================  =========================

Incompressible: y follows from t and the pressure drops out of dΨ/dt, so the
stress is exact and independent of the volumetric energy. Compressible: y is
where ∂Ψ/∂y = 0, found by Newton's method. A material with directions also shears:
see :mod:`palpate_jax.directional`. The compression of a cylinder
between greased plates is ``uniaxial`` with t < 1 and force / area < 0.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from palpate.api import FloatArray, IsotropicMaterial, Material, mechanics
from palpate.api.mechanics import Array
from palpate_jax import directional

LONGEST_STEP = 0.3
"""Largest change of ln y in one Newton step."""

NEAR = 1e-4
"""Steps of ln y below this are never extended: the gradient may be rounding."""

STEP_TOLERANCE = 1e-11
"""A transverse stretch has converged when its logarithm moves by less."""

Lateral = Callable[[Array, Array], Array]


def _stretches(mode: str, t: Array, y: Array) -> Array:
    """Principal stretches (..., 3) of a mode with a transverse stretch."""
    triple = {"uniaxial": (t, y, y), "equibiaxial": (t, t, y), "pure_shear": (t, jnp.ones_like(t), y)}
    return jnp.stack(triple[mode], axis=-1)


class _Search(NamedTuple):
    """State of the search for u = ln y: the factor on the Newton step, and that step."""

    u: Array
    boost: Array
    step: Array
    n_steps: Array | int


def _transverse(gradient: Lateral, log_t: Array, guess: Array) -> tuple[Array, Array]:
    """Solve ∂Ψ/∂u = 0 for u = ln y, shape (n,); also return where that succeeded.

    Newton with the modulus of the curvature, which always descends in energy,
    and a bounded step. While the steps hardly shrink, as they do far out on an
    exponential, their factor doubles. A solution must also be a minimum. Its derivatives
    follow from the theorem of implicit functions.
    """
    root = partial(gradient, log_t)
    u, found = jax.lax.custom_root(
        root, guess, _minimum, lambda linear, y: y / linear(jnp.ones_like(y)), has_aux=True
    )
    return u, found > 0.0


def _minimum(gradient: Callable[[Array], Array], guess: Array) -> tuple[Array, Array]:
    """The root, and 1 where it was found."""

    def newton(u: Array) -> tuple[Array, Array]:
        g, curvature = jax.jvp(gradient, (u,), (jnp.ones_like(u),))
        return -g / jnp.abs(curvature), curvature

    def unfinished(state: _Search) -> Array:
        return jnp.any(jnp.abs(state.step) > STEP_TOLERANCE) & (state.n_steps < 100)

    def advance(state: _Search) -> _Search:
        step, _ = newton(state.u)
        # Newton's method is slow where a step is longer than this share of the one before.
        slow = (step / state.step > 0.5) & (jnp.abs(step) > NEAR)
        boost = jnp.where(slow, 2.0 * state.boost, 1.0)
        move = jnp.clip(boost * step, -LONGEST_STEP, LONGEST_STEP)
        return _Search(state.u + move, boost, step, state.n_steps + 1)

    start = _Search(guess, jnp.ones_like(guess), jnp.full_like(guess, jnp.inf), 0)
    u = jax.lax.while_loop(unfinished, advance, start).u
    step, curvature = newton(u)
    return u, jnp.where((jnp.abs(step) <= STEP_TOLERANCE) & (curvature > 0.0), 1.0, 0.0)


def _free_stress(
    material: IsotropicMaterial, mode: str, incompressible: bool, theta: Array, t: Array
) -> Array:
    """Nominal stress (n,) of a mode with a transverse stretch; NaN where no equilibrium was found."""

    def energy(log_t: Array, u: Array) -> Array:
        return jnp.sum(material.energy(_stretches(mode, jnp.exp(log_t), jnp.exp(u)), theta))

    # Power of t that the free transverse stretch of a mode has at constant volume.
    power = {"uniaxial": -0.5, "equibiaxial": -2.0, "pure_shear": -1.0}[mode]
    log_t = jnp.log(t)
    if incompressible:
        along = jax.grad(lambda x: energy(x, power * x))(log_t)
    else:
        u, found = _transverse(jax.grad(energy, argnums=1), log_t, power * log_t)
        along = jnp.where(found, jax.grad(energy)(log_t, u), jnp.nan)
    return along / t * (0.5 if mode == "equibiaxial" else 1.0)


def _prescribed(material: Material, theta: Array, amount: Array, place: tuple[int, int]) -> Array:
    """Component of the nominal stress where this component of F alone differs from rest, by ``amount``."""
    F = jnp.eye(3) + amount[:, None, None] * jnp.zeros((3, 3)).at[place].set(1.0)
    return mechanics.stress(material, F, theta)[:, *place]


def nominal_stress(material: Material, mode: str, incompressible: bool, theta: Array, path: Array) -> Array:
    """Nominal stress of one mode along a path, under ``jax.jit`` and ``jax.vmap`` too.

    Parameters
    ----------
    mode : str
        One of ``MODES``.
    theta : (n_parameters,) array
        Textbook values.
    path : (n,) array
        Stretches, or amounts of shear.

    Returns
    -------
    (n,) array
        [MPa]; NaN where no equilibrium was found.
    """
    if mode == "simple_shear":
        return _prescribed(material, theta, path, (0, 1))
    if mode == "confined_compression":
        return _prescribed(material, theta, path - 1.0, (0, 0))
    if not isinstance(material, IsotropicMaterial):
        return directional.nominal_stress(material, mode, incompressible, theta, path)
    return _free_stress(material, mode, incompressible, theta, path)


def compiled_stresses(
    material: Material, modes: tuple[str, ...], incompressible: bool, slopes: bool
) -> Callable[[FloatArray, dict[str, FloatArray]], dict[str, Array]]:
    """Compiled function of sets (n, n_parameters) and paths that gives stresses by mode, or their slopes."""

    def evaluate(thetas: Array, paths: dict[str, Array]) -> dict[str, Array]:
        def one(theta: Array) -> dict[str, Array]:
            stress = partial(nominal_stress, material)
            return {mode: stress(mode, incompressible, theta, paths[mode]) for mode in modes}

        return jax.vmap(jax.jacfwd(one) if slopes else one)(thetas)

    return jax.jit(evaluate)


def isochoric_slopes(material: Material, theta: FloatArray) -> FloatArray:
    """Derivatives (n_parameters, n) of the energy in the parameters, at constant volume."""
    if not isinstance(material, IsotropicMaterial):
        return directional.isochoric_slopes(material, theta)
    # Stretches at which an incompressible specimen's parameters are checked for an effect.
    t = jnp.asarray((0.6, 1.4, 2.0))
    modes = ((t, t**-0.5, t**-0.5), (t, 1 / t, t**0))
    stretches = jnp.concatenate([jnp.stack(mode, axis=-1) for mode in modes])
    slopes = jax.jit(jax.jacfwd(lambda theta: material.energy(stretches, theta)))(jnp.asarray(theta))
    return np.asarray(slopes).T
