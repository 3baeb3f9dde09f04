"""Differences between spots: a random effect of each parameter that the spots share.

Each spot has parameters of its own, spread around their mean: moduli in logarithms, since two spots may
differ manifold, and errors of curves grow with moduli. Their standard deviations are those that make the
spots' own values most likely (restricted likelihood), and their intervals come from the Q-profile
(Viechtbauer, Statistics in Medicine 26, 2007). In the residuals the differences are one more error source.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray, IntArray
from palpate.api.fit import LEVEL
from palpate_certainty.laplace import laplace, scores_of
from palpate_certainty.noise_model import ResidualLayout

SPOTS = "spots"
"""Error source of the differences between spots."""

UNUSUAL = 0.05
"""Probability of spots that differ so much, under which they have parameters of their own."""

LEAST_SD, MOST_SD = 1e-5, 3.0
"""Ends of the standard deviations, in coordinates of the box, among which the most likely is sought."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotDifferences:
    """Mean and standard deviations of parameters between spots, in coordinates of the box.

    Parameters
    ----------
    shared : (n,) integer array
        Numbers of the parameters that at least two spots have in common.
    seen : (n_spots, n) array
        Whether the curves of a spot depend on a parameter.
    own : (n_spots, n) array
        Value of each spot by its own curves, minus the value of the joint fit, in ranges.
    rates : (n,) array
        Derivative of the joint value, as a share of its range, in the coordinate.
    sd : (n,) array
    ends : (n, 2) array
        95 % intervals of ``sd``.
    mean : (n,) array
        Of the spots' own values.
    covariance : (n, n) array
        Of the mean.
    """

    shared: IntArray
    seen: BoolArray
    own: FloatArray
    rates: FloatArray
    sd: FloatArray
    ends: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the variances, the least of them."""
        return float(self.seen.sum(axis=0).min()) - 1.0

    def columns(self, jacobian: FloatArray, rows: ResidualLayout) -> FloatArray:
        """Change of the residuals (n, m) by one standard deviation of each parameter at each spot."""
        return np.concatenate(
            [jacobian[:, self.shared] * (self.rates * self.sd) * inside[:, None] for inside in _spots(rows)],
            axis=1,
        )

    def changes(self, jacobian: FloatArray, rows: ResidualLayout) -> FloatArray:
        """Change of the residuals (n,) from the joint fit to the own values of each spot."""
        each = zip(self.own, _spots(rows), strict=True)
        changes: FloatArray = sum(
            (inside * (jacobian[:, self.shared] @ own) for own, inside in each), np.zeros(rows.spot.size)
        )
        return changes

    def freedom_with(self, share: FloatArray, others: float) -> float:
        """Least degrees of freedom of variances of this ``share``, the rest with others (Satterthwaite)."""
        inverse = share**2 / self.freedom + (1.0 - share) ** 2 / others
        return float(1.0 / np.max(inverse))


def shared_parameters(jacobian: FloatArray, rows: ResidualLayout) -> IntArray:
    """Numbers of the parameters that change the curves of two spots or more."""
    return np.flatnonzero(_seen(jacobian, rows).sum(axis=0) > 1)


def by_spot(jacobian: FloatArray, rows: ResidualLayout) -> FloatArray:
    """Slopes (n, m) where each spot has shared parameters of its own; the other parameters come last."""
    shared = shared_parameters(jacobian, rows)
    others = np.delete(jacobian, shared, axis=1)
    return np.concatenate([*(jacobian[:, shared] * i[:, None] for i in _spots(rows)), others], axis=1)


def _seen(jacobian: FloatArray, rows: ResidualLayout) -> BoolArray:
    """Whether curves depend on a parameter (n_spots, n_parameters)."""
    return np.array([np.any(jacobian[inside] != 0.0, axis=0) for inside in _spots(rows)])


def _spots(rows: ResidualLayout) -> list[BoolArray]:
    return [rows.spot == spot for spot in np.unique(rows.spot[rows.channel >= 0])]


def same_spot(scores: FloatArray, rows: ResidualLayout) -> FloatArray:
    """1 for pairs of scores (n, k) of one spot, else 0.

    Where spots differ, each is weighed by its own errors: else slightly unequal effects of a common error
    would be told from the differences, and the mean would leave the values that it is of.
    """
    spot = rows.spot[np.argmax(np.abs(scores), axis=0)]
    together: FloatArray = (spot[:, None] == spot).astype(np.float64)
    return together


def differences(
    residuals: FloatArray,
    jacobian: FloatArray,
    causes: Mapping[str, FloatArray],
    rows: ResidualLayout,
    point: FloatArray,
    logs: FloatArray,
    *,
    by_size: Collection[str] = (),
) -> SpotDifferences:
    """Estimate the differences between spots; at least two spots share a parameter.

    Parameters
    ----------
    residuals, jacobian, causes
        As :func:`palpate_certainty.laplace.laplace` takes them, without differences between spots.
    point : (n_parameters,) array
        Where the slopes are, as shares of the ranges.
    logs : (n_parameters,) array
        Logarithm of the upper over the lower bound of a modulus; 0 of a parameter that is no logarithm.
    by_size : collection of str
        Causes whose columns are shares of each measured curve; others have shares of the joint fit's.
    """
    shared, slopes = shared_parameters(jacobian, rows), by_spot(jacobian, rows)
    logs, joint, n = logs[shared], point[shared], len(shared)
    found = laplace(np.zeros(slopes.shape[1]), residuals, slopes, causes, scores_of(slopes, rows.curve))
    own = found.centre[: n * len(_spots(rows))].reshape(-1, n)
    # A modulus is no less than its lower bound, whatever its curves ask for.
    values = np.where(logs > 0.0, np.maximum(joint + own, 0.0), joint + own)
    rates, of_own = rates_of(joint, logs), np.zeros((own.size, own.size))
    for name, part in found.parts.items():
        per = rates_of(values, logs).ravel() if name in by_size else np.tile(rates, len(own))
        of_own += part[: own.size, : own.size] / np.outer(per, per)
    at = coordinates_of(values, logs).ravel()
    sd, seen = _most_likely(at, of_own, n), _seen(jacobian[:, shared], rows)
    through, of_spots = _mean(of_own, sd), np.diag(np.tile(sd**2, len(own)))
    of_mean = through @ at, through @ (of_own + of_spots) @ through.T
    known = rows.channel < 0
    size = np.sum([part[known] @ part[known].T for part in causes.values()], axis=0)
    prior = residuals[known], jacobian[np.ix_(known, shared)], size
    mean, covariance = _with_priors(*of_mean, prior, joint, logs)
    of_sd = {"rates": rates, "sd": sd, "ends": _ends(at, of_own, sd, seen)}
    return SpotDifferences(shared=shared, seen=seen, own=own, mean=mean, covariance=covariance, **of_sd)


def _with_priors(
    mean: FloatArray, covariance: FloatArray, prior: Sequence[FloatArray], joint: FloatArray, logs: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and its covariance by priors too, which have residuals at the joint fit, slopes and a size."""
    left, slopes, size = prior
    wide, at, known = np.maximum(logs, 1e-9), mean, covariance
    for _ in range(5):  # a prior of a value is not linear in its logarithm
        there = np.expm1(wide * at) / np.expm1(wide)
        along = slopes * rates_of(there, logs)
        gain = np.linalg.solve(along @ covariance @ along.T + size, along @ covariance).T
        at = mean - gain @ (left + slopes @ (there - joint) + along @ (mean - at))
        known = covariance - gain @ along @ covariance
    return at, (known + known.T) / 2.0


