"""Fits to Treloar's rubber that others published: three modes of one material."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.domain import HomogeneousTests, Job
from palpate_jax.homogeneous import HomogeneousSettings, HomogeneousSolver
from palpate_materials import Ogden, Yeoh
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


def fitted(solver, modes):
    """Unweighted least squares over the points of all modes."""
    start = np.array([0.2, -1e-3, 4e-5])
    return least_squares(
        lambda c: np.concatenate(list(residuals(solver, Yeoh(), c, modes).values())),
        start,
        x_scale=np.abs(start),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )


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
