"""An interval holds every set that is about as good, and no more than it must."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from palpate.determination import LEAST_Q2, fit_slopes

SEEDS = st.integers(0, 2**32 - 1)


def linear_problem(seed, n_parameters, n_sets=60, n_points=25):
    random = np.random.default_rng(seed)
    steps = random.uniform(-0.5, 0.5, (n_sets, n_parameters))
    slopes = random.normal(size=(n_parameters, n_points))
    offset = 0.1 * random.normal(size=n_points)
    return steps, offset + steps @ slopes, offset, slopes


@settings(max_examples=25)
@given(seed=SEEDS, n_parameters=st.integers(1, 4), more=st.floats(0.01, 3.0))
def test_where_curves_follow_the_parameters_the_ends_are_the_farthest_sets_as_good(seed, n_parameters, more):
    steps, residuals, offset, slopes = linear_problem(seed, n_parameters)
    fopt = (residuals**2).sum(axis=1)
    limit = float(offset @ offset) * (1.0 + more)
    found = fit_slopes(steps, residuals, fopt)
    assert found is not None
    assert found.q2 > 1.0 - 1e-9
    ellipsoid = found.ellipsoid(limit)
    assert ellipsoid is not None
    low, high = ellipsoid.centre - ellipsoid.half_widths, ellipsoid.centre + ellipsoid.half_widths
    as_good = steps[fopt <= limit]
    assert (as_good >= low - 1e-9).all()
    assert (as_good <= high + 1e-9).all()
    # An optimiser that knows nothing of ellipsoids goes as far, and no farther.
    farthest = minimize(
        lambda u: -u[0],
        ellipsoid.centre,
        constraints={"type": "ineq", "fun": lambda u: limit - ((offset + u @ slopes) ** 2).sum()},
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assume(farthest.success)
    np.testing.assert_allclose(farthest.x[0], high[0], rtol=1e-3, atol=1e-6)


@settings(max_examples=40)
@given(seed=SEEDS, larger=st.floats(1.1, 10.0))
def test_a_wider_limit_makes_no_interval_narrower(seed, larger):
    steps, residuals, offset, _ = linear_problem(seed, 3)
    found = fit_slopes(steps, residuals, (residuals**2).sum(axis=1))
    limit = float(offset @ offset) * 1.5
    narrow, wide = found.ellipsoid(limit), found.ellipsoid(limit * larger)
    assert (wide.half_widths >= narrow.half_widths).all()


@settings(max_examples=40)
@given(seed=SEEDS)
def test_curves_of_second_degree_have_the_slopes_at_the_best_set(seed):
    steps, residuals, offset, slopes = linear_problem(seed, 2)
    bend = np.random.default_rng(seed + 1).normal(size=residuals.shape[1])
    bent = residuals + np.outer(steps[:, 0] * steps[:, 1] + steps[:, 0] ** 2, bend)
    found = fit_slopes(steps, bent, (bent**2).sum(axis=1))
    np.testing.assert_allclose(found.slopes, slopes, atol=1e-8)
    np.testing.assert_allclose(found.residuals, offset, atol=1e-8)


@settings(max_examples=40)
@given(seed=SEEDS)
def test_noise_is_not_taken_for_an_answer(seed):
    random = np.random.default_rng(seed)
    steps, residuals = random.uniform(-0.5, 0.5, (20, 3)), random.normal(size=(20, 40))
    found = fit_slopes(steps, residuals, (residuals**2).sum(axis=1))
    assert found is not None
    assert found.q2 < LEAST_Q2
    assert found.ellipsoid(1e9) is None


@given(n_sets=st.integers(1, 5))
def test_too_few_sets_tell_nothing(n_sets):
    steps, residuals, _, _ = linear_problem(0, 3, n_sets)
    assert fit_slopes(steps, residuals, (residuals**2).sum(axis=1)) is None