def _mean(covariance: FloatArray, sd: FloatArray) -> FloatArray:
    """Weights (n, n_spots * n) of own values in their mean: each spot's own errors, as in ``same_spot``."""
    n_spots = len(covariance) // len(sd)
    alone = np.kron(np.eye(n_spots), np.ones((len(sd), len(sd)))) * covariance
    of_mean = np.tile(np.eye(len(sd)), (n_spots, 1))
    gain = np.linalg.solve(alone + np.diag(np.tile(sd**2, n_spots)), of_mean)
    weights: FloatArray = np.linalg.solve(of_mean.T @ gain, gain.T)
    return weights


def coordinates_of(shares: FloatArray, logs: FloatArray) -> FloatArray:
    """Coordinates of the box of values, as shares of their ranges; ``logs`` is as in :func:`differences`."""
    logs = np.maximum(logs, 1e-9)
    return np.asarray(np.log1p(np.expm1(logs) * shares) / logs)


def rates_of(shares: FloatArray, logs: FloatArray) -> FloatArray:
    """Derivatives of values, as shares of their ranges, in their coordinates."""
    logs = np.maximum(logs, 1e-9)
    return np.asarray(logs * (shares + 1.0 / np.expm1(logs)))


def _most_likely(own: FloatArray, covariance: FloatArray, n: int) -> FloatArray:
    """Standard deviations (n,) of the largest restricted likelihood."""
    n_spots = own.size // n
    mean = np.tile(np.eye(n), (n_spots, 1))

    def loss(logs: FloatArray) -> float:
        whole = covariance + np.diag(np.tile(np.exp(2.0 * logs), n_spots))
        inverse = np.linalg.inv(whole)
        of_mean = mean.T @ inverse @ mean
        left = own - mean @ np.linalg.solve(of_mean, mean.T @ inverse @ own)
        return float(np.linalg.slogdet(whole)[1] + np.linalg.slogdet(of_mean)[1] + left @ inverse @ left)

    bounds = [(np.log(LEAST_SD), np.log(MOST_SD))] * n
    spread = np.log(np.clip(own.reshape(n_spots, n).std(axis=0, ddof=1), LEAST_SD, MOST_SD))
    tried = [
        scipy.optimize.minimize(loss, start, method="L-BFGS-B", bounds=bounds)
        for start in (spread, spread - 2.0)
    ]
    sd: FloatArray = np.exp(min(tried, key=lambda each: float(each.fun)).x)
    return sd


