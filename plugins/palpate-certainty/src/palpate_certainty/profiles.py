"""Profiles: the least misfit along each parameter, and in the planes of two, the others fitted again."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import polars as pl
import scipy

from palpate.api import BoolArray, Design, FloatArray, ParameterName, Simulation
from palpate.api.fit import RISE, channel_of, linear_least
from palpate_certainty.bounded import Residuals, least_near, slopes_at
from palpate_certainty.declared import DECLARED
from palpate_certainty.emulated_curves import (
    EmulatedCurves,
    EmulatedProblem,
    SimulatedCurves,
    runs_of_fits,
    runs_of_sets,
)
from palpate_certainty.tables import Assessed

N_POINTS = 9
"""Points of a profile to either side of the least."""


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
        Whether an end is at the bound, where the rise is too small for an end.
    """

    points: FloatArray
    rises: FloatArray
    ends: FloatArray
    is_open: tuple[bool, bool]


def profile(white: Residuals, best: FloatArray, least: float, i: int, sd: float) -> Profile:
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
            here, misfit = least_near(white, start, np.arange(best.size) != i)
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


def _end(white: Residuals, least: float, i: int, path: list[tuple[float, float, FloatArray]]) -> FloatArray:
    """Point where a profile has risen enough, between its last two."""
    (a, low, inside), (b, high, _) = path[-2:]
    for _ in range(4):
        # The rise is nearly a square, so its root is nearly straight.
        at = a + (b - a) * (np.sqrt(RISE) - np.sqrt(low)) / (np.sqrt(high) - np.sqrt(low))
        start = inside.copy()
        start[i] = at
        found, misfit = least_near(white, start, np.arange(start.size) != i)
        rise = max(misfit - least, 0.0)
        if abs(rise - RISE) < 1e-3:
            break
        if rise < RISE:
            a, low, inside = at, rise, found
        else:
            b, high = at, rise
    return found


def refitted(
    white: Residuals, solved: Residuals, points: FloatArray, fixed: Sequence[int | None]
) -> FloatArray:
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
        free = np.arange(point.size) != (-1 if held is None else held)
        if np.isfinite(residual).all():
            slopes = slopes_at(white, point[None], white(point[None]), free)[0]
            point[free] += linear_least(slopes, -residual, -point[free], 1.0 - point[free])
    both = np.stack([(each**2).sum(axis=1) for each in (residuals, solved(moved))])
    return np.fmin(*both)


N_EVEN = 13
"""Points along an axis, evenly over the range."""

NEAR_SDS = np.array([0.25, 0.5, 1.0, 2.0, 4.0])
"""Further points to both sides of the fit, in standard deviations: a series, as the levels of Fopt are."""

KNOWN = 0.25
"""Largest part of Fopt that what the emulator does not know may be of it."""

CHUNK = 128
"""Points that are fitted at once."""


def least_fopt(density: EmulatedProblem, points: FloatArray, free: BoolArray) -> FloatArray:
    """Least Fopt (n,) over the coordinates ``free``, near points of the box; NaN where little is known."""
    box, found = density.problem.box, []

    def residuals(at: FloatArray) -> FloatArray:
        return density.residuals(box.values(at))

    for start in range(0, len(points), CHUNK):
        at, fopt = fitted(residuals, _started(residuals, points[start : start + CHUNK], free), free)
        found.append(np.where(density.unknown(box.values(at)) <= KNOWN * fopt, fopt, np.nan))
    return np.concatenate(found)


def _started(residuals: Residuals, points: FloatArray, free: BoolArray) -> FloatArray:
    """The points, or others over the coordinates ``free`` where Fopt is less there."""
    if not free.any():
        return points
    tried = [points]
    for start in scipy.stats.qmc.Halton(int(free.sum()), rng=1).random(8):
        tried.append(points.copy())
        tried[-1][:, free] = start
    fopts = [(residuals(each) ** 2).sum(axis=1) for each in tried]
    return np.stack(tried)[np.argmin(fopts, axis=0), np.arange(len(points))]


