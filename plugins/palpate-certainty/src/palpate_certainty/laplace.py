"""Density of the parameters by the most efficient fit by scores, from the errors of its residuals.

Within a curve all points count as in Fopt: what it says of the parameters is in its scores Uᵀr, with
orthonormal columns U that span its slopes. The scores of all curves, with slopes G = UᵀJ and covariance UᵀCU,
are weighed by what they may be wrong by (generalised method of moments: Hansen, Econometrica 50, 1982): the
information is Gᵀ(UᵀCU)⁻¹G, and one step leads from the fit to the most likely values. Fopt's weights and zero
are among these, so that no further curve takes information away. Weights of single points (generalised least
squares) would rest on the shape of each error as well. Scores that span the slopes of all curves together
are the scores of Fopt itself: as many as parameters, whatever weighs them. What is outside of the ranges is
cut off.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from palpate.api import FloatArray, IntArray, PalpateError
from palpate.api.fit import LEVEL, linear_least

RANGE, PRIORS = "range", "priors"
"""Names of the shares that are due to the width of the range alone, and to priors."""

RANGE_SD = 10.0
"""Standard deviation, in ranges, of what is known without any curve: flat within the range."""

FLAT_SD = 12.0**-0.5
"""Standard deviation, in ranges, of a value that may be anywhere in its range: nothing is outside of it."""

N_DRAWS = 1024
"""Points that stand for the density in the box."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Laplace:
    """Student's density of the parameters, as shares of their ranges: the scale of errors is uncertain.

    Parameters
    ----------
    centre : (n_parameters,) array
        May be outside the box, where a fit has ended at a bound.
    covariance : (n_parameters, n_parameters) array
        Student's scale matrix, smaller than the covariance by (freedom - 2) / freedom.
    parts : mapping of cause to (n_parameters, n_parameters) array
        They sum to the covariance.
    freedom : float
        Degrees of freedom of the scale; infinite: the density is normal.
    through : (n_parameters, n) array
        Change of the centre by each residual, its sign turned.
    """

    centre: FloatArray
    covariance: FloatArray
    parts: Mapping[str, FloatArray]
    freedom: float = np.inf
    through: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def mapped(self, by: FloatArray, centre: FloatArray) -> "Laplace":
        """Density around a ``centre`` (m,) of changes that are combinations (m, n_parameters) of these."""
        parts, covariance = {n: by @ p @ by.T for n, p in self.parts.items()}, by @ self.covariance @ by.T
        through = by @ self.through if self.through.size else self.through
        return replace(self, centre=centre, covariance=covariance, parts=parts, through=through)

    def with_part(self, name: str, part: FloatArray) -> "Laplace":
        """Density with one more part of a cause in its covariance."""
        parts = {**self.parts, name: self.parts.get(name, 0.0) + part}
        return replace(self, covariance=self.covariance + part, parts=parts)

    @property
    def in_range(self) -> "Laplace":
        """Density where every value is known to be within its range: as wide as the intervals."""
        # Known already is a value with the standard deviation RANGE_SD.
        size = np.eye(self.centre.size) / (FLAT_SD**-2 - RANGE_SD**-2)
        gain = np.linalg.solve(self.covariance + size, self.covariance).T
        rest = self.mapped(np.eye(len(gain)) - gain, self.centre + gain @ (0.5 - self.centre))
        return rest.with_part(RANGE, gain @ size @ gain.T)

    @property
    def shares(self) -> dict[str, FloatArray]:
        """Share (n_parameters,) of each cause in the variances; they sum to 1."""
        variance = np.diag(self.covariance)
        # Rounding may make a part less than nothing.
        return {name: np.maximum(np.diag(part) / variance, 0.0) for name, part in self.parts.items()}

    @property
    def sd(self) -> FloatArray:
        """Standard deviation (n_parameters,) of the normal density with the same 95 % interval.

        Student's density may have none; bounds are aside.
        """
        return wider(self.freedom) * np.sqrt(np.diag(self.covariance))

    @property
    def in_ranges(self) -> float:
        """Probability of a centre as far outside of the ranges as this one, or farther."""
        whiten, likely = self._whiten, self.most_likely
        size, square = likely.size, float(np.sum((whiten @ (likely - self.centre)) ** 2))
        if np.isinf(self.freedom):
            return float(scipy.stats.chi2.sf(square, size))
        return float(scipy.stats.f.sf(square / size, size, self.freedom))

    @property
    def most_likely(self) -> FloatArray:
        """Point (n_parameters,) of the ranges where the density is largest."""
        # In standard deviations: a coefficient of many powers of ten has shares that a solver takes for 0.
        sd = np.sqrt(np.diag(self.covariance))
        found = linear_least(self._whiten * sd, 0.0 * sd, -self.centre / sd, (1.0 - self.centre) / sd)
        return np.clip(self.centre + sd * found, 0.0, 1.0)

    @property
    def _whiten(self) -> FloatArray:
        return np.linalg.inv(np.linalg.cholesky(self.covariance))

    def within(self, prior: Callable[[FloatArray], FloatArray] | None = None) -> "Density":
        """Cut off what is outside the box; a prior weighs points (n, n_parameters), unless all by 0."""
        root = np.linalg.cholesky(self.covariance).astype(np.float64)
        points, weights = _in_box(self.centre, root, self.freedom)
        known = weights if prior is None else weights * prior(points)
        if not known.any():
            raise PalpateError(
                f"the filters reject all {len(points):,} values that describe the curves as well as the fit; "
                "leave out a filter, or widen the ranges"
            )
        return Density(centre=self.centre, covariance=self.covariance, points=points, weights=known)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Density:
    """Density cut off at the ranges, as weighted points (n, n_parameters)."""

    centre: FloatArray
    covariance: FloatArray
    points: FloatArray
    weights: FloatArray

    def of(self, columns: Sequence[int]) -> "Density":
        """Density of some of the parameters, whatever the others are."""
        at = list(columns)
        part = self.covariance[np.ix_(at, at)]
        return replace(self, centre=self.centre[at], covariance=part, points=self.points[:, at])

    def interval(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ends (n_parameters,) of the 95 % intervals; a fitted point at a bound is within."""
        tails = [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0]
        ends = np.stack([_quantiles(column, self.weights, tails) for column in self.points.T], axis=1)
        return np.minimum(ends[0], point), np.maximum(ends[1], point)

    @property
    def nearest(self) -> FloatArray:
        """Point with a weight where the normal density is largest (n_parameters,)."""
        points = self.points[self.weights > 0.0]
        return points[np.argmin(self._squares(points))]

    def draws(self, n: int) -> FloatArray:
        """Points (n, n_parameters), spread evenly over the weights."""
        # In random order: every 16th point of a Sobol sequence lies in one narrow slab.
        order = np.random.default_rng(0).permutation(len(self.points))
        cumulative = np.cumsum(self.weights[order])
        middles = (np.arange(n) + 0.5) / n * cumulative[-1]
        return self.points[order[np.searchsorted(cumulative, middles)]]

    def holds(self, point: FloatArray) -> bool:
        """Whether a point is in the joint 95 % region, an ellipsoid within the box."""
        squares = self._squares(np.concatenate([self.points, point[None]]))
        (most,) = _quantiles(squares[:-1], self.weights, [LEVEL])
        return bool(squares[-1] <= most)

    def _squares(self, points: FloatArray) -> FloatArray:
        apart = points - self.centre
        return (apart * np.linalg.solve(self.covariance, apart.T).T).sum(axis=1)


def wider(freedom: float) -> float:
    """Length of Student's 95 % interval over the normal one with the scale matrix as its covariance."""
    upper = 0.5 + LEVEL / 2.0
    return float(scipy.stats.t.ppf(upper, freedom) / scipy.stats.norm.ppf(upper))


def scores_of(jacobian: FloatArray, curves: IntArray) -> FloatArray:
    """Orthonormal columns (n, m) that span the slopes of each curve, where ``curves`` (n,) numbers these."""
    parts = []
    for curve in np.unique(curves):
        axes, sizes, _ = np.linalg.svd(jacobian * (curves == curve)[:, None], full_matrices=False)
        # Least slope of a curve, over its largest, that is not rounding.
        parts.append(axes[:, sizes > 1e-9 * max(float(sizes.max()), 1e-300)])
    return np.concatenate(parts, axis=1)


def laplace(
    point: FloatArray,
    residuals: FloatArray,
    jacobian: FloatArray,
    causes: Mapping[str, FloatArray],
    scores: FloatArray,
    *,
    range_sd: float = RANGE_SD,
    freedom: float = np.inf,
) -> Laplace:
    """Density around the most likely values, and the part of each cause in its covariance.

    Parameters
    ----------
    point : (n_parameters,) array
        Where the fit has ended, as shares of the ranges.
    residuals : (n,) array
    jacobian : (n, n_parameters) array
        Of the residuals, per range.
    causes : mapping of name to (n, m) array
        What each makes of the residuals: F with the covariance F Fᵀ. At least one is noise of every residual.
    scores : (n, k) array
        What is weighed, as :func:`scores_of` returns it.
    range_sd : float
        Standard deviation of each parameter before any curve; infinite for none.
    freedom : float
        Degrees of freedom of the errors' scale.
    """
    of_scores = {name: scores.T @ factor for name, factor in causes.items()}
    parts = {name: factor @ factor.T for name, factor in of_scores.items()}
    slopes = scores.T @ jacobian
    total = np.sum(list(parts.values()), axis=0)
    prior = np.eye(jacobian.shape[1]) / range_sd**2
    gain = np.linalg.solve(total, slopes)
    of_weights: FloatArray = np.linalg.inv(slopes.T @ gain + prior).astype(np.float64)
    through = of_weights @ gain.T
    made = {name: through @ part @ through.T for name, part in parts.items()}
    made[RANGE] = of_weights @ prior @ of_weights
    covariance = np.sum(list(made.values()), axis=0)
    centre = point - through @ (scores.T @ residuals)
    symmetric = (covariance + covariance.T) / 2.0
    return Laplace(
        centre=centre, covariance=symmetric, parts=made, freedom=freedom, through=through @ scores.T
    )


def _in_box(centre: FloatArray, root: FloatArray, freedom: float) -> tuple[FloatArray, FloatArray]:
    """Weighted points of a density within the unit box (Geweke, Hajivassiliou and Keane).

    Student's density is a normal one whose scale is drawn first. Each coordinate is drawn within its bounds,
    given those before it; the weight is the product of the probabilities.
    """
    is_normal = np.isinf(freedom)
    even = scipy.stats.qmc.Sobol(centre.size + (not is_normal), rng=0).random(N_DRAWS)
    normal, logs = np.zeros((N_DRAWS, centre.size)), np.zeros(N_DRAWS)
    scale = np.ones(N_DRAWS)
    if not is_normal:
        scale = np.sqrt(freedom / scipy.stats.chi2.ppf(np.clip(even[:, -1], 1e-9, 1.0 - 1e-9), freedom))
    for i in range(centre.size):
        mean, size = centre[i] + scale * (normal[:, :i] @ root[i, :i]), scale * root[i, i]
        low, high = -mean / size, (1.0 - mean) / size
        flip = low > 0.0  # where a tail is exact
        low, high = np.where(flip, -high, low), np.where(flip, -low, high)
        below, above = scipy.special.ndtr(low), scipy.special.ndtr(high)
        drawn = scipy.special.ndtri(np.clip(below + even[:, i] * (above - below), 1e-300, 1.0 - 1e-16))
        normal[:, i] = np.where(flip, -1.0, 1.0) * np.clip(drawn, low, high)
        logs += np.log(np.maximum(above - below, 1e-300))
    points = np.clip(centre + scale[:, None] * (normal @ root.T), 0.0, 1.0)
    return points, np.exp(logs - logs.max())


def _quantiles(values: FloatArray, weights: FloatArray, at: list[float]) -> FloatArray:
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    middles = cumulative - weights[order] / 2.0
    return np.interp(np.array(at) * cumulative[-1], middles, values[order])


def root_of(covariance: FloatArray) -> FloatArray:
    """Factor F (n, n) of a covariance F Fᵀ, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def whitening(scores: FloatArray, covariance: FloatArray, groups: FloatArray) -> FloatArray:
    """Matrix (m, n) from the n residuals of a problem to independent ones of variance 1.

    The scores (m, k) are apart from what is left of the curves, which moves no fit. They and the covariance
    (m, m) are of the averages ``groups`` (m, n) of the residuals.
    """
    white = [
        scipy.linalg.solve_triangular(_root(part.T @ covariance @ part), part.T, lower=True)
        for part in (scores, scipy.linalg.null_space(scores.T))
    ]
    return np.concatenate(white) @ groups


def _root(covariance: FloatArray) -> FloatArray:
    jitter = 1e-12 * np.trace(covariance) / len(covariance)
    return np.linalg.cholesky(covariance + jitter * np.eye(len(covariance)))
