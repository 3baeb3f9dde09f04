"""The sparse linear system, with one pattern for all tangents.

The tangent is unsymmetric under friction and changes little from one Newton
iteration to the next, so a factorisation is reused as the preconditioner of GMRES
as long as that is cheaper.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import scipy.sparse as sp

from palpate.api import FloatArray, IntArray, SparseFactor
from palpate_jax.krylov import Space

PATIENCE = 60
"""Extra Krylov steps of an older factor, compared with a new one, before a new factorisation.

A new factorisation is due when the extra steps since the last one have cost about as much.
"""

FEW_KRYLOV_STEPS = 40
"""A solve that needs more gets a new preconditioner."""

MOST_KRYLOV_STEPS = 60
"""A solve that needs more with a fresh preconditioner has failed."""


class Pattern:
    """Places of the element entries in a compressed-row matrix of the free unknowns.

    Parameters
    ----------
    groups : sequence of (e, m) integer arrays
        Unknown of each element degree of freedom, −1 if it is fixed.
    n_unknowns : int
    """

    def __init__(self, groups: Sequence[IntArray], n_unknowns: int) -> None:
        self.n_unknowns = n_unknowns
        rows = np.concatenate([np.repeat(g, g.shape[1], axis=1).ravel() for g in groups])
        columns = np.concatenate([np.tile(g, (1, g.shape[1])).ravel() for g in groups])
        free = (rows >= 0) & (columns >= 0)
        entries, found = np.unique(rows[free] * n_unknowns + columns[free], return_inverse=True)
        places = np.full(len(rows), len(entries))  # fixed entries go to one spare place
        places[free] = found
        self._places = np.split(places, np.cumsum([g.size * g.shape[1] for g in groups])[:-1])
        self._sizes = [g.shape[1] for g in groups]
        self.indices = (entries % n_unknowns).astype(np.int32)
        counts = np.bincount(entries // n_unknowns, minlength=n_unknowns)
        self.indptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self._transposed = np.argsort(entries % n_unknowns * n_unknowns + entries // n_unknowns)

    def places(self, group: int) -> IntArray:
        """Place (e, m, m) of each entry of a group in ``indices``, their number for a fixed one."""
        m = self._sizes[group]
        return self._places[group].reshape(-1, m, m)

    def add(self, values: FloatArray, group: int, elements: IntArray, stiffnesses: FloatArray) -> None:
        """Add stiffnesses (e', m, m) of some elements of a group to values in the order of ``indices``."""
        if len(elements):
            places = self._places[group].reshape(-1, stiffnesses[0].size)[elements].ravel()
            free = places < len(values)
            np.add.at(values, places[free], stiffnesses.ravel()[free])

    def matrix(self, values: FloatArray) -> sp.csr_array:
        """Matrix with these values."""
        return sp.csr_array((values, self.indices, self.indptr), shape=(self.n_unknowns,) * 2)

    def symmetric_part(self, values: FloatArray) -> FloatArray:
        """Values of (K + Kᵀ)/2."""
        return 0.5 * (values + values[self._transposed])


class LinearSolver:
    """Solves K x = b by GMRES, preconditioned with the factors of a symmetric matrix close to K.

    Symmetric factors cost a fifth of unsymmetric ones, and older ones are
    reused until the extra iterations cost more.

    Parameters
    ----------
    pattern : Pattern

    Attributes
    ----------
    n_factorisations : int
        Number of factorisations.
    """

    def __init__(self, pattern: Pattern) -> None:
        self.n_factorisations = 0
        self._pattern = pattern
        self._factor = _factor(pattern, "single")
        self._ready = False
        self._fresh_steps = 0
        self._extra_steps = 0

    def reset(self) -> None:
        """Drop the factors."""
        self._ready = False

    def restart(self) -> None:
        """Drop the factors and the count, before another simulation of the same pattern."""
        self.reset()
        self.n_factorisations = 0

    def solve(
        self,
        matrix: sp.csr_array,
        preconditioner: Callable[[], FloatArray],
        rhs: FloatArray,
        tolerance: float,
    ) -> FloatArray:
        """Solution to the relative residual ``tolerance``.

        Parameters
        ----------
        matrix : (n, n) sparse array
        preconditioner : callable
            Returns the values of a symmetric matrix close to it, for new factors.
        rhs : (n,) array
        tolerance : float

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular to working precision, or a value is not finite.
        """
        if not (np.isfinite(matrix.data).all() and np.isfinite(rhs).all()):
            raise np.linalg.LinAlgError("the tangent is not finite")
        if self._ready and self._extra_steps < PATIENCE:
            solution, n_steps = self._iterate(matrix, rhs, tolerance, FEW_KRYLOV_STEPS)
            if solution is not None:
                self._extra_steps += max(n_steps - self._fresh_steps, 0)
                return solution
        self._factorise(preconditioner())
        solution, self._fresh_steps = self._iterate(matrix, rhs, tolerance, MOST_KRYLOV_STEPS)
        if solution is None:
            raise np.linalg.LinAlgError("the tangent is singular or far from symmetric")
        return solution

    def solve_all(
        self, matrix: sp.csr_array, preconditioner: FloatArray, rhs: FloatArray, tolerance: float
    ) -> FloatArray:
        """Solutions (m, n) of several right-hand sides (m, n), with new factors and one Krylov space.

        New factors, because older ones need many more steps at a tight tolerance.

        Raises
        ------
        numpy.linalg.LinAlgError
            As :meth:`solve`.
        """
        self._factorise(preconditioner)
        space = Space(matrix, self._factor.precondition, len(rhs))
        return np.stack([space.solve(b, tolerance) for b in rhs])

    def _factorise(self, values: FloatArray) -> None:
        self.n_factorisations += 1
        self._ready, self._extra_steps = False, 0
        try:
            self._factor.factorise(values)
        except np.linalg.LinAlgError:
            if self._factor.precision == "double":
                raise
            # Thin and nearly incompressible: from here on, a larger space is faster.
            self._factor = _factor(self._pattern, "double")
            self._factor.factorise(values)
        self._ready = True

    def _iterate(
        self, matrix: sp.csr_array, rhs: FloatArray, tolerance: float, most_steps: int
    ) -> tuple[FloatArray | None, int]:
        """Solution, or None, and the steps that it took."""
        solution, n_steps, converged = self._factor.krylov(matrix.data, rhs, tolerance, most_steps)
        return solution if converged else None, n_steps


def _factor(pattern: Pattern, precision: Literal["single", "double"]) -> SparseFactor:
    return SparseFactor(pattern.indptr, pattern.indices, precision=precision)
