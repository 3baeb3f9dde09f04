"""Interpolation of values and slopes: a Gaussian process around a polynomial.

Universal kriging with derivatives (Morris, Mitchell & Ylvisaker, Technometrics 35, 1993): a polynomial of
first or second degree, plus a process of the covariance exp(−Σ (Δ_i/l_i)²/2), of which slopes are observed
as values are. The lengths l are the most likely ones. Leaving one run out needs no other fit (Dubrule,
Mathematical Geology 15, 1983).
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from palpate.api import FloatArray, IntArray

LENGTHS = (0.1, 20.0)
"""Range of the correlation lengths, in half ranges of the coordinates."""

NUGGETS = (1e-12, 1e-6)
"""Range of the variance of what is not reproduced, over that of the process."""

EXACT = 1e-9
"""What the polynomial leaves, over what was observed, up to which it is exact."""

UNKNOWN = 1e30
"""Variance of outputs of which nothing but the polynomial is known."""

NO_SLOPES: IntArray = np.zeros(0, dtype=np.int64)


class GaussianProcess:
    """Several outputs over the same coordinates, which range from −1 to 1.

    Parameters
    ----------
    points : (n, d) array
    sloped : (m,) integer array
        Numbers of the points with slopes.
    values : (n, n_outputs) array
    slopes : (d, m, n_outputs) array
    lengths : (d,) array, optional
        Correlation lengths, in half ranges of the coordinates; the most likely ones by default.
    nugget : float
        Variance of what is not reproduced, over that of the process; it counts where lengths are given.

    Attributes
    ----------
    left_out : (n, n_outputs) array
        Values less what all other points predict.
    """

    def __init__(
        self,
        points: FloatArray,
        sloped: IntArray,
        values: FloatArray,
        slopes: FloatArray,
        lengths: FloatArray | None = None,
        nugget: float = 1e-8,
    ) -> None:
        self.points, self.sloped = points, sloped
        observed = np.concatenate([values, *slopes])
        n, d = points.shape
        self.powers = _powers(d, 2 if len(observed) >= (d + 1) * (d + 2) else 1)
        trend = _trend(points, sloped, self.powers)
        if lengths is None:
            lengths, nugget = self._most_likely(trend, observed)
        self.lengths = lengths
        inverse = np.linalg.inv(self._covariance(self.lengths, nugget))
        through = inverse @ trend
        normal = np.linalg.inv(trend.T @ through)
        self.coefficients = normal @ through.T @ observed
        self.weights = inverse @ (observed - trend @ self.coefficients)
        projected = inverse - through @ normal @ through.T
        weighted = projected @ observed
        self.left_out = self._left_out(projected, weighted, n, d)
        n_free = len(observed) - len(self.powers)
        sizes = (observed * weighted).sum(axis=0) / max(n_free, 1)
        self._sizes = sizes if n_free > 0 else np.full(observed.shape[1], UNKNOWN)
        self._parts = (inverse, through, normal)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Outputs (n, n_outputs) at points (n, d)."""
        process = _kernel(points, self.points, self.lengths, NO_SLOPES, self.sloped) @ self.weights
        found: FloatArray = _trend(points, NO_SLOPES, self.powers) @ self.coefficients + process
        return found

    def variance(self, points: FloatArray) -> FloatArray:
        """Variance (n, n_outputs) of the outputs at points (n, d); ``UNKNOWN`` where nothing tells it."""
        inverse, through, normal = self._parts
        kernel = _kernel(points, self.points, self.lengths, NO_SLOPES, self.sloped)
        rest = _trend(points, NO_SLOPES, self.powers) - kernel @ through
        shares = 1.0 - (kernel @ inverse * kernel).sum(axis=1) + (rest @ normal * rest).sum(axis=1)
        found: FloatArray = np.maximum(shares, 1e-12)[:, None] * self._sizes
        return found

    def _covariance(self, lengths: FloatArray, nugget: float) -> FloatArray:
        covariance = _kernel(self.points, self.points, lengths, self.sloped, self.sloped)
        covariance[np.diag_indices_from(covariance)] *= 1.0 + nugget
        return covariance

    def _most_likely(self, trend: FloatArray, observed: FloatArray) -> tuple[FloatArray, float]:
        """Lengths (d,) and nugget of the largest restricted likelihood, all outputs together."""
        d = self.points.shape[1]
        free = np.linalg.qr(trend, mode="complete")[0][:, trend.shape[1] :]
        rest = free.T @ observed
        least = 1e-12 * (observed**2).sum() + 1e-300

        def loss(logs: FloatArray) -> float:
            covariance = free.T @ self._covariance(np.exp(logs[:d]), float(np.exp(logs[d]))) @ free
            try:
                factor = cho_factor(covariance, lower=True)
            except np.linalg.LinAlgError:
                return 1e10
            variances = (rest * cho_solve(factor, rest)).sum(axis=0) + least
            determinant = 2.0 * np.log(np.diag(factor[0])).sum()
            return float(len(rest) * np.log(variances).sum() + rest.shape[1] * determinant)

        logs = np.append(np.zeros(d), np.log(1e-8))
        if np.linalg.norm(rest) > EXACT * np.linalg.norm(observed):
            bounds = [tuple(np.log(LENGTHS))] * d + [tuple(np.log(NUGGETS))]
            logs = minimize(loss, logs, method="L-BFGS-B", bounds=bounds, options={"maxiter": 30}).x
        return np.exp(logs[:d]), float(np.exp(logs[d]))

    def _left_out(self, projected: FloatArray, weighted: FloatArray, n: int, d: int) -> FloatArray:
        left_out, m = np.zeros((n, weighted.shape[1])), len(self.sloped)
        for i in range(n):
            of_slopes = np.flatnonzero(self.sloped == i)
            rows = np.concatenate([[i], *(n + k * m + of_slopes for k in range(d))])
            block = projected[np.ix_(rows, rows)]
            left_out[i] = np.linalg.lstsq(block, weighted[rows], rcond=None)[0][0]
        return left_out


