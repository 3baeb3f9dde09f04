"""A fit to first order: residuals, slopes, and columns with names for every source of error.

Intervals, checks, held-out curves, posteriors and planned presses read a :class:`LinearProblem`, and the
sizes of its errors from :class:`ResidualErrors`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Self

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray, IntArray, PalpateError
from palpate.api.fit import Fit, Trial
from palpate_certainty.between_spots import (
    SPOTS,
    UNUSUAL,
    SpotDifferences,
    by_spot,
    differences,
    probability_of_alike,
    same_spot,
    shared_parameters,
)
from palpate_certainty.laplace import FLAT_SD, Laplace, laplace, root_of, scores_of, whitening
from palpate_certainty.noise_model import (
    PAIRS,
    ErrorScale,
    NoiseModel,
    ResidualLayout,
    error_scale,
    estimate,
    grouped,
    groups_of,
)

NOISE, DISCREPANCY, PRIORS = "noise", "model", "priors"
"""Error sources besides the sources of :mod:`~palpate_certainty.error_sources`."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ResidualErrors:
    """Sizes of the errors in residuals.

    Parameters
    ----------
    noise : NoiseModel
        Of noise and discrepancy.
    scale : ErrorScale
        Of the stated errors.
    between : SpotDifferences, optional
        Of spots that differ by more than their errors.
    alike : float, optional
        Probability of spots that differ so much by errors alone.
    """

    noise: NoiseModel
    scale: ErrorScale
    between: SpotDifferences | None = None
    alike: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearProblem:
    """A fit to first order around its end.

    Parameters
    ----------
    point : (n_parameters,) array
        Its end, as shares of the ranges.
    residuals : (n,) array
        Simulated less measured.
    jacobian : (n, n_parameters) array
        Of the residuals, per range.
    rows : ResidualLayout
    known : mapping of source to (n, m) array
        What one standard deviation of each known source of error adds to the residuals.
    channels : tuple of str
        By their numbers.
    expected : mapping of channel number to float
        Discrepancy that the study expects, over the largest ordinate.
    groups : (n, n_points) array
        As :func:`~palpate_certainty.noise_model.groups_of` returns them, where residuals are averages.
    logs : (n_parameters,) array
        Logarithm of the upper over the lower bound of a modulus; 0 of a parameter that is no logarithm.
    is_like_fopt : bool
        The curves count as in Fopt, for the model differs from them by more than its stated errors.
    """

    point: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    rows: ResidualLayout
    known: Mapping[str, FloatArray]
    channels: tuple[str, ...]
    expected: Mapping[int, float]
    groups: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    logs: FloatArray = field(default_factory=lambda: np.zeros(0))
    is_like_fopt: bool = False

    @property
    def n_points(self) -> IntArray:
        """Measured points (n,) that each residual is the average of."""
        counts: IntArray = (self.groups > 0.0).sum(axis=1)
        return counts

    def averaged(self) -> Self:
        """Problem whose residuals are averages of neighbours on long curves."""
        groups = groups_of(self.rows)
        return replace(
            self,
            residuals=groups @ self.residuals,
            jacobian=groups @ self.jacobian,
            rows=grouped(self.rows, groups),
            known={name: groups @ part for name, part in self.known.items()},
            groups=groups,
        )

    def only(self, kept: BoolArray) -> Self:
        """Problem of some of the residuals."""
        return replace(
            self,
            residuals=self.residuals[kept],
            jacobian=self.jacobian[kept],
            rows=self.rows.only(kept),
            known={name: part[kept] for name, part in self.known.items()},
            groups=self.groups[kept],
        )

    @cached_property
    def free(self) -> FloatArray:
        """Orthonormal directions (n, n - n_parameters) of the residuals that no parameter explains."""
        free: FloatArray = scipy.linalg.null_space(self.jacobian.T)
        return free

    @cached_property
    def stated(self) -> FloatArray:
        """Columns (n, m) of all known sources, as they are stated."""
        return np.concatenate(list(self.known.values()), axis=1)

    @cached_property
    def scores(self) -> FloatArray:
        """Orthonormal columns (n, m) that span the slopes of each curve, or of all curves as one."""
        curves = np.zeros_like(self.rows.curve) if self.is_like_fopt else self.rows.curve
        return scores_of(self.jacobian, curves)

    def together(self, errors: ResidualErrors) -> FloatArray | float:
        """1 for pairs of scores that are weighed by their common errors, else 0."""
        is_one = errors.between is None or self.is_like_fopt
        return 1.0 if is_one else same_spot(self.scores, self.rows)

    def like_fopt(self, errors: ResidualErrors) -> tuple[Self, ResidualErrors]:
        """Problem whose curves count as in Fopt, and its errors: the discrepancy is as large as it may be."""
        noise = errors.noise.at_most
        free = self.free if errors.between is None else _free_by_spot(self)
        scale = error_scale(self.residuals, free, self.stated, self.rest(noise))
        larger = replace(errors, noise=noise, scale=scale, between=None)
        if errors.between is not None:
            larger = replace(larger, between=_between(self, self.columns(larger)))
        return replace(self, is_like_fopt=True), larger

    @property
    def has_shared(self) -> bool:
        """True if at least two spots have a parameter in common."""
        return bool(shared_parameters(self.jacobian, self.rows).size)

    def sized(self, errors: ResidualErrors) -> dict[str, FloatArray]:
        """Columns (n, m) of the known sources and of the differences between spots, by their sizes."""
        # Priors have a scale of their own.
        found = {
            name: part if name == PRIORS else errors.scale.factor * part for name, part in self.known.items()
        }
        if errors.between is not None:
            found[SPOTS] = errors.between.columns(self.jacobian, self.rows)
        return found

    def columns(self, errors: ResidualErrors, kept: BoolArray | None = None) -> dict[str, FloatArray]:
        """Columns (n, m) of every source of error by name, in their sizes; of the residuals that are kept."""
        of_all = np.ones(self.residuals.size, dtype=bool) if kept is None else kept
        noise, discrepancy = (part[np.ix_(of_all, of_all)] for part in errors.noise.covariances(self.rows))
        known = {name: part[of_all] for name, part in self.sized(errors).items()}
        return {**known, NOISE: root_of(noise), DISCREPANCY: root_of(discrepancy)}

    def covariance(self, errors: ResidualErrors) -> FloatArray:
        """Covariance (n, n) of the residuals by every source of error."""
        parts = (part @ part.T for part in self.sized(errors).values())
        covariance: FloatArray = np.sum([self.rest(errors.noise), *parts], axis=0)
        return covariance

    def rest(self, model: NoiseModel) -> FloatArray:
        """Covariance (n, n) of the residuals by noise and discrepancy."""
        noise, discrepancy = model.covariances(self.rows)
        return noise + discrepancy

    def weighed(self, errors: ResidualErrors, *, is_likeliest: bool = False) -> tuple[Laplace, Laplace]:
        """Density of the parameters by all errors, and one where each is known to be in its range.

        No step leads from a ``point`` that is the most likely one.
        """
        missed = np.zeros_like(self.residuals) if is_likeliest else self.residuals
        density = partial(
            laplace,
            self.point,
            missed,
            self.jacobian,
            self.columns(errors),
            self.scores,
            freedom=errors.scale.freedom,
            together=self.together(errors),
        )
        of_all, in_range = density(), density(range_sd=FLAT_SD)
        if errors.between is not None:
            freedom = errors.between.freedom_with(of_all.shares[SPOTS], errors.scale.freedom)
            of_all, in_range = (replace(each, freedom=freedom) for each in (of_all, in_range))
        return of_all, in_range

    def white(self, errors: ResidualErrors) -> FloatArray:
        """Matrix (m, n_points) from the residuals of measured points to independent ones of variance 1."""
        return whitening(self.scores, self.covariance(errors), self.groups)


