"""Parts of residuals besides the known causes: noise, and what the model leaves out.

Noise of a curve is correlated over a few points, as smoothing leaves it. The discrepancy of a curve is a
Gaussian process along its path, times the largest ordinate reached so far, so that it is zero at first
contact; a share of its variance is common to all sites. Their sizes are those that make the residuals most
likely once the parameters are fitted (restricted likelihood: Patterson & Thompson, Biometrika 58, 1971).
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray, IntArray
from palpate.api.fit import SpotTerm, channel_of, path_of, pieces
from palpate_certainty.assumptions import ASSUMED

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares among which that is averaged: of a wrong law it is 1, of wrong anatomy 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResidualLayout:
    """Places of the residuals on the measured curves.

    Parameters
    ----------
    spot, site, channel : (n,) integer array
        Numbers of the spots, of the places on limbs that they are at, and of the channels; negative for
        residuals that are no measured point.
    point : (n,) array
        Number of the measured point on its curve.
    path : (n,) array
        Travel along the curve, in ranges of its abscissa.
    scale : (n,) array
        Residual of the largest ordinate of the curve.
    envelope : (n,) array
        Residual of the largest ordinate reached so far.
    """

    spot: IntArray
    site: IntArray
    channel: IntArray
    point: FloatArray
    path: FloatArray
    scale: FloatArray
    envelope: FloatArray

    def only(self, kept: BoolArray) -> "ResidualLayout":
        """Layout of some of the residuals, chosen by ``kept`` (n,)."""
        return ResidualLayout(**{each.name: getattr(self, each.name)[kept] for each in fields(self)})

    @property
    def channels(self) -> list[int]:
        """Numbers of the channels."""
        return [int(each) for each in np.unique(self.channel) if each >= 0]

    @property
    def curve(self) -> IntArray:
        """Number (n,) of the curve that each residual is of; priors have one."""
        return np.unique(np.stack([self.spot, self.channel]), axis=1, return_inverse=True)[1]

    def noise(self, channel: int, points: float) -> FloatArray:
        """Covariance (n, n) of noise of size 1 over the largest ordinate, correlated over so many points.

        Over no more than a part of the path, however: what is longer is no noise.
        """
        inside = self.channel == channel
        spacing = np.ptp(self.path[inside]) / np.ptp(self.point[inside])
        length = min(points, ASSUMED.longest_noise / spacing)
        apart = np.abs(self.point[:, None] - self.point)
        along = matern(apart / length) if length > 0.0 else (apart == 0.0).astype(np.float64)
        same = (self.spot[:, None] == self.spot) * self._both(channel)
        return same * along * np.outer(self.scale, self.scale)

    def discrepancy(self, channel: int, length: float, common: float = ASSUMED.common) -> FloatArray:
        """Covariance (n, n) of a discrepancy of size 1 over the largest ordinate in a channel.

        All sites have the share ``common`` of its variance in common.
        """
        along = matern(np.abs(self.path[:, None] - self.path) / length)
        same = np.where(self.site[:, None] == self.site, 1.0, common) * self._both(channel)
        return same * along * np.outer(self.envelope, self.envelope)

    def _both(self, channel: int) -> FloatArray:
        inside = (self.channel == channel).astype(np.float64)
        return np.outer(inside, inside)


def matern(apart: FloatArray) -> FloatArray:
    """Correlation of a process with one derivative (Matérn, 3/2) at distances in correlation lengths."""
    scaled = np.sqrt(3.0) * apart
    return (1.0 + scaled) * np.exp(-scaled)


def layout_of(
    terms: Sequence[SpotTerm], n: int, first: Sequence[str] = ()
) -> tuple[ResidualLayout, tuple[str, ...]]:
    """Places of ``n`` residuals, priors last; and the names of the channels by their numbers.

    Channels that are known already come ``first``.
    """
    names = (channel_of(name) for term in terms for name in term.weights)
    channels = tuple(dict.fromkeys([*first, *names]))
    spots, sites = [term.spot for term in terms], [term.site for term in terms]
    found = {name: np.zeros(n) for name in ("point", "path", "scale", "envelope")}
    spot, site, channel = (np.full(n, -1) for _ in range(3))
    for term, name, at, scale in pieces(terms):
        curve, inside = term.measured[channel_of(name)], term.counted(name)
        size = np.abs(curve.ordinate)
        spot[at], channel[at] = spots.index(term.spot), channels.index(channel_of(name))
        site[at] = sites.index(term.site)
        found["point"][at] = np.arange(size.size)[inside]
        found["path"][at] = path_of(curve.abscissa)[inside]
        found["scale"][at] = (scale * size.max())[inside]
        found["envelope"][at] = (scale * np.maximum.accumulate(size))[inside]
    return ResidualLayout(spot=spot, site=site, channel=channel, **found), channels


def groups_of(rows: ResidualLayout) -> FloatArray:
    """Average neighbours on long curves: (n_groups, n), with orthonormal rows."""
    n = rows.spot.size
    number, last = np.arange(n), 0
    for key in dict.fromkeys(zip(rows.spot.tolist(), rows.channel.tolist(), strict=True)):
        inside = np.flatnonzero((rows.spot == key[0]) & (rows.channel == key[1]))
        # Points of a curve; more are averaged with their neighbours.
        each = 1 if key[1] < 0 else -(-inside.size // 64)
        number[inside] = last + np.arange(inside.size) // each
        last = int(number[inside].max()) + 1
    groups = (np.arange(last)[:, None] == number).astype(np.float64)
    return groups / np.sqrt(groups.sum(axis=1, keepdims=True))


def grouped(rows: ResidualLayout, groups: FloatArray) -> ResidualLayout:
    """Places of averages, of groups as :func:`groups_of` returns them."""
    first = np.argmax(groups > 0.0, axis=1)
    share = groups**2
    return replace(
        rows,
        spot=rows.spot[first],
        site=rows.site[first],
        channel=rows.channel[first],
        point=share @ rows.point / (groups > 0.0).sum(axis=1),
        path=share @ rows.path,
        scale=share @ rows.scale,
        envelope=groups @ rows.envelope,
    )


POINTS = (0.0, 1.0, 2.0, 4.0)
"""Correlation lengths of the noise that are tried, in measured points."""

PAIRS = tuple(product(POINTS, ASSUMED.discrepancy_lengths))

LEAST = 0.02
"""Probability below which a pair of lengths is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoiseModel:
    """Noise and discrepancy of each channel, averaged over what the residuals leave open.

    Parameters
    ----------
    of_lengths : mapping of (points, length) to (noise, discrepancy, most)
        Of each pair of correlation lengths, of noise and discrepancy, the variances of both by the number of
        the channel, over the square of the largest ordinate, times the probability of the pair; and of the
        discrepancy that is not seen. The discrepancy is the mean over its size, and at ``most`` one that
        residuals do not exclude.
    correlations : mapping of (points, length) to float
        Probability of each pair.
    common : float
        Share of the discrepancy's variance that all sites have in common.
    """

    of_lengths: Mapping[tuple[float, float], tuple[Mapping[int, float], ...]]
    correlations: Mapping[tuple[float, float], float]
    common: float = ASSUMED.common

    @property
    def noise(self) -> dict[int, float]:
        """Standard deviation by channel, over the largest ordinate."""
        return self._sizes(0)

    @property
    def discrepancy(self) -> dict[int, float]:
        """Standard deviation by channel, over the largest ordinate."""
        return self._sizes(1)

    @property
    def at_most(self) -> "NoiseModel":
        """Model whose discrepancy is as large as the residuals do not exclude."""
        return replace(self, of_lengths={key: (of[0], of[2], of[2]) for key, of in self.of_lengths.items()})

    def lengths(self, channel: int) -> dict[float, float]:
        """Share of the variance of a channel's discrepancy by correlation length."""
        found: dict[float, float] = {}
        for (_, length), (_, variances, _) in self.of_lengths.items():
            found[length] = found.get(length, 0.0) + variances[channel]
        total = sum(found.values())
        return {length: variance / total for length, variance in found.items()}

    def _sizes(self, kind: int) -> dict[int, float]:
        each = [variances[kind] for variances in self.of_lengths.values()]
        return {channel: float(np.sqrt(sum(of[channel] for of in each))) for channel in each[0]}

    def covariances(self, rows: ResidualLayout) -> tuple[FloatArray, FloatArray]:
        """Covariance (n, n) of residuals by noise, and that by discrepancy."""
        noise, discrepancy = np.zeros((2, rows.spot.size, rows.spot.size))
        for (points, length), (of_noise, of_discrepancy, _) in self.of_lengths.items():
            for channel in rows.channels:
                noise += of_noise[channel] * rows.noise(channel, points)
                discrepancy += of_discrepancy[channel] * rows.discrepancy(channel, length, self.common)
        return noise, discrepancy


