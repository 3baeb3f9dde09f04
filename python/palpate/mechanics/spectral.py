"""Stress, tangent and initial moduli of any material, from its energy alone.

An energy is complete (it includes the volumetric part) and a function of the
principal stretches λ1, λ2, λ3. With F N_a = g_a, |g_a| = λ_a:

===========  =============================================================
variable     quantity
===========  =============================================================
``F``        deformation gradient
``P``        first Piola–Kirchhoff stress [MPa], P = Σ_a S_a g_a ⊗ N_a
``A``        tangent ∂P/∂F [MPa], ``A[i, J, k, L]`` = ∂P_iJ / ∂F_kL
``psi_i``    ∂Ψ/∂λ_i [MPa]; ``psi_ij`` = ∂²Ψ/∂λ_i∂λ_j [MPa]
``S_a``      principal second Piola–Kirchhoff stress ψ_a / λ_a [MPa]
``c_a``      λ_a², eigenvalues of C = FᵀF
===========  =============================================================

All functions are batched over the leading axes of ``F``, take one parameter
vector ``theta`` and work under ``jax.jit`` and ``jax.vmap`` (many parameter
sets: ``jax.vmap`` over ``theta``). Importing the module turns on JAX's 64-bit
mode, without which none of the tolerances below hold.
"""

from collections.abc import Callable, Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from palpate.domain import FloatArray
from palpate.domain.component import NO_FIELDS, Array
from palpate.domain.material import IsotropicMaterial, Material, check_number
from palpate.errors import NUMPY_IN_ENERGY, MaterialError
from palpate.mechanics.compilation_cache import keep_compilations

jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
keep_compilations()

# Where |c_a - c_b| <= EQUAL (c_a + c_b) the divided difference gives way to its limit.
# Cancellation grows as eps / EQUAL and truncation as m² EQUAL² / 12 for a stress ~ c^(m/2):
# here both are below 1e-10 for exponents m up to 16.
EQUAL = 3e-6

REST_TOLERANCE = 1e-8
"""Largest energy and stress at rest, relative to the shear modulus, of a sound material."""

Column = tuple[Array, ...]
Columns = tuple[Column, ...]


# ------------------------------------------------------- principal directions


def _rotate(pair: tuple[Column, Column], cosine: Array, sine: Array) -> tuple[Column, Column]:
    left, right = pair
    return (
        tuple(cosine * x - sine * y for x, y in zip(left, right, strict=True)),
        tuple(sine * x + cosine * y for x, y in zip(left, right, strict=True)),
    )


def _jacobi_angle(left: Column, right: Column) -> tuple[Array, Array]:
    """Cosine and sine of the rotation that makes two columns orthogonal."""
    dot = sum(x * y for x, y in zip(left, right, strict=True))
    difference = sum(y * y - x * x for x, y in zip(left, right, strict=True))
    orthogonal = dot == 0.0
    cotangent = difference / jnp.where(orthogonal, 1.0, 2.0 * dot)
    tangent = jnp.where(cotangent < 0.0, -1.0, 1.0) / (jnp.abs(cotangent) + jnp.sqrt(1.0 + cotangent**2))
    tangent = jnp.where(orthogonal, 0.0, tangent)
    cosine = 1.0 / jnp.sqrt(1.0 + tangent**2)
    return cosine, cosine * tangent


def _jacobi_sweep(_: int, state: tuple[Columns, Columns]) -> tuple[Columns, Columns]:
    g, n = map(list, state)
    for a, b in ((0, 1), (0, 2), (1, 2)):
        cosine, sine = _jacobi_angle(g[a], g[b])
        g[a], g[b] = _rotate((g[a], g[b]), cosine, sine)
        n[a], n[b] = _rotate((n[a], n[b]), cosine, sine)
    return tuple(g), tuple(n)


def _principal_columns(F: Array) -> tuple[Columns, Columns]:
    """Columns g_a = F N_a (orthogonal) and N_a (orthonormal), by one-sided Jacobi rotations.

    Three times as fast as a batched ``eigh`` of FᵀF, and small stretches keep
    their relative accuracy because FᵀF is never formed.
    """
    one, zero = jnp.ones_like(F[..., 0, 0]), jnp.zeros_like(F[..., 0, 0])
    g = tuple(tuple(F[..., i, a] for i in range(3)) for a in range(3))
    n = tuple(tuple(one if i == a else zero for i in range(3)) for a in range(3))
    # A loop, not an unrolled chain: XLA would fuse the chain into every entry of the tangent.
    # One-sided Jacobi converges quadratically: the fourth sweep reaches rounding, the fifth is margin.
    return jax.lax.fori_loop(0, 5, _jacobi_sweep, (g, n))


