"""The sparse linear system, with one pattern for all tangents.

The tangent is unsymmetric under friction and changes little from one Newton
iteration to the next, so a factorisation is reused as the preconditioner of GMRES
as long as that is cheaper.
"""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from palpate.api import FloatArray, IntArray
from palpate.api.mechanics import SparseFactor
from palpate_jax.compiled import keep_order, kept_order, order_file

PATIENCE = 60
"""Extra Krylov steps of an older factor, compared with a new one, before a new factorisation.

A new factorisation is due when the extra steps since the last one have cost about as much.
"""

FEW_KRYLOV_STEPS = 40
"""A solve that needs more gets a new preconditioner."""

MOST_KRYLOV_STEPS = 60
"""A solve that needs more with a fresh preconditioner has failed."""


_ACROSS = np.arange(3)
"""Unknowns of a node."""


TOLERATED = 1e-5
"""Relative residual of a solution that is taken although rounding keeps it from its tolerance."""


class Pattern:
    """Places of the element entries in a compressed-row matrix of the free unknowns.

    Parameters
    ----------
    groups : sequence of (e, 3n) integer arrays
        Unknown of each element degree of freedom, −1 if it is fixed. A node has three numbers
        in sequence that start at a multiple of three, or are all fixed.
    """

    def __init__(self, groups: Sequence[IntArray], n_unknowns: int) -> None:
        self.n_unknowns, n_nodes = n_unknowns, n_unknowns // 3
        nodes = [g[:, ::3] // 3 for g in groups]
        rows = np.concatenate([np.repeat(g, g.shape[1], axis=1).ravel() for g in nodes])
        columns = np.concatenate([np.tile(g, (1, g.shape[1])).ravel() for g in nodes])
        free = (rows >= 0) & (columns >= 0)
        codes = rows[free] * n_nodes + columns[free]
        pairs = np.sort(codes)  # much faster than a search for distinct values
        pairs = pairs[np.diff(pairs, prepend=-1) > 0]
        of, to = np.divmod(pairs, n_nodes)
        counts = np.bincount(of, minlength=n_nodes)
        starts = np.concatenate([[0], np.cumsum(counts)])
        # Of a pair: 3 × 3 entries; the next row of a node is as far as it has columns.
        first = 9 * starts[of] + 3 * (np.arange(len(pairs)) - starts[of])
        blocks = first[:, None, None] + (3 * counts[of])[:, None, None] * _ACROSS[:, None] + _ACROSS
        self.indptr = np.concatenate([[0], np.cumsum(np.repeat(3 * counts, 3))]).astype(np.int32)
        self.indices = np.empty(blocks.size, dtype=np.int32)
        self.indices[blocks] = 3 * to[:, None, None] + _ACROSS
        counterparts = blocks[np.searchsorted(pairs, to * n_nodes + of)]
        self._transposed = np.empty(blocks.size, dtype=np.int64)
        self._transposed[blocks] = counterparts.transpose(0, 2, 1)
        found = np.full(len(rows), len(pairs))  # pairs with a fixed node go to one spare place
        found[free] = np.searchsorted(pairs, codes)
        blocks = np.concatenate([blocks, np.full((1, 3, 3), blocks.size)])
        parts = np.split(found, np.cumsum([g.size * g.shape[1] for g in nodes])[:-1])
        self._places: list[IntArray] = [
            blocks[part].reshape(-1, g.shape[1], g.shape[1], 3, 3).swapaxes(2, 3).reshape(len(g), -1)
            for g, part in zip(nodes, parts, strict=True)
        ]
        self._sizes = [g.shape[1] for g in groups]

    def places(self, group: int) -> IntArray:
        """Place (e, m, m) of each entry of a group in ``indices``, their number for a fixed one."""
        m = self._sizes[group]
        return self._places[group].reshape(-1, m, m)

    def add(self, values: FloatArray, group: int, elements: IntArray, stiffnesses: FloatArray) -> None:
        """Add stiffnesses (e', m, m) of some elements of a group to values in the order of ``indices``."""
        if len(elements):
            places = self._places[group][elements].ravel()
            free = places < len(values)
            np.add.at(values, places[free], stiffnesses.ravel()[free])

    def symmetric_part(self, values: FloatArray) -> FloatArray:
        """Values of (K + Kᵀ)/2."""
        return 0.5 * (values + values[self._transposed])


class LinearSolver:
    """Solves K x = b by GMRES, preconditioned with the factors of a symmetric matrix close to K.

    Symmetric factors cost a fifth of unsymmetric ones, and older ones are
    reused until the extra iterations cost more.

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
        self._fresh_steps = MOST_KRYLOV_STEPS
        self._extra_steps = 0

    def reset(self) -> None:
        """Drop the factors."""
        self._ready = False

    def restart(self) -> None:
        """Drop the factors and the count, before another simulation of the same pattern.

        It begins in single precision, whatever the one before it has needed: its bits are its own.
        """
        self.reset()
        self.n_factorisations = 0
        if self._factor.precision != "single":
            self._factor = _factor(self._pattern, "single")

    def solve(
        self, matrix: FloatArray, preconditioner: Callable[[], FloatArray], rhs: FloatArray, tolerance: float
    ) -> FloatArray:
        """Solution to the relative residual ``tolerance``.

        Parameters
        ----------
        matrix : (n_entries,) array
            In the order of the pattern.
        preconditioner : callable
            Returns the values of a symmetric matrix close to it, for new factors.
        rhs : (n,) array

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular to working precision, or a value is not finite.
        """
        if not (np.isfinite(matrix).all() and np.isfinite(rhs).all()):
            raise np.linalg.LinAlgError("the tangent is not finite")
        if self._ready and self._extra_steps < PATIENCE:
            solution, n_steps = self._iterate(matrix, rhs, tolerance, FEW_KRYLOV_STEPS)
            if solution is not None:
                # The least with this factor: its first system may have been a hard one.
                self._fresh_steps = min(self._fresh_steps, n_steps)
                self._extra_steps += max(n_steps - self._fresh_steps, 0)
                return solution
        self._factorise(preconditioner())
        for sweep in (True, False):  # where friction makes a sweep diverge, the factor alone does not
            solution, self._fresh_steps = self._iterate(matrix, rhs, tolerance, MOST_KRYLOV_STEPS, sweep)
            if solution is not None:
                return solution
        raise np.linalg.LinAlgError("the tangent is singular or far from symmetric")

    def solve_all(
        self, matrix: FloatArray, preconditioner: Callable[[], FloatArray], rhs: FloatArray, tolerance: float
    ) -> FloatArray:
        """Solutions (m, n) of several right-hand sides (m, n), in one Krylov space.

        A solution is taken up to ``TOLERATED`` if rounding keeps it from its tolerance.

        Raises
        ------
        numpy.linalg.LinAlgError
            As :meth:`solve`.
        """
        if not (np.isfinite(matrix).all() and np.isfinite(rhs).all()):
            raise np.linalg.LinAlgError("the tangent is not finite")
        if self._ready:
            solutions, _, left = self._factor.krylov_together(
                matrix, rhs, tolerance, len(rhs) * FEW_KRYLOV_STEPS
            )
            if left <= tolerance:
                return solutions
        self._factorise(preconditioner())
        for sweep in (True, False):
            solutions, _, left = self._factor.krylov_together(
                matrix, rhs, tolerance, len(rhs) * MOST_KRYLOV_STEPS, sweep=sweep
            )
            if left <= max(tolerance, TOLERATED):
                return solutions
        raise np.linalg.LinAlgError("the tangent is singular or far from symmetric")

    def _factorise(self, values: FloatArray) -> None:
        self.n_factorisations += 1
        self._ready, self._fresh_steps, self._extra_steps = False, MOST_KRYLOV_STEPS, 0
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
        self, matrix: FloatArray, rhs: FloatArray, tolerance: float, most_steps: int, sweep: bool = True
    ) -> tuple[FloatArray | None, int]:
        """Solution, or None, and the steps that it took."""
        solution, n_steps, converged = self._factor.krylov(matrix, rhs, tolerance, most_steps, sweep=sweep)
        return solution if converged else None, n_steps


def _factor(pattern: Pattern, precision: Literal["single", "double"]) -> SparseFactor:
    file = order_file(pattern.indptr, pattern.indices)
    order = kept_order(file)
    factor = SparseFactor(pattern.indptr, pattern.indices, precision=precision, order=order)
    if order is None:
        keep_order(file, factor.order)
    return factor
