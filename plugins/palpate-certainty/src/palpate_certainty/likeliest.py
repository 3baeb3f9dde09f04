"""The most likely values of a fit by simulated curves, where these bend too much for one step."""

from dataclasses import replace

import numpy as np

from palpate.api import FloatArray
from palpate.api.fit import Evaluation, Trial
from palpate_certainty.bounded import least_near
from palpate_certainty.tables import Assessed


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
