"""A polynomial fit of the simulated curves over the parameters, and Fopt as a quadratic from it.

Parameters are scaled to their ranges, so each is in [0, 1].
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, lsq_linear

from palpate.api import FloatArray

LEAST_Q2 = 0.8
"""Smallest share of the curves' variation that is predicted at sets left out of the fit."""

SETS_PER_COEFFICIENT = 1.5
"""Sets that a fit needs for each of its coefficients."""


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadraticForm:
    """Fopt(u) = |matrix u + offset|² + rest over the box 0 ≤ u ≤ 1.

    Parameters
    ----------
    matrix : (p, p) array
    offset : (p,) array
    """

    matrix: FloatArray
    offset: FloatArray
    rest: float

    def __call__(self, u: FloatArray) -> float:
        """Fopt at ``u`` (p,)."""
        return float(((self.matrix @ u + self.offset) ** 2).sum()) + self.rest

    def minimum(self) -> FloatArray:
        """Where Fopt is least in the box: (p,)."""
        return _least_in_box(self.matrix, self.offset)

    def interval(self, i: int, limit: float) -> tuple[float, float]:
        """Find the least and largest u_i at which Fopt ≤ limit, the others free within the box."""
        optimum = self.minimum()

        def excess(value: float) -> float:
            u = np.insert(self._profile(i, value), i, value)
            return self(u) - limit

        low, high = (_end(excess, float(optimum[i]), bound) for bound in (0.0, 1.0))
        return low, high

    def _profile(self, i: int, value: float) -> FloatArray:
        """Best values of the other parameters where the i-th is given."""
        others = np.delete(self.matrix, i, axis=1)
        return _least_in_box(others, self.offset + self.matrix[:, i] * value)

    def correlation(self) -> FloatArray:
        """Correlation (p, p) of the parameters among sets that fit about as well, the box aside."""
        sizes, axes = np.linalg.eigh(self.matrix.T @ self.matrix)
        # A direction without effect has a very large width, not an infinite one.
        covariance = (axes / np.maximum(sizes, 1e-12 * max(sizes[-1], 1e-300))) @ axes.T
        widths = np.sqrt(np.diag(covariance))
        correlation: FloatArray = covariance / np.outer(widths, widths)
        return correlation


def together(forms: Iterable[tuple[float, QuadraticForm]]) -> float:
    """Least value over the box of the sum of weight · Fopt of several forms."""
    weighted = list(forms)
    matrix = np.concatenate([np.sqrt(weight) * form.matrix for weight, form in weighted])
    offset = np.concatenate([np.sqrt(weight) * form.offset for weight, form in weighted])
    u = _least_in_box(matrix, offset)
    return sum(weight * form(u) for weight, form in weighted)


def _least_in_box(matrix: FloatArray, offset: FloatArray) -> FloatArray:
    """Minimise |matrix u + offset| over 0 ≤ u ≤ 1; the middle along directions without effect."""
    n = matrix.shape[1]
    if n == 0:
        return np.zeros(0)
    weak = 1e-8 * max(float(np.linalg.norm(matrix)), 1e-150)
    found = lsq_linear(
        np.concatenate([matrix, weak * np.eye(n)]),
        np.concatenate([-offset, np.full(n, 0.5 * weak)]),
        bounds=(0.0, 1.0),
        method="bvls",
    )
    u: FloatArray = np.clip(found.x, 0.0, 1.0)
    return u


def _end(excess: Callable[[float], float], inside: float, bound: float) -> float:
    if inside == bound or excess(bound) <= 0.0:
        return bound
    if excess(inside) >= 0.0:
        return inside
    return float(brentq(excess, inside, bound, xtol=1e-6))


@dataclass(frozen=True, kw_only=True, eq=False)
class Slopes:
    """Residuals (n_points,) at the origin of the steps, and their slopes (p, n_points).

    Parameters
    ----------
    q2 : float
        Share of the curves' variation that is predicted at sets left out of the fit.
    error : float
        Mean square error of such a prediction, near the best sets: that much of Fopt is unknown.
    """

    residuals: FloatArray
    slopes: FloatArray
    q2: float
    error: float

    def form(self, origin: FloatArray) -> QuadraticForm:
        """Fopt over the box, where the steps were from ``origin`` (p,)."""
        q, matrix = np.linalg.qr(self.slopes.T)
        along = q.T @ self.residuals
        rest = max(0.0, float(self.residuals @ self.residuals - along @ along))
        return QuadraticForm(matrix=matrix, offset=along - matrix @ origin, rest=rest)


def fit_slopes(steps: FloatArray, residuals: FloatArray, fopt: FloatArray) -> Slopes | None:
    """Fit residuals as a polynomial of the steps from a set, sets that fit well counting more.

    Parameters
    ----------
    steps : (n, p) array
        Of each set from that one, as a share of the ranges.
    residuals : (n, n_points) array
    fopt : (n,) array

    Returns
    -------
    Slopes or None
        Of second degree, or of first where the sets do not suffice; None where they do not
        suffice for that either.
    """
    for columns in (_quadratic(steps), _linear(steps)):
        if len(steps) >= SETS_PER_COEFFICIENT * columns.shape[1]:
            break
    else:
        return None
    weights = np.sqrt(1.0 / (fopt + max(float(fopt.min()), 1e-3 * float(np.median(fopt)), 1e-300)))[:, None]
    q, r = np.linalg.qr(weights * columns)
    if np.abs(np.diag(r)).min() <= 1e-10 * np.abs(np.diag(r)).max():
        return None
    target = weights * residuals
    coefficients = np.linalg.solve(r, q.T @ target)
    # Leave-one-out error of each set.
    left_out = (target - q @ (q.T @ target)) / np.maximum(1.0 - (q**2).sum(axis=1), 1e-9)[:, None]
    missed = float((left_out**2).sum())
    mean = (weights * target).sum(axis=0) / (weights**2).sum()
    variation = float(((target - weights * mean) ** 2).sum())
    n_parameters = steps.shape[1]
    return Slopes(
        residuals=coefficients[0],
        slopes=coefficients[1 : 1 + n_parameters],
        q2=1.0 - missed / variation if variation > 0.0 else -np.inf,
        error=missed / float((weights**2).sum()),
    )


def _linear(steps: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(steps)), steps])


def _quadratic(steps: FloatArray) -> FloatArray:
    i, j = np.triu_indices(steps.shape[1])
    return np.column_stack([_linear(steps), steps[:, i] * steps[:, j]])
