"""A fit to first order: residuals, slopes, and columns with names for every source of error.

Intervals, checks, held-out curves, posteriors and planned presses read a :class:`LinearProblem`, and the
sizes of its errors from :class:`ResidualErrors`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray, IntArray, PalpateError
from palpate.api.fit import THRESHOLDS, Box, Evaluation
from palpate_certainty.between_spots import (
    SPOTS,
    SpotDifferences,
    by_spot,
    differences,
    freedom_of,
    probability_of_alike,
    shared_parameters,
    sites_of,
)
from palpate_certainty.laplace import PRIORS, Laplace, laplace, root_of, scores_of, whitening
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

NOISE, DISCREPANCY = "noise", "model"
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
        Its end, as shares of the ranges; (n_spots, n_parameters) where each spot has parameters of its own,
        the same for presses at one place.
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
    box : Box
        Of the parameters.
    own : LinearProblem, optional
        The same curves, each spot's to first order around the end of its own fit.
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
    box: Box = field(default_factory=lambda: Box(()))
    own: "LinearProblem | None" = None
    is_like_fopt: bool = False

    @property
    def n_points(self) -> IntArray:
        """Measured points (n,) that each residual is the average of."""
        return (self.groups > 0.0).sum(axis=1)

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
            own=self.own and self.own.averaged(),
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
            own=self.own and self.own.only(kept),
        )

    @cached_property
    def by_spot(self) -> "LinearProblem":
        """Problem where each spot has shared parameters of its own."""
        n_spots = int(self.rows.spot.max()) + 1
        return self.own or replace(self, point=np.tile(self.point, (n_spots, 1)))

    @cached_property
    def slopes(self) -> FloatArray:
        """Slopes (n, m) of the residuals, of shared parameters at each spot where each has its own."""
        return self.jacobian if self.point.ndim == 1 else by_spot(self.jacobian, self.rows)

    @cached_property
    def free(self) -> FloatArray:
        """Orthonormal directions (n, n - n_parameters) of the residuals that no parameter explains."""
        # Priors of what spots share hold the mean alone, where each spot has values of its own.
        held = (self.rows.channel >= 0) | self.slopes.any(axis=1)
        return np.eye(held.size)[:, held] @ scipy.linalg.null_space(self.slopes[held].T)

    @cached_property
    def stated(self) -> FloatArray:
        """Columns (n, m) of all known sources, as they are stated."""
        return np.concatenate(list(self.known.values()), axis=1)

    @cached_property
    def scores(self) -> FloatArray:
        """Orthonormal columns (n, m) that span the slopes of each curve, or of all curves as one."""
        curves = np.zeros_like(self.rows.curve) if self.is_like_fopt else self.rows.curve
        return scores_of(self.slopes, curves)

    def like_fopt(self, errors: ResidualErrors) -> tuple[Self, ResidualErrors]:
        """Problem whose curves count as in Fopt, and its errors: the discrepancy is as large as it may be."""
        noise, by = errors.noise.at_most, self if errors.between is None else self.by_spot
        scale = error_scale(by.residuals, by.free, by.stated, by.rest(noise))
        larger = replace(errors, noise=noise, scale=scale, between=None)
        own = self.own and replace(self.own, is_like_fopt=True)
        found = replace(self, is_like_fopt=True, own=own)
        return found, larger if errors.between is None else replace(larger, between=_between(found, larger))

    @property
    def has_shared(self) -> bool:
        """True if at least two spots have a parameter in common."""
        return bool(shared_parameters(self.jacobian, self.rows).size)

    def columns(self, errors: ResidualErrors) -> dict[str, FloatArray]:
        """Columns (n, m) of every source of error by name, in their sizes."""
        noise, discrepancy = errors.noise.covariances(self.rows)
        # Priors have a scale of their own.
        known = {
            name: part if name == PRIORS else errors.scale.factor * part for name, part in self.known.items()
        }
        return {**known, NOISE: root_of(noise), DISCREPANCY: root_of(discrepancy)}

    def covariance(self, errors: ResidualErrors) -> FloatArray:
        """Covariance (n, n) of the residuals by every source of error."""
        return np.sum([part @ part.T for part in self.columns(errors).values()], axis=0)

    def rest(self, model: NoiseModel) -> FloatArray:
        """Covariance (n, n) of the residuals by noise and discrepancy."""
        noise, discrepancy = model.covariances(self.rows)
        return noise + discrepancy

    def density(self, errors: ResidualErrors, *, is_likeliest: bool = False) -> Laplace:
        """Density of the parameters by all errors, of their means where spots differ.

        No step leads from a ``point`` that is the most likely one.
        """
        if errors.between is not None:
            mean, freedom = errors.between.mean, errors.scale.freedom
            return replace(mean, freedom=freedom_of(mean.shares[SPOTS], errors.between.freedom, freedom))
        missed, freedom = self.residuals * (not is_likeliest), errors.scale.freedom
        return laplace(self.point, missed, self.jacobian, self.columns(errors), self.scores, freedom=freedom)

    def at_site(self, errors: ResidualErrors, site: int) -> Laplace:
        """Density of the parameters at a site by its own curves, where sites differ."""
        by, shared, sites = self.by_spot, shared_parameters(self.jacobian, self.rows), sites_of(self.rows)
        found, n = _changes(self, errors), by.point.shape[1]
        others, first = np.delete(np.arange(n), shared), int(np.searchsorted(sites, site)) * shared.size
        chosen = np.zeros((n, found.centre.size))
        chosen[shared, first + np.arange(shared.size)] = 1.0
        chosen[others, sites.size * shared.size + np.arange(others.size)] = 1.0
        there = found.mapped(chosen, by.point[site] + chosen @ found.centre)
        return replace(there, freedom=errors.scale.freedom)

    def white(self, errors: ResidualErrors) -> FloatArray:
        """Matrix (m, n_points) from the residuals of measured points to independent ones of variance 1."""
        return whitening(self.scores, self.covariance(errors), self.groups)


def linearised(box: Box, found: Evaluation) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals, slopes per range, and values as shares of their ranges, of an evaluation with slopes.

    Near the fit curves are linear in moduli as well as in their logarithms, which a search steps in. Farther
    off a :class:`~palpate_certainty.curve_coordinates.CurveCoordinates` says in which power.
    """
    assert found.residuals is not None
    assert found.jacobian is not None
    width = box.upper - box.lower
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
    if alike >= THRESHOLDS.spots:
        return replace(errors, alike=alike)
    if first is None or first.between is None:
        by = linear.by_spot
        errors = _sizes(by, by.free)
    return replace(errors, alike=alike, between=_between(linear, errors))


