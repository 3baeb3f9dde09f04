"""An interval holds every set that is about as good, and no more than it must."""

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.optimize import minimize

from palpate_certainty.emulator import NO_SLOPES, GaussianProcess
from palpate_certainty.identifiability import LEAST_Q2, QuadraticForm

SEEDS = st.integers(0, 2**32 - 1)


def linear_problem(seed, n_parameters, n_sets=60, n_points=25):
    """Sets (n, p) in the box, and residuals that follow them in proportion."""
    random = np.random.default_rng(seed)
    sets = random.uniform(0.0, 1.0, (n_sets, n_parameters))
    slopes = random.normal(size=(n_parameters, n_points))
    offset = 0.1 * random.normal(size=n_points) - random.uniform(-0.2, 1.2, n_parameters) @ slopes
    return sets, offset + sets @ slopes, offset, slopes


def emulated(sets, residuals):
    none = np.zeros((sets.shape[1], 0, residuals.shape[1]))
    return GaussianProcess(2.0 * sets - 1.0, NO_SLOPES, residuals, none)


@given(seed=SEEDS, n_parameters=st.integers(1, 4), more=st.floats(0.01, 3.0))
def test_where_curves_follow_the_parameters_the_ends_are_the_farthest_sets_as_good(seed, n_parameters, more):
    sets, residuals, offset, slopes = linear_problem(seed, n_parameters)
    form = QuadraticForm.near(lambda points: offset + points @ slopes, sets[0])

    def fopt(u):
        return float(((offset + u @ slopes) ** 2).sum())

    least = form(form.minimum())
    np.testing.assert_allclose(form(sets[3]), fopt(sets[3]), rtol=1e-6, atol=1e-9)
    found = minimize(fopt, form.minimum(), bounds=[(0.0, 1.0)] * n_parameters)
    assert least == pytest.approx(found.fun, rel=1e-5, abs=1e-8)
    limit = least * (1.0 + more)
    low, high = form.interval(0, limit)
    as_good = sets[(residuals**2).sum(axis=1) <= limit, 0]
    assert ((as_good >= low - 1e-5) & (as_good <= high + 1e-5)).all()
    # An optimiser that knows nothing of the form goes as far, and no farther.
    farthest = minimize(
        lambda u: -u[0],
        form.minimum(),
        bounds=[(0.0, 1.0)] * n_parameters,
        constraints={"type": "ineq", "fun": lambda u: limit - fopt(u)},
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 500},
    )
    assume(farthest.success)
    np.testing.assert_allclose(farthest.x[0], high, rtol=1e-3, atol=1e-4)


@given(seed=SEEDS, larger=st.floats(1.1, 10.0))
def test_a_wider_limit_makes_no_interval_narrower(seed, larger):
    sets, _, offset, slopes = linear_problem(seed, 3)
    form = QuadraticForm.near(lambda points: offset + points @ slopes, sets[0])
    limit = 1.5 * form(form.minimum())
    for i in range(3):
        narrow, wide = form.interval(i, limit), form.interval(i, limit * larger)
        assert 0.0 <= wide[0] <= narrow[0] + 1e-6
        assert narrow[1] - 1e-6 <= wide[1] <= 1.0


@given(seed=SEEDS)
def test_noise_is_not_taken_for_an_identification(seed):
    random = np.random.default_rng(seed)
    sets, residuals = random.uniform(0.0, 1.0, (20, 3)), random.normal(size=(20, 40))
    missed = (emulated(sets, residuals).left_out ** 2).sum()
    assert 1.0 - missed / ((residuals - residuals.mean(axis=0)) ** 2).sum() < LEAST_Q2


@pytest.mark.slow
@given(seed=SEEDS, curved=st.floats(0.0, 1.0), noise=st.sampled_from([0.0, 1e-3]))
def test_a_parameter_without_effect_reaches_across_its_range(seed, curved, noise):
    sets, _, offset, slopes = linear_problem(seed, 3)
    slopes[2] = 0.0  # the third decides nothing
    residuals = offset + (sets + curved * sets**3) @ slopes
    residuals = residuals + noise * np.random.default_rng(seed).normal(size=residuals.shape)
    process, fopt = emulated(sets, residuals), (residuals**2).sum(axis=1)
    form = QuadraticForm.near(lambda points: process(2.0 * points - 1.0), sets[np.argmin(fopt)])
    least = form(form.minimum())
    missed = float((process.left_out**2).sum(axis=1).mean())
    low, high = form.interval(2, least + max(least, missed, 1e-6 * float(np.median(fopt))))
    assert high - low > 0.8
