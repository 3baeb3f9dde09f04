"""Least squares within the unit box, against their conditions of optimality."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate_certainty.bounded import least_near, slopes_at


def is_least(gradient, found, lower, upper):
    """No step within the bounds goes down."""
    size = 1e-6 * (1.0 + np.abs(gradient).max(initial=0.0))
    down = np.where(gradient > 0.0, found > lower + 1e-9, found < upper - 1e-9)
    return bool((~down | (np.abs(gradient) < size)).all())


@given(st.integers(0, 2**32 - 1), st.sets(st.integers(0, 2), max_size=3))
def test_other_residuals_too_with_the_others_held(seed, moving):
    rng = np.random.default_rng(seed)
    matrix, target, start = rng.normal(size=(9, 3)), rng.normal(size=9), rng.random(3)

    def residuals(points):
        return np.expm1(0.3 * points) @ matrix.T - target

    def slopes(point):
        return matrix * 0.3 * np.exp(0.3 * point)

    free = np.isin(np.arange(3), list(moving))
    found, least = least_near(residuals, start, free, slopes, tolerance=1e-12, most_steps=200)
    np.testing.assert_array_equal(found[~free], start[~free])
    assert least == pytest.approx(float((residuals(found[None]) ** 2).sum()))
    gradient = (slopes(found).T @ residuals(found[None])[0])[free]
    if free.any():
        inside = found[free].clip(1e-5, 1.0 - 1e-5)  # a search ends near a bound
        assert is_least(gradient * (np.abs(gradient) > 1e-4), inside, 1e-5, 1.0 - 1e-5)
    by_differences = slopes_at(residuals, found[None], residuals(found[None]), free)[0]
    np.testing.assert_allclose(by_differences, slopes(found)[:, free], atol=1e-3)
