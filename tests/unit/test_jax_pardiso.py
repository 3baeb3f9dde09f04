"""PARDISO in the place of the sparse factor: the same interface, the same answers, the same refusals."""

import numpy as np
import pytest
import scipy.sparse as sp

from palpate._core import SparseFactor
from palpate.errors import PalpateError
from palpate_jax import pardiso

installed = pytest.mark.skipif(not pardiso.is_installed(), reason="pypardiso is not installed")


@pytest.fixture
def stiffness() -> sp.csr_array:
    """A symmetric matrix of a grid, shaken so that it is indefinite."""
    n = 12
    chain = sp.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    grid = sp.kronsum(chain, chain, format="csr")
    shake = sp.diags_array(np.where(np.arange(n * n) % 7 == 0, -9.0, 0.5))
    return sp.csr_array(grid + shake)


@installed
@pytest.mark.parametrize("kind", ["lu", "ldlt"])
def test_solutions_are_those_of_the_sparse_factor(stiffness, kind):
    ours = SparseFactor(stiffness.indptr, stiffness.indices, kind=kind, layout="csr")
    theirs = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices, kind=kind)
    rhs = np.sin(np.arange(theirs.n))
    for scale in (1.0, 3.0):  # new values, the same analysis
        for factor in (ours, theirs):
            factor.factorise(scale * stiffness.data)
        np.testing.assert_allclose(theirs.solve(rhs), ours.solve(rhs), atol=1e-10)
        np.testing.assert_allclose(theirs.precondition(rhs), ours.solve(rhs), atol=1e-8)
    assert theirs.probe_error < 1e-8


@installed
def test_an_older_factor_preconditions_an_unsymmetric_matrix(stiffness):
    factor = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices)
    factor.factorise(stiffness.data)
    data = stiffness.data * (1.0 + 0.05 * np.sin(np.arange(stiffness.nnz)))
    rhs = np.cos(np.arange(factor.n))
    solution, n_steps, converged = factor.krylov(data, rhs, 1e-9, 60)
    left = sp.csr_array((data, stiffness.indices, stiffness.indptr)) @ solution - rhs
    assert converged
    assert 3 < n_steps <= 60
    assert np.linalg.norm(left) <= 1e-9 * np.linalg.norm(rhs)
    assert not factor.krylov(data, rhs, 1e-9, 2)[2]


@installed
def test_what_cannot_be_solved_is_refused(stiffness):
    factor = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices)
    with pytest.raises(ValueError, match="call factorise first"):
        factor.precondition(np.ones(factor.n))
    with pytest.raises(ValueError, match=r"data has shape \(2,\)"):
        factor.factorise(np.ones(2))
    with pytest.raises(ValueError, match=r"data\[0\] is nan"):
        factor.factorise(np.full(factor.n_data, np.nan))
    loose = sp.csr_array(sp.diags_array([[1.0, 2.0, 1.0], [-1.0, -1.0], [-1.0, -1.0]], offsets=[0, 1, -1]))
    singular = pardiso.PardisoFactor(loose.indptr, loose.indices)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        singular.factorise(loose.data)
    with pytest.raises(ValueError, match="call factorise first"):
        singular.solve(np.ones(3))
    definite = pardiso.PardisoFactor(stiffness.indptr, stiffness.indices, kind="llt")
    with pytest.raises(np.linalg.LinAlgError, match="PARDISO ended with error"):
        definite.factorise(stiffness.data)
    with pytest.raises(ValueError, match="every diagonal entry"):
        pardiso.PardisoFactor(np.array([0, 1, 2]), np.array([1, 0]))


def test_its_absence_is_said_with_what_to_do(stiffness, monkeypatch):
    monkeypatch.setattr(pardiso, "find_spec", lambda name: None)
    with pytest.raises(PalpateError, match=r"palpate-jax\[pardiso\]"):
        pardiso.PardisoFactor(stiffness.indptr, stiffness.indices)
