"""An emulator of a spot's curves between the sets that were simulated, from their values and slopes.

Where all moduli are searched, curves are in proportion to them: S(v) = t R(z), with the total stiffness
t = Σ w_i v_i and the shares z_i = w_i v_i / t, so that one coordinate less is left. The weights w are those
by which the moduli stiffen the curves. Whether this holds is seen in the slopes, by Euler's theorem.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray, IntArray, Parameter

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
        Variance of the reproduction error, over the process variance; it counts where lengths are given.

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
        # Variance of outputs of which nothing but the polynomial is known.
        self._sizes = sizes if n_free > 0 else np.full(observed.shape[1], 1e30)
        self._parts = (inverse, through, normal)

    def __call__(self, points: FloatArray) -> FloatArray:
        """Outputs (n, n_outputs) at points (n, d)."""
        process = _kernel(points, self.points, self.lengths, NO_SLOPES, self.sloped) @ self.weights
        return _trend(points, NO_SLOPES, self.powers) @ self.coefficients + process

    def variance(self, points: FloatArray) -> FloatArray:
        """Variance (n, n_outputs) of the outputs at points (n, d); ``UNKNOWN`` where nothing tells it."""
        inverse, through, normal = self._parts
        kernel = _kernel(points, self.points, self.lengths, NO_SLOPES, self.sloped)
        rest = _trend(points, NO_SLOPES, self.powers) - kernel @ through
        shares = 1.0 - (kernel @ inverse * kernel).sum(axis=1) + (rest @ normal * rest).sum(axis=1)
        return np.maximum(shares, 1e-12)[:, None] * self._sizes

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
                factor = scipy.linalg.cho_factor(covariance, lower=True)
            except np.linalg.LinAlgError:
                return 1e10
            variances = (rest * scipy.linalg.cho_solve(factor, rest)).sum(axis=0) + least
            determinant = 2.0 * np.log(np.diag(factor[0])).sum()
            return float(len(rest) * np.log(variances).sum() + rest.shape[1] * determinant)

        logs = np.append(np.zeros(d), np.log(1e-8))
        # What the polynomial leaves, over what was observed, up to which it is exact.
        if np.linalg.norm(rest) > 1e-9 * np.linalg.norm(observed):
            # Ranges of the correlation lengths, in half ranges of the coordinates, and of the variance of
            # the error of reproduction, over the variance of the process.
            bounds = [tuple(np.log((0.1, 20.0)))] * d + [tuple(np.log((1e-12, 1e-6)))]
            logs = scipy.optimize.minimize(
                loss, logs, method="L-BFGS-B", bounds=bounds, options={"maxiter": 30}
            ).x
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Runs:
    """Simulated sets.

    Parameters
    ----------
    values : (n, n_parameters) array
    ordinates : (n, n_points) array
        NaN where a run has failed.
    slopes : (n, n_points, n_parameters) array
        Per unit of each value; NaN where a run has none.
    """

    values: FloatArray
    ordinates: FloatArray
    slopes: FloatArray

    def and_others(self, others: "Runs") -> "Runs":
        """These runs, then the others."""
        pairs = ((getattr(self, f.name), getattr(others, f.name)) for f in fields(self))
        values, ordinates, slopes = (np.concatenate(pair) for pair in pairs)
        return Runs(values=values, ordinates=ordinates, slopes=slopes)

    def __getitem__(self, chosen: IntArray) -> "Runs":
        """Some of the runs."""
        return Runs(values=self.values[chosen], ordinates=self.ordinates[chosen], slopes=self.slopes[chosen])

    @property
    def ended(self) -> "Runs":
        """Runs with a result."""
        return self[np.flatnonzero(np.isfinite(self.ordinates).all(axis=1))]

    @property
    def sloped(self) -> BoolArray:
        """Mask (n,) of the runs that have slopes."""
        return np.array([np.isfinite(each).all() for each in self.slopes], dtype=np.bool_)

    def weights(self, is_modulus: BoolArray, scale: FloatArray) -> FloatArray | None:
        """Stiffening by each modulus, (n_parameters,); None where curves are not in proportion to them."""
        sloped = self.sloped
        if not is_modulus.any() or not sloped.any() or (self.values[:, is_modulus] < 0.0).any():
            return None
        slopes, curves = self.slopes[sloped] / scale[:, None], self.ordinates[sloped] / scale
        by_moduli = np.einsum("nkp,np->nk", slopes[:, :, is_modulus], self.values[sloped][:, is_modulus])
        # Difference from Euler's theorem, over the curves, up to which they are in proportion to the moduli.
        if np.abs(by_moduli - curves).max() > 1e-3 * np.abs(curves).max():
            return None
        effects = np.median(np.linalg.norm(slopes, axis=1), axis=0)
        return np.where(is_modulus & (effects > 0.0), effects, 0.0)


class Emulator:
    """Curves of one spot as functions of the searched values.

    Parameters
    ----------
    parameters : sequence of Parameter
    runs : Runs
    scale : (n_points,) array
        Size of the ordinates, such as the peak of each curve, by which errors count.

    Attributes
    ----------
    left_out : (n, n_points) array
        Ordinates of each run less what the others predict.
    """

    def __init__(self, parameters: Sequence[Parameter], runs: Runs, scale: FloatArray) -> None:
        self.is_modulus = np.array([p.kind == "modulus" for p in parameters])
        self.weights, self.scale = runs.weights(self.is_modulus, scale), scale
        total, free = self._coordinates(runs.values)
        self.lower, self.upper = free.min(axis=0), free.max(axis=0)
        self.upper = np.where(self.upper > self.lower, self.upper, self.lower + 1.0)
        curves = runs.ordinates / scale / total[:, None]
        sloped = np.flatnonzero(runs.sloped)
        rates = self._rates(runs.slopes[sloped] / scale[:, None], total[sloped])
        self.mean = curves.mean(axis=0)
        stacked = np.concatenate([curves - self.mean, *np.moveaxis(rates, 2, 0)])
        _, sizes, axes = np.linalg.svd(stacked, full_matrices=False)
        # Size of a principal component, over the largest one, below which it is left out.
        self.axes = axes[sizes > 1e-6 * max(sizes[0], 1e-300)]
        slopes = np.moveaxis(rates, 2, 0) @ self.axes.T
        self.process = GaussianProcess(self._scaled(free), sloped, (curves - self.mean) @ self.axes.T, slopes)
        self.left_out = self.process.left_out @ self.axes * total[:, None] * scale

    def __call__(self, values: FloatArray) -> FloatArray:
        """Ordinates (n, n_points) at values (n, n_parameters)."""
        total, free = self._coordinates(values)
        curves = self.mean + self.process(self._scaled(free)) @ self.axes
        return curves * total[:, None] * self.scale

    def variance(self, values: FloatArray) -> FloatArray:
        """Variance (n, n_points) of the ordinates at values (n, n_parameters)."""
        total, free = self._coordinates(values)
        of_curves = self.process.variance(self._scaled(free)) @ self.axes**2
        return of_curves * (total[:, None] * self.scale) ** 2

    def _coordinates(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinate that the curves are in proportion to (n,), and the other coordinates (n, d)."""
        if self.weights is None:
            return np.ones(len(values)), values
        total = values @ self.weights
        shares = values * self.weights / total[:, None]
        return total, np.where(self.is_modulus, shares, values)[:, self._free]

    @property
    def _free(self) -> BoolArray:
        free = np.ones(self.is_modulus.size, dtype=np.bool_)
        if self.weights is not None:
            free[self._last] = False
        return free

    @property
    def _last(self) -> int:
        assert self.weights is not None
        return int(np.flatnonzero(self.weights)[-1])

    def _rates(self, slopes: FloatArray, total: FloatArray) -> FloatArray:
        """Slopes (n, n_points, d) of curves over their total stiffness, in the scaled coordinates."""
        width = (self.upper - self.lower) / 2.0
        if self.weights is None:
            return slopes * width
        # With the total held: what one share gains, the last one loses.
        weights = np.where(self.weights > 0.0, self.weights, 1.0)
        by_share = slopes / weights - slopes[:, :, [self._last]] / weights[self._last]
        rates = np.where(self.is_modulus, by_share, slopes / total[:, None, None])
        return rates[:, :, self._free] * width

    def _scaled(self, free: FloatArray) -> FloatArray:
        return 2.0 * (free - self.lower) / (self.upper - self.lower) - 1.0