@dataclass(frozen=True, slots=True, eq=False)
class _Mode:
    """The most likely sizes for one correlation and one length."""

    lengths: tuple[float, float]
    likelihood: "_Likelihood"
    squares: FloatArray
    value: float

    def sizes(self, channels: Sequence[int], weight: float) -> tuple[dict[int, float], ...]:
        """Variance of the noise, mean and most of the discrepancy's, by channel and times a weight."""
        k = len(channels)
        of_model = np.transpose([self.likelihood.sizes(self.squares, i) for i in range(k)])
        every = [self.squares[:k], *of_model]
        return tuple(dict(zip(channels, (weight * each).tolist(), strict=True)) for each in every)


def estimate(
    residuals: FloatArray,
    free: FloatArray,
    known: FloatArray,
    rows: ResidualLayout,
    *,
    expected: Mapping[int, float],
    lengths: Sequence[tuple[float, float]] = PAIRS,
    common: float | None = None,
) -> NoiseModel:
    """Estimate noise and discrepancy from the residuals of a fit.

    The discrepancy is no smaller than expected, with a correlation length of :data:`ASSUMED` where the
    residuals do not show it: parameters absorb a part.

    Parameters
    ----------
    free : (n, n - n_parameters) array
        Orthonormal directions that no parameter explains: the null space of the transposed Jacobian.
    known : (n, m) array
        Change of the residuals by one standard deviation of each known cause.
    expected : mapping of channel number to float
        Discrepancy that models usually have, over the largest ordinate.
    common : float, optional
        Share of the discrepancy's variance common to all sites; by default a mean, from three sites on.
    """
    channels, modes_of = rows.channels, partial(_modes, residuals, free, known, rows, expected)
    kept = _likely(modes_of(lengths, ASSUMED.common if common is None else common))
    if common is None and np.unique(rows.site[rows.channel >= 0]).size >= 3:  # they tell it
        best, _ = max(kept, key=lambda each: each[1])
        common = float(_probabilities([next(modes_of([best.lengths], share)) for share in SHARES]) @ SHARES)
        kept = _likely(modes_of([mode.lengths for mode, weight in kept if weight > LEAST], common))
    likely = {mode.lengths: weight for mode, weight in kept}
    of_lengths = {mode.lengths: mode.sizes(channels, weight) for mode, weight in kept}
    unseen = {c: max(expected[c] ** 2 - sum(of[1][c] for of in of_lengths.values()), 0.0) for c in channels}
    of_lengths[0.0, ASSUMED.unseen_length] = dict.fromkeys(channels, 0.0), unseen, unseen
    return NoiseModel(
        of_lengths=of_lengths,
        correlations={lengths: weight / sum(likely.values()) for lengths, weight in likely.items()},
        common=ASSUMED.common if common is None else common,
    )


