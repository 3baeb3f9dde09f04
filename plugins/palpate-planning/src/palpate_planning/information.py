"""Fisher information of each press on the parameters, in sums that presses add to.

The covariance of a fit is that of :mod:`palpate_certainty.laplace`. With slopes J of the residuals and their
covariance C a fit by Fopt needs no more than JᵀJ and JᵀCJ. Both are sums: the first over the presses, the
second over the presses and over every cause, whose columns F give (JᵀF)(JᵀF)ᵀ with JᵀF a sum over the presses
that share the cause. For generalised least squares the information is JᵀC⁻¹J, with all causes in C: a press
adds its rows to a Cholesky factor of C. So a press that is simulated once is added to any others in
milliseconds.
"""

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar, final

import numpy as np
from scipy.linalg import solve_triangular
from typing_extensions import override

from palpate.api import FloatArray
from palpate_certainty.noise_model import COMMON, ResidualLayout, matern

SPACING = 0.1
"""Distance, in correlation lengths, of the places on a path between which a discrepancy is interpolated."""

FLAT_SD = 12.0**-0.5
"""Standard deviation, in ranges, of a value that may be anywhere in its range: nothing is outside of it."""

SEEN = 1e-12
"""Share of the largest information below which a direction counts as not seen."""


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
    usual : float
        Both of a channel that no press has shown so far.
    """

    noise: Mapping[str, float]
    discrepancy: Mapping[str, float]
    correlations: Mapping[tuple[float, float], float] = field(default_factory=lambda: {(0.0, 0.35): 1.0})
    usual: float = 0.005

    def marginal(self, i: int) -> dict[float, float]:
        """Probability of each correlation length: of noise (0) or of the discrepancy (1)."""
        found: dict[float, float] = {}
        for lengths, probability in self.correlations.items():
            found[lengths[i]] = found.get(lengths[i], 0.0) + probability
        return found


class FisherInformation(ABC):
    """Information of some presses on the parameters; the sum of two is that of both."""

    __slots__ = ()

    @abstractmethod
    def __add__(self, other: Self) -> Self: ...

    @abstractmethod
    def again(self, press: str, number: int) -> Self:
        """Information of the same press when it is made once more: its own error sources are drawn again."""

    @abstractmethod
    def covariance(self, range_sd: float = FLAT_SD) -> FloatArray:
        """Covariance (n_parameters, n_parameters) of the fit of these presses, in shares of the ranges."""


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoptInformation(FisherInformation):
    """Information of presses that are fitted by least Fopt.

    Parameters
    ----------
    information : (n_parameters, n_parameters) array
        JᵀJ, per range of each parameter.
    noise : (n_parameters, n_parameters) array
        JᵀCJ by what no two presses share.
    causes : mapping of name to (n_parameters, m) array
        JᵀF of each cause that presses may share.
    """

    information: FloatArray
    noise: FloatArray
    causes: Mapping[str, FloatArray]

    def __add__(self, other: Self) -> Self:
        names = dict.fromkeys([*self.causes, *other.causes])
        return replace(
            self,
            information=self.information + other.information,
            noise=self.noise + other.noise,
            causes={name: _sum(self.causes.get(name), other.causes.get(name)) for name in names},
        )

    @override
    def again(self, press: str, number: int) -> Self:
        return replace(self, causes=_renamed(self.causes, press, number))

    @override
    def covariance(self, range_sd: float = FLAT_SD) -> FloatArray:
        # As palpate_certainty.laplace has it.
        scores = self.noise + sum(part @ part.T for part in self.causes.values())
        sizes, axes = np.linalg.eigh(self.information)
        seen = sizes > SEEN * sizes[-1]
        roots = axes[:, seen] * np.sqrt(sizes[seen])
        inverse = axes[:, seen] / np.sqrt(sizes[seen])
        gained = roots @ np.linalg.solve(inverse.T @ scores @ inverse, roots.T)
        covariance: FloatArray = np.linalg.inv(gained + np.eye(len(gained)) / range_sd**2)
        return (covariance + covariance.T) / 2.0


def _sum(one: FloatArray | None, other: FloatArray | None) -> FloatArray:
    """Sum of columns; those of the shorter path are zero beyond its end."""
    given = sorted((part for part in (one, other) if part is not None), key=lambda part: part.shape[1])
    summed = given[-1].copy()
    for part in given[:-1]:
        summed[:, : part.shape[1]] += part
    return summed


Named = TypeVar("Named")


def _renamed(causes: Mapping[str, Named], press: str, number: int) -> dict[str, Named]:
    """Rename the error sources that act on one press only."""
    end = f" of {press}"
    return {f"{name} {number}" if name.endswith(end) else name: part for name, part in causes.items()}


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GlsInformation(FisherInformation):
    """Information of presses that are fitted by generalised least squares.

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

    @override
    def again(self, press: str, number: int) -> Self:
        return replace(self, causes=tuple(_renamed(each, press, number) for each in self.causes))

    @override
    def covariance(self, range_sd: float = FLAT_SD) -> FloatArray:
        information = self.scores.T @ self.scores
        inverse = np.linalg.inv(information + np.eye(len(information)) / range_sd**2)
        covariance: FloatArray = inverse.astype(np.float64)
        return (covariance + covariance.T) / 2.0

    def _shared(self, other: Self) -> FloatArray:
        """Covariance (n, n_other) of the rows with those of others, by the error sources of both."""
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
    root: FloatArray = np.linalg.cholesky(covariance).astype(np.float64)
    return root


