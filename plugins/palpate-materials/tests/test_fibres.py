"""The material with fibres: contract, closed forms, FEBio's formula, and its isotropic limits."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from palpate import mechanics
from palpate.api import HomogeneousTests, Job, Status
from palpate.testing import MaterialContract
from palpate_jax.homogeneous import HomogeneousSettings, HomogeneousSolver
from palpate_materials import Drucker, HolzapfelGasserOgden, Yeoh
from palpate_materials.fibres import FibreSettings
from palpate_materials.stability import DruckerSettings
from palpate_materials.uncoupled import YeohSettings

C1, K1, K2, KAPPA = ALIGNED = np.array([0.01, 0.03, 1.5, 1.0])
SPREAD = 0.1
DISPERSED = np.array([C1, K1, K2, SPREAD, KAPPA])
E1, E2, OBLIQUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (2.0, -2.0, 1.0)
CAUCHY = jax.jit(mechanics.cauchy_stress, static_argnums=0)
STRESS = jax.jit(mechanics.stress, static_argnums=0)


def material(**settings):
    return HolzapfelGasserOgden(FibreSettings(**settings))


def theta_of(dispersion):
    return DISPERSED if dispersion else ALIGNED


class TestFibres(MaterialContract):
    @pytest.fixture(
        params=[
            pytest.param({"direction": OBLIQUE}, id="one direction", marks=pytest.mark.slow),
            pytest.param({}, id="the limb's axis", marks=pytest.mark.slow),
            pytest.param({"dispersion": True, "terms": 3}, id="dispersed in yeoh"),
        ],
    )
    def material(self, request):
        return material(**request.param)

    @pytest.fixture
    def gradients(self):
        """Leave out rest and change of volume alone: the tangent of fibres in tension alone jumps there."""
        e = self.largest_strain
        random = np.random.default_rng(1).uniform(-e, e, (3, 3, 3))
        return np.eye(3) + np.concatenate([[np.diag([e, -e / 2, -e / 2]), np.diag([e, e, -e])], random])


@pytest.mark.slow
class TestSmoothFibres(MaterialContract):
    """Fibres that bear compression too: nothing jumps, at rest neither."""

    @pytest.fixture(params=[False, True], ids=["aligned", "dispersed"])
    def material(self, request):
        return material(tension_only=False, dispersion=request.param)


def invariants(t, y, d):
    """E and its derivatives in Ĩ1 and Ĩ4 at constant volume: stretch y of the fibres, t and 1/ty across."""
    E = d * (t**2 + y**2 + 1 / (t * y) ** 2 - 3) + (1 - 3 * d) * (y**2 - 1)
    return np.maximum(E, 0.0)


def slopes(E, d):
    """∂Ψ/∂Ĩ1 and ∂Ψ/∂Ĩ4 of one neo-Hookean ground and the fibres."""
    by_E = K1 * E * np.exp(K2 * E**2)
    return C1 + d * by_E, (1 - 3 * d) * by_E


def pulled(direction, t, dispersion):
    """Nominal stress of an incompressible strip that is pulled along e1."""
    job = Job(
        spot="strip",
        set_id=0,
        materials={"strip": material(direction=direction, dispersion=dispersion)},
        thetas={"strip": theta_of(dispersion)},
        protocol=HomogeneousTests(paths={"uniaxial": t}),
    )
    simulation = HomogeneousSolver(HomogeneousSettings(incompressible=True)).simulate(job, None)
    assert simulation.status is Status.OK, simulation.message
    return simulation.response["uniaxial"].ordinate


@pytest.mark.slow
@pytest.mark.parametrize("dispersion", [False, True])
def test_a_strip_along_the_fibres(dispersion):
    """P = 2 Ψ1 (t − t⁻²) + 2 Ψ4 t, the sides free and equal."""
    t, d = np.linspace(0.7, 1.5, 9), SPREAD * dispersion
    first, fourth = slopes(invariants(t**-0.5, t, d), d)
    expected = 2 * first * (t - t**-2) + 2 * fourth * t
    np.testing.assert_allclose(pulled(E1, t, dispersion), expected, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("dispersion", [False, True])
def test_a_strip_across_the_fibres(dispersion):
    """P = 2 Ψ1 (t − 1/(t³ y²)), with the stretch y of the fibres where their direction is free of stress."""
    d = SPREAD * dispersion

    def sideways(y, t):
        first, fourth = slopes(invariants(t, y, d), d)
        return first * (y - 1 / (t * t * y**3)) + fourth * y

    def across(t):
        y = brentq(partial(sideways, t=t), 0.4, 2.0, xtol=1e-15)
        first, _ = slopes(invariants(t, y, d), d)
        return 2 * first * (t - 1 / (t**3 * y * y))

    t = np.linspace(0.7, 1.5, 8)
    np.testing.assert_allclose(pulled(E2, t, dispersion), [across(x) for x in t], atol=1e-10)


@pytest.mark.parametrize("dispersion", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 150.0])
def test_simple_shear(degrees, dispersion):
    """σ12 = 2 Ψ1 γ + 2 Ψ4 (c + γ s) s; fibres along the shear are not lengthened and bear nothing of it."""
    c, s, d = np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), SPREAD * dispersion
    own = material(direction=(c, s, 0.0), dispersion=dispersion)
    for gamma in (-0.4, 0.2, 0.6):
        fourth_invariant = (c + gamma * s) ** 2 + s**2
        E = max(d * gamma**2 + (1 - 3 * d) * (fourth_invariant - 1), 0.0)
        first, fourth = slopes(E, d)
        F = np.array([[1.0, gamma, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        expected = 2 * first * gamma + 2 * fourth * (c + gamma * s) * s
        assert CAUCHY(own, F, theta_of(dispersion))[0, 1] == pytest.approx(expected, rel=1e-12)


def febio_cauchy(F, c, k1, k2, kappa, k, a):
    """Cauchy stress of FEBio 4's uncoupled ``Holzapfel-Gasser-Ogden`` with γ = 0, as its code forms it.

    dev(c b̃ + 2 Σ_α k1 E exp(k2 E²) h)/J where E ≥ 0, h = κ b̃ + (1 − 3κ) ã⊗ã, two families that coincide,
    and the pressure k ln J / J of its default volumetric energy.
    """
    J = np.linalg.det(F)
    Ft = F * J ** (-1 / 3)
    b, fibre = Ft @ Ft.T, Ft @ a
    E = kappa * (np.trace(b) - 3) + (1 - 3 * kappa) * (fibre @ fibre - 1)
    stress = c * b
    for _ in range(2):
        if E >= 0:
            h = kappa * b + (1 - 3 * kappa) * np.outer(fibre, fibre)
            stress = stress + h * (2 * k1 * E * np.exp(k2 * E * E))
    return (stress - np.trace(stress) / 3 * np.eye(3)) / J + k * np.log(J) / J * np.eye(3)


@pytest.mark.parametrize("dispersion", [False, True])
def test_stress_is_febios(dispersion):
    own, a = material(direction=OBLIQUE, dispersion=dispersion), np.array(OBLIQUE) / 3.0
    shown = [0, 0]
    for entries in np.random.default_rng(3).uniform(-0.3, 0.3, (20, 3, 3)):
        F = np.eye(3) + entries
        numbers = 2 * C1, K1 / 2, K2, SPREAD * dispersion, KAPPA
        expected = febio_cauchy(F, *numbers, a)
        np.testing.assert_allclose(CAUCHY(own, F, theta_of(dispersion)), expected, rtol=1e-10, atol=1e-14)
        shown[int(np.linalg.norm(F @ a) ** 3 > np.linalg.det(F))] += 1
    assert min(shown) > 3, "of lengthened and of shortened fibres"


def deformations():
    return np.eye(3) + np.random.default_rng(0).uniform(-0.25, 0.25, (6, 3, 3))


@pytest.mark.parametrize("terms", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_without_stiffness_it_is_its_ground(terms):
    ground = np.array([0.012, -1e-3, 1e-4])[:terms]
    theta = np.concatenate([ground, [0.0, K2, KAPPA]])
    expected = STRESS(Yeoh(YeohSettings(terms=terms)), deformations(), np.append(ground, KAPPA))
    own = material(terms=terms, direction=OBLIQUE)
    np.testing.assert_allclose(STRESS(own, deformations(), theta), expected, rtol=1e-9, atol=1e-14)
    theta[terms] = 1e-9
    np.testing.assert_allclose(STRESS(own, deformations(), theta), expected, atol=1e-8)


@pytest.mark.slow
def test_fibres_dispersed_all_around_have_no_direction():
    theta = np.array([C1, K1, K2, 1 / 3, KAPPA])
    one, other = (
        STRESS(material(direction=a, dispersion=True), deformations(), theta) for a in (E1, OBLIQUE)
    )
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-14)


def test_dispersion_of_zero_is_alignment():
    theta = np.array([C1, K1, K2, 0.0, KAPPA])
    dispersed = STRESS(material(direction=OBLIQUE, dispersion=True), deformations(), theta)
    aligned = STRESS(material(direction=OBLIQUE), deformations(), ALIGNED)
    np.testing.assert_allclose(dispersed, aligned, rtol=1e-12, atol=1e-15)


def test_turning_the_body_about_its_fibres_changes_nothing():
    own, axis, angle = material(direction=OBLIQUE, dispersion=True), np.array(OBLIQUE) / 3.0, 0.7
    cross = np.cross(np.eye(3), axis)
    about = np.eye(3) - np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    P, turned = (np.asarray(STRESS(own, F, DISPERSED)) for F in (deformations(), deformations() @ about))
    np.testing.assert_allclose(turned, P @ about, rtol=1e-9, atol=1e-13)
    elsewhere = about[[1, 2, 0]][:, [1, 2, 0]]
    assert np.abs(STRESS(own, deformations() @ elsewhere, DISPERSED) - P @ elsewhere).max() > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("tension_only", [False, True])
def test_slopes_in_every_parameter(tension_only):
    own = material(terms=2, direction=OBLIQUE, dispersion=True, tension_only=tension_only)
    theta = np.array([0.012, -1e-3, K1, K2, SPREAD, KAPPA])
    exact = np.asarray(jax.jacfwd(lambda t: STRESS(own, deformations(), t))(jnp.asarray(theta)))
    for k, value in enumerate(theta):
        step = np.zeros(theta.size)
        step[k] = 1e-5 * abs(value)
        rise = np.asarray(STRESS(own, deformations(), theta + step))
        rise = rise - np.asarray(STRESS(own, deformations(), theta - step))
        off = 1e-7 * np.abs(exact[..., k]).max()
        np.testing.assert_allclose(exact[..., k], rise / (2 * step[k]), atol=off)


def test_initial_moduli_are_those_of_the_ground():
    """In the unstrained state fibres in tension alone do not bear yet."""
    assert mechanics.initial_moduli(material(), ALIGNED) == pytest.approx((2 * C1, KAPPA))
    both = material(tension_only=False)
    # Voigt's average of 4 k1 e_a e_a over all directions adds 4 k1 (2/15) to twice the shear modulus.
    assert mechanics.initial_moduli(both, ALIGNED)[0] == pytest.approx(2 * C1 + 4 * K1 / 15, rel=1e-9)


@pytest.mark.parametrize("dispersion", [0.0, SPREAD, 1 / 3])
def test_small_strains_along_the_fibres_meet_them(dispersion):
    stretch, theta = 1.0 + 1e-4, np.array([C1, K1, K2, dispersion, KAPPA])
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    energy = material(direction=E1, dispersion=True).energy_from_F(F, theta)
    modulus = 2.0 * float(energy) / 1e-8
    assert modulus == pytest.approx(6 * C1 + 4 * K1 * (1 - 3 * dispersion) ** 2, rel=1e-3)


@pytest.mark.slow
def test_fibres_in_tension_alone_are_stable():
    """Those that bear compression soften there: the slope of E² in the logarithmic strain falls."""
    drucker = Drucker(DruckerSettings(least_stretch=0.7, largest_stretch=2.0, n_stretches=7))
    accepted = [drucker.stable(material(tension_only=x), ALIGNED[None])[0] for x in (True, False)]
    assert accepted == [True, False]


def test_a_direction_is_no_zero_and_takes_no_field():
    assert material().fields == ("axis",)
    assert material(field="fibre").fields == ("fibre",)
    assert material(direction=E1).fields == ()
    with pytest.raises(ValueError, match="points nowhere"):
        FibreSettings(direction=(0.0, 0.0, 0.0))
