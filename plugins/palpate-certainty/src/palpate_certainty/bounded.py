"""Least squares within the unit box, with slopes by differences that stay in it."""

from collections.abc import Callable

import numpy as np
import scipy

from palpate.api import BoolArray, FloatArray

STEP = 1e-4
"""Step in the unit box for slopes by differences."""

INSIDE = 1e-9
"""Distance from the ends of the unit box at which a search begins."""

Residuals = Callable[[FloatArray], FloatArray]
"""Residuals (n, m) at points (n, n_parameters) of the unit box."""


def slopes_at(residuals: Residuals, points: FloatArray, here: FloatArray, free: BoolArray) -> FloatArray:
    """Slopes (n, m, n_free) of residuals in the free coordinates, at points where they are ``here``."""
    slopes = []
    for i in np.flatnonzero(free).tolist():
        step = np.where(points[:, i] > 0.5, -STEP, STEP)
        moved = points.copy()
        moved[:, i] += step
        slopes.append((residuals(moved) - here) / step[:, None])
    return np.stack(slopes, axis=-1) if slopes else np.empty((*here.shape, 0))


def least_near(
    residuals: Residuals,
    start: FloatArray,
    free: BoolArray,
    slopes: Callable[[FloatArray], FloatArray] | None = None,
    *,
    tolerance: float = 1e-7,
    most_steps: int = 40,
) -> tuple[FloatArray, float]:
    """Point (n_parameters,) of the unit box of the least Σ r² near a start, and Σ r²; others are held.

    Parameters
    ----------
    slopes : callable, optional
        Of the residuals (m, n_parameters) at a point (n_parameters,); by default from differences.
    """

    def whole(part: FloatArray) -> FloatArray:
        point = start.copy()
        point[free] = part
        return point

    def at(part: FloatArray) -> FloatArray:
        return residuals(whole(part)[None])[0]

    def jacobian(part: FloatArray) -> FloatArray:
        point = whole(part)
        if slopes is not None:
            return slopes(point)[:, free]
        return slopes_at(residuals, point[None], residuals(point[None]), free)[0]

    if not free.any():
        return start, float((residuals(start[None]) ** 2).sum())
    inside = np.clip(start[free], INSIDE, 1.0 - INSIDE)
    found = scipy.optimize.least_squares(
        at, inside, jacobian, bounds=(0.0, 1.0), ftol=tolerance, xtol=tolerance, max_nfev=most_steps
    )
    return whole(found.x), float(2.0 * found.cost)
