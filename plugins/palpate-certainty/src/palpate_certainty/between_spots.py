"""Differences between spots: a random effect of each parameter that the spots share.

Each spot has parameters of its own, spread around their mean: moduli in logarithms, since two spots may
differ manifold, and errors of curves grow with moduli. Presses at one place of a limb (a site) are of one
tissue: they count as one spot. The standard deviations are those that make the
spots' own values most likely (restricted likelihood), and their intervals come from the Q-profile
(Viechtbauer, Statistics in Medicine 26, 2007).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray, IntArray
from palpate.api.fit import LEVEL, Box
from palpate_certainty.laplace import PRIORS, Laplace
from palpate_certainty.noise_model import ResidualLayout

SPOTS = "spots"
"""Error source of the differences between spots."""

LEAST_SD, MOST_SD = 1e-5, 3.0
"""Ends of the standard deviations, in coordinates of the box, among which the most likely is sought."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotDifferences:
    """Mean and standard deviations of parameters between spots; the latter in coordinates of the box.

    Parameters
    ----------
    shared : (n,) integer array
        Numbers of the parameters that at least two spots have in common.
    seen : (n_spots, n) array
        Whether the curves of a spot depend on a parameter.
    own : (n_spots, n_parameters) array
        Most likely value of each spot by its own curves, minus the value where these are linear, in ranges.
    sd : (n,) array
    ends : (n, 2) array
        95 % intervals of ``sd``.
    point, rates : (n_parameters,) array
        Most likely means, as shares of the ranges, and their derivatives in coordinates of the box.
    mean : Laplace
        Density of these, and of the parameters that no two spots share, linear around the most likely.
    """

    shared: IntArray
    seen: BoolArray
    own: FloatArray
    sd: FloatArray
    ends: FloatArray
    point: FloatArray
    rates: FloatArray
    mean: Laplace

    @property
    def sizes(self) -> FloatArray:
        """Standard deviations (n_parameters,) of a spot's values around the means, in ranges."""
        sizes = np.zeros(self.point.size)
        sizes[self.shared] = self.rates[self.shared] * self.sd
        return sizes

    def rates_to(self, values: FloatArray, box: Box) -> FloatArray:
        """Rates (n_parameters,) on the way to values, as shares of ranges, over the rates at the means."""
        width = box.upper - box.lower
        there, here = (box.coordinates(box.lower + width * each) for each in (values, self.point))
        is_apart, along = np.abs(there - here) > 1e-6, self.rates * (there - here)
        return np.divide(values - self.point, along, out=np.ones_like(along), where=is_apart)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the variances, the least of them."""
        return float(self.seen.sum(axis=0).min()) - 1.0

    def changes(self, jacobian: FloatArray, rows: ResidualLayout) -> FloatArray:
        """Change of the residuals (n,) to the own values of each spot."""
        each = zip(self.own, _at_sites(rows), strict=True)
        return sum((i * (jacobian @ own) for own, i in each), np.zeros(rows.spot.size))


def freedom_of(share: FloatArray, between: float, others: float) -> float:
    """Least degrees of freedom of variances with this ``share`` between spots, the rest with others.

    Satterthwaite, Biometrics Bulletin 2, 1946.
    """
    return float(1.0 / np.max(share**2 / between + (1.0 - share) ** 2 / others))


def shared_parameters(jacobian: FloatArray, rows: ResidualLayout) -> IntArray:
    """Numbers of the parameters that change the curves of two spots or more."""
    return np.flatnonzero(_seen(jacobian, rows).sum(axis=0) > 1)


def by_spot(jacobian: FloatArray, rows: ResidualLayout) -> FloatArray:
    """Slopes (n, m) where each spot has shared parameters of its own; the other parameters come last."""
    shared = shared_parameters(jacobian, rows)
    others = np.delete(jacobian, shared, axis=1)
    return np.concatenate([*(jacobian[:, shared] * i[:, None] for i in _at_sites(rows)), others], axis=1)


def _seen(jacobian: FloatArray, rows: ResidualLayout) -> BoolArray:
    """Whether curves depend on a parameter (n_spots, n_parameters)."""
    return np.array([np.any(jacobian[inside] != 0.0, axis=0) for inside in _at_sites(rows)])


def _at_sites(rows: ResidualLayout) -> list[BoolArray]:
    return [rows.site == site for site in sites_of(rows)]


def sites_of(rows: ResidualLayout) -> IntArray:
    """Numbers of the sites that measured points are at."""
    return np.unique(rows.site[rows.channel >= 0])


def differences(
    found: Laplace,
    jacobian: FloatArray,
    rows: ResidualLayout,
    points: FloatArray,
    box: Box,
    prior: Sequence[FloatArray],
) -> SpotDifferences:
    """Estimate the differences between spots; at least two spots share a parameter.

    Parameters
    ----------
    found : Laplace
        Changes of the parameters that :func:`by_spot` has slopes of.
    points : (n_spots, n_parameters) array
        Where the curves of each spot are linear, as shares of the ranges.
    prior : sequence of arrays
        Residuals of priors at a value, their slopes, the variances of their errors, and the value.
    """
    every, shared, own = _seen(jacobian, rows), shared_parameters(jacobian, rows), np.zeros_like(points)
    others, n = np.delete(np.arange(points.shape[1]), shared), len(points) * len(shared)
    # A parameter that no two spots share has the value of the spot that it belongs to.
    width, of_others = box.upper - box.lower, (every[:, others].argmax(axis=0), others)
    own[:, shared], own[of_others] = found.centre[:n].reshape(-1, len(shared)), found.centre[n:]
    # A modulus is no less than its lower bound, whatever its curves ask for.
    values = np.maximum(box.lower + width * (points + own), np.where(box.log, box.lower, -np.inf))
    at, per = (
        np.concatenate([of[:, shared].ravel(), of[of_others]])
        for of in (box.coordinates(values), width / box.rates_at(values))
    )
    each = found.mapped(np.diag(per), at)
    sd = _most_likely(at[:n], each.covariance[:n, :n], len(shared))
    mean = _with_priors(_mean(each, sd, shared, others), shared, prior, box)
    there, seen = mean.most_likely, every[:, shared]
    point, rates = (box.values(there) - box.lower) / width, box.rates(there) / width
    return SpotDifferences(
        shared=shared,
        seen=seen,
        own=own,
        sd=sd,
        ends=_ends(at[:n], each.covariance[:n, :n], sd, seen),
        point=point,
        rates=rates,
        mean=mean.mapped(np.diag(rates), point + rates * (mean.centre - there)),
    )


def _with_priors(mean: Laplace, shared: IntArray, prior: Sequence[FloatArray], box: Box) -> Laplace:
    """Density by priors of shared parameters too."""
    left, slopes, size, joint = prior
    slopes = np.where(np.isin(np.arange(joint.size), shared), slopes, 0.0)  # others have theirs already
    width, centre, at = box.upper - box.lower, mean.centre, mean.centre
    for _ in range(5):  # a prior of a value is not linear in its logarithm
        values = box.values(at)
        along = slopes * box.rates_at(values) / width
        there = left + slopes @ ((values - box.lower) / width - joint)
        gain = np.linalg.solve(along @ mean.covariance @ along.T + size, along @ mean.covariance).T
        at = centre - gain @ (there + along @ (centre - at))
    return mean.mapped(np.eye(at.size) - gain @ along, at).with_part(PRIORS, gain @ size @ gain.T)


def _mean(each: Laplace, sd: FloatArray, shared: IntArray, others: IntArray) -> Laplace:
    """Density of the means, by the errors of each spot alone, and of the other parameters.

    Else slightly unequal effects of a common error would pass for differences, and the mean would
    leave the own values, which come first in ``each``.
    """
    n = each.centre.size - others.size
    n_spots = n // len(sd)
    alone = np.kron(np.eye(n_spots), np.ones((len(sd), len(sd)))) * each.covariance[:n, :n]
    of_mean = np.tile(np.eye(len(sd)), (n_spots, 1))
    gain = np.linalg.solve(alone + np.diag(np.tile(sd**2, n_spots)), of_mean)
    by = np.zeros((shared.size + others.size, each.centre.size))
    by[shared, :n] = np.linalg.solve(of_mean.T @ gain, gain.T)
    by[others, n + np.arange(others.size)] = 1.0
    between = by[:, :n] * np.tile(sd, n_spots)
    return each.mapped(by, by @ each.centre).with_part(SPOTS, between @ between.T)


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
    return np.exp(min(tried, key=lambda each: float(each.fun)).x)


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
    each = (jacobian * inside[:, None] for inside in _at_sites(rows))
    scores = np.concatenate([np.linalg.svd(of, full_matrices=False)[0] for of in each], axis=1)
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
