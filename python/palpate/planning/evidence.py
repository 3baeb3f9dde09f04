"""What each press tells about the parameters, in sums that presses add to.

The covariance of a fit is that of :mod:`palpate.certainty.laplace`. With slopes J of the residuals and their
covariance C it needs no more than JᵀJ and JᵀCJ. Both are sums: the first over the presses, the second over
the presses and over every cause, whose columns F give (JᵀF)(JᵀF)ᵀ with JᵀF a sum over the presses that
share the cause. So a press that is simulated once is added to any others at no cost.
"""

import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.certainty.rows import COMMON, Rows, matern
from palpate.domain import FloatArray

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
        :class:`~palpate.certainty.curve_errors.CurveErrors`.
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """What some presses tell.

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

    def __add__(self, other: "Evidence") -> "Evidence":
        names = dict.fromkeys([*self.causes, *other.causes])
        return Evidence(
            information=self.information + other.information,
            noise=self.noise + other.noise,
            causes={name: _sum(self.causes.get(name), other.causes.get(name)) for name in names},
        )

    def again(self, press: str, number: int) -> "Evidence":
        """What the same press tells when it is made once more: causes of one press are drawn again."""
        end = f" of {press}"
        causes = {f"{n} {number}" if n.endswith(end) else n: part for n, part in self.causes.items()}
        return replace(self, causes=causes)

    def covariance(self, range_sd: float = FLAT_SD) -> FloatArray:
        """Covariance (n_parameters, n_parameters) of the fit of these presses, in shares of the ranges."""
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


def total(parts: Iterable[Evidence], n_parameters: int) -> Evidence:
    """Sum of what several presses tell; of none, nothing."""
    none = np.zeros((n_parameters, n_parameters))
    return sum(parts, start=Evidence(information=none, noise=none, causes={}))


def evidence_of(
    slopes: FloatArray,
    free: FloatArray,
    rows: Rows,
    known: Mapping[str, FloatArray],
    errors: ErrorSizes,
    *,
    channels: tuple[str, ...],
    site: str,
) -> Evidence:
    """Tell what one press says.

    Parameters
    ----------
    slopes : (n, n_parameters) array
        Of the residuals, per range of each parameter.
    free : (n, m) array
        Slopes in what is fitted to this press alone, such as its onset.
    rows : Rows
        Where each residual is on the curves.
    known : mapping of name to (n,) array
        What one standard deviation of each cause adds to the residuals.
    errors : ErrorSizes
    channels : tuple of str
        By their numbers in ``rows``.
    site : str
        Presses at one site share what the model leaves out there.
    """
    axes, sizes, _ = np.linalg.svd(free, full_matrices=False)
    taken = axes[:, sizes > SEEN * max(sizes.max(initial=0.0), 1e-300)]
    slopes = slopes - taken @ (taken.T @ slopes)  # as the fit does, which fits them too
    noise = np.zeros((slopes.shape[1],) * 2)
    causes = {name: (slopes.T @ column)[:, None] for name, column in known.items()}
    for number in rows.channels:
        channel, inside = channels[number], rows.channel == number
        for points, probability in errors.marginal(0).items():
            covariance = (
                probability * errors.noise.get(channel, errors.usual) ** 2 * rows.noise(number, points)
            )
            noise += slopes.T @ covariance @ slopes
        for length, probability in errors.marginal(1).items():
            size = (
                np.sqrt(probability) * errors.discrepancy.get(channel, errors.usual) * rows.envelope[inside]
            )
            left_out = slopes[inside].T @ (size[:, None] * _along(rows.path[inside], length))
            name = f"model {channel} {length:g}"
            causes[name] = np.sqrt(COMMON) * left_out
            causes[f"{name} {site}"] = np.sqrt(1.0 - COMMON) * left_out
    return Evidence(information=slopes.T @ slopes, noise=noise, causes=causes)


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
