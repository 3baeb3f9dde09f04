"""Fits to Treloar's rubber that others published: three modes of one material."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.domain import HomogeneousTests, Job
from palpate_jax.homogeneous import HomogeneousSettings, HomogeneousSolver
from palpate_materials import ArrudaBoyce, Gent, Ogden, Yeoh
from palpate_materials.uncoupled import OgdenSettings

FOLDER = Path(__file__).parents[1] / "data" / "treloar_1944"
FILES = {"uniaxial": "UT", "equibiaxial": "ET", "pure_shear": "PS"}
MEASURED = {mode: np.loadtxt(FOLDER / f"{f}.csv", delimiter=",", skiprows=1) for mode, f in FILES.items()}
KAPPA = 1.0  # plays no part: the tests are incompressible


@pytest.fixture(scope="module")
def solver():
    return HomogeneousSolver(HomogeneousSettings(incompressible=True))


def residuals(solver, material, theta, modes=tuple(FILES)):
    """Simulated minus measured stress [MPa] by mode."""
    job = Job(
        spot="specimen",
        set_id=0,
        materials={"rubber": material},
        thetas={"rubber": np.append(theta, KAPPA)},
        protocol=HomogeneousTests(paths={mode: data[:, 0] for mode, data in MEASURED.items()}),
    )
    response = solver.simulate(job, None).response
    return {mode: response[mode].ordinate - MEASURED[mode][:, 1] for mode in modes}


def fitted(solver, modes, material=None, start=(0.2, -1e-3, 4e-5)):
    """Unweighted least squares over the points of all modes."""
    return least_fit(
        lambda c: np.concatenate(list(residuals(solver, material or Yeoh(), c, modes).values())), start
    )


def least_fit(misfit, start):
    return least_squares(misfit, start, x_scale=np.abs(start), xtol=1e-14, ftol=1e-14, gtol=1e-14)


def test_joint_yeoh_fit_is_the_known_one(solver):
    fit = fitted(solver, tuple(FILES))
    np.testing.assert_allclose(fit.x, [0.1847019, -0.001464556, 4.021503e-5], rtol=2e-6)
    # scipy's cost is half the sum of squares.
    assert fit.cost == pytest.approx(0.504396, abs=1e-6)


def test_a_single_mode_misleads(solver):
    fit = fitted(solver, ("uniaxial",))
    wrong = residuals(solver, Yeoh(), fit.x)["equibiaxial"]
    measured = MEASURED["equibiaxial"][:, 1]
    r_squared = 1.0 - np.sum(wrong**2) / np.sum((measured - measured.mean()) ** 2)
    assert r_squared == pytest.approx(0.883, abs=5e-4)


def test_ogdens_three_terms_of_1972(solver):
    mu, alpha = np.array([0.63, 0.0012, -0.01]), np.array([1.3, 5.0, -2.0])
    theta = np.column_stack([mu * alpha, alpha]).ravel()
    off = residuals(solver, Ogden(OgdenSettings(terms=3)), theta)
    rmse = [np.sqrt(np.mean(off[mode] ** 2)) for mode in FILES]
    np.testing.assert_allclose(rmse, [0.310, 0.041, 0.025], atol=5e-4)


FIRST_INVARIANT = {
    "uniaxial": (lambda t: t**2 + 2 / t, lambda t: 2 * (t - t**-2)),
    "equibiaxial": (lambda t: 2 * t**2 + t**-4, lambda t: 2 * (t - t**-5)),
    "pure_shear": (lambda t: t**2 + 1 + t**-2, lambda t: 2 * (t - t**-3)),
}
"""I1 of a stretch, and the factor of dΨ/dI1 in the nominal stress of incompressible rubber."""


def gent_slope(theta, first):
    """dΨ/dI1 of Gent, A new constitutive relation for rubber, Rubber Chem. Technol. 69 (1996) 59."""
    mu, limit = theta
    return 0.5 * mu * limit / (limit - first + 3.0)


def eight_chain_slope(theta, first):
    """dΨ/dI1 of Arruda & Boyce, J. Mech. Phys. Solids 41 (1993) 389, in the five terms that they print."""
    mu, links = theta
    x = first / links
    return mu * (1 / 2 + x / 10 + 11 / 350 * x**2 + 19 / 1750 * x**3 + 519 / 134750 * x**4)


LAWS = [(Gent(), gent_slope, (0.3, 80.0)), (ArrudaBoyce(), eight_chain_slope, (0.27, 25.0))]


@pytest.mark.parametrize(("material", "slope", "start"), LAWS, ids=lambda each: getattr(each, "name", ""))
def test_laws_of_limited_chains_are_those_of_the_literature(solver, material, slope, start):
    """Stress in each mode, and the joint fit against a least squares of the printed formula."""

    def misfit(theta):
        parts = []
        for mode, (first, factor) in FIRST_INVARIANT.items():
            t, stress = MEASURED[mode].T
            parts.append(slope(theta, first(t)) * factor(t) - stress)
        return np.concatenate(parts)

    off = residuals(solver, material, np.array(start))
    np.testing.assert_allclose(np.concatenate(list(off.values())), misfit(start), atol=1e-12)
    expected = least_fit(misfit, start)
    np.testing.assert_allclose(fitted(solver, tuple(FILES), material, start).x, expected.x, rtol=1e-6)


def test_the_modulus_of_the_network_is_the_published_one(solver):
    """Arruda & Boyce 1993 have n k T = 0.27 MPa for these data; their N = 26.5 is of the whole series."""
    fit = fitted(solver, tuple(FILES), ArrudaBoyce(), (0.27, 25.0))
    assert fit.x[0] == pytest.approx(0.27, rel=0.03)


def test_more_terms_of_ogden_describe_more(solver):
    """Three terms from the values of 1972 leave 0.2 MPa² of 2.6; Yeoh's three leave 1.0."""
    start = np.array([0.82, 1.3, 0.006, 5.0, 0.02, -2.0])
    fit = fitted(solver, tuple(FILES), Ogden(OgdenSettings(terms=3)), start)
    off = residuals(solver, Ogden(OgdenSettings(terms=3)), start)
    assert sum(np.sum(each**2) for each in off.values()) == pytest.approx(2.34, abs=0.02)
    assert 2.0 * fit.cost < 0.25