def _probabilities(modes: Sequence["_Mode"]) -> FloatArray:
    """Probabilities (n,) of modes by their likelihoods."""
    values = np.array([mode.value for mode in modes])
    weights = np.exp(values - values.max())
    return np.asarray(weights / weights.sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorScale:
    """Scale of the stated errors, as far as the residuals show it.

    Parameters
    ----------
    factor : float
        Errors over the stated ones.
    freedom : float
        Degrees of freedom of the squared factor: densities of the parameters are Student's with these.
    """

    factor: float
    freedom: float


def error_scale(residuals: FloatArray, free: FloatArray, known: FloatArray, rest: FloatArray) -> ErrorScale:
    """Scale of the stated errors: an inverse-gamma prior around 1, updated by the residuals.

    Seen are the directions that no parameter explains and in which the known causes are larger than noise and
    discrepancy: with χ² of n of them, the square of the scale is (ν₀ + χ²) / (ν₀ + n), with ν₀ + n degrees of
    freedom (Gelman et al., Bayesian Data Analysis, section 14.2). Directions and known causes are as in
    :func:`estimate`; ``rest`` (n, n) is the covariance by noise and discrepancy.
    """
    root = np.linalg.cholesky(free.T @ rest @ free)
    axes, sizes, _ = np.linalg.svd(
        scipy.linalg.solve_triangular(root, free.T @ known, lower=True), full_matrices=False
    )
    seen = sizes > 1.0
    along = axes[:, seen].T @ scipy.linalg.solve_triangular(root, free.T @ residuals, lower=True)
    square = float((along**2 / (1.0 + sizes[seen] ** 2)).sum())
    freedom = ASSUMED.scale_freedom + float(seen.sum())
    return ErrorScale(factor=float(np.sqrt((ASSUMED.scale_freedom + square) / freedom)), freedom=freedom)


def _likely(modes: Iterable[_Mode]) -> list[tuple[_Mode, float]]:
    """Modes that are not improbable, with their probabilities among all."""
    every = list(modes)
    return [(m, float(w)) for m, w in zip(every, _probabilities(every), strict=True) if w >= LEAST]


def _modes(
    residuals: FloatArray,
    projection: FloatArray,
    known: FloatArray,
    rows: ResidualLayout,
    expected: Mapping[int, float],
    lengths: Sequence[tuple[float, float]],
    common: float,
) -> Iterator[_Mode]:
    channels = rows.channels
    usual = np.array([expected[channel] for channel in channels])
    fixed = projection.T @ known
    of_noise, of_discrepancy = map(set, zip(*lengths, strict=True))
    noises = {points: [rows.noise(c, points) for c in channels] for points in of_noise}
    others = {length: [rows.discrepancy(c, length, common) for c in channels] for length in of_discrepancy}
    free = projection.T @ residuals
    seen = {
        id(part): projection.T @ part @ projection
        for parts in (*noises.values(), *others.values())
        for part in parts
    }
    # Size of the discrepancy, over what the residuals have of it, above which it is not tried.
    most = [max(5.0 * _seen(residuals, rows, c), 2.0 * expected[c]) for c in channels]
    for points, length in lengths:
        parts = [*noises[points], *others[length]]
        stacked = np.stack([seen[id(part)] for part in parts])
        likelihood = _Likelihood(free, fixed @ fixed.T, stacked, usual, most)
        squares, value = likelihood.mode()
        yield _Mode((points, length), likelihood, squares, value)


def _seen(residuals: FloatArray, rows: ResidualLayout, channel: int) -> float:
    """Size of the discrepancy of a channel, if all of its residuals were that."""
    inside = rows.channel == channel
    return float(np.linalg.norm(residuals[inside]) / np.linalg.norm(rows.envelope[inside]))


@dataclass(frozen=True, slots=True, eq=False)
class _Likelihood:
    """Restricted likelihood of the sizes, with a half-t prior of each discrepancy up to the ``most``.

    The first half of ``parts`` (2 n_channels, n, n) is noise, the other discrepancy; ``expected``
    (n_channels,) is the discrepancy of usual models.
    """

    residuals: FloatArray
    fixed: FloatArray
    parts: FloatArray
    expected: FloatArray
    most: list[float]

    def mode(self) -> tuple[FloatArray, float]:
        """Most likely squares (2 n_channels,) of the sizes, and the logarithm of their likelihood."""
        k = len(self.parts) // 2
        start = np.log(np.concatenate([np.full(k, 5e-3), self.expected]))
        # Least noise, over the largest ordinate: simulated curves are not exact.
        bounds = [(np.log(1e-5), 0.0)] * k
        bounds += list(zip(np.log(1e-3 * self.expected), np.log(self.most), strict=True))
        found = scipy.optimize.minimize(self._loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
        return np.exp(2.0 * found.x), -float(found.fun)

    def sizes(self, squares: FloatArray, i: int) -> tuple[float, float]:
        """Mean square of the discrepancy of one channel, and the largest that is not excluded."""
        # Sizes of the discrepancy, over the one expected, among which it is averaged.
        sizes = self.expected[i] * np.geomspace(0.02, 30.0, 25)
        sizes = sizes[sizes <= self.most[i]]
        logs, values = np.log(sizes), self._values(squares, i, sizes)
        weights = np.exp(values - values.max()) * np.gradient(logs)
        weights /= weights.sum()
        most = float(np.interp(ASSUMED.not_excluded, np.cumsum(weights), sizes))
        return float(weights @ sizes**2), max(most**2, float(weights @ sizes**2))

    def _values(self, squares: FloatArray, i: int, sizes: FloatArray) -> FloatArray:
        """Logarithms (n,) of the likelihood at sizes of one channel's discrepancy, by one factorisation."""
        place = len(self.parts) // 2 + i
        others = np.where(np.arange(squares.size) == place, 0.0, squares)
        root = np.linalg.cholesky(self._covariance(others))
        part = scipy.linalg.solve_triangular(root, self.parts[place], lower=True)
        own, axes = np.linalg.eigh(scipy.linalg.solve_triangular(root, part.T, lower=True))
        along = axes.T @ scipy.linalg.solve_triangular(root, self.residuals, lower=True)
        variances = 1.0 + sizes[:, None] ** 2 * np.maximum(own, 0.0)
        values = -0.5 * (np.log(variances) + along**2 / variances).sum(axis=1)
        return np.asarray(values + np.log(sizes) - 2.5 * np.log1p((sizes / self.expected[i]) ** 2 / 4.0))

    def _covariance(self, squares: FloatArray) -> FloatArray:
        covariance = self.fixed + np.tensordot(squares, self.parts, axes=1)
        covariance[np.diag_indices_from(covariance)] += 1e-12 * np.trace(covariance) / len(covariance)
        return np.asarray(covariance)

    def _loss(self, logs: FloatArray) -> tuple[float, FloatArray]:
        squares = np.exp(2.0 * logs)
        covariance = self._covariance(squares)
        factor, white, is_bad = scipy.linalg.lapack.dposv(covariance, self.residuals, lower=1)
        if is_bad:
            raise np.linalg.LinAlgError("the covariance of the residuals is not positive definite")
        value = np.log(np.diag(factor)).sum() + 0.5 * float(self.residuals @ white)
        k = len(self.parts) // 2
        ratio = squares[k:] / self.expected**2
        # Densities over the logarithm of a size: Student's with four degrees of freedom, times the size.
        value += float(np.sum(2.5 * np.log1p(ratio / 4.0) - logs[k:]))
        half = np.tril(scipy.linalg.lapack.dpotri(factor, lower=1)[0])
        inverse = half + np.tril(half, -1).T
        gradient: FloatArray = squares * np.tensordot(self.parts, inverse - np.outer(white, white), axes=2)
        gradient[k:] += 5.0 * ratio / (4.0 + ratio) - 1.0
        return value, gradient
