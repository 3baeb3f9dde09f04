"""Fisher information of each press on the parameters, in sums that presses add to.

The covariance of a fit is as in :mod:`palpate_certainty.laplace`: with slopes G of the scores of all curves
and their covariance C, by every cause, the information is GᵀC⁻¹G. A press adds the rows of its scores to a
Cholesky factor of C. So a press that is simulated once is added to any others in milliseconds.
"""

import functools
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar, final

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray
from palpate_certainty.api import (
    ASSUMED,
    FLAT_SD,
    MESH,
    SPOTS,
    LinearProblem,
    ResidualLayout,
    freedom_of,
    matern,
    wider,
)

SPACING = 0.1
"""Distance, in correlation lengths, of the places on a path between which a discrepancy is interpolated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSizes:
    """Noise and discrepancy of the channels, over the largest ordinate of a curve.

    Parameters
    ----------
    noise, discrepancy : mapping of channel to float
        Standard deviations.
    correlations : mapping of (points, length) to float
        Probability of each pair of correlation lengths, as in
        :class:`~palpate_certainty.noise_model.NoiseModel`.
    lengths : mapping of channel to mapping of length to float
        Share of the variance of a channel's discrepancy by correlation length; by default as probable.
    usual : callable of channel to float
        Both of a channel that no press has shown so far.
    common : float
        Share of a discrepancy's variance that all sites have in common.
    freedom : float
        Degrees of freedom of the stated errors' scale, by the presses so far.
    """

    noise: Mapping[str, float]
    discrepancy: Mapping[str, float]
    correlations: Mapping[tuple[float, float], float] = field(default_factory=lambda: {(0.0, 0.35): 1.0})
    lengths: Mapping[str, Mapping[float, float]] = field(default_factory=dict)
    usual: Callable[[str], float] = lambda _: 0.005
    common: float = ASSUMED.common
    freedom: float = ASSUMED.scale_freedom

    def freedom_by(self, n_more: int, n_so_far: int) -> float:
        """Degrees of freedom where further presses show the scale as those so far do."""
        shown = self.freedom - ASSUMED.scale_freedom
        return self.freedom + n_more * shown / max(n_so_far, 1)

    def marginal(self, i: int) -> dict[float, float]:
        """Probability of each correlation length: of noise (0) or of the discrepancy (1)."""
        found: dict[float, float] = {}
        for lengths, probability in self.correlations.items():
            found[lengths[i]] = found.get(lengths[i], 0.0) + probability
        return found


def cause_name(label: str, name: str, press: str = "") -> str:
    """Name of an error source among all presses; with its press where no other shares it."""
    return f"{label}: {name}{_of(press)}"


def _of(press: str) -> str:
    return f" of {press}" if press else ""


Named = TypeVar("Named")


def _renamed(causes: Mapping[str, Named], press: str, number: int) -> dict[str, Named]:
    """Rename the error sources that act on one press only."""
    end = _of(press)
    return {f"{name} {number}" if name.endswith(end) else name: part for name, part in causes.items()}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedError:
    """Covariance of a fit, and what the meshes may do to it at worst.

    The covariance takes the errors of the meshes as random numbers m_i with known shapes c_i along the
    curves: in part the same at all presses, in part of each press. At worst they are all as large as one
    standard deviation, |m_i| ≤ 1, with the signs that add up.

    Parameters
    ----------
    covariance : (n_parameters, n_parameters) array
        By all causes, in shares of the ranges.
    by_meshes : (n_parameters, m) array
        J⁺c_i: change by one standard deviation of each error of the meshes.
    freedom : float
        Degrees of freedom of the covariance's scale.
    """

    covariance: FloatArray
    by_meshes: FloatArray
    freedom: float = np.inf

    @property
    def sds(self) -> FloatArray:
        """Standard deviations (n_parameters,) of normal densities with the same 95 % intervals."""
        return wider(self.freedom) * np.sqrt(np.diag(self.covariance))

    def mesh_bias(self, along: FloatArray) -> FloatArray:
        """Largest change (n,) of combinations (n, n_parameters) a by the meshes: Σ_i |a J⁺c_i|."""
        return np.abs(along @ self.by_meshes).sum(axis=1)

    def rms(self, along: FloatArray) -> FloatArray:
        """Root mean square error (n,) of combinations (n, n_parameters): √(variance + bias²).

        The variance is that by all other causes, so that the mesh counts once, and of normal densities with
        the same 95 % intervals, as :attr:`sds` are.
        """
        of_meshes = np.sum((along @ self.by_meshes) ** 2, axis=1)
        others = np.maximum(np.sum(along @ self.covariance * along, axis=1) - of_meshes, 0.0)
        return np.sqrt(wider(self.freedom) ** 2 * others + self.mesh_bias(along) ** 2)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FisherInformation:
    """Information of some presses on the parameters; the sum of two is the information of both.

    With white noise and the columns F of all causes, residuals have the covariance LLᵀ = 1 + FFᵀ. A further
    press adds rows to L: only what it shares with the presses so far, and its own block, is factorised.

    Parameters
    ----------
    scores : (n, n_parameters) array
        L⁻¹J of the slopes.
    root : (n, n) array
        L, lower triangular.
    causes : tuple of mapping of name to (n_rows, m) array
        Columns of the causes, in the rows of each press; at least one, if of no columns.
    """

    scores: FloatArray
    root: FloatArray
    causes: tuple[Mapping[str, FloatArray], ...]

    @classmethod
    def of(cls, slopes: FloatArray, causes: Mapping[str, FloatArray]) -> Self:
        """One press, from slopes (n, n_parameters) and columns (n, m) of the causes in units of its noise."""
        root = _factor(np.eye(len(slopes)) + sum(part @ part.T for part in causes.values()))
        return cls(scores=_divided(root, slopes), root=root, causes=(causes,))

    def __add__(self, other: Self) -> Self:
        across = _divided(self.root, self._shared(other))
        root = _factor(other.root @ other.root.T - across.T @ across)
        scores = _divided(root, other.root @ other.scores - across.T @ self.scores)
        return replace(
            self,
            scores=np.concatenate([self.scores, scores]),
            root=np.block([[self.root, np.zeros_like(across)], [across.T, root]]),
            causes=(*self.causes, *other.causes),
        )

    def again(self, press: str, number: int) -> Self:
        """Information of the same press when it is made once more: its own error sources are drawn again."""
        return replace(self, causes=tuple(_renamed(each, press, number) for each in self.causes))

    def covariance(self, range_sd: float = FLAT_SD) -> FloatArray:
        """Covariance (n_parameters, n_parameters) of the fit of these presses, in shares of the ranges."""
        information = self.scores.T @ self.scores
        inverse = np.linalg.inv(information + np.eye(len(information)) / range_sd**2)
        covariance: FloatArray = inverse.astype(np.float64)
        return (covariance + covariance.T) / 2.0

    def expected_error(self, range_sd: float = FLAT_SD, freedom: float = np.inf) -> ExpectedError:
        """Error of the fit of these presses, in shares of the ranges.

        The scale of the stated errors has this ``freedom``; differences between spots have theirs, by the
        number of places.
        """
        covariance = self.covariance(range_sd)
        fit = covariance @ scipy.linalg.solve_triangular(self.root, self.scores, lower=True, trans="T").T
        by_cause: dict[str, dict[str, FloatArray]] = {MESH: {}, SPOTS: {}}
        end = 0
        for causes in self.causes:
            begin, end = end, end + len(next(iter(causes.values())))
            for label, found in by_cause.items():
                for name in (name for name in causes if name.startswith(cause_name(label, ""))):
                    (change,) = (fit[:, begin:end] @ causes[name]).T
                    found[name] = found.get(name, 0.0) + change
        by_meshes, by_spots = (
            np.array(list(found.values())).reshape(-1, len(covariance)).T for found in by_cause.values()
        )
        if by_spots.size:
            of_spots = Counter(name.rpartition(" ")[0] for name in by_cause[SPOTS])
            share = np.sum(by_spots**2, axis=1) / np.diag(covariance)
            freedom = freedom_of(share, max(min(of_spots.values()) - 1.0, 1.0), freedom)
        return ExpectedError(covariance=covariance, by_meshes=by_meshes, freedom=freedom)

    def _shared(self, other: Self) -> FloatArray:
        """Covariance (n, n_other) of the rows with the rows of others, by the error sources of both."""
        blocks = [[_covariance(mine, theirs) for theirs in other.causes] for mine in self.causes]
        return np.block(blocks).astype(np.float64)


def _covariance(mine: Mapping[str, FloatArray], theirs: Mapping[str, FloatArray]) -> FloatArray:
    """Covariance of the rows of two presses; columns of the shorter path are zero beyond its end."""
    n_mine, n_theirs = (len(next(iter(each.values()))) for each in (mine, theirs))
    found = np.zeros((n_mine, n_theirs))
    for name in mine.keys() & theirs.keys():
        n = min(mine[name].shape[1], theirs[name].shape[1])
        found += mine[name][:, :n] @ theirs[name][:, :n].T
    return found


def _factor(covariance: FloatArray) -> FloatArray:
    return np.linalg.cholesky(covariance).astype(np.float64)


def _divided(root: FloatArray, columns: FloatArray) -> FloatArray:
    """Solve a lower triangular system for columns (n, k)."""
    return scipy.linalg.solve_triangular(root, columns, lower=True, check_finite=False)


def press_information(
    linear: LinearProblem, own: BoolArray, errors: ErrorSizes, *, site: str
) -> FisherInformation:
    """Make the information of one press.

    Parameters
    ----------
    linear : LinearProblem
        With one column for each cause.
    own : (n_parameters,) array
        Which parameters are fitted to this press alone, such as its onset.
    site : str
        Presses at one site share what the model leaves out there.
    """
    rows, channels, scores = linear.rows, linear.channels, linear.scores.T
    causes = {**linear.known, **_left_out(rows, errors, channels, site)}
    root = _factor(scores @ _noise(rows, errors, channels) @ scores.T)
    white = [_divided(root, scores @ each) for each in (linear.jacobian[:, ~own], *causes.values())]
    fitted = _divided(root, scores @ linear.jacobian[:, own])
    shared, *parts = (_without(fitted, columns) for columns in white)
    return FisherInformation.of(shared, dict(zip(causes, parts, strict=True)))


def _without(free: FloatArray, columns: FloatArray) -> FloatArray:
    """Project columns (n, k) onto the complement of the free ones (n, m)."""
    axes, sizes, _ = np.linalg.svd(free, full_matrices=False)
    # Share of the largest information below which a direction counts as not seen.
    taken = axes[:, sizes > 1e-12 * max(sizes.max(initial=0.0), 1e-300)]
    return columns - taken @ (taken.T @ columns)


def _noise(rows: ResidualLayout, errors: ErrorSizes, channels: tuple[str, ...]) -> FloatArray:
    """Covariance (n, n) of the noise."""
    noise = np.zeros((rows.channel.size,) * 2)
    for number in rows.channels:
        size = errors.noise.get(channels[number], errors.usual(channels[number]))
        for points, probability in errors.marginal(0).items():
            noise += probability * size**2 * rows.noise(number, points)
    return noise


def _left_out(
    rows: ResidualLayout, errors: ErrorSizes, channels: tuple[str, ...], site: str
) -> dict[str, FloatArray]:
    """Independent columns (n, m) of the discrepancy: common to all presses, and of this site."""
    found = {}
    for number in rows.channels:
        channel, inside = channels[number], rows.channel == number
        for length, share in errors.lengths.get(channel, errors.marginal(1)).items():
            size = np.sqrt(share) * errors.discrepancy.get(channel, errors.usual(channel))
            along = _along(rows.path[inside], length)
            part = np.zeros((inside.size, along.shape[1]))
            part[inside] = size * rows.envelope[inside][:, None] * along
            name = f"model {channel} {length:g}"
            found[name] = np.sqrt(errors.common) * part
            found[f"{name} {site}"] = np.sqrt(1.0 - errors.common) * part
    return found


def _along(path: FloatArray, length: float) -> FloatArray:
    """Independent parts (n, m) of a discrepancy of size 1 along a path (n,), in its ranges.

    A longer path begins with the same parts: what a press shares with another is shared from the
    surface on.
    """
    root = _root(int(np.ceil(path.max() / (SPACING * length))) + 1)
    grid = SPACING * length * np.arange(len(root))
    return np.stack([np.interp(path, grid, column) for column in root.T], axis=1)


@functools.lru_cache(maxsize=64)
def _root(n: int) -> FloatArray:
    """Independent parts (n, n) of a discrepancy of size 1 at places that are ``SPACING`` apart."""
    places = SPACING * np.arange(n)
    correlation = matern(np.abs(places[:, None] - places))
    return np.linalg.cholesky(correlation + 1e-10 * np.eye(n)).astype(np.float64)
