"""One Krylov space for several right-hand sides of the same matrix."""

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from scipy.linalg import solve_triangular

from palpate.api import FloatArray

MOST_STEPS = 60
"""Directions per right-hand side; more would mean a poor preconditioner."""

TOLERATED = 1e-5
"""Relative residual of a solution that is taken although rounding keeps it from its tolerance."""


class Space:
    """Solves K x = b for one b after the other by minimal residuals, as GCR does.

    Every solution is a combination of the preconditioned residuals of all right-hand
    sides so far: the error of the preconditioner is the same for each, so the
    first one costs most. With Z the directions, K Zᵀ = Cᵀ R and C Cᵀ = I,
    the residual is least for x = Zᵀ R⁻¹ C b.

    Parameters
    ----------
    matrix : (n, n) sparse array
    precondition : callable
        Approximate solution (n,) of a right-hand side (n,).
    n_rhs : int
        How many right-hand sides will come.
    """

    def __init__(
        self, matrix: sp.csr_array, precondition: Callable[[FloatArray], FloatArray], n_rhs: int
    ) -> None:
        self._matrix, self._precondition = matrix, precondition
        most = MOST_STEPS * n_rhs
        self._directions, self._images = np.empty((2, most, matrix.shape[0]))
        self._triangle = np.zeros((most, most))
        self.n_steps = 0

    def solve(self, rhs: FloatArray, tolerance: float) -> FloatArray:
        """Solution to the relative residual ``tolerance``, or as far as rounding allows.

        Raises
        ------
        numpy.linalg.LinAlgError
            Not even ``TOLERATED`` is reached, or a value is not finite.
        """
        if not np.isfinite(rhs).all():
            raise np.linalg.LinAlgError("the right-hand side is not finite")
        size = float(np.linalg.norm(rhs))
        target = tolerance * size
        solution, residual = np.zeros_like(rhs), rhs
        while (left := float(np.linalg.norm(residual))) > target:
            solution = solution + self._correction(residual, target)
            residual = rhs - self._matrix @ solution
            if not (after := float(np.linalg.norm(residual))) < 0.5 * left:
                if after <= TOLERATED * size:
                    break
                raise np.linalg.LinAlgError("the tangent is singular or far from its preconditioner")
        return solution

    def _correction(self, residual: FloatArray, target: float) -> FloatArray:
        """Solution for a residual, up to rounding in the images."""
        shares = self._images[: self.n_steps] @ residual
        residual = residual - shares @ self._images[: self.n_steps]
        more = []
        while np.linalg.norm(residual) > 0.9 * target and self._extend(self._precondition(residual)):
            image = self._images[self.n_steps - 1]
            more.append(float(image @ residual))
            residual = residual - more[-1] * image
        n = self.n_steps
        coefficients = solve_triangular(self._triangle[:n, :n], np.concatenate([shares, more]))
        correction: FloatArray = coefficients @ self._directions[:n]
        return correction

    def _extend(self, direction: FloatArray) -> bool:
        """Add a direction; false if it is dependent, or the space is full."""
        n = self.n_steps
        image = self._matrix @ direction
        if n == len(self._images) or not np.isfinite(image).all():
            return False
        size = np.linalg.norm(image)
        shares = np.zeros(n)
        for _ in range(2):  # the second removes the rounding of the first
            more = self._images[:n] @ image
            image -= more @ self._images[:n]
            shares += more
        left = np.linalg.norm(image)
        if not left > 1e-10 * size:
            return False
        self._directions[n], self._images[n] = direction, image / left
        self._triangle[:n, n], self._triangle[n, n] = shares, left
        self.n_steps += 1
        return True