def _divided(root: FloatArray, columns: FloatArray) -> FloatArray:
    """Solve a lower triangular system for columns (n, k)."""
    solved: FloatArray = solve_triangular(root, columns, lower=True, check_finite=False)
    return solved


def press_information(
    slopes: FloatArray,
    free: FloatArray,
    rows: ResidualLayout,
    known: Mapping[str, FloatArray],
    errors: ErrorSizes,
    *,
    channels: tuple[str, ...],
    site: str,
    is_gls: bool = False,
) -> FisherInformation:
    """Make the information of one press.

    Parameters
    ----------
    slopes : (n, n_parameters) array
        Of the residuals, per range of each parameter.
    free : (n, m) array
        Slopes in what is fitted to this press alone, such as its onset.
    rows : ResidualLayout
        Where each residual is on the curves.
    known : mapping of name to (n,) array
        What one standard deviation of each cause adds to the residuals.
    channels : tuple of str
        By their numbers in ``rows``.
    site : str
        Presses at one site share what the model leaves out there.
    is_gls : bool
        Whether the fit is by generalised least squares.
    """
    noise = _noise(rows, errors, channels)
    causes = {name: column[:, None] for name, column in known.items()} | _left_out(
        rows, errors, channels, site
    )
    if not is_gls:
        slopes = _without(free, slopes)
        return FoptInformation(
            information=slopes.T @ slopes,
            noise=slopes.T @ noise @ slopes,
            causes={name: slopes.T @ part for name, part in causes.items()},
        )
    root = _factor(noise)
    white = [_divided(root, columns) for columns in (slopes, *causes.values())]
    fitted = _divided(root, free)
    own, *parts = (_without(fitted, columns) for columns in white)
    return GlsInformation.of(own, dict(zip(causes, parts, strict=True)))


def _without(free: FloatArray, columns: FloatArray) -> FloatArray:
    """Project columns (n, k) onto the complement of the free ones (n, m)."""
    axes, sizes, _ = np.linalg.svd(free, full_matrices=False)
    taken = axes[:, sizes > SEEN * max(sizes.max(initial=0.0), 1e-300)]
    left: FloatArray = columns - taken @ (taken.T @ columns)
    return left


def _noise(rows: ResidualLayout, errors: ErrorSizes, channels: tuple[str, ...]) -> FloatArray:
    """Covariance (n, n) of the noise."""
    noise = np.zeros((rows.channel.size,) * 2)
    for number in rows.channels:
        size = errors.noise.get(channels[number], errors.usual)
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
        for length, probability in errors.marginal(1).items():
            size = np.sqrt(probability) * errors.discrepancy.get(channel, errors.usual)
            along = _along(rows.path[inside], length)
            part = np.zeros((inside.size, along.shape[1]))
            part[inside] = size * rows.envelope[inside][:, None] * along
            name = f"model {channel} {length:g}"
            found[name] = np.sqrt(COMMON) * part
            found[f"{name} {site}"] = np.sqrt(1.0 - COMMON) * part
    return found


def _along(path: FloatArray, length: float) -> FloatArray:
    """Independent parts (n, m) of a discrepancy of size 1 along a path (n,), in its ranges.

    Those of a longer path begin with the same parts: what a press shares with another is shared from the
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
    root: FloatArray = np.linalg.cholesky(correlation + 1e-10 * np.eye(n)).astype(np.float64)
    return root