def errors_without(linear: LinearProblem, kept: BoolArray, known: ResidualErrors) -> ResidualErrors:
    """Sizes of the errors by the residuals that are kept of a problem whose errors are ``known``.

    They come from all residuals where a channel is left out altogether, or too few are kept to tell, and
    where all kept ones of several sites are of one: its parameters absorb most of the misfit of a wrong law.
    """
    rest, errors = linear.only(kept), known
    is_one = sites_of(rest.rows).size == 1 < sites_of(linear.rows).size
    has_all = set(rest.rows.channels) == set(linear.rows.channels)
    if has_all and not is_one and rest.residuals.size > rest.point.size:
        by = rest if known.between is None else rest.by_spot
        errors = _sizes(by, by.free, tuple(known.noise.correlations), known.noise.common)
    return replace(errors, between=_between(rest, errors) if known.between and rest.has_shared else None)


def _changes(linear: LinearProblem, errors: ResidualErrors) -> Laplace:
    """Density of the changes of the parameters, where each site has shared parameters of its own."""
    by = linear.by_spot
    return laplace(np.zeros(by.slopes.shape[1]), by.residuals, by.slopes, by.columns(errors), by.scores)


def _between(linear: LinearProblem, errors: ResidualErrors) -> SpotDifferences:
    by, known, changes = linear.by_spot, linear.rows.channel < 0, _changes(linear, errors)
    size = linear.known[PRIORS][known] if PRIORS in linear.known else np.empty((0, 0))
    prior = linear.residuals[known], linear.jacobian[known], size @ size.T, linear.point
    points = by.point[sites_of(linear.rows)]
    return differences(changes, by.jacobian, by.rows, points, linear.box, prior)


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
