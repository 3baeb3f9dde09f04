"""Least squares within a box, against their conditions of optimality."""

import numpy as np
from hypothesis import given, strategies as st

from palpate.fit.bounded import linear_least

seeds = st.integers(0, 2**32 - 1)


def is_least(gradient, found, lower, upper):
    """No step within the bounds goes down."""
    size = 1e-6 * (1.0 + np.abs(gradient).max(initial=0.0))
    down = np.where(gradient > 0.0, found > lower + 1e-9, found < upper - 1e-9)
    return bool((~down | (np.abs(gradient) < size)).all())


@given(seeds, st.integers(1, 4))
def test_linear_residuals_have_their_least_between_the_bounds(seed, n):
    rng = np.random.default_rng(seed)
    matrix, target = rng.normal(size=(8, n)), rng.normal(size=8)
    lower = rng.uniform(-1.0, 0.5, n)
    upper = lower + np.where(rng.random(n) < 0.3, 0.0, rng.random(n))
    found = linear_least(matrix, target, lower, upper)
    assert ((lower <= found) & (found <= upper)).all()
    gradient = matrix.T @ (matrix @ found - target)
    assert is_least(gradient[upper > lower], *(each[upper > lower] for each in (found, lower, upper)))
