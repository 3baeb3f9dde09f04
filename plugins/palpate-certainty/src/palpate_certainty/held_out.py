"""Held-out presses: each predicted from the others with a band, and compared with its measured curves.

Of one press alone each channel is held out. Once a press is left out, the fit moves by one step along its
slopes, weighed as the intervals weigh it (:mod:`palpate_certainty.laplace`); noise and discrepancy are
estimated again without it. The band is what the errors of the parameters and of the press itself make of its
curves. Nothing is simulated.
"""

from typing import Any

import numpy as np
import polars as pl
import scipy

from palpate.api import BoolArray, FloatArray
from palpate.api.fit import THRESHOLDS
from palpate_certainty.between_spots import SPOTS, freedom_of
from palpate_certainty.linear_problem import errors_without
from palpate_certainty.tables import Assessed

BAND = 0.9
"""Probability that a curve is inside of its band."""


def held_out(assessed: Assessed) -> pl.DataFrame:
    """One row per held-out curve, as the table ``held_out`` has it: its difference, its band, and their odds.

    Each spot is left out in turn; of one spot alone, each channel is. ``difference`` and ``band`` are roots
    of the mean square along the curve over its peak, the latter with the probability :data:`BAND`.
    """
    rows, spots = assessed.linear.rows, list(dict.fromkeys(term.spot for term in assessed.end.problem.terms))
    parts = [rows.spot == i for i in range(len(spots))]
    if len(spots) == 1:
        parts = [rows.channel == channel for channel in rows.channels if len(rows.channels) > 1]
    found = []
    for out in filter(np.any, parts):
        difference, covariance, scale_freedom = _predicted(assessed, out)
        spot, channels, scale = spots[rows.spot[out][0]], rows.channel[out], rows.scale[out]
        for channel in np.unique(channels):
            at = channels == channel
            share = difference[at] / scale[at]
            of_share = covariance[np.ix_(at, at)] / np.outer(scale[at], scale[at])
            n_points = int(assessed.linear.n_points[out][at].sum())
            compared = _compared(share, of_share, n_points, scale_freedom)
            found.append({"spot": spot, "channel": assessed.linear.channels[channel], **compared})
    return pl.DataFrame(found)


def _compared(
    share: FloatArray, covariance: FloatArray, n_points: int, scale_freedom: float
) -> dict[str, Any]:
    """Root mean square over so many points of differences (n,), against errors with a covariance (n, n).

    The sum of squares of correlated normal errors is nearly χ² over degrees of freedom that have its mean
    and variance (Satterthwaite, Biometrics Bulletin 2, 1946); the uncertain scale of the errors makes it F.
    """
    mean, square = float(np.trace(covariance)), float(share @ share)
    freedom = mean**2 / float((covariance**2).sum())
    probability = float(scipy.stats.f.sf(square / mean, freedom, scale_freedom))
    return {
        "difference": float(np.sqrt(square / n_points)),
        "band": float(np.sqrt(mean * scipy.stats.f.ppf(BAND, freedom, scale_freedom) / n_points)),
        "probability": probability,
        "inside": probability >= 1.0 - BAND,
    }


def _predicted(assessed: Assessed, out: BoolArray) -> tuple[FloatArray, FloatArray, float]:
    """Differences (n,) of the curves left out from their prediction by the others, and their covariance.

    Third are the degrees of freedom of the covariance's scale.
    """
    linear, kept = assessed.linear, ~out
    errors, rest = errors_without(linear, kept, assessed.errors), linear.only(kept)
    # Where the others tell nothing, a value is anywhere in its range.
    found, there, freedom = rest.density(errors).in_range, linear.jacobian[out], errors.scale.freedom
    others = of_out = linear.columns(errors)
    new, known = np.zeros_like(found.covariance), assessed.errors.between
    between, own, spot = errors.between or known, linear.by_spot, linear.rows.spot[out][0]
    residuals, point, site = linear.residuals[out], linear.point, int(linear.rows.site[out][0])
    if errors.between is not None and site in rest.rows.site:  # other presses show the values there
        found, there, others = rest.at_site(errors, site).in_range, own.jacobian[out], own.columns(errors)
        residuals, point, of_out, between = own.residuals[out], own.point[spot], others, None
    elif known is not None and between is not None:  # the spot has values of its own
        others, rates = own.columns(errors), between.rates_to(own.point[spot], linear.box)
        # Two spots differ by twice the variance; one and the means of the others, which differ too, by one.
        sd = np.sqrt(2.0) * known.sizes / known.rates
        if errors.between is not None:
            found = found.mapped(np.diag(rates), found.centre)
            sd[between.shared] = between.sd
        new = np.diag((rates * between.rates * sd) ** 2)
    covariance = np.sum([part[out] @ part[out].T for part in of_out.values()], axis=0)
    common = np.sum([part[out] @ others[name][kept].T for name, part in of_out.items()], axis=0)
    across = common @ found.through.T @ there.T
    predicted = covariance - across - across.T + there @ (found.covariance + new) @ there.T
    if between is not None:
        share = np.trace(there @ (found.parts.get(SPOTS, 0.0) + new) @ there.T) / np.trace(predicted)
        freedom = freedom_of(np.array([share]), between.freedom, freedom)
    return residuals + there @ (found.centre - point), predicted, freedom


def sentence(table: pl.DataFrame) -> str:
    """Sentence on what was held out, the number of curves inside of their bands, and the farthest off."""
    inside, spots = int(table["inside"].sum()), table["spot"].unique(maintain_order=True)
    verb, its, bands = ("is", "its", "band") if inside == 1 else ("are", "their", "bands")
    are = f"{verb} inside {its} {100.0 * BAND:.0f} % {bands}"
    text = f"{inside} of {table.height} curves of held-out presses {are}"
    if len(spots) == 1:
        which = f"each curve of the only press ({spots[0]}) was predicted from its other channels"
        text = f"{which}: {inside} of {table.height} {are}"
    if inside == table.height:
        return text
    worst = table.sort("probability").row(0, named=True)
    text += (
        f"; farthest off is {worst['channel']} at {worst['spot']}, by {100.0 * worst['difference']:.1f} % of "
        f"its peak (band {100.0 * worst['band']:.1f} %)"
    )
    return f"{text}: it does not belong to the others" if is_apart(table) else text


def is_apart(table: pl.DataFrame) -> bool:
    """True if a held-out curve is so far off as hardly any would be by chance."""
    least = table["probability"].min()
    return isinstance(least, float) and least * table.height < THRESHOLDS.held_out
