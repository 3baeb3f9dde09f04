"""Homogeneous tests of a material with fibres, against closed forms and a scalar root."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from palpate import AnisotropicMaterial, Parameter
from palpate.domain import HomogeneousTests, Job, Status
from palpate.domain.material import IsotropicMaterial
from palpate_jax.homogeneous import HomogeneousSettings, HomogeneousSolver

MU, K, KAPPA = 0.02, 0.05, 1.0
STRETCHES = np.linspace(0.7, 1.4, 8)


def parameter(name, kind="modulus"):
    unit = "MPa" if kind == "modulus" else ""
    return Parameter(name=name, unit=unit, lower=0.01, upper=1.0, kind=kind, description=name)


class Fibred(AnisotropicMaterial):
    """Standard reinforcing model whose direction is given with the parameters: one compilation."""

    name, summary = "fibred", "test material"
    parameters = (
        *(parameter(name) for name in ("mu", "k", "kappa")),
        *(parameter(name, "shape") for name in ("x", "y", "z")),
    )

    def energy_from_F(self, F, theta):  # noqa: N802 - the interface's name
        mu, k, kappa = theta[:3]
        J = jnp.linalg.det(F)
        ground = mu / 2 * (jnp.sum(F * F) * J ** (-2 / 3) - 3) + kappa / 2 * jnp.log(J) ** 2
        return ground + k / 2 * (jnp.sum((F @ theta[3:]) ** 2) - 1) ** 2


class Ground(IsotropicMaterial):
    """The same without fibres, in principal stretches."""

    name, summary, parameters = "ground", "test material", Fibred.parameters[:3:2]

    def energy(self, stretches, theta):
        J = jnp.prod(stretches, axis=-1)
        ground = theta[0] / 2 * (jnp.sum(stretches**2, axis=-1) * J ** (-2 / 3) - 3)
        return ground + theta[1] / 2 * jnp.log(J) ** 2


def stresses(solver, material, thetas, mode, path=STRETCHES):
    """Stress (n_sets, n) of one mode for each parameter set."""
    jobs = [
        Job(
            spot="strip",
            set_id=k,
            materials={"tissue": material},
            thetas={"tissue": np.array(theta)},
            protocol=HomogeneousTests(paths={mode: path}),
        )
        for k, theta in enumerate(thetas)
    ]
    solver.check(jobs[0], None)
    done = list(solver.simulate_many(jobs, None))
    assert [s.status for s in done] == [Status.OK] * len(jobs), [s.message for s in done]
    return np.array([s.response[mode].ordinate for s in done])


def fibre(*direction, k=K):
    return [MU, k, KAPPA, *(np.array(direction) / np.linalg.norm(direction))]


def fibre_slope(stretch):
    """Derivative of the fibre's energy in its stretch."""
    return 2 * K * (stretch**2 - 1) * stretch


def across(t):
    """Uniaxial stress across the fibres: their stretch y is where the energy is least."""
    y = brentq(lambda y: MU * (y - 1 / (t * t * y**3)) + fibre_slope(y), 0.3, 2.0, xtol=1e-15)
    return MU * (t - 1 / (t**3 * y * y))


def young_of_oblique_fibres(*direction):
    """Young's modulus along e1 of the linear elastic stiffness, whose shears are free."""
    a = np.array(direction)
    dyad = np.array([a[0] ** 2, a[1] ** 2, a[2] ** 2, a[1] * a[2], a[0] * a[2], a[0] * a[1]])
    volume = np.array([1, 1, 1, 0, 0, 0])
    stiffness = 2 * MU * np.diag([1, 1, 1, 0.5, 0.5, 0.5]) + 1e4 * np.outer(volume, volume)
    return 1 / np.linalg.inv(stiffness + 4 * K * np.outer(dyad, dyad))[0, 0]


@pytest.mark.slow
def test_uniaxial_stress_along_across_and_oblique():
    solver = HomogeneousSolver(HomogeneousSettings(incompressible=True))
    sets = [fibre(1, 0, 0), fibre(0, 1, 0), fibre(1, 2, 0), fibre(1, 0, 2), fibre(1, 1, 1, k=0.0)]
    t = np.append(STRETCHES, 1.0 + 1e-6)
    P = stresses(solver, Fibred(), sets, "uniaxial", t)
    np.testing.assert_allclose(P[0], MU * (t - t**-2) + fibre_slope(t), atol=1e-12)
    np.testing.assert_allclose(P[1], [across(x) for x in t], atol=1e-12)
    np.testing.assert_allclose(P[2], P[3], atol=1e-12)
    assert P[2, -1] / 1e-6 == pytest.approx(young_of_oblique_fibres(*sets[2][3:]), rel=1e-4)
    np.testing.assert_allclose(P[4], MU * (t - t**-2), atol=1e-12)


@pytest.mark.slow
def test_equibiaxial_stress_is_the_mean_of_both_directions():
    solver = HomogeneousSolver(HomogeneousSettings(incompressible=True))
    (P,) = stresses(solver, Fibred(), [fibre(1, 2, 0)], "equibiaxial")
    t = STRETCHES
    np.testing.assert_allclose(P, MU * (t - t**-5) + fibre_slope(t) / 2, atol=1e-12)


@pytest.mark.slow
def test_without_fibres_it_is_the_isotropic_result():
    solver = HomogeneousSolver()
    (P,) = stresses(solver, Fibred(), [fibre(1, 2, 2, k=0.0)], "pure_shear")
    (expected,) = stresses(solver, Ground(), [[MU, KAPPA]], "pure_shear")
    np.testing.assert_allclose(P, expected, atol=1e-12)


def test_an_incompressible_specimen_does_not_use_the_bulk_modulus():
    solver = HomogeneousSolver(HomogeneousSettings(incompressible=True))
    assert solver.ignored(Fibred()) == ("kappa",)
    assert HomogeneousSolver().ignored(Fibred()) == ()