def _squared_stretches(g: Columns) -> Array:
    """c_a (..., 3), NaN where the volume is not positive: no energy is defined there."""
    c = jnp.stack([sum(x * x for x in column) for column in g], axis=-1)
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = g
    volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    return jnp.where((volume > 0.0)[..., None], c, jnp.nan)


# -------------------------------------------------- derivatives in stretches


def _psi_i(material: IsotropicMaterial, stretches: Array, theta: Array) -> Array:
    return jax.grad(lambda s: jnp.sum(material.energy(s, theta)))(stretches)


def principal_derivatives(material: IsotropicMaterial, stretches: Array, theta: Array) -> tuple[Array, Array]:
    """First and second derivatives of the energy in the principal stretches.

    Parameters
    ----------
    stretches : (..., 3) array
    theta : (n_parameters,) array
        Textbook values.

    Returns
    -------
    psi_i : (..., 3) array
        ∂Ψ/∂λ_i [MPa].
    psi_ij : (..., 3, 3) array
        ∂²Ψ/∂λ_i∂λ_j [MPa].
    """
    stretches = jnp.asarray(stretches, dtype=jnp.float64)
    theta = jnp.asarray(theta, dtype=jnp.float64)
    psi_i, along = jax.linearize(lambda s: _psi_i(material, s, theta), stretches)
    units = jnp.broadcast_to(jnp.eye(3), (*stretches.shape, 3))
    columns = [along(units[..., k]) for k in range(3)]
    return psi_i, jnp.stack(columns, axis=-1)


def _divided_differences(c: Array, S: Array, H: Array) -> tuple[Array, Array, Array]:
    """(S_a - S_b) / (c_a - c_b) for the pairs 01, 02, 12, with its limit at equal stretches.

    The limit is the mean over both ends of ½ (∂/∂c_a - ∂/∂c_b)(S_a - S_b), where
    ``H`` = 2 ∂S_a/∂c_b: symmetric in the pair, so its error is of second order.
    """

    def pair(a: int, b: int) -> Array:
        gap = c[..., a] - c[..., b]
        equal = jnp.abs(gap) <= EQUAL * (c[..., a] + c[..., b])
        limit = 0.25 * (H[..., a, a] + H[..., b, b] - 2.0 * H[..., a, b])
        return jnp.where(equal, limit, (S[..., a] - S[..., b]) / jnp.where(equal, 1.0, gap))

    return pair(0, 1), pair(0, 2), pair(1, 2)


# ----------------------------------------------------------- stress, tangent


def _isotropic_stress(material: IsotropicMaterial, F: Array, theta: Array) -> Array:
    g, n = _principal_columns(F)
    stretches = jnp.sqrt(_squared_stretches(g))
    S = _psi_i(material, stretches, theta) / stretches
    return _from_principal(S, g, n)


def _from_principal(S: Array, g: Columns, n: Columns) -> Array:
    """Σ_a S_a g_a ⊗ N_a, shape (..., 3, 3)."""
    rows = [
        jnp.stack([sum(S[..., a] * g[a][i] * n[a][j] for a in range(3)) for j in range(3)], axis=-1)
        for i in range(3)
    ]
    return jnp.stack(rows, axis=-2)


def _dyads(g: Columns, n: Columns) -> list[Array]:
    """Six dyads of C's change, each (..., 9): g_a ⊗ N_a, then g_a ⊗ N_b + g_b ⊗ N_a."""

    def outer(a: int, b: int) -> Array:
        return jnp.stack([g[a][i] * n[b][j] for i in range(3) for j in range(3)], axis=-1)

    return [outer(a, a) for a in range(3)] + [outer(a, b) + outer(b, a) for a, b in ((0, 1), (0, 2), (1, 2))]


def _isotropic_stress_and_tangent(material: IsotropicMaterial, F: Array, theta: Array) -> tuple[Array, Array]:
    g, n = _principal_columns(F)
    c = _squared_stretches(g)
    stretches = jnp.sqrt(c)
    psi_i, psi_ij = principal_derivatives(material, stretches, theta)
    S = psi_i / stretches
    H = psi_ij / (stretches[..., :, None] * stretches[..., None, :])
    H = H - jnp.eye(3) * (S / c)[..., None]
    shear = _divided_differences(c, S, H)
    dyads = _dyads(g, n)
    weighted = [sum(H[..., a, b, None] * dyads[a] for a in range(3)) for b in range(3)]
    weighted += [shear[k][..., None] * dyads[3 + k] for k in range(3)]
    # Sums of outer products: a batched matrix product of this size runs three times slower.
    material_part = sum(w[..., :, None] * d[..., None, :] for w, d in zip(weighted, dyads, strict=True))
    second = _from_principal(S, n, n)
    A = material_part.reshape((*F.shape[:-2], 3, 3, 3, 3))
    A = A + jnp.eye(3)[:, None, :, None] * second[..., None, :, None, :]
    return _from_principal(S, g, n), A


