"""Where a description of a signal changes: least squares over everything but the place itself.

For each candidate place the description is linear in its coefficients; the place kept is the
one with the least squared residual, found on grids that close in on it. Its standard
deviation is that of the linearised problem, with the noise that the residual shows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from palpate.api import FloatArray

FINE = (31, 9, 9, 9)
"""Places on each grid, from the whole interval to the last step."""

COARSE = (31, 9, 5)
"""Enough to compare descriptions."""

Design = Callable[[FloatArray, FloatArray], FloatArray]
"""Columns (m, n, k) of the description at n abscissae for m candidate places."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A place, its standard deviation and the squared residual there."""

    at: float
    std: float
    squares: float
    n_rows: int
    kind: Literal["kink", "smooth"] = "smooth"


def profile(
    abscissa: FloatArray,
    values: FloatArray,
    between: tuple[float, float],
    design: Design,
    zoom: Sequence[int] = FINE,
) -> Fit:
    """Place of the change, sought in an interval.

    Parameters
    ----------
    abscissa, values : (n,) array
    between : tuple of float
        Where the place is.
    design : callable
        Columns of the description. It is called with the abscissae scaled to a range of
        length 1, and with candidate places on that scale.
    zoom : sequence of int
        Places on each of the grids that close in.
    """
    middle, scale = float(abscissa.mean()), float(np.ptp(abscissa)) or 1.0
    x, y = (abscissa - middle) / scale, values - values.mean()
    low, high = ((place - middle) / scale for place in between)
    best, coefficients, squares = _closed_in(x, y, (low, high), design, zoom)
    std = _std_of_place(x, best, design, coefficients, squares)
    return Fit(at=middle + scale * best, std=scale * std, squares=squares, n_rows=y.size)


def _closed_in(
    x: FloatArray, y: FloatArray, between: tuple[float, float], design: Design, zoom: Sequence[int]
) -> tuple[float, FloatArray, float]:
    """Best place on grids that close in, with its coefficients and squared residual."""
    low, high = between
    place, coefficients, least = (low + high) / 2.0, np.empty(0), np.inf
    for n_places in zoom:
        grid = np.linspace(low, high, n_places)
        found, squares = _residuals(design(x, grid), y)
        index = int(np.argmin(squares))
        place, coefficients, least = float(grid[index]), found[index], float(squares[index])
        step = (high - low) / (n_places - 1)
        low, high = max(low, place - step), min(high, place + step)
    return place, coefficients, least


def _residuals(designs: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients (m, k) and squared residuals (m,) of designs (m, n, k)."""
    across = designs.swapaxes(1, 2)
    normal = across @ designs
    # A ridge far below the noise keeps a place at the interval's edge solvable.
    ridge = 1e-13 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(normal.shape[1])
    coefficients = np.linalg.solve(normal + ridge, across @ y[:, None])
    misfit = y[:, None] - designs @ coefficients
    return coefficients[..., 0], np.einsum("mni,mni->m", misfit, misfit)


def _std_of_place(
    x: FloatArray, at: float, design: Design, coefficients: FloatArray, squares: float
) -> float:
    """Standard deviation of the place: the part of ∂values/∂place that no coefficient imitates."""
    step = 1e-4
    pair = design(x, np.array([at - step, at + step])) @ coefficients
    slope = (pair[1] - pair[0]) / (2.0 * step)
    here = design(x, np.array([at]))
    left_over = float(_residuals(here, slope)[1][0])
    variance = squares / max(x.size - here.shape[2] - 1, 1)
    return float(np.sqrt(variance / left_over)) if left_over > 0.0 else float(np.ptp(x))
