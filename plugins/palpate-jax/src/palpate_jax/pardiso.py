"""Intel's PARDISO in the place of palpate's own sparse factor, where it is installed.

``pip install "palpate-jax[pardiso]"`` brings it; its licence is free of charge but not
open, and it takes 650 MB.
"""

import math
import weakref
from importlib.util import find_spec
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, gmres

from palpate.domain import FloatArray, IntArray
from palpate.errors import PalpateError

if TYPE_CHECKING:
    from pypardiso import PyPardisoSolver

LARGEST_PROBE_ERROR = 1e-5
"""Relative error of a known solution beyond which a matrix counts as singular; as in ``SparseFactor``."""

Integers = NDArray[np.int32] | NDArray[np.int64]

_TYPES = {"lu": 11, "ldlt": -2, "llt": 2}
_ANALYSE, _FACTORISE, _SOLVE, _RELEASE = 11, 22, 33, -1


def is_installed() -> bool:
    """Whether pypardiso, and with it PARDISO, can be imported."""
    return find_spec("pypardiso") is not None


class PardisoFactor:
    """A direct solver of A x = b for a pattern that stays the same, with ``SparseFactor``'s interface.

    Parameters
    ----------
    indptr, indices : integer arrays
        Compressed rows of a square matrix, sorted, with a full diagonal.
    kind : {"lu", "ldlt", "llt"}
        Any matrix; symmetric, possibly indefinite (Bunch-Kaufman); positive definite. For the last
        two the pattern and values are those of the whole matrix, of which the upper triangle is read.

    Raises
    ------
    PalpateError
        pypardiso is not installed.
    ValueError
        The pattern is not sorted, or lacks a diagonal entry.
    """

    def __init__(
        self, indptr: Integers, indices: Integers, *, kind: Literal["lu", "ldlt", "llt"] = "ldlt"
    ) -> None:
        self.kind, self.precision = kind, "double"
        self.n, self.n_data = len(indptr) - 1, len(indices)
        self._indptr, self._indices = np.asarray(indptr), np.asarray(indices)
        rows = np.repeat(np.arange(self.n), np.diff(indptr))
        self._kept = np.flatnonzero(indices >= rows) if kind != "lu" else np.arange(self.n_data)
        matrix = self._triangle(np.ones(self.n_data))
        if not matrix.has_sorted_indices or matrix.diagonal().sum() != self.n:
            raise ValueError("PARDISO needs sorted columns and every diagonal entry: sort_indices, add zeros")
        self._solver = _solver(kind)
        self._matrix = matrix
        weakref.finalize(self, _call, self._solver, _RELEASE, matrix, np.zeros(self.n))
        self._call(_ANALYSE, matrix, np.zeros(self.n))
        self._ready = False
        self.probe_error: float | None = None

    def factorise(self, data: FloatArray) -> None:
        """Factorise the values (n_data,) of the whole matrix, in the order of ``indices``.

        Raises
        ------
        ValueError
            Wrong length, NaN or infinite.
        numpy.linalg.LinAlgError
            Singular to working precision, or not positive definite for ``llt``.
        """
        self._check("data", data, self.n_data)
        self._ready, self.probe_error = False, None
        self._matrix = self._triangle(data)
        self._call(_FACTORISE, self._matrix, np.zeros(self.n))
        known = 0.5 + np.modf(np.arange(1, self.n + 1) * (math.sqrt(5.0) - 1.0) / 2.0)[0]
        found = self._call(_SOLVE, self._matrix, self._whole(data) @ known)
        error = float(np.abs(found - known).max())
        if not error <= LARGEST_PROBE_ERROR:
            raise np.linalg.LinAlgError(
                f"the matrix is singular to working precision: a known solution came back with a relative "
                f"error of {error:.1e}; is every part of the body held?"
            )
        self._ready, self.probe_error = True, error

    def precondition(self, rhs: FloatArray) -> FloatArray:
        """Apply the last factor to (n,), neither checked nor refined.

        Raises
        ------
        ValueError
            No factor or wrong length.
        """
        if not self._ready:
            raise ValueError("there is no factor to solve with: call factorise first, and mind its error")
        if rhs.shape != (self.n,):
            raise ValueError(f"rhs has shape {rhs.shape} where ({self.n},) was expected")
        return self._call(_SOLVE, self._matrix, np.ascontiguousarray(rhs))

    def solve(self, rhs: FloatArray) -> FloatArray:
        """Solve for (n,).

        Raises
        ------
        ValueError
            No factor, wrong length, NaN or infinite.
        """
        self._check("rhs", rhs, self.n)
        return self.precondition(rhs)

    def krylov(
        self, data: FloatArray, rhs: FloatArray, tolerance: float, most_steps: int
    ) -> tuple[FloatArray, int, bool]:
        """Solve with other values by GMRES, the last factor preconditioning.

        Returns
        -------
        solution, n_steps, converged
            As ``SparseFactor.krylov``: the residual watched is the true one, relative to ``rhs``.
        """
        self._check("data", data, self.n_data)
        self._check("rhs", rhs, self.n)
        matrix, steps = self._whole(data), 0

        def product(vector: FloatArray) -> FloatArray:
            nonlocal steps
            steps += 1
            return np.asarray(matrix @ self.precondition(vector))

        operator = LinearOperator((self.n, self.n), matvec=product, dtype=np.float64)
        most = max(most_steps, 1)
        inner, _ = gmres(operator, rhs, rtol=0.9 * tolerance, atol=0.0, restart=most, maxiter=1)
        solution = self.precondition(inner)
        left = float(np.linalg.norm(matrix @ solution - rhs))
        return solution, steps, left <= tolerance * float(np.linalg.norm(rhs))

    def _whole(self, data: FloatArray) -> sp.csr_array:
        return sp.csr_array((data, self._indices, self._indptr), shape=(self.n, self.n))

    def _triangle(self, data: FloatArray) -> sp.csr_matrix:
        indices: IntArray = self._indices[self._kept].astype(np.int64)
        rows = np.repeat(np.arange(self.n), np.diff(self._indptr))[self._kept]
        indptr = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=self.n))])
        return sp.csr_matrix((data[self._kept], indices, indptr), shape=(self.n, self.n))

    def _check(self, name: str, values: FloatArray, expected: int) -> None:
        if values.shape != (expected,):
            raise ValueError(f"{name} has shape {values.shape} where ({expected},) was expected")
        if not np.isfinite(values).all():
            index = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ValueError(f"{name}[{index}] is {values[index]}: every value must be finite")

    def _call(self, phase: int, matrix: sp.csr_matrix, rhs: FloatArray) -> FloatArray:
        return _call(self._solver, phase, matrix, rhs)


def _call(solver: "PyPardisoSolver", phase: int, matrix: sp.csr_matrix, rhs: FloatArray) -> FloatArray:
    from pypardiso.pardiso_wrapper import PyPardisoError

    solver.set_phase(phase)
    try:
        return np.asarray(solver._call_pardiso(matrix, rhs), dtype=np.float64)
    except PyPardisoError as error:
        raise np.linalg.LinAlgError(f"PARDISO ended with error {error.value} in phase {phase}") from error


def _solver(kind: str) -> "PyPardisoSolver":
    if not is_installed():
        raise PalpateError('PARDISO is not installed: pip install "palpate-jax[pardiso]"')
    from pypardiso import PyPardisoSolver

    solver = PyPardisoSolver(mtype=_TYPES[kind])
    solver.set_iparm(1, 1)  # the values below, not the defaults
    solver.set_iparm(2, 2)  # nested dissection
    solver.set_iparm(10, 13 if kind == "lu" else 8)  # pivots below 10^-k are perturbed
    solver.set_iparm(11, 0)  # scaling and matching would tie the analysis to its values
    solver.set_iparm(13, 0)
    solver.set_iparm(21, 1)  # pivots of one and two rows
    return solver