Fields = Mapping[str, Array]


def _pointwise(function: Callable[..., Array], F: Array, fields: Fields) -> Array:
    """Map a function of one F (3, 3), and of the fields there if there are any, over all leading axes."""
    n = F.ndim - 2
    own = (
        [{name: jnp.reshape(each, (-1, *each.shape[n:])) for name, each in fields.items()}] if fields else []
    )
    results = jax.vmap(function)(F.reshape((-1, 3, 3)), *own)
    return jax.tree.map(lambda r: r.reshape((*F.shape[:-2], *r.shape[1:])), results)


def _as_arrays(F: Array, theta: Array) -> tuple[Array, Array]:
    return jnp.asarray(F, dtype=jnp.float64), jnp.asarray(theta, dtype=jnp.float64)


def stress_and_tangent(
    material: Material, F: Array, theta: Array, fields: Fields = NO_FIELDS
) -> tuple[Array, Array]:
    """First Piola–Kirchhoff stress and its exact tangent.

    Spectral, with divided differences (Daleckii–Krein) in place of the
    derivative of an eigen-decomposition: exact, and finite, at equal stretches.
    Anisotropic materials are differentiated in F itself.

    Parameters
    ----------
    F : (..., 3, 3) array
        Deformation gradient. Where det F <= 0 the results are NaN.
    theta : (n_parameters,) array
        Textbook values.
    fields : mapping of name to (...) or (..., 3) array, optional
        Values at each F of the fields that the material takes.

    Returns
    -------
    P : (..., 3, 3) array
        [MPa]
    A : (..., 3, 3, 3, 3) array
        ``A[..., i, J, k, L]`` = ∂P_iJ / ∂F_kL [MPa].
    """
    F, theta = _as_arrays(F, theta)
    if isinstance(material, IsotropicMaterial):
        return _isotropic_stress_and_tangent(material, F, theta)
    gradient = jax.grad(material.energy_from_F)
    tangent = jax.jacfwd(gradient)
    return _pointwise(lambda f, *own: (gradient(f, theta, *own), tangent(f, theta, *own)), F, fields)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _stress(material: Material, F: Array, theta: Array, fields: Fields) -> Array:
    if isinstance(material, IsotropicMaterial):
        return _isotropic_stress(material, F, theta)
    return _pointwise(lambda f, *own: jax.grad(material.energy_from_F)(f, theta, *own), F, fields)


@_stress.defjvp
def _stress_jvp(
    material: Material, primals: tuple[Array, Array, Fields], tangents: tuple[Array, Array, Fields]
) -> tuple[Array, Array]:
    (F, theta, fields), (dF, dtheta, _) = primals, tangents
    P, A = stress_and_tangent(material, F, theta, fields)
    if isinstance(material, IsotropicMaterial):
        g, n = _principal_columns(F)
        stretches = jnp.sqrt(_squared_stretches(g))
        _, dpsi = jax.jvp(lambda t: _psi_i(material, stretches, t), (theta,), (dtheta,))
        dP = _from_principal(dpsi / stretches, g, n)
    else:
        energy = material.energy_from_F
        _, dP = jax.jvp(
            lambda t: _pointwise(lambda f, *own: jax.grad(energy)(f, t, *own), F, fields), (theta,), (dtheta,)
        )
    return P, dP + jnp.einsum("...iJkL,...kL->...iJ", A, dF)


def stress(material: Material, F: Array, theta: Array, fields: Fields = NO_FIELDS) -> Array:
    """First Piola–Kirchhoff stress alone, the cheap path for residuals.

    JAX differentiates it once in ``F`` and ``theta``, forward or reverse, with
    the exact tangent of :func:`stress_and_tangent`.

    Parameters
    ----------
    F : (..., 3, 3) array
        Where det F <= 0 the stress is NaN.
    theta : (n_parameters,) array
    fields : mapping of name to (...) or (..., 3) array, optional
        Values at each F of the fields that the material takes, held constant in every derivative.

    Returns
    -------
    (..., 3, 3) array
        [MPa]
    """
    return _stress(material, *_as_arrays(F, theta), dict(fields))


