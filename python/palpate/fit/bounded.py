"""Least squares of linear residuals within a box, and slopes by differences."""

from collections.abc import Sequence

import numpy as np
import scipy

from palpate.domain import FloatArray


def linear_least(
    matrix: FloatArray, target: FloatArray, lower: FloatArray | float = 0.0, upper: FloatArray | float = 1.0
) -> FloatArray:
    """Least |matrix x − target| (n,) between bounds; coordinates without room stay at their lower one."""
    ends = np.broadcast_arrays(lower, upper, np.zeros(matrix.shape[1]))
    low, high = (np.asarray(end, dtype=np.float64) for end in ends[:2])
    found, free = low.copy(), high > low
    if free.any():
        left = target - matrix[:, ~free] @ low[~free]
        bounds = (low[free], high[free])
        solved = scipy.optimize.lsq_linear(matrix[:, free], left, bounds=bounds, method="bvls")
        found[free] = np.clip(solved.x, *bounds)
    return found


def slope_of(here: FloatArray, points: Sequence[tuple[float, FloatArray]]) -> FloatArray:
    """Derivative from two steps: central, or one-sided of second order; of first order from one step."""
    (a, at_a), (b, at_b) = points[0], points[-1]
    if len(points) == 1:
        return (at_a - here) / a
    return (a / b * (at_b - here) - b / a * (at_a - here)) / (a - b)