def linearised(fit: Fit, at: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals, slopes per range, and values as shares of their ranges, where a fit has ended or at values.

    Curves are nearly linear in moduli, and not in the logarithms of these, which a search steps in.
    """
    box = fit.problem.box
    width = box.upper - box.lower
    found = fit.at_end()
    if at is not None:
        (there,) = fit.problem.evaluate([Trial(point=box.point(box.lower + width * at), slopes=True)])
        found = found if there.jacobian is None else there
    assert found.residuals is not None
    assert found.jacobian is not None
    shares = (box.values(found.point) - box.lower) / width
    return found.residuals, found.jacobian * width / box.rates(found.point), shares


def errors_of(linear: LinearProblem, first: ResidualErrors | None = None) -> ResidualErrors:
    """Sizes of the errors of a fit, with the differences between its spots where these are not alike.

    Each spot then has parameters of its own.

    Parameters
    ----------
    first : ResidualErrors, optional
        Errors of another fit, which serve here too if they have all channels of this fit.

    Raises
    ------
    PalpateError
        There are fewer residuals than parameters.
    """
    n, n_parameters = linear.jacobian.shape
    if n <= n_parameters:
        raise PalpateError(f"{n} measured points for {n_parameters} parameters; fix some")
    known = first if first is not None and first.noise.noise.keys() >= set(linear.rows.channels) else None
    errors = _sizes(linear, linear.free) if known is None else replace(known, between=None, alike=None)
    if not linear.has_shared:
        return errors
    stated = linear.stated @ linear.stated.T + linear.rest(errors.noise)
    alike = probability_of_alike(linear.residuals, linear.jacobian, stated, linear.rows)
    if alike >= UNUSUAL:
        return replace(errors, alike=alike)
    if first is None or first.between is None:
        errors = _sizes(linear, _free_by_spot(linear))
    return replace(errors, alike=alike, between=_between(linear, linear.columns(errors)))


def errors_without(linear: LinearProblem, kept: BoolArray, known: ResidualErrors) -> ResidualErrors:
    """Sizes of the errors by the residuals that are kept of a problem whose errors are ``known``.

    They come from all residuals where a channel is left out altogether, or too few are kept to tell.
    """
    rest, errors = linear.only(kept), known
    if set(rest.rows.channels) == set(linear.rows.channels) and rest.residuals.size > rest.point.size:
        free = rest.free if known.between is None else _free_by_spot(rest)
        errors = _sizes(rest, free, tuple(known.noise.correlations), known.noise.common)
    if known.between is None or not rest.has_shared:
        return replace(errors, between=known.between)
    columns = linear.columns(replace(errors, between=None), kept)
    return replace(errors, between=_between(rest, columns))


def _between(linear: LinearProblem, columns: Mapping[str, FloatArray]) -> SpotDifferences:
    logs = linear.logs if linear.logs.size else np.zeros(linear.point.size)
    by_size = (NOISE, DISCREPANCY)
    return differences(
        linear.residuals, linear.jacobian, columns, linear.rows, linear.point, logs, by_size=by_size
    )


def _sizes(
    linear: LinearProblem,
    free: FloatArray,
    lengths: tuple[tuple[float, float], ...] = PAIRS,
    common: float | None = None,
) -> ResidualErrors:
    """Sizes of noise and discrepancy, and the scale of the stated errors."""
    residuals, stated = linear.residuals, linear.stated
    noise = estimate(
        residuals, free, stated, linear.rows, expected=linear.expected, lengths=lengths, common=common
    )
    noise = noise.at_most if linear.is_like_fopt else noise
    return ResidualErrors(noise=noise, scale=error_scale(residuals, free, stated, linear.rest(noise)))


def _free_by_spot(linear: LinearProblem) -> FloatArray:
    """Directions that no parameter explains where each spot has shared parameters of its own."""
    free: FloatArray = scipy.linalg.null_space(by_spot(linear.jacobian, linear.rows).T)
    return free
