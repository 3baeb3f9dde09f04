"""Profiles: the least misfit at each value of one parameter, the others fitted again."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from palpate.api import FloatArray
from palpate.api.fit import RISE

N_POINTS = 9
"""Points of a profile to either side of the least."""

STEP = 1e-4
"""Step in the box for slopes of emulated curves."""

White = Callable[[FloatArray], FloatArray]
"""Independent residuals (n, m) at points (n, n_parameters) of the box."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Profile:
    """The profile of one parameter.

    Parameters
    ----------
    points : (n, n_parameters) array
        Where the density is largest, by the coordinate of the parameter.
    rises : (n,) array
        −2 log of the density there, less its least.
    ends : (2, n_parameters) array
        The best points at the two ends of the interval.
    is_open : (2,) tuple of bool
        Whether an end is at the bound, where the rise is less than that of an end.
    """

    points: FloatArray
    rises: FloatArray
    ends: FloatArray
    is_open: tuple[bool, bool]


def slopes_of(white: White, point: FloatArray) -> FloatArray:
    """Slopes (m, n_parameters) of the residuals at a point, by differences within the box."""
    steps = np.where(point > 0.5, -STEP, STEP)
    values = white(np.concatenate([point[None], point + np.diag(steps)]))
    slopes: FloatArray = ((values[1:] - values[0]) / steps[:, None]).T
    return slopes


def best_point(white: White, start: FloatArray, fixed: int | None = None) -> tuple[FloatArray, float]:
    """Point of the box of the least misfit, with one coordinate held; and the misfit."""
    free = np.arange(start.size) != (-1 if fixed is None else fixed)

    def whole(part: FloatArray) -> FloatArray:
        point = start.copy()
        point[free] = part
        return point

    if not free.any():
        return start, float((white(start[None]) ** 2).sum())

    def residuals(part: FloatArray) -> FloatArray:
        return white(whole(part)[None])[0]  # type: ignore[no-any-return]

    def jacobian(part: FloatArray) -> FloatArray:
        return slopes_of(white, whole(part))[:, free]

    found = least_squares(
        residuals,
        np.clip(start[free], 1e-6, 1.0 - 1e-6),
        jac=jacobian,
        bounds=(0.0, 1.0),
        xtol=1e-7,
        ftol=1e-7,
        max_nfev=40,
    )
    return whole(found.x), float(2.0 * found.cost)


def profile(white: White, best: FloatArray, least: float, i: int, sd: float) -> Profile:
    """Follow the least misfit from the best point to both sides, as far as the interval goes.

    Parameters
    ----------
    white : callable
    best : (n_parameters,) array
    least : float
        Misfit there.
    i : int
        Which coordinate.
    sd : float
        About its standard deviation, by which steps are chosen.
    """
    points, rises = [best], [0.0]
    ends, is_open = [], []
    for side in (-1.0, 1.0):
        here, step = best, 3.0 * sd / N_POINTS
        path = [(float(best[i]), 0.0, best)]
        bound = 0.0 if side < 0.0 else 1.0
        while path[-1][1] <= RISE and here[i] != bound and len(path) < 4 * N_POINTS:
            step *= 1.0 if len(path) < N_POINTS else 1.5
            start = here.copy()
            start[i] = np.clip(here[i] + side * step, 0.0, 1.0)
            here, misfit = best_point(white, start, i)
            path.append((float(here[i]), max(misfit - least, 0.0), here))
        points += [each[2] for each in path[1:]]
        rises += [each[1] for each in path[1:]]
        is_open.append(path[-1][1] < RISE)
        ends.append(path[-1][2] if is_open[-1] else _end(white, least, i, path))
    order = np.argsort([point[i] for point in points])
    return Profile(
        points=np.stack(points)[order],
        rises=np.array(rises)[order],
        ends=np.stack(ends),
        is_open=(is_open[0], is_open[1]),
    )


def _end(white: White, least: float, i: int, path: list[tuple[float, float, FloatArray]]) -> FloatArray:
    """Point where a profile has risen enough, between its last two."""
    (a, low, inside), (b, high, _) = path[-2:]
    for _ in range(4):
        # The rise is nearly a square, so its root is nearly straight.
        at = a + (b - a) * (np.sqrt(RISE) - np.sqrt(low)) / (np.sqrt(high) - np.sqrt(low))
        start = inside.copy()
        start[i] = at
        found, misfit = best_point(white, start, i)
        rise = max(misfit - least, 0.0)
        if abs(rise - RISE) < 1e-3:
            break
        if rise < RISE:
            a, low, inside = at, rise, found
        else:
            b, high = at, rise
    return found


def refitted(white: White, solved: White, points: FloatArray, fixed: Sequence[int | None]) -> FloatArray:
    """Least misfits (n,) of the real solver near points of the emulator, with one coordinate of each held.

    One Gauss-Newton step from each, with the slopes of the emulator.

    Parameters
    ----------
    white, solved : callable
        Residuals by the emulator, and by the real solver: NaN where a simulation fails.
    points : (n, n_parameters) array
    fixed : sequence of int or None
    """
    residuals, moved = solved(points), points.copy()
    for point, residual, held in zip(moved, residuals, fixed, strict=True):
        free = np.flatnonzero(np.arange(point.size) != (-1 if held is None else held))
        if free.size and np.isfinite(residual).all():
            bounds = (-point[free] - 1e-9, 1.0 - point[free] + 1e-9)
            step = lsq_linear(slopes_of(white, point)[:, free], -residual, bounds=bounds).x
            point[free] = np.clip(point[free] + step, 0.0, 1.0)
    both = np.stack([(each**2).sum(axis=1) for each in (residuals, solved(moved))])
    least: FloatArray = np.fmin(*both)
    return least
