"""Whether the model describes the data at all: only then do intervals mean anything."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import chi2, norm

from palpate.certainty.rows import Rows
from palpate.domain import FloatArray

RARE = 1e-3
"""Probability under which residuals do not happen to a good model."""

SURE = 0.95
"""Probability from which a discrepancy counts as larger than a model may have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A check of a model against its residuals.

    Parameters
    ----------
    name : {"discrepancy", "runs", "spots", "ranges", "estimators", "relaxation"}
    channel : int
        Number of the channel; negative for all.
    probability : float
        Of residuals as unlike those of a good model as these, or more.
    is_failed : bool
        Whether the model does not describe the data.
    message : str
        What is wrong, where that is not in the residuals.
    """

    name: str
    channel: int
    probability: float
    is_failed: bool
    message: str = ""


def checks(
    residuals: FloatArray,
    jacobian: FloatArray,
    covariance: FloatArray,
    rows: Rows,
    exceeds: Mapping[int, float],
    in_ranges: float,
    agreement: float | None = None,
) -> Iterator[Check]:
    """Check the residuals of a fit.

    Parameters
    ----------
    residuals : (n,) array
    jacobian : (n, n_parameters) array
    covariance : (n, n) array
        Of the residuals, as the budget and the estimated noise and discrepancy have them.
    rows : Rows
    exceeds : mapping of channel number to float
        Probability that its discrepancy is larger than a model may have.
    in_ranges : float
        Probability of a fit that, without its bounds, would end as far outside of the ranges.
    agreement : float, optional
        Probability of most likely values as far from those of the least Fopt, where these are wanted.
    """
    white = whitened(residuals, covariance)
    for channel, more in exceeds.items():
        yield Check(name="discrepancy", channel=channel, probability=1.0 - more, is_failed=more > SURE)
        p = _runs(white, rows, channel)
        # Signs know no size: residuals of exact curves are systematic, and mean nothing while they are small.
        yield Check(name="runs", channel=channel, probability=p, is_failed=p < RARE and more > 0.5)
    if np.unique(rows.spot[rows.spot >= 0]).size > 1:
        p = _spots(residuals, jacobian, covariance, rows)
        yield Check(name="spots", channel=-1, probability=p, is_failed=p < RARE)
    yield Check(name="ranges", channel=-1, probability=in_ranges, is_failed=in_ranges < RARE)
    if agreement is not None:
        yield Check(name="estimators", channel=-1, probability=agreement, is_failed=agreement < RARE)


def whitened(residuals: FloatArray, covariance: FloatArray) -> FloatArray:
    """Residuals (n,) of unit variance, each by what those before it do not predict."""
    jitter = 1e-12 * np.trace(covariance) / len(covariance) * np.eye(len(covariance))
    white: FloatArray = solve_triangular(np.linalg.cholesky(covariance + jitter), residuals, lower=True)
    return white


def _runs(white: FloatArray, rows: Rows, channel: int) -> float:
    """Probability of so few runs of one sign along the curves (Wald & Wolfowitz 1940)."""
    excess, variance = 0.0, 0.0
    for spot in np.unique(rows.spot[rows.channel == channel]):
        above = white[(rows.channel == channel) & (rows.spot == spot)] > 0.0
        n_above, n_below = int(above.sum()), int((~above).sum())
        n = n_above + n_below
        if n_above and n_below and n > 2:
            mean = 1.0 + 2.0 * n_above * n_below / n
            variance += (mean - 1.0) * (mean - 2.0) / (n - 1.0)
            excess += 1.0 + np.count_nonzero(np.diff(above)) - mean
    return float(norm.cdf(excess / np.sqrt(variance))) if variance > 0.0 else 1.0


def _spots(residuals: FloatArray, jacobian: FloatArray, covariance: FloatArray, rows: Rows) -> float:
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
    return float(chi2.sf(square, axes.shape[1]))
