"""Kernels through their binding: agreement with NumPy and SciPy, memory layouts, and arguments in errors.

Laws of the kernels themselves are in ``crates/*/tests``.
"""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.sparse.linalg import spsolve
from scipy.stats import qmc

from palpate import _core
from palpate.errors import CurveError, SamplingError, ScoringError

Floats = NDArray[np.float64]
SEEDS = st.integers(0, 2**64 - 1)
PRECISIONS = st.sampled_from(["double", "single"])


# ------------------------------------------------------------------------------------------- curves


@st.composite
def loops(draw: st.DrawFn) -> tuple[Floats, Floats, Floats, int]:
    """Simulated x, y and measured x of one loop, and its number of legs."""
    legs = draw(st.lists(st.floats(1, 20), min_size=1, max_size=4))
    sign = draw(st.sampled_from([-1.0, 1.0]))
    turns = np.cumsum([draw(st.floats(-5, 5)), *(sign * (-1) ** k * leg for k, leg in enumerate(legs))])
    n_sim, n_exp = draw(st.integers(0, 12)), draw(st.integers(0, 40))
    sim_x, exp_x = walk(turns, n_sim), walk(turns, n_exp)
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    return sim_x, rng.normal(size=sim_x.size), exp_x, len(legs)


def walk(turns: Floats, n_between: int) -> Floats:
    """A path through the turning points with as many points on every leg."""
    legs = [np.linspace(a, b, n_between + 2)[1:] for a, b in pairwise(turns)]
    return np.concatenate([turns[:1], *legs])


def by_numpy(sim_x: Floats, sim_y: Floats, at_x: Floats, n_legs: int) -> Floats:
    """numpy.interp leg by leg; every leg has the same number of points."""
    values = np.full(at_x.size, np.nan)
    n_sim, n_at = (sim_x.size - 1) // n_legs, (at_x.size - 1) // n_legs
    for leg in range(n_legs):
        sim = slice(leg * n_sim, (leg + 1) * n_sim + 1)
        at = slice(leg * n_at + (leg > 0), (leg + 1) * n_at + 1)
        order = np.argsort(sim_x[sim])
        values[at] = np.interp(at_x[at], sim_x[sim][order], sim_y[sim][order])
    return values


@given(loops())
def test_each_branch_agrees_with_numpy_in_any_memory_layout(loop):
    sim_x, sim_y, exp_x, n_legs = loop
    padded = np.full((exp_x.size, 3), np.nan)
    padded[:, 1] = exp_x
    values, covered = _core.interpolate(sim_x[::-1].copy()[::-1], sim_y[::-1].copy()[::-1], padded[:, 1])
    assert covered.all()
    np.testing.assert_array_equal(values, _core.interpolate(sim_x, sim_y, exp_x)[0])
    tolerance = 1e-12 * np.abs(sim_y).max()
    np.testing.assert_allclose(values, by_numpy(sim_x, sim_y, exp_x, n_legs), rtol=1e-12, atol=tolerance)


# ------------------------------------------------------------------------------------------- scores

BY_NUMPY = {
    "mean_abs": lambda exp: np.abs(exp).mean(),
    "mean": lambda exp: abs(exp.mean()),
    "rms": lambda exp: np.sqrt((exp**2).mean()),
    "range": np.ptp,
    "std": np.std,
}


@st.composite
def pairs(draw: st.DrawFn) -> tuple[Floats, Floats, Floats]:
    """Simulated and measured values and weights, (n,) each."""
    n = draw(st.integers(2, 30))
    sim = draw(arrays(float, n, elements=st.floats(-50, 50)))
    # Rising by at least 0.1 a point, so that no normaliser is degenerate.
    exp = np.cumsum(draw(arrays(float, n, elements=st.floats(0.1, 5))))
    return sim, exp, draw(arrays(float, n, elements=st.floats(0.01, 10)))


