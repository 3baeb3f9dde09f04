"""Newton's linear systems: when factors are renewed, in which precision, and what helps hard systems."""

import numpy as np
import pytest

from palpate_jax.sparse import PATIENCE, LinearSolver, Pattern

N_CHAIN = 90
CHAIN = Pattern([3 * np.arange(N_CHAIN - 1)[:, None] + np.arange(6)], 3 * N_CHAIN)
ELEMENTS = np.arange(24).reshape(2, 12)
PATTERN = Pattern([ELEMENTS, np.concatenate([ELEMENTS[:, :6], ELEMENTS[::-1, 6:]], axis=1)], 24)


@pytest.fixture
def chain():
    """Entries of a chain of nodes, and of one whose nodes drag each other sideways as by friction."""
    laplacian = 2.05 * np.eye(N_CHAIN) - np.eye(N_CHAIN, k=1) - np.eye(N_CHAIN, k=-1)
    dragging = np.diag(np.where(np.arange(N_CHAIN - 1) % 10 < 9, 3.0, 0.0), k=1)
    rows = np.repeat(np.arange(3 * N_CHAIN), np.diff(CHAIN.indptr))
    both = (laplacian, laplacian + dragging - dragging.T)
    return tuple(np.kron(each, np.eye(3))[rows, CHAIN.indices] for each in both)


def test_rows_far_from_symmetric_are_solved_without_a_sweep(chain):
    symmetric, dragged = chain
    solver, rhs = LinearSolver(CHAIN), np.sin(np.arange(6 * N_CHAIN)).reshape(2, -1)
    dense = np.zeros((3 * N_CHAIN, 3 * N_CHAIN))
    dense[np.repeat(np.arange(3 * N_CHAIN), np.diff(CHAIN.indptr)), CHAIN.indices] = dragged
    one = solver.solve(dragged, lambda: symmetric, rhs[0], 1e-2)
    assert np.linalg.norm(dense @ one - rhs[0]) <= 1e-2 * np.linalg.norm(rhs[0])
    for right, left in zip(rhs, solver.solve_all(dragged, lambda: symmetric, rhs, 1e-2), strict=True):
        assert np.linalg.norm(dense @ left - right) <= 1e-2 * np.linalg.norm(right)
    with pytest.raises(np.linalg.LinAlgError, match="far from symmetric"):
        solver.solve_all(dragged, lambda: symmetric, rhs, 1e-12)


def test_a_simulation_begins_in_single_precision_whatever_was_before_it():
    rows = np.repeat(np.arange(24), np.diff(PATTERN.indptr))
    diagonal = np.flatnonzero(rows == PATTERN.indices)
    hard, easy = (np.zeros(len(PATTERN.indices)) for _ in range(2))
    hard[diagonal], easy[diagonal] = 1.0, 1.0 / 3.0
    coupled = (rows == 0) & (PATTERN.indices == 1) | (rows == 1) & (PATTERN.indices == 0)
    hard[coupled] = 1.0 - 1e-10
    rhs = np.linspace(1.0, 2.0, 24)
    alone = LinearSolver(PATTERN).solve(easy, lambda: easy, rhs, 1e-12)
    after = LinearSolver(PATTERN)
    after.solve(hard, lambda: hard, rhs, 1e-6)
    assert after._factor.precision == "double"  # which alone can hold it
    after.restart()
    assert np.array_equal(after.solve(easy, lambda: easy, rhs, 1e-12), alone)


def test_a_factor_whose_first_system_was_hard_is_renewed(monkeypatch):
    steps = iter([35, 5, *[PATIENCE // 4 + 5] * 4, 4])
    monkeypatch.setattr(LinearSolver, "_iterate", lambda self, matrix, rhs, *rest: (rhs, next(steps)))
    rows = np.repeat(np.arange(24), np.diff(PATTERN.indptr))
    solver, values = LinearSolver(PATTERN), (rows == PATTERN.indices).astype(float)
    for _ in range(7):
        solver.solve(values, lambda: values, np.ones(24), 1e-3)
    assert solver.n_factorisations == 2


def test_a_factor_that_derivatives_made_is_compared_with_itself(monkeypatch):
    steps = iter([2, *[20] * 30])
    monkeypatch.setattr(LinearSolver, "_iterate", lambda self, matrix, rhs, *rest: (rhs, next(steps)))
    rows = np.repeat(np.arange(24), np.diff(PATTERN.indptr))
    solver, values = LinearSolver(PATTERN), (rows == PATTERN.indices).astype(float)
    solver.solve(values, lambda: values, np.ones(24), 1e-3)
    solver.reset()
    solver.solve_all(values, lambda: values, np.ones((2, 24)), 1e-3)
    for _ in range(30):  # as many steps as its first system
        solver.solve(values, lambda: values, np.ones(24), 1e-3)
    assert solver.n_factorisations == 2
