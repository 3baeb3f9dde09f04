"""Verdict on a model by its residuals: it describes the data, approximates them, or does neither."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from palpate.api import FloatArray
from palpate.api.fit import THRESHOLDS, Adequacy, SpotTerm, channel_of, pieces
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.linear_problem import LinearProblem, ResidualErrors


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """A check of a model against its residuals.

    Parameters
    ----------
    name : {"discrepancy", "shape", "spots", "ranges", "relaxation"}
    channel : int
        Number of the channel; negative for all.
    probability : float
        A good model gives residuals as unlikely as these, or more so, with this probability.
    verdict : Adequacy
    closeness : Closeness, optional
        Of the model to the channel.
    visible : float, optional
        Discrepancy of a law that the data show in nine of ten cases.
    message : str
        What is wrong, where that is not in the residuals.
    """

    name: str
    channel: int
    probability: float
    verdict: Adequacy
    closeness: "Closeness | None" = None
    visible: float | None = None
    message: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Closeness:
    """Closeness of curves at the most likely values to a measured channel.

    Parameters
    ----------
    difference : float
        Largest difference over the peak of its curve.
    r2 : float
        Least R² of a spot.
    """

    difference: float
    r2: float

    @property
    def is_close(self) -> bool:
        """True if a model that is no closer still approximates the channel."""
        return self.difference <= THRESHOLDS.close_difference and self.r2 >= THRESHOLDS.close_r2


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit:
    """Largest difference between a fit and what was measured in a channel.

    Parameters
    ----------
    row : int
        Number of its residual.
    share : float
        Over the peak of the measured curve.
    unexplained : float
        The most of a difference that is left by the error budget, and by three standard deviations of the
        noise, over the peak.
    cause : str, optional
        Known error source that explains at least half of the largest difference.
    """

    row: int
    share: float
    unexplained: float
    cause: str | None


def misfits(points: LinearProblem, linear: LinearProblem, errors: ResidualErrors) -> dict[int, Misfit]:
    """Largest difference of each channel, by its number.

    The budget explains of each difference what its causes have in it by the covariance of all (their mean,
    given the residuals), and never turns its sign. So what is left grows with the difference that a reader
    sees, and is not more than that. Noise is what differs from the mean of both neighbours on the curve.

    Parameters
    ----------
    points, linear : LinearProblem
        Of every measured point, and of averages of these.
    errors : ResidualErrors
    """
    residuals, rows, groups, free = points.residuals, points.rows, linear.groups, linear.free
    known = linear.stated
    covariance = known @ known.T + linear.rest(errors.noise)
    averaged = groups @ residuals
    within = free.T @ covariance @ free
    jitter = 1e-12 * np.trace(within) / len(within) * np.eye(len(within))
    weights = free @ np.linalg.solve(within + jitter, free.T @ averaged)
    by_cause = {name: free @ (free.T @ part) @ (part.T @ weights) for name, part in linear.known.items()}
    explained = np.sum(list(by_cause.values()), axis=0)
    ratio, group = np.zeros_like(averaged), np.argmax(groups > 0.0, axis=0)
    np.divide(explained, averaged, out=ratio, where=averaged != 0.0)
    left = (1.0 - ratio.clip(0.0, 1.0))[group]
    found = {}
    for channel in rows.channels:
        curves = [np.flatnonzero((rows.channel == channel) & (rows.spot == s)) for s in np.unique(rows.spot)]
        shares = [residuals[at] / rows.scale[at] for at in curves]
        share, at = np.abs(np.concatenate(shares)), np.concatenate(curves)
        # Standard deviations of the noise that a difference may have of it.
        most = (
            np.abs(of * left[i]).max() - 3.0 * _noise(of)
            for of, i in zip(shares, curves, strict=True)
            if of.size
        )
        row, largest = int(at[np.argmax(share)]), float(share.max())
        parts = {name: float(part[group[row]]) for name, part in by_cause.items()}
        cause = _most_of(float(averaged[group[row]]), parts)
        found[channel] = Misfit(row=row, share=largest, unexplained=float(max(0.0, *most)), cause=cause)
    return found


def _most_of(whole: float, parts: Mapping[str, float]) -> str | None:
    """Name of the part that leaves least of the whole, if that is less than the part itself."""
    left = {name: abs(whole - part) for name, part in parts.items()}
    name = min(left, key=left.__getitem__)
    return name if left[name] < abs(parts[name]) else None


def shape_of(linear: LinearProblem, errors: ResidualErrors) -> tuple[float, dict[int, float]]:
    """Probability of residuals so unlike the stated errors, by a score test of variance components.

    Second is, by the number of each channel, the discrepancy of a law (standard deviation over the peak) that
    the test sees in nine of ten cases; none where the parameters explain nearly every curve.
    The statistic has most power for small additions: a discrepancy along the path, in part common to all
    spots, and larger stated errors (Lin, Biometrika 84, 1997). Another law is not alike at all spots: one set
    of values is too stiff where strains are small, and too soft where they are large. The statistic is a sum
    of squares with weights, taken for χ² of its mean and variance (Satterthwaite).
    """
    rows, free, known = linear.rows, linear.free, linear.stated
    if not free.size:
        return 1.0, {}
    noise, _ = errors.noise.covariances(rows)
    length, size = ASSUMED.law_length, linear.expected
    law = np.sum([size[i] ** 2 * rows.discrepancy(i, length) for i in rows.channels], axis=0)
    usual = free.T @ (known @ known.T + noise + law) @ free
    root = np.linalg.cholesky(usual + 1e-12 * np.trace(usual) / len(usual) * np.eye(len(usual)))
    through = scipy.linalg.solve_triangular(root, free.T, lower=True)
    of_law = through @ law @ through.T
    tested = of_law + ASSUMED.larger * (through @ known) @ (through @ known).T
    white, both = through @ linear.residuals, tested @ of_law

    def distribution(times: float) -> Any:  # noqa: ANN401 -- SciPy's frozen distributions have no type
        """Distribution of the statistic where the law adds so many times the usual discrepancy."""
        mean = np.trace(tested) + times * np.trace(both)
        square = np.sum(tested**2) + 2.0 * times * np.sum(both * tested) + times**2 * np.sum(both * both.T)
        return scipy.stats.chi2(mean**2 / square, scale=square / mean)

    limit = distribution(0.0).isf(THRESHOLDS.unusual)

    def unseen(log: float) -> float:
        """Probability that the test does not see so many times the usual discrepancy, less a tenth."""
        return float(distribution(np.exp(log)).cdf(limit) - 0.1)

    visible: dict[int, float] = {}
    if unseen(30.0) < 0.0:
        more = np.exp(scipy.optimize.brentq(unseen, -20.0, 30.0) / 2.0)
        visible = {channel: float(more * size[channel]) for channel in rows.channels}
    return float(distribution(0.0).sf(white @ tested @ white)), visible


def closeness_of(
    residuals: FloatArray, terms: Sequence[SpotTerm], channels: Sequence[str]
) -> dict[int, Closeness]:
    """Closeness to each of the channels by its number; ``residuals`` (n,) are of the terms."""
    squares: dict[tuple[int, str], FloatArray] = {}
    differences: dict[int, float] = {}
    for term, name, at, scale in pieces(terms):
        number, inside = channels.index(channel_of(name)), term.counted(name)
        curve = term.measured[channel_of(name)]
        sizes = scale * np.abs(curve.ordinate).max()
        here = float(np.max(np.abs(residuals[at] / sizes[inside]), initial=0.0))
        differences[number] = max(differences.get(number, 0.0), here)
        spread = (scale * (curve.ordinate - curve.ordinate[inside].mean()))[inside]
        both = np.array([(residuals[at] ** 2).sum(), (spread**2).sum()])
        squares[number, term.spot] = squares.get((number, term.spot), 0.0) + both
    r2 = {key: 1.0 - float(left / spread) if spread else 0.0 for key, (left, spread) in squares.items()}
    return {
        number: Closeness(difference=size, r2=min(value for (of, _), value in r2.items() if of == number))
        for number, size in differences.items()
    }


def _noise(along: FloatArray) -> float:
    """Standard deviation of the noise of values (n,) along a curve, from point to point."""
    if along.size < 3:
        return 0.0
    return float(np.sqrt(np.mean(np.diff(along, 2) ** 2) / 6.0))


def is_beyond(misfit: Misfit, expected: float) -> bool:
    """True if a good model, with a discrepancy of the ``expected`` size, does not differ so much."""
    return misfit.unexplained > THRESHOLDS.allowed * expected


def checks(
    found: Mapping[int, Misfit],
    expected: Mapping[int, float],
    close: Mapping[int, Closeness],
    shape: tuple[float, Mapping[int, float]],
    alike: float | None,
    in_ranges: float,
) -> Iterator[Check]:
    """Check the residuals of a fit, by channel number, and the result of :func:`shape_of`.

    A good model has a discrepancy of the ``expected`` size over the peak. Spots differ so much by errors
    alone with the probability ``alike``: they may, and it takes nothing away. Without its bounds a fit would
    end as far outside of the ranges with the probability ``in_ranges``.
    """
    for channel, misfit in found.items():
        p = 2.0 * float(scipy.stats.norm.sf(misfit.unexplained / expected[channel]))
        worse = Adequacy.APPROXIMATES if close[channel].is_close else Adequacy.FAILS
        yield Check(
            name="discrepancy",
            channel=channel,
            probability=p,
            verdict=worse if is_beyond(misfit, expected[channel]) else Adequacy.DESCRIBES,
            closeness=close[channel],
            visible=shape[1].get(channel),
        )
    unusual = Adequacy.APPROXIMATES if all(each.is_close for each in close.values()) else Adequacy.FAILS
    yield Check(
        name="shape",
        channel=-1,
        probability=shape[0],
        verdict=unusual if shape[0] < THRESHOLDS.unusual else Adequacy.DESCRIBES,
    )
    if alike is not None:
        yield Check(name="spots", channel=-1, probability=alike, verdict=Adequacy.DESCRIBES)
    verdict = unusual if in_ranges < THRESHOLDS.outside else Adequacy.DESCRIBES
    yield Check(name="ranges", channel=-1, probability=in_ranges, verdict=verdict)