def _kernel(a: FloatArray, b: FloatArray, lengths: FloatArray, of_a: IntArray, of_b: IntArray) -> FloatArray:
    """Covariance of values and slopes at ``a`` with those at ``b``; slopes where the numbers say."""
    apart = (a[:, None] - b) / lengths
    values = np.exp(-0.5 * (apart**2).sum(axis=-1))
    rates = apart / lengths
    n = lengths.size
    top = [values] + [(values * rates[:, :, j])[:, of_b] for j in range(n) if of_b.size]
    rows = [np.concatenate(top, axis=1)]
    for i in range(n if of_a.size else 0):
        row = [-(values * rates[:, :, i])[of_a]]
        for j in range(n if of_b.size else 0):
            both = values * ((i == j) / lengths[i] ** 2 - rates[:, :, i] * rates[:, :, j])
            row.append(both[np.ix_(of_a, of_b)])
        rows.append(np.concatenate(row, axis=1))
    return np.concatenate(rows)


def _powers(d: int, degree: int) -> IntArray:
    """Powers (n_terms, d) of the polynomial's terms."""
    first = np.concatenate([np.zeros((1, d), dtype=np.int64), np.eye(d, dtype=np.int64)])
    i, j = np.triu_indices(d)
    second = np.eye(d, dtype=np.int64)[i] + np.eye(d, dtype=np.int64)[j]
    return np.concatenate([first, second]) if degree == 2 else first


def _trend(points: FloatArray, sloped: IntArray, powers: IntArray) -> FloatArray:
    """Terms of the polynomial at the points, then their slopes by coordinate."""
    rows = [np.prod(points[:, None] ** powers, axis=-1)]
    for i in range(powers.shape[1] if sloped.size else 0):
        lower = powers.copy()
        lower[:, i] = np.maximum(lower[:, i] - 1, 0)
        rows.append(powers[:, i] * np.prod(points[sloped, None] ** lower, axis=-1))
    return np.concatenate(rows)
