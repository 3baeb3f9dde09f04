"""Most likely values and intervals of a fit by simulated curves, where these bend too much for one step."""

from dataclasses import replace

import numpy as np

from palpate.api import FloatArray
from palpate.api.fit import Evaluation, Trial
from palpate_certainty.bounded import least_near
from palpate_certainty.curve_coordinates import power_of
from palpate_certainty.tables import Assessed, most_likely


def likeliest(assessed: Assessed) -> Assessed:
    """Fit at the values of the least misfit, by the errors of its residuals, as they were where it ended."""
    problem, white = assessed.end.problem, assessed.white
    box, known = problem.box, dict[bytes, Evaluation]()

    def at(point: FloatArray) -> Evaluation:
        key = point.tobytes()
        if key not in known:
            (known[key],) = problem.evaluate([Trial(point=point, slopes=True)])
        return known[key]

    def residuals(point: FloatArray) -> FloatArray:
        found = at(point).residuals
        # Independent residual, in standard deviations, of values that cannot be simulated.
        return np.full(len(white), 1e3) if found is None else white @ found

    def slopes(point: FloatArray) -> FloatArray:
        found = at(point).jacobian
        return np.zeros((len(white), point.size)) if found is None else white @ found

    def point_of(shares: FloatArray) -> FloatArray:
        return box.point(box.linear(shares))

    first, start = point_of(assessed.linear.point), point_of(assessed.point)
    step = (box.values(start) - box.values(first)) / box.rates(first)
    # Difference from linear curves, in standard deviations, up to which these hold.
    if float(np.linalg.norm(residuals(start) - residuals(first) - slopes(first) @ step)) < 0.1:
        return assessed
    best = min(first, start, key=lambda point: float(np.sum(residuals(point) ** 2)))
    found, _ = least_near(
        lambda points: np.stack([*map(residuals, points)]),
        best,
        np.ones(best.size, dtype=bool),
        slopes,
        tolerance=1e-4,  # relative gain, or step, at which a search has ended
        most_steps=60,  # each simulates every spot
    )
    values = box.values(np.clip(found, 0.0, 1.0))
    return replace(assessed, point=(values - box.lower) / (box.upper - box.lower))


def straightened(assessed: Assessed, powers: dict[str, float]) -> Assessed:
    """Fit along powers of moduli in which its curves are linear, where an interval is wide.

    Parameters
    ----------
    powers : dict of name to float
        Those that are known; the others are added, each by one simulation of each spot.
    """
    if assessed.errors.between is not None:
        return assessed
    problem, own = assessed.end.problem, assessed.along.powers.copy()
    box = problem.box
    sd = assessed.laplace.sd * (box.upper - box.lower)
    # Standard deviation, over a modulus, from which an interval shows in which power curves are linear.
    for k in np.flatnonzero(box.log & (sd > 0.1 * assessed.values)).tolist():
        if (name := box.names[k]) not in powers:
            powers[name] = _power_at(assessed, k, float(sd[k]))
        own[k] = powers[name]
    if np.array_equal(own, assessed.along.powers):
        return assessed
    along = replace(assessed.along, powers=own)
    density, point = most_likely(assessed.laplace, assessed.linear, assessed.errors, along, problem)
    return replace(assessed, along=along, density=density, point=point)


def _power_at(assessed: Assessed, k: int, sd: float) -> float:
    """Power of a modulus in which curves are linear, by curves one standard deviation from the fit.

    It is 1 where these cannot be simulated.
    """
    problem, linear = assessed.end.problem, assessed.linear
    box, values = problem.box, problem.box.linear(linear.point)
    factors = np.ones(values.size)
    factors[k] = np.exp(min(sd / values[k], np.log(2.0)))
    if factors[k] * values[k] > box.upper[k]:
        factors[k] = max(1.0 / factors[k], box.lower[k] / values[k])
    (there,) = problem.evaluate([Trial(point=box.point(factors * values))])
    # Change of a modulus within which no power shows: its range ends here.
    if there.residuals is None or abs(factors[k] - 1.0) < 0.01:
        return 1.0
    moved = assessed.laplace.through[k] @ (linear.groups @ there.residuals - linear.residuals)
    change = moved * (box.upper[k] - box.lower[k]) / values[k]
    # No finer than one simulation tells: what is in proportion to a modulus stays linear.
    return round(power_of(float(factors[k]), float(change)), 1)