def cauchy_stress(material: Material, F: Array, theta: Array) -> Array:
    """Cauchy stress σ = P Fᵀ / det F [MPa], shape (..., 3, 3); arguments as for :func:`stress`."""
    F, theta = _as_arrays(F, theta)
    P = stress(material, F, theta)
    return jnp.einsum("...iJ,...kJ->...ik", P, F) / jnp.linalg.det(F)[..., None, None]


# ------------------------------------------------------------ reference state


def moduli_at_rest(material: Material, theta: Array) -> tuple[Array, Array]:
    """Shear and bulk modulus [MPa] of the tangent at rest, as JAX scalars and unchecked.

    The Voigt averages for an anisotropic material. For use under ``jax.vmap``;
    :func:`initial_moduli` is the checked form.
    """
    if not isinstance(material, IsotropicMaterial):
        _, A = stress_and_tangent(material, jnp.eye(3), theta)
        trace, double = jnp.einsum("iikk->", A), jnp.einsum("ikik->", A)
        swapped = jnp.einsum("ikki->", A)
        return (0.5 * (double + swapped) - trace / 3.0) / 10.0, trace / 9.0
    _, h = principal_derivatives(material, jnp.ones(3), theta)
    return _moduli(h)


def _moduli(h: Array) -> tuple[Array, Array]:
    """Shear and bulk modulus of an isotropic material by its second derivatives in stretches at rest."""
    return (h[0, 0] - h[0, 1]) / 2.0, (h[0, 0] + 2.0 * h[0, 1]) / 3.0


@partial(jax.jit, static_argnums=0)
def _rest(material: Material, theta: Array) -> tuple[Array, Array, Array, Array]:
    """Energy, largest stress, shear and bulk modulus at rest."""
    if isinstance(material, IsotropicMaterial):
        # All by one trace of the energy, which takes most of the time of the first call.
        both = jax.value_and_grad(lambda s: material.energy(s, theta))
        (energy, slope), along = jax.linearize(both, jnp.ones(3))
        moduli = _moduli(jnp.stack([along(unit)[1] for unit in np.eye(3)]))
    else:
        energy, slope = jax.value_and_grad(material.energy_from_F)(jnp.eye(3), theta)
        moduli = moduli_at_rest(material, theta)
    return energy, jnp.max(jnp.abs(slope)), *moduli


def initial_moduli(material: Material, theta: FloatArray) -> tuple[float, float]:
    """Return the initial shear modulus μ and bulk modulus κ [MPa] of any material.

    Parameters
    ----------
    theta : (n_parameters,) array
        Textbook values.

    Raises
    ------
    MaterialError
        The reference state is not free of energy and stress, or a modulus is
        not positive.
    ParameterError
        ``theta`` has another length.
    """
    check_number(material, theta)
    where = f"material '{material.name}' at {_named(material, theta)}"
    try:
        energy, largest, mu, kappa = map(float, _rest(material, jnp.asarray(theta, dtype=jnp.float64)))
    except jax.errors.TracerArrayConversionError:
        raise MaterialError(f"material '{material.name}': {NUMPY_IN_ENERGY}") from None
    if np.isnan(energy):
        raise MaterialError(
            f"{where}: the energy is NaN at unit stretches, where it must be 0; change the parameters, or "
            "correct the energy"
        )
    # A modulus that is missing altogether shows up as rounding of the other.
    least = REST_TOLERANCE * (mu + kappa)
    if not (mu > least and kappa > least):
        raise MaterialError(
            f"{where}: initial shear modulus {mu:g} MPa and bulk modulus {kappa:g} MPa must be positive; "
            "change the parameters, or give the energy a volumetric part"
        )
    for what, value in (("energy", energy), ("stress", largest)):
        if not abs(value) <= REST_TOLERANCE * mu:
            raise MaterialError(
                f"{where}: {what} {value:g} MPa in the undeformed state; "
                "an energy must have its minimum, zero, at unit stretches"
            )
    return mu, kappa


def check_reference_state(material: Material, theta: FloatArray) -> None:
    """Refuse parameters outside their physical range or without a sound reference state.

    Raises
    ------
    MaterialError
        As :func:`initial_moduli`, or a parameter is outside its physical range.
    """
    material.check(theta)
    initial_moduli(material, theta)


def _named(material: Material, theta: FloatArray) -> str:
    pairs = zip(material.parameters, np.asarray(theta), strict=True)
    return ", ".join(f"{p.name} = {value:g} {p.unit}".rstrip() for p, value in pairs)
