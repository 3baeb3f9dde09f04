"""Normal approximation of a least-squares fit, from what its residuals may be wrong by.

A fit at the least Σ r² solves Jᵀr = 0. With residuals of covariance C, the scores Jᵀr hold the information
JᵀJ (JᵀCJ)⁻¹ JᵀJ on the parameters: its inverse is the covariance of the fit, whatever the weights of
Fopt are (the sandwich of generalised estimating equations: Liang & Zeger, Biometrika 73, 1986). Generalised
least squares weighs all residuals by C⁻¹ instead (Aitken, Proc. R. Soc. Edinb. 55, 1935): the information is
JᵀC⁻¹J, never less, and one step leads from the fit to the most likely values. A wide normal density over each
range is added, and what is outside the ranges is cut off, so that a direction which no curve shows is as wide
as the ranges.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear
from scipy.special import ndtr, ndtri
from scipy.stats import chi2, qmc

from palpate.api import FloatArray, PalpateError
from palpate.api.fit import LEVEL

RANGE = "range"
"""Name of the share that is due to the width of the range alone."""

RANGE_SD = 1.0
"""Standard deviation, in ranges, of what is known without any curve."""

LEAST_GAIN = 1e-3
"""Least share of a variance that one density has to be narrower by than another to be compared with it."""

N_DRAWS = 1024
"""Points that stand for the density in the box."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Laplace:
    """Normal density of the parameters, each as a share of its range.

    Parameters
    ----------
    centre : (n_parameters,) array
        May be outside the box, where a fit has ended at a bound.
    covariance : (n_parameters, n_parameters) array
    parts : mapping of cause to (n_parameters, n_parameters) array
        They sum to the covariance.
    """

    centre: FloatArray
    covariance: FloatArray
    parts: Mapping[str, FloatArray]

    @property
    def shares(self) -> dict[str, FloatArray]:
        """Share (n_parameters,) of each cause in the variances; they sum to 1."""
        variance = np.diag(self.covariance)
        # Rounding may make a part less than nothing.
        return {name: np.maximum(np.diag(part) / variance, 0.0) for name, part in self.parts.items()}

    def by(self, *causes: str) -> "Laplace":
        """What some of the causes alone make of the density."""
        parts = {name: self.parts[name] for name in causes}
        return replace(self, covariance=np.sum(list(parts.values()), axis=0), parts=parts)

    @property
    def sd(self) -> FloatArray:
        """Standard deviation (n_parameters,) of each parameter, the bounds aside."""
        sd: FloatArray = np.sqrt(np.diag(self.covariance))
        return sd

    @property
    def in_ranges(self) -> float:
        """Probability of a centre as far outside of the ranges as this one, or farther."""
        whiten = np.linalg.inv(np.linalg.cholesky(self.covariance))
        nearest = lsq_linear(whiten, whiten @ self.centre, bounds=(0.0, 1.0)).cost
        return float(chi2.sf(2.0 * nearest, self.centre.size))

    def within(self, prior: Callable[[FloatArray], FloatArray] | None = None) -> "Density":
        """Cut off what is outside the box; a prior weighs points (n, n_parameters), unless all by 0."""
        root = np.linalg.cholesky(self.covariance).astype(np.float64)
        points, weights = _in_box(self.centre, root)
        known = weights if prior is None else weights * prior(points)
        if not known.any():
            raise PalpateError(
                f"the filters reject all {len(points):,} values that describe the curves as well as the fit; "
                "leave out a filter, or widen the ranges"
            )
        return Density(centre=self.centre, covariance=self.covariance, points=points, weights=known)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Density:
    """A normal density cut off at the ranges, as weighted points (n, n_parameters)."""

    centre: FloatArray
    covariance: FloatArray
    points: FloatArray
    weights: FloatArray

    def of(self, columns: Sequence[int]) -> "Density":
        """Density of some of the parameters, whatever the others are."""
        at = list(columns)
        return replace(
            self,
            centre=self.centre[at],
            covariance=self.covariance[np.ix_(at, at)],
            points=self.points[:, at],
        )

    def interval(self, point: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Ends (n_parameters,) of the 95 % intervals; a fitted point at a bound is within."""
        tails = [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0]
        ends = np.stack([_quantiles(column, self.weights, tails) for column in self.points.T], axis=1)
        return np.minimum(ends[0], point), np.maximum(ends[1], point)

    def draws(self, n: int) -> FloatArray:
        """Points (n, n_parameters), spread evenly over the weights."""
        # In random order: every 16th point of a Sobol sequence lies in one narrow slab.
        order = np.random.default_rng(0).permutation(len(self.points))
        cumulative = np.cumsum(self.weights[order])
        middles = (np.arange(n) + 0.5) / n * cumulative[-1]
        drawn: FloatArray = self.points[order[np.searchsorted(cumulative, middles)]]
        return drawn

    def holds(self, point: FloatArray) -> bool:
        """Whether a point is in the joint 95 % region, an ellipsoid within the box."""
        squares = self._squares(np.concatenate([self.points, point[None]]))
        (most,) = _quantiles(squares[:-1], self.weights, [LEVEL])
        return bool(squares[-1] <= most)

    def _squares(self, points: FloatArray) -> FloatArray:
        apart = points - self.centre
        squares: FloatArray = (apart * np.linalg.solve(self.covariance, apart.T).T).sum(axis=1)
        return squares


def laplace(
    point: FloatArray,
    residuals: FloatArray,
    jacobian: FloatArray,
    causes: Mapping[str, FloatArray],
    *,
    range_sd: float = RANGE_SD,
    is_gls: bool = False,
) -> Laplace:
    """Normal density around a fit, and the part of each cause in its covariance.

    Parameters
    ----------
    point : (n_parameters,) array
        Where the fit has ended, as shares of the ranges.
    residuals : (n,) array
    jacobian : (n, n_parameters) array
        Of the residuals, per range.
    causes : mapping of name to (n, m) array
        What each makes of the residuals: F with the covariance F Fᵀ. At least one is noise of every residual.
    range_sd : float
        Standard deviation of each parameter before any curve; infinite for none.
    is_gls : bool
        Whether every residual counts by its own errors: generalised least squares. Else as in Fopt.
    """
    left: FloatArray = np.eye(len(jacobian))
    if not is_gls:
        left = np.linalg.svd(jacobian, full_matrices=False)[0].astype(np.float64)
    parts = {name: _gram(left.T @ factor) for name, factor in causes.items()}
    slopes = left.T @ jacobian
    gain = np.linalg.solve(np.sum(list(parts.values()), axis=0), slopes)
    prior = np.eye(jacobian.shape[1]) / range_sd**2
    covariance: FloatArray = np.linalg.inv(slopes.T @ gain + prior).astype(np.float64)
    through = covariance @ gain.T
    made = {name: through @ part @ through.T for name, part in parts.items()}
    made[RANGE] = covariance @ prior @ covariance
    centre = point - through @ (left.T @ residuals)
    return Laplace(centre=centre, covariance=(covariance + covariance.T) / 2.0, parts=made)


def agreement(robust: Laplace, efficient: Laplace) -> float:
    """Probability of centres as far apart as these, or farther, if both rest on the right errors.

    The covariance of their difference is that of the wider density less that of the narrower one
    (Hausman, Econometrica 46, 1978). Directions in which both are equally wide tell nothing.
    """
    root = np.linalg.cholesky(robust.covariance)
    apart = np.linalg.solve(root, efficient.centre - robust.centre)
    narrower, axes = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, efficient.covariance).T))
    gained = 1.0 - narrower
    used = gained > LEAST_GAIN
    square = float(((axes.T @ apart)[used] ** 2 / gained[used]).sum())
    return float(chi2.sf(square, used.sum())) if used.any() else 1.0


def _gram(factor: FloatArray) -> FloatArray:
    gram: FloatArray = factor @ factor.T
    return gram


def _in_box(centre: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weighted points of a normal density within the unit box (Geweke, Hajivassiliou and Keane).

    Each coordinate is drawn within its bounds, given those before it; the weight is the product of the
    probabilities of that.
    """
    even = qmc.Sobol(centre.size, rng=0).random(N_DRAWS)
    normal, logs = np.zeros_like(even), np.zeros(N_DRAWS)
    for i in range(centre.size):
        mean = centre[i] + normal[:, :i] @ root[i, :i]
        low, high = -mean / root[i, i], (1.0 - mean) / root[i, i]
        flip = low > 0.0  # where a tail is exact
        low, high = np.where(flip, -high, low), np.where(flip, -low, high)
        below, above = ndtr(low), ndtr(high)
        drawn = ndtri(np.clip(below + even[:, i] * (above - below), 1e-300, 1.0 - 1e-16))
        normal[:, i] = np.where(flip, -1.0, 1.0) * np.clip(drawn, low, high)
        logs += np.log(np.maximum(above - below, 1e-300))
    points = np.clip(centre + normal @ root.T, 0.0, 1.0)
    return points, np.exp(logs - logs.max())


def _quantiles(values: FloatArray, weights: FloatArray, at: list[float]) -> FloatArray:
    order = np.argsort(values)
    cumulative = np.cumsum(weights[order])
    middles = cumulative - weights[order] / 2.0
    quantiles: FloatArray = np.interp(np.array(at) * cumulative[-1], middles, values[order])
    return quantiles


def whitening(jacobian: FloatArray, covariance: FloatArray, groups: FloatArray) -> FloatArray:
    """Matrix (m, n) from the n residuals of a problem to independent ones of variance 1.

    Parameters
    ----------
    jacobian : (m, n_parameters) array
    covariance : (m, m) array
        Of the averages ``groups`` (m, n) of the residuals, as the slopes are.
    """
    axes, sizes, _ = np.linalg.svd(jacobian, full_matrices=True)
    n_seen = int((sizes > 1e-9 * sizes.max()).sum())
    white = [
        solve_triangular(_root(part.T @ covariance @ part), part.T, lower=True)
        for part in (axes[:, :n_seen], axes[:, n_seen:])
    ]
    found: FloatArray = np.concatenate(white) @ groups
    return found


def _root(covariance: FloatArray) -> FloatArray:
    jitter = 1e-12 * np.trace(covariance) / len(covariance)
    root: FloatArray = np.linalg.cholesky(covariance + jitter * np.eye(len(covariance)))
    return root