def _ends(own: FloatArray, covariance: FloatArray, sd: FloatArray, seen: BoolArray) -> FloatArray:
    """Intervals (n, 2) of standard deviations, each by the spots whose curves depend on the parameter."""
    numbers = [np.flatnonzero(seen[:, k]) * len(sd) + k for k in range(len(sd))]
    ends = np.array([_q_profile(own[i], covariance[np.ix_(i, i)]) for i in numbers])
    return np.stack([np.minimum(ends[:, 0], sd), np.maximum(ends[:, 1], sd)], axis=1)


def _q_profile(own: FloatArray, covariance: FloatArray) -> tuple[float, float]:
    """Ends of the 95 % interval of the standard deviation of values (n_spots,) with a covariance."""

    def square(sd: float) -> float:
        inverse = np.linalg.inv(covariance + sd**2 * np.eye(own.size))
        left = own - np.sum(inverse @ own) / np.sum(inverse)
        return float(left @ inverse @ left)

    def at(probability: float) -> float:
        aim = float(scipy.stats.chi2.ppf(probability, own.size - 1))
        if square(0.0) <= aim:
            return 0.0
        most = MOST_SD
        while square(most) > aim:
            most *= 2.0
        return float(scipy.optimize.brentq(lambda sd: square(sd) - aim, 0.0, most))

    return at(0.5 + LEVEL / 2.0), at(0.5 - LEVEL / 2.0)


def probability_of_alike(
    residuals: FloatArray, jacobian: FloatArray, covariance: FloatArray, rows: ResidualLayout
) -> float:
    """Probability of spots that ask for parameters so far from the joint ones (χ² of their scores)."""
    spots = [spot for spot in np.unique(rows.spot) if spot >= 0]
    scores = np.concatenate(
        [np.linalg.svd(jacobian * (rows.spot == s)[:, None], full_matrices=False)[0] for s in spots], axis=1
    )
    left, sizes, _ = np.linalg.svd(jacobian, full_matrices=False)
    left = left[:, sizes > 1e-9 * sizes.max()]
    free = scores - left @ (left.T @ scores)
    axes, lengths, _ = np.linalg.svd(free, full_matrices=False)
    axes = axes[:, lengths > 1e-6]
    if not axes.shape[1]:
        return 1.0
    seen = axes.T @ residuals
    square = float(seen @ np.linalg.solve(axes.T @ covariance @ axes, seen))
    return float(scipy.stats.chi2.sf(square, axes.shape[1]))