@given(pairs(), st.sampled_from(sorted(BY_NUMPY)))
def test_a_score_agrees_with_numpy_in_any_memory_layout(pair, normaliser):
    sim, exp, weights = pair
    expected = np.average((sim - exp) ** 2, weights=weights) / BY_NUMPY[normaliser](exp) ** 2
    found = _core.nmse(sim, exp, normaliser, weights)
    assert found == pytest.approx(expected, rel=1e-12)
    spaced = [np.repeat(values, 2)[::2] for values in (sim, exp)]
    assert _core.nmse(*spaced, normaliser, weights[::-1].copy()[::-1]) == found
    assert _core.normaliser(exp, normaliser) == pytest.approx(BY_NUMPY[normaliser](exp), rel=1e-12)


@st.composite
def batches(draw: st.DrawFn) -> tuple[Floats, Floats, Floats, Floats]:
    """Simulated x (n,) and ordinates (n_sets, n), measured x and ordinates (N,), one rising branch."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n, n_points, n_sets = draw(st.integers(2, 30)), draw(st.integers(2, 80)), draw(st.integers(1, 9))
    sim_x, exp_x = (np.cumsum(rng.uniform(0.05, 1.0, size)) for size in (n, n_points))
    sim_x, exp_x = ((x - x[0]) / (x[-1] - x[0]) * 10.0 for x in (sim_x, exp_x))
    noise = 10.0 ** draw(st.integers(-6, 1))
    exp = 1.0 + exp_x**2
    return sim_x, 1.0 + sim_x**2 + noise * rng.normal(size=(n_sets, n)), exp_x, exp


@given(batches())
def test_a_batch_agrees_with_numpy_in_any_memory_layout(batch):
    sim_x, sim, exp_x, exp = batch
    path = _core.Measured(exp_x, exp).along(sim_x)
    nmse, coverage = path.score(sim)
    values = np.stack([np.interp(exp_x, sim_x, row) for row in sim])
    expected = np.mean((values - exp) ** 2, axis=1) / np.mean(np.abs(exp)) ** 2
    # numpy's slope form of the interpolant rounds the curve itself by 1e-16 of its size.
    np.testing.assert_allclose(nmse, expected, rtol=1e-12, atol=1e-15 * np.sqrt(nmse.max()))
    assert (coverage == 1.0).all()
    for layout in (np.asfortranarray(sim), np.repeat(sim, 2, axis=1)[:, ::2], sim[::-1].copy()[::-1]):
        np.testing.assert_array_equal(path.score(layout), (nmse, coverage))


@given(batches())
def test_the_gradient_is_zero_at_the_best_scale(batch):
    sim_x, sim, exp_x, exp = batch
    path = _core.Measured(exp_x, exp).along(sim_x)
    values = np.stack([np.interp(exp_x, sim_x, row) for row in sim])
    scale = values @ exp / np.sum(values**2, axis=1)
    _, gradient = path.gradient(scale[:, None] * sim)
    # d NMSE/d scale = sim · gradient.
    slope, size = np.sum(sim * gradient, axis=1), np.sum(np.abs(sim * gradient), axis=1)
    assert (np.abs(slope) <= 1e-9 * size + 1e-13).all()


# ------------------------------------------------------------------------------------------ designs


@given(st.integers(2, 60), st.integers(2, 6), SEEDS)
def test_a_better_design_has_less_discrepancy_by_scipy_in_any_memory_layout(n, d, seed):
    points = np.random.default_rng(seed).random((n, d))
    better = _core.optimise_design(points, "cd", 1, n_swaps=50)
    np.testing.assert_array_equal(np.sort(better, axis=0), np.sort(points, axis=0))
    assert qmc.discrepancy(better, method="CD") <= qmc.discrepancy(points, method="CD") + 1e-13
    spaced = np.repeat(np.asfortranarray(points), 2, axis=0)[::2]
    np.testing.assert_array_equal(_core.optimise_design(spaced, "cd", 1, n_swaps=50), better)


@given(st.integers(0, 7), st.integers(1, 6), SEEDS)
def test_a_scrambled_net_is_a_net(levels, d, seed):
    net = qmc.Sobol(d, scramble=False, bits=32).random_base2(levels)
    scrambled = _core.owen_scramble(net, seed)
    strata = np.sort(np.floor(scrambled * len(scrambled)), axis=0)
    np.testing.assert_array_equal(strata, np.repeat(np.arange(2**levels)[:, None], d, axis=1))
    # Any two equal leading parts stay equal, any two different ones different.
    for digits in (1, 3, 9):
        before, after = (np.floor(p * 2**digits) for p in (net, scrambled))
        for k in range(d):
            both = np.unique(np.stack([before[:, k], after[:, k]]), axis=1)
            assert len(both.T) == len(np.unique(before[:, k]))


def test_a_scrambled_point_is_uniform_and_its_columns_independent():
    corner = np.zeros((1, 2))
    drawn = np.concatenate([_core.owen_scramble(corner, seed) for seed in range(4000)])
    assert np.abs(drawn.mean(axis=0) - 0.5).max() < 5 / np.sqrt(12 * 4000)
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 5 / np.sqrt(4000)


def test_scrambling_makes_the_error_of_an_integral_smaller_than_chance():
    net = qmc.Sobol(3, scramble=False, bits=32).random_base2(8)
    errors = [np.prod(_core.owen_scramble(net, seed) * 2, axis=1).mean() - 1 for seed in range(50)]
    by_chance = np.sqrt((4 / 3) ** 3 - 1) / 16
    assert np.std(errors) < by_chance / 10
    assert abs(np.mean(errors)) < 5 * np.std(errors) / np.sqrt(50)


def test_columns_of_a_hypercube_are_uncorrelated():
    correlation = np.corrcoef(_core.latin_hypercube(20_000, 3, 1).T) - np.eye(3)
    assert np.abs(correlation).max() < 5 / np.sqrt(20_000)


# ----------------------------------------------------------------------------------- sparse factors


@st.composite
def systems(draw: st.DrawFn) -> tuple[sp.csr_array, Floats]:
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


@given(systems(), PRECISIONS, st.integers(-30, 30))
def test_preconditioning_is_linear_in_size(system, precision, exponent):
    matrix, rhs = system
    factor, size = factor_of(matrix, precision), 2.0**exponent
    found = factor.precondition(size * rhs)
    np.testing.assert_allclose(found, size * factor.precondition(rhs), rtol=1e-12, atol=0)
    assert not factor.precondition(np.zeros(rhs.size)).any()


@pytest.fixture(scope="module")
def elastic() -> sp.csr_array:
    """Stiffness (1944, 1944) of random springs between neighbours of a lattice that is held at the bottom."""
    n, rng = 9, np.random.default_rng(0)
    total = sp.csr_array((3 * n**3, 3 * n**3))
    for step in np.stack(np.meshgrid(*((-1, 0, 1),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)[14:]:
        x, y, z = (sp.eye_array(n, k=int(k)) for k in step)
        neighbour = sp.kron(x, sp.kron(y, z))
        difference = neighbour - sp.diags_array(neighbour.sum(axis=1))
        springs = difference.T @ sp.diags_array(rng.uniform(0.5, 2.0, n**3)) @ difference
        total = total + sp.kron(springs, np.outer(step, step) + 0.05 * np.eye(3))
    matrix = sp.csr_array((total + total.T)[3 * n**2 :, 3 * n**2 :])
    matrix.sort_indices()
    return matrix


@pytest.mark.parametrize(("precision", "tolerance"), [("double", 1e-10), ("single", 1e-3)])
def test_a_solid_body_is_solved(elastic, precision, tolerance):
    expected = np.cos(np.arange(elastic.shape[0]))
    once = factor_of(elastic, precision).precondition(elastic @ expected)
    np.testing.assert_allclose(once, expected, atol=tolerance)


def test_krylov_takes_more_steps_the_farther_the_matrix_and_stops_at_the_limit(elastic):
    factor, rhs = factor_of(elastic, "single"), np.cos(np.arange(elastic.shape[0]))
    noise, steps = np.random.default_rng(3).uniform(-1.0, 1.0, elastic.nnz), []
    for size in (0.0, 0.01, 0.1):
        data = elastic.data * (1.0 + size * noise)
        solution, n_steps, converged = factor.krylov(data, rhs, 1e-8, 100)
        assert converged
        matrix = sp.csr_array((data, elastic.indices, elastic.indptr))
        assert np.linalg.norm(matrix @ solution - rhs) <= 1e-8 * np.linalg.norm(rhs)
        steps.append(n_steps)
    assert steps[0] <= 3 < steps[1] < steps[2]
    assert factor.krylov(data, rhs, 1e-8, 2)[1:] == (2, False)
    solution, n_steps, converged = factor.krylov(data, np.zeros(rhs.size), 1e-8, 2)
    assert (n_steps, converged) == (0, True)
    assert not solution.any()


# ------------------------------------------------------------------------------------------- errors

LINE, TWO = np.array([0.0, 1.0, 2.0]), np.array([[0.1, 0.2], [0.3, 0.4]])
PATH = _core.Measured(LINE, LINE + 1.0).along(LINE)
CHAIN = sp.csr_array(sp.diags_array([[-1.0, -1.0], [1.0, 2.0, 1.0], [-1.0, -1.0]], offsets=[-1, 0, 1]))
"""Springs in a row, not held."""


def chain_factor() -> _core.SparseFactor:
    return _core.SparseFactor(CHAIN.indptr, CHAIN.indices, precision="double")


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: _core.branches(np.array([0.0, -np.inf])), CurveError, r"abscissa\[1\] is -inf"),
        (lambda: _core.interpolate(LINE, LINE, [0.0, 1.0]), TypeError, "at_x"),
        (lambda: _core.interpolate(LINE, LINE, np.arange(3)), TypeError, "at_x"),
        (lambda: _core.interpolate(LINE, LINE, np.zeros((2, 2))), TypeError, "at_x"),
        (lambda: _core.nmse(LINE, LINE, weights=np.zeros(3)), ScoringError, "every weight"),
        (lambda: _core.nmse(LINE, LINE, "median"), ScoringError, '"median" is unknown'),
        (lambda: _core.nmse(np.array([np.nan, 1.0]), LINE[1:]), CurveError, r"sim\[0\] is NaN"),
        (lambda: _core.nmse(LINE[None], LINE), TypeError, "sim"),
        (lambda: PATH.score(np.ones((1, 2))), CurveError, "1 sets of 3"),
        (lambda: PATH.score(np.ones(3)), TypeError, "sim"),
        (lambda: PATH.score(np.ones((1, 3), np.float32)), TypeError, "sim"),
        (lambda: _core.latin_hypercube(-1, 2, 1), SamplingError, "n is -1"),
        (lambda: _core.latin_hypercube(2, 2, 2**64), SamplingError, "seed is"),
        (lambda: _core.latin_hypercube(2.5, 1, 1), TypeError, r"n is 2\.5"),
        (lambda: _core.optimise_design(TWO, "cd", -1), SamplingError, "seed is -1"),
        (lambda: _core.optimise_design(TWO, "cd", 1, n_swaps=-2), SamplingError, "n_swaps is -2"),
        (lambda: _core.optimise_design(TWO, "cd", 1, n_swaps=0.5), TypeError, r"n_swaps is 0\.5"),
        (lambda: _core.optimise_design(TWO[0], "cd", 1), TypeError, "points"),
        (lambda: _core.optimise_design(TWO.astype(np.float32), "cd", 1), TypeError, "points"),
        (lambda: _core.extend_latin_hypercube(TWO, 3, 1), SamplingError, "share one of n_total = 3"),
        (lambda: _core.owen_scramble(TWO - 1, 1), SamplingError, "unit cube"),
        (lambda: _core.geometric(TWO[0], 0.0, 1.0), SamplingError, "0 to 1 has no logarithmic scale"),
        (lambda: chain_factor().krylov(CHAIN.data, np.ones(2), 1e-6, 9), ValueError, "call factorise first"),
        (lambda: chain_factor().factorise(np.ones(2)), ValueError, "data has 2 values where 7"),
        (lambda: chain_factor().factorise(CHAIN.data.astype(np.float32)), TypeError, "data"),
        (lambda: chain_factor().factorise(CHAIN.data), np.linalg.LinAlgError, "singular"),
        (lambda: chain_factor().precondition(np.ones(3)), ValueError, "call factorise first"),
    ],
)
def test_an_error_names_argument_and_value(call, error, message):
    with pytest.raises(error, match=message):
        call()