def fitted(residuals: Residuals, points: FloatArray, free: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Points (n, n_parameters) of the box of the least Σ r², with all coordinates but ``free`` held.

    Levenberg-Marquardt steps from every point at once, without the coordinates at a bound that they would
    leave.

    Returns
    -------
    points : (n, n_parameters) array
    least : (n,) array
    """
    moving, here = np.flatnonzero(free), residuals(points)
    least, damping = (here**2).sum(axis=1), np.full(len(points), 1e-3)
    # Most steps of the fits of the others.
    for _ in range(20 if moving.size else 0):
        slopes = slopes_at(residuals, points, here, free)
        gradient = np.einsum("nm,nmi->ni", here, slopes)
        normal = np.einsum("nmi,nmj->nij", slopes, slopes)
        at = points[:, moving]
        stays = ((at <= 0.0) & (gradient > 0.0)) | ((at >= 1.0) & (gradient < 0.0))
        eye = np.eye(moving.size)
        size = np.maximum(np.einsum("nii->ni", normal), 1e-300)
        normal = normal + (damping[:, None] * size)[:, :, None] * eye
        either = stays[:, :, None] | stays[:, None, :]
        normal = np.where(either, size[:, :, None] * eye, normal)
        step = np.linalg.solve(normal, np.where(stays, 0.0, gradient)[:, :, None])[:, :, 0]
        moved = points.copy()
        moved[:, moving] = np.clip(at - step, 0.0, 1.0)
        there = residuals(moved)
        fopt = (there**2).sum(axis=1)
        # Gain of a step, over Fopt, from which there is another one.
        better, goes_on = fopt < least, (fopt < (1.0 - 1e-3) * least) | (fopt > least)
        points, here = np.where(better[:, None], moved, points), np.where(better[:, None], there, here)
        least, damping = np.where(better, fopt, least), damping * np.where(better, 0.1, 10.0)
        if not goes_on.any():
            break
    return points, least


def planes_of_fits(
    assessed: Sequence[Assessed], design: Design, swept: Sequence[Simulation], *, main: str
) -> pl.DataFrame:
    """Fopt of the joint fits, by an emulator of what the fits and the sweep have simulated.

    Parameters
    ----------
    assessed : sequence of Assessed
    design : Design
        Of the sweep; may be empty.
    swept : sequence of Simulation
        Of its sets.
    main : str
        Scenario that generalises.
    """
    first = next((each for each in assessed if each.case.scenario.name == main), None)
    if first is None:
        return DECLARED["contours"]["profile_planes"].empty()
    joint = [first, *(a for a in assessed if a is not first and a.case.label == first.case.label)]
    channels = {channel_of(name) for a in joint for t in a.end.problem.terms for name in t.weights}
    simulated = SimulatedCurves(first.end.problem, sorted(channels))
    runs, others = runs_of_fits(simulated, [a.case for a in joint]), runs_of_sets(simulated, design, swept)
    curves = EmulatedCurves(simulated, runs if others is None else runs.and_others(others))
    return profile_planes(joint, curves)


def profile_planes(joint: Sequence[Assessed], curves: EmulatedCurves) -> pl.DataFrame:
    """Table ``profile_planes`` of joint fits."""
    return DECLARED["contours"]["profile_planes"].frame(
        [row for each in joint for row in _rows(each, curves)]
    )


def _rows(each: Assessed, curves: EmulatedCurves) -> Iterator[dict[str, Any]]:
    assert each.end.best is not None
    box, best = each.end.problem.box, each.end.best
    density = EmulatedProblem(each.end.problem, curves.simulated, box.values(best.point), emulated=curves)
    sds = each.laplace.sd * (box.upper - box.lower) / box.rates(best.point)
    shared = [i for i, name in enumerate(box.names) if not ParameterName.parse(name).spot]
    # No more planes of one scenario than 15.
    for held in [*combinations(shared, 2)][:15] + [(i,) for i in shared]:
        axes = [_along(float(best.point[i]), float(sds[i])) for i in held]
        points = np.tile(best.point, (int(np.prod([axis.size for axis in axes])), 1))
        points[:, held] = np.stack([part.ravel() for part in np.meshgrid(*axes, indexing="ij")], axis=1)
        fopts = least_fopt(density, points, ~np.isin(np.arange(best.point.size), held))
        names = {"parameter": box.names[held[0]], "other": box.names[held[1]] if len(held) > 1 else None}
        for values, fopt in zip(box.values(points)[:, held].tolist(), fopts.tolist(), strict=True):
            other = values[1] if len(held) > 1 else None
            known = fopt if np.isfinite(fopt) else None
            yield each.about | names | {"value": values[0], "other_value": other, "fopt": known}


def _along(best: float, sd: float) -> FloatArray:
    """Coordinates over the range, closer to each other near the fit."""
    near = np.clip(best + sd * np.concatenate([-NEAR_SDS, [0.0], NEAR_SDS]), 0.0, 1.0)
    return np.unique(np.round([*np.linspace(0.0, 1.0, N_EVEN), *near], 9))
