"""Laws of the sparse direct solver, against scipy."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.linalg import spsolve

from palpate import _core

INDEX_TYPES = st.sampled_from([np.int32, np.int64])


@st.composite
def systems(draw: st.DrawFn, *, symmetric: bool) -> tuple[sp.csc_array, np.ndarray]:
    """A random sparse matrix far from singular, and right-hand sides."""
    n = draw(st.integers(1, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    matrix = sp.random_array((n, n), density=draw(st.floats(0, 0.3)), rng=rng)
    if symmetric:
        matrix = matrix + matrix.T
    matrix = sp.csc_array(matrix + sp.diags_array(abs(matrix).sum(1) + rng.uniform(0.5, 2, n)))
    return matrix, rng.normal(size=(n, draw(st.integers(1, 3))))


def factor_of(
    matrix: sp.csc_array, kind: str, layout: str, index: type, precision: str = "double"
) -> _core.SparseFactor:
    compressed = matrix.asformat(layout)
    factor = _core.SparseFactor(
        compressed.indptr.astype(index),
        compressed.indices.astype(index),
        kind=kind,
        layout=layout,
        precision=precision,
    )
    factor.factorise(compressed.data)
    return factor


@given(systems(symmetric=False), st.sampled_from(["csc", "csr"]), INDEX_TYPES)
def test_lu_agrees_with_scipy(system, layout, index):
    matrix, rhs = system
    factor = factor_of(matrix, "lu", layout, index)
    assert (factor.n, factor.n_data, factor.kind) == (matrix.shape[0], matrix.nnz, "lu")
    expected = spsolve(matrix, rhs).reshape(rhs.shape)
    np.testing.assert_allclose(factor.solve(rhs), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(factor.solve(np.asfortranarray(rhs)), factor.solve(rhs))
    np.testing.assert_allclose(factor.solve(rhs[:, 0]), expected[:, 0], rtol=1e-9, atol=1e-12)
    assert factor.solve(rhs[:, 0]).shape == (factor.n,)


@given(systems(symmetric=True), st.sampled_from(["ldlt", "llt"]), st.booleans(), INDEX_TYPES)
def test_symmetric_kinds_agree_with_scipy(system, kind, lower, index):
    matrix, rhs = system
    given_part = sp.csc_array(sp.tril(matrix)) if lower else matrix
    found = factor_of(given_part, kind, "csc", index).solve(rhs)
    np.testing.assert_allclose(found, spsolve(matrix, rhs).reshape(rhs.shape), rtol=1e-9, atol=1e-12)


@given(systems(symmetric=True), st.data())
def test_ldlt_solves_indefinite_matrices(system, data):
    matrix, rhs = system
    n = matrix.shape[0]
    signs = data.draw(st.lists(st.sampled_from([-1.0, 1.0]), min_size=n, max_size=n))
    off_diagonal = matrix - sp.diags_array(matrix.diagonal())
    matrix = sp.csc_array(off_diagonal + sp.diags_array(np.array(signs) * matrix.diagonal()))
    found = factor_of(matrix, "ldlt", "csc", np.int32).solve(rhs)
    np.testing.assert_allclose(matrix @ found, rhs, atol=1e-9)


@given(systems(symmetric=True), st.sampled_from(["lu", "ldlt", "llt"]), st.floats(-4, 4))
def test_a_single_factor_is_near_the_solution_and_refinement_reaches_it(system, kind, spread):
    matrix, rhs = system
    # Units a hundred million apart in one matrix, as a stiff penalty and a soft tissue have.
    units = sp.diags_array(np.logspace(-spread, spread, matrix.shape[0]))
    matrix = sp.csc_array(units @ matrix @ units)
    factor = factor_of(matrix, kind, "csc", np.int32, "single")
    assert factor.precision == "single"
    expected = spsolve(matrix, rhs[:, 0])
    scaled = np.abs(units @ expected).max()
    once = units @ (factor.precondition(rhs[:, 0]) - expected)
    assert np.abs(once).max() <= 1e-4 * scaled
    assert np.abs(units @ (factor.solve(rhs[:, 0]) - expected)).max() <= 1e-8 * scaled


@given(systems(symmetric=True), st.sampled_from(["double", "single"]), st.floats(-30, 30))
def test_preconditioning_is_linear_in_size(system, precision, exponent):
    matrix, rhs = system
    factor = factor_of(matrix, "ldlt", "csc", np.int32, precision)
    size = 2.0 ** round(exponent)
    once = factor.precondition(rhs[:, 0])
    np.testing.assert_allclose(factor.precondition(size * rhs[:, 0]), size * once, rtol=1e-12, atol=0)
    assert not factor.precondition(np.zeros(factor.n)).any()


@given(systems(symmetric=True), st.data())
def test_krylov_solves_a_nearby_unsymmetric_matrix(system, data):
    matrix, rhs = system
    kind = data.draw(st.sampled_from(["lu", "ldlt"]))
    layout = data.draw(st.sampled_from(["csc", "csr"]))
    factor = factor_of(matrix, kind, layout, np.int32, data.draw(st.sampled_from(["double", "single"])))
    compressed = matrix.asformat(layout)
    compressed.data = compressed.data * data.draw(st.floats(0.9, 1.1)) ** np.arange(compressed.nnz).clip(0, 3)
    tolerance = 10.0 ** data.draw(st.integers(-12, -1))
    solution, n_steps, converged = factor.krylov(compressed.data, rhs[:, 0], tolerance, 200)
    assert converged
    assert n_steps <= 60
    left = np.linalg.norm(compressed @ solution - rhs[:, 0])
    assert left <= 1.001 * tolerance * np.linalg.norm(rhs[:, 0])


def test_krylov_takes_more_steps_the_farther_the_matrix_and_stops_when_told(elastic):
    factor = _core.SparseFactor(
        elastic.indptr, elastic.indices, kind="ldlt", layout="csr", precision="single"
    )
    factor.factorise(elastic.data)
    rhs = np.cos(np.arange(factor.n))
    rng = np.random.default_rng(3)
    noise = rng.uniform(-1.0, 1.0, elastic.nnz)
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
    solution, n_steps, converged = factor.krylov(elastic.data, np.zeros(factor.n), 1e-8, 2)
    assert (n_steps, converged) == (0, True)
    assert not solution.any()


@pytest.mark.parametrize("kind", ["lu", "ldlt", "llt"])
@pytest.mark.parametrize("precision", ["double", "single"])
def test_a_solid_body_is_solved(elastic, kind, precision):
    factor = _core.SparseFactor(elastic.indptr, elastic.indices, kind=kind, layout="csr", precision=precision)
    factor.factorise(elastic.data)
    expected = np.cos(np.arange(factor.n))
    once = factor.precondition(elastic @ expected)
    np.testing.assert_allclose(once, expected, atol=1e-10 if precision == "double" else 1e-3)
    np.testing.assert_allclose(factor.solve(elastic @ expected), expected, atol=1e-9)


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
    return sp.csr_array(total)


def laplacian(n: int) -> sp.csc_array:
    """A chain of springs, not held."""
    matrix = sp.diags_array([2 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1]).tolil()
    matrix[0, 0] = matrix[-1, -1] = 1.0
    return matrix.tocsc()


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("kind", ["lu", "ldlt", "llt"])
def test_a_singular_matrix_is_an_error_and_leaves_no_factor(kind, precision):
    loose = laplacian(30)
    factor = _core.SparseFactor(loose.indptr, loose.indices, kind=kind, precision=precision)
    with pytest.raises(np.linalg.LinAlgError, match=r"singular|not positive definite"):
        factor.factorise(loose.data)
    assert factor.probe_error is None
    with pytest.raises(ValueError, match="call factorise first"):
        factor.solve(np.ones(30))
    with pytest.raises(ValueError, match="call factorise first"):
        factor.precondition(np.ones(30))
    held = loose.copy()
    held[0, 0] += 1.0
    factor.factorise(held.data)
    assert factor.probe_error < (1e-12 if precision == "double" else 1e-3)
    np.testing.assert_allclose(held @ factor.solve(np.ones(30)), 1.0, rtol=1e-9)


def test_bad_arguments_are_named():
    matrix = laplacian(3)
    with pytest.raises(ValueError, match=r"indices\[0\] is 7"):
        _core.SparseFactor(matrix.indptr, np.full_like(matrix.indices, 7))
    with pytest.raises(ValueError, match='kind "qr" is unknown'):
        _core.SparseFactor(matrix.indptr, matrix.indices, kind="qr")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="indptr"):
        _core.SparseFactor(matrix.indptr.astype(float), matrix.indices)  # type: ignore[arg-type]
    factor = _core.SparseFactor(matrix.indptr, matrix.indices, kind="ldlt")
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
    factor.factorise((matrix + 0.1 * sp.eye_array(3, format="csc")).data)
    with pytest.raises(ValueError, match="rhs has 4 values where 3"):
        factor.solve(np.ones(4))
    with pytest.raises(ValueError, match="rhs has 6 values"):
        factor.solve(np.ones((2, 3)))
    with pytest.raises(ValueError, match="rhs has 4 values where 3"):
        factor.precondition(np.ones(4))
    with pytest.raises(ValueError, match="data has 2 values where 7"):
        factor.krylov(np.ones(2), np.ones(3), 1e-6, 10)
    with pytest.raises(ValueError, match=r"rhs\[1\] is NaN"):
        factor.krylov(matrix.data, np.array([1.0, np.nan, 1.0]), 1e-6, 10)
    with pytest.raises(ValueError, match='precision "half" is unknown: choose double or single'):
        _core.SparseFactor(matrix.indptr, matrix.indices, precision="half")  # type: ignore[arg-type]
