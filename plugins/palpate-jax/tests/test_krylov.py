"""One space for several right-hand sides, up to what rounding allows."""

import numpy as np
import pytest
import scipy.sparse as sp

from palpate_jax.krylov import TOLERATED, Space


def space(condition, noise=0.0, n=40):
    """A matrix whose products have a relative error of ``noise``, as badly scaled tangents have."""
    rng = np.random.default_rng(1)
    rotation = np.linalg.qr(rng.normal(size=(n, n)))[0]
    exact = rotation @ np.diag(np.geomspace(1.0, condition, n)) @ rotation.T

    class Noisy:
        shape = exact.shape

        def __matmul__(self, vector):
            return exact @ vector * (1.0 + noise * rng.normal(size=n))

    inverse = np.linalg.inv(exact)
    return exact, Space(Noisy() if noise else sp.csr_array(exact), lambda r: inverse @ r, 3)


def test_every_right_hand_side_is_solved_to_its_tolerance():
    exact, solver = space(1e3)
    for rhs in np.random.default_rng(2).normal(size=(3, 40)):
        left = rhs - exact @ solver.solve(rhs, 1e-10)
        assert np.linalg.norm(left) <= 1.01e-10 * np.linalg.norm(rhs)


@pytest.mark.parametrize(("noise", "is_taken"), [(1e-8, True), (1e-2, False)])
def test_rounding_above_the_tolerance_is_taken_up_to_a_limit(noise, is_taken):
    exact, solver = space(10.0, noise)
    rhs = np.random.default_rng(2).normal(size=40)
    if is_taken:
        left = rhs - exact @ solver.solve(rhs, 1e-13)
        assert np.linalg.norm(left) <= TOLERATED * np.linalg.norm(rhs)
    else:
        with pytest.raises(np.linalg.LinAlgError, match="singular"):
            solver.solve(rhs, 1e-13)
