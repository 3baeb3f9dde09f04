"""Stress, tangent and moduli of an energy, against derivatives that were computed otherwise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from palpate import mechanics
from palpate.domain import Parameter
from palpate.domain.material import AnisotropicMaterial, IsotropicMaterial
from palpate.errors import MaterialError, ParameterError, PluginError
from palpate.plugins.guard import answering_for

THETA = np.array([0.061, 3.1, 1.3])
stress = jax.jit(mechanics.stress, static_argnums=0)
stress_and_tangent = jax.jit(mechanics.stress_and_tangent, static_argnums=0)


def parameter(name):
    return Parameter(name=name, unit="MPa", lower=0.0, upper=9.0, kind="modulus", description=name)


class PowerLaw(IsotropicMaterial):
    """One Ogden term, from principal stretches."""

    name = "power_law"
    summary = "test material"
    parameters = (parameter("c"), parameter("m"), parameter("kappa"))

    def energy(self, stretches, theta):
        xp = stretches.__array_namespace__()
        c, m, kappa = theta
        J = xp.prod(stretches, axis=-1)
        powers = xp.sum((stretches * J[..., None] ** (-1 / 3)) ** m, axis=-1)
        return c / m**2 * (powers - 3) + kappa / 2 * xp.log(J) ** 2


class InF(AnisotropicMaterial):
    """The power law with m = 2 again, and fibres along e1, written in F."""

    name = "in_f"
    summary = "test material"
    parameters = (parameter("c"), parameter("fibre"), parameter("kappa"))

    def energy_from_F(self, F, theta):  # noqa: N802 - the interface's name
        c, fibre, kappa = theta
        J, C = jnp.linalg.det(F), F.T @ F
        ground = c / 4 * (jnp.trace(C) * J ** (-2 / 3) - 3) + kappa / 2 * jnp.log(J) ** 2
        return ground + fibre / 2 * (C[0, 0] - 1) ** 2


POWER_LAW, IN_F = PowerLaw(), InF()


def rotation(seed):
    Q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return Q * np.linalg.det(Q)


def with_stretches(*stretches):
    """Deformation gradient with these principal stretches along general directions."""
    return rotation(1) @ np.diag(stretches) @ rotation(2)


STATES = {
    "rest": np.eye(3),
    "rotated": rotation(3),
    "three_equal": with_stretches(1.1, 1.1, 1.1),
    "two_equal": with_stretches(1.4, 0.8, 0.8),
    "two_nearly_equal": with_stretches(1.4, 0.8, 0.8 * (1 + 3e-6)),
    "at_the_threshold": with_stretches(1.4, 0.8, 0.8 * (1 + 2.9e-6)),
    "distinct": with_stretches(2.5, 0.9, 0.35),
    "diagonal": np.diag([0.7, 1.3, 1.0]),
}


def complex_step_tangent(F, theta, h=1e-30):
    """∂P/∂F of the power law with m = 2 by complex steps of its closed-form stress."""
    c, kappa = theta
    A = np.empty((3, 3, 3, 3))
    for k, m in np.ndindex(3, 3):
        G = F.astype(complex)
        G[k, m] += 1j * h
        J, inverse = np.linalg.det(G), np.linalg.inv(G).T
        P = c / 2 * J ** (-2 / 3) * (G - np.trace(G.T @ G) / 3 * inverse) + kappa * np.log(J) * inverse
        A[:, :, k, m] = P.imag / h
    return A


@pytest.mark.parametrize("F", STATES.values(), ids=STATES)
def test_tangent_is_the_complex_steps(F):
    theta = np.array([0.061, 2.0, 1.3])
    _, A = stress_and_tangent(POWER_LAW, F, theta)
    expected = complex_step_tangent(F, theta[[0, 2]])
    np.testing.assert_allclose(A, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("F", STATES.values(), ids=STATES)
def test_tangent_of_a_general_exponent_is_the_slope_of_the_stress(F):
    material, step = POWER_LAW, 1e-5
    P, A = stress_and_tangent(material, F, THETA)
    np.testing.assert_allclose(P, stress(material, F, THETA), atol=1e-14)
    for k, m in np.ndindex(3, 3):
        dF = np.zeros((3, 3))
        dF[k, m] = step
        rise = stress(material, F + dF, THETA) - stress(material, F - dF, THETA)
        np.testing.assert_allclose(A[:, :, k, m], rise / (2 * step), atol=3e-9 * np.abs(A).max())


class WithNumpy(IsotropicMaterial):
    name = "with_numpy"
    summary = "calls numpy"
    parameters = POWER_LAW.parameters

    def energy(self, stretches, theta):
        return np.sum(np.asarray(stretches) ** 2, axis=-1)


def test_an_energy_that_calls_numpy_gets_the_function_to_call():
    with pytest.raises(MaterialError, match=r"'with_numpy': .* calls numpy: take xp = stretches\.__array_na"):
        mechanics.initial_moduli(WithNumpy(), THETA)
    message = r"raised TracerArrayConversionError; JAX cannot .* xp = stretches"
    with pytest.raises(PluginError, match=message), answering_for(WithNumpy(), "filtering the design"):
        mechanics.stress(WithNumpy(), np.eye(3), THETA)


def test_divided_difference_and_limit_agree_where_they_meet(monkeypatch):
    F = with_stretches(1.5, 0.9, 0.9 * (1 + 0.99 * mechanics.EQUAL))
    thetas = [np.array([0.1, power, 1.0]) for power in (-8.0, 8.0)]
    limits = [stress_and_tangent(POWER_LAW, F, theta)[1] for theta in thetas]
    monkeypatch.setattr(mechanics.spectral, "EQUAL", 0.0)
    retraced = jax.jit(lambda theta: mechanics.stress_and_tangent(POWER_LAW, F, theta)[1])
    for limit, theta in zip(limits, thetas, strict=True):
        divided = retraced(theta)
        assert np.any(limit != divided)
        np.testing.assert_allclose(limit, divided, atol=1e-9 * np.abs(limit).max())


@pytest.mark.slow
def test_derivative_passes_through_the_stress():
    """Forward and reverse, in F and in theta, at equal stretches."""
    F = jnp.asarray(STATES["two_equal"])
    _, A = stress_and_tangent(POWER_LAW, F, THETA)
    forward, reverse = (
        jax.jit(jacobian(mechanics.stress, (1, 2)), static_argnums=0)(POWER_LAW, F, jnp.asarray(THETA))
        for jacobian in (jax.jacfwd, jax.jacrev)
    )
    for in_F, in_theta in (forward, reverse):
        np.testing.assert_allclose(in_F, A, atol=1e-13)
        np.testing.assert_allclose(in_theta, forward[1], atol=1e-13)
    for k, step in enumerate([1e-6, 1e-5, 1e-5]):
        d = step * np.eye(3)[k]
        slope = (stress(POWER_LAW, F, THETA + d) - stress(POWER_LAW, F, THETA - d)) / (2 * step)
        np.testing.assert_allclose(forward[1][..., k], slope, atol=1e-9)


@pytest.mark.slow
def test_stacks_and_vmap_agree_with_single_points():
    material = POWER_LAW
    F = np.array(list(STATES.values())).reshape(2, 4, 3, 3)
    P, A = stress_and_tangent(material, F, THETA)
    assert P.shape == (2, 4, 3, 3)
    assert A.shape == (2, 4, 3, 3, 3, 3)
    single = stress_and_tangent(material, F[1, 2], THETA)
    np.testing.assert_allclose(P[1, 2], single[0], atol=1e-15)
    np.testing.assert_allclose(A[1, 2], single[1], atol=1e-13)
    thetas = np.stack([THETA, 2 * THETA])
    many = jax.jit(jax.vmap(lambda t: mechanics.stress(material, F, t)))(thetas)
    np.testing.assert_allclose(many[1], stress(material, F, thetas[1]), atol=1e-13)


def test_an_inverted_point_has_no_stress():
    P, A = stress_and_tangent(POWER_LAW, np.diag([1.0, 1.0, -1.0]), THETA)
    assert np.isnan(P).all()
    assert np.isnan(A).any()


def test_cauchy_stress_is_symmetric_and_pushed_forward():
    F = STATES["distinct"]
    sigma = np.asarray(mechanics.cauchy_stress(POWER_LAW, F, THETA))
    np.testing.assert_allclose(sigma, sigma.T, atol=1e-14)
    P = np.asarray(stress(POWER_LAW, F, THETA))
    np.testing.assert_allclose(sigma, P @ F.T / np.linalg.det(F), atol=1e-14)


@pytest.mark.slow
def test_anisotropic_energy_is_differentiated_directly():
    F, theta = STATES["distinct"], np.array([0.061, 0.2, 1.3])
    P, A = stress_and_tangent(IN_F, F, theta)
    ground, _ = stress_and_tangent(POWER_LAW, F, np.array([0.061, 2.0, 1.3]))
    # Only F's first column, e1's image, carries fibre stress: P = 2 k (C11 - 1) F e1 ⊗ e1.
    fibre = 2 * 0.2 * ((F.T @ F)[0, 0] - 1) * np.outer(F[:, 0], [1, 0, 0])
    np.testing.assert_allclose(P, ground + fibre, atol=1e-13)
    np.testing.assert_allclose(
        jax.jit(jax.jacfwd(mechanics.stress, 1), static_argnums=0)(IN_F, F, theta), A, atol=1e-13
    )


def test_initial_moduli():
    assert mechanics.initial_moduli(POWER_LAW, THETA) == pytest.approx((0.061 / 2, 1.3), rel=1e-12)
    # Without fibres the anisotropic material is the isotropic one, and Voigt's averages are its moduli.
    assert mechanics.initial_moduli(IN_F, np.array([0.061, 0.0, 1.3])) == pytest.approx(
        (0.061 / 2, 1.3), rel=1e-12
    )


def test_moduli_at_too_few_values_are_refused():
    with pytest.raises(ParameterError, match=f"takes {THETA.size} parameters, got 1"):
        mechanics.initial_moduli(POWER_LAW, THETA[:1])


class Offset(PowerLaw):
    name = "offset"

    def energy(self, stretches, theta):
        return super().energy(stretches, theta) + 0.01


class Prestressed(PowerLaw):
    name = "prestressed"

    def energy(self, stretches, theta):
        xp = stretches.__array_namespace__()
        return super().energy(stretches, theta) + 0.01 * xp.log(xp.prod(stretches, axis=-1))


@pytest.mark.parametrize(
    ("material", "theta", "what"),
    [
        (Offset(), THETA, "energy 0.01 MPa"),
        (Prestressed(), THETA, "stress 0.01 MPa"),
        (POWER_LAW, THETA * [-1, 1, 1], "shear modulus -0.0305 MPa"),
        (POWER_LAW, THETA * [1, 1, 0], "volumetric part"),
        (POWER_LAW, THETA * [1, 0, 1], "the energy is NaN at unit stretches, where it must be 0"),
    ],
)
def test_unsound_reference_state_is_refused(material, theta, what):
    with pytest.raises(MaterialError, match=what) as caught:
        mechanics.initial_moduli(material, theta)
    assert f"'{material.name}' at c = " in str(caught.value)


def test_check_covers_the_physical_range():
    with pytest.raises(MaterialError, match="takes 3 parameters"):
        mechanics.check_reference_state(POWER_LAW, THETA[:2])
    mechanics.check_reference_state(POWER_LAW, THETA)


def test_equal_materials_share_what_is_compiled():
    traced = []

    class Counted(PowerLaw):
        def energy(self, stretches, theta):
            traced.append(self)
            return super().energy(stretches, theta)

    assert Counted() == Counted()
    assert Counted() != PowerLaw()
    mechanics.initial_moduli(Counted(), THETA)
    n_traced = len(traced)
    mechanics.initial_moduli(Counted(), 2 * THETA)
    assert len(traced) == n_traced > 0
