"""Laws of the sparse factors, against scipy."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, strategies as st
from scipy.sparse.linalg import spsolve

from palpate import _core

PRECISIONS = st.sampled_from(["double", "single"])


@st.composite
def systems(draw: st.DrawFn) -> tuple[sp.csr_array, np.ndarray]:
    """A random symmetric matrix far from singular, and a right-hand side."""
    n = draw(st.integers(1, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    matrix = sp.random_array((n, n), density=draw(st.floats(0, 0.3)), rng=rng)
    matrix = matrix + matrix.T
    signs = rng.choice(draw(st.sampled_from([(1.0,), (-1.0, 1.0)])), n)
    matrix = sp.csr_array(matrix + sp.diags_array(signs * (abs(matrix).sum(1) + rng.uniform(0.5, 2, n))))
    matrix.sort_indices()
    return matrix, rng.normal(size=n)


def factor_of(matrix: sp.csr_array, precision: str) -> _core.SparseFactor:
    indptr, indices = matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32)
    factor = _core.SparseFactor(indptr, indices, precision=precision)
    factor.factorise(matrix.data)
    assert factor.precision == precision
    return factor


@given(systems())
def test_a_double_factor_agrees_with_scipy(system):
    matrix, rhs = system
    expected = spsolve(matrix.tocsc(), rhs)
    np.testing.assert_allclose(factor_of(matrix, "double").precondition(rhs), expected, rtol=1e-9, atol=1e-12)


@given(systems(), st.floats(-4, 4))
def test_a_single_factor_is_near_the_solution_in_any_units(system, spread):
    matrix, rhs = system
    # Units a hundred million apart in one matrix, as a stiff penalty and a soft tissue have.
    units = sp.diags_array(np.logspace(-spread, spread, matrix.shape[0]))
    matrix = sp.csr_array(units @ matrix @ units)
    expected = spsolve(matrix.tocsc(), rhs)
    once = units @ (factor_of(matrix, "single").precondition(rhs) - expected)
    assert np.abs(once).max() <= 1e-4 * np.abs(units @ expected).max()


@given(systems(), PRECISIONS, st.floats(-30, 30))
def test_preconditioning_is_linear_in_size(system, precision, exponent):
    matrix, rhs = system
    factor = factor_of(matrix, precision)
    size = 2.0 ** round(exponent)
    once = factor.precondition(rhs)
    np.testing.assert_allclose(factor.precondition(size * rhs), size * once, rtol=1e-12, atol=0)
    assert not factor.precondition(np.zeros(rhs.size)).any()


@given(systems(), PRECISIONS, st.floats(0.9, 1.1), st.integers(-12, -1))
def test_krylov_solves_a_nearby_unsymmetric_matrix(system, precision, ratio, digits):
    matrix, rhs = system
    factor = factor_of(matrix, precision)
    nearby = matrix.copy()
    nearby.data = nearby.data * ratio ** np.arange(nearby.nnz).clip(0, 3)
    solution, n_steps, converged = factor.krylov(nearby.data, rhs, 10.0**digits, 200)
    assert converged
    assert n_steps <= 60
    assert np.linalg.norm(nearby @ solution - rhs) <= 1.001 * 10.0**digits * np.linalg.norm(rhs)


def test_krylov_takes_more_steps_the_farther_the_matrix_and_stops_at_the_limit(elastic):
    factor = factor_of(elastic, "single")
    rhs = np.cos(np.arange(elastic.shape[0]))
    noise = np.random.default_rng(3).uniform(-1.0, 1.0, elastic.nnz)
    steps = []
    for size in (0.0, 0.01, 0.1):
        data = elastic.data * (1.0 + size * noise)
        solution, n_steps, converged = factor.krylov(data, rhs, 1e-8, 100)
        assert converged
        matrix = sp.csr_array((data, elastic.indices, elastic.indptr))
        assert np.linalg.norm(matrix @ solution - rhs) <= 1e-8 * np.linalg.norm(rhs)
        steps.append(n_steps)
    assert steps[0] <= 3 < steps[1] < steps[2]
    solution, n_steps, converged = factor.krylov(elastic.data * (1.0 + 0.1 * noise), rhs, 1e-8, 2)
    assert (n_steps, converged) == (2, False)
    solution, n_steps, converged = factor.krylov(elastic.data, np.zeros(rhs.size), 1e-8, 2)
    assert (n_steps, converged) == (0, True)
    assert not solution.any()


@pytest.mark.parametrize(("precision", "tolerance"), [("double", 1e-10), ("single", 1e-3)])
def test_a_solid_body_is_solved(elastic, precision, tolerance):
    expected = np.cos(np.arange(elastic.shape[0]))
    once = factor_of(elastic, precision).precondition(elastic @ expected)
    np.testing.assert_allclose(once, expected, atol=tolerance)


@pytest.fixture(scope="module")
def elastic():
    """Random springs between the neighbours of a lattice, three unknowns a node, held at the bottom."""
    n = 9
    nodes = np.stack(np.meshgrid(*(np.arange(n),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(0)
    n_free = 3 * (n**3 - n**2)
    total = sp.coo_array((n_free, n_free))
    for step in np.stack(np.meshgrid(*((-1, 0, 1),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)[14:]:
        ends = nodes + step
        inside = ((ends >= 0) & (ends < n)).all(axis=1)
        one, other = nodes[inside] @ [n**2, n, 1], ends[inside] @ [n**2, n, 1]
        direction = step + 0.3 * rng.uniform(-1, 1, (len(one), 3))
        block = direction[:, :, None] * direction[:, None, :] + 0.05 * np.eye(3)
        for a, b, sign in ((one, one, 1), (other, other, 1), (one, other, -1), (other, one, -1)):
            rows = np.broadcast_to(3 * a[:, None, None] + np.arange(3)[:, None], block.shape)
            columns = np.broadcast_to(3 * b[:, None, None] + np.arange(3), block.shape)
            free = (rows >= 3 * n**2) & (columns >= 3 * n**2)
            places = (rows[free] - 3 * n**2, columns[free] - 3 * n**2)
            total = total + sp.coo_array((sign * block[free], places), shape=(n_free, n_free))
    matrix = sp.csr_array(total)
    matrix.sort_indices()
    return matrix


def chain(n: int) -> sp.csr_array:
    """Springs in a row, not held."""
    matrix = sp.diags_array([2 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]).tolil()
    matrix[0, 0] = matrix[-1, -1] = 1.0
    return matrix.tocsr()


@pytest.mark.parametrize("precision", ["double", "single"])
def test_a_singular_matrix_is_an_error_and_leaves_no_factor(precision):
    loose = chain(30)
    factor = _core.SparseFactor(loose.indptr, loose.indices, precision=precision)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        factor.factorise(loose.data)
    with pytest.raises(ValueError, match="call factorise first"):
        factor.precondition(np.ones(30))
    held = loose.copy()
    held[0, 0] += 1.0
    factor.factorise(held.data)
    np.testing.assert_allclose(held @ factor.precondition(np.ones(30)), 1.0, rtol=1e-3)


def test_bad_arguments_are_named():
    matrix = chain(3)
    with pytest.raises(ValueError, match=r"indices\[0\] is 7"):
        _core.SparseFactor(matrix.indptr, np.full_like(matrix.indices, 7), precision="double")
    with pytest.raises(ValueError, match=r"indices\[1\], in row 0, does not exceed"):
        _core.SparseFactor(matrix.indptr, np.zeros_like(matrix.indices), precision="double")
    with pytest.raises(TypeError, match="indptr"):
        _core.SparseFactor(matrix.indptr.astype(float), matrix.indices, precision="double")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match='precision "half" is unknown: choose double or single'):
        _core.SparseFactor(matrix.indptr, matrix.indices, precision="half")  # type: ignore[arg-type]
    factor = _core.SparseFactor(matrix.indptr, matrix.indices, precision="double")
    with pytest.raises(ValueError, match="data has 2 values where 7"):
        factor.factorise(np.ones(2))
    with pytest.raises(ValueError, match=r"data\[0\] is NaN"):
        factor.factorise(np.full(7, np.nan))
    unsymmetric = matrix.copy()
    unsymmetric[0, 1] = 5.0
    with pytest.raises(ValueError, match="its counterpart is 5"):
        factor.factorise(unsymmetric.data)
    with pytest.raises(TypeError, match="data"):
        factor.factorise(matrix.data.astype(np.float32))
    factor.factorise(matrix.data + 0.1 * (matrix.data > 0))
    with pytest.raises(ValueError, match="rhs has 4 values where 3"):
        factor.precondition(np.ones(4))
    with pytest.raises(ValueError, match="data has 2 values where 7"):
        factor.krylov(np.ones(2), np.ones(3), 1e-6, 10)
    with pytest.raises(ValueError, match=r"rhs\[1\] is NaN"):
        factor.krylov(matrix.data, np.array([1.0, np.nan, 1.0]), 1e-6, 10)
