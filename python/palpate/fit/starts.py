"""Starts of searches: in the basins of the sweep, or in the middle of the ranges."""

import numpy as np
import polars as pl
import scipy

from palpate.domain import Design, FloatArray, ParameterName, channel_of
from palpate.fit.box import Box, on_grid
from palpate.fit.problem import Problem
from palpate.fit.spot_term import pieces
from palpate.plugins.search import Trial

WORST = 10.0
"""Fopt of a basin, over that of the best one, beyond which no search starts there."""


def basins(design: Design, fopt: pl.DataFrame, most: int) -> list[dict[str, float]]:
    """Sets of a sweep that fit better than every set near them, the best first.

    Parameters
    ----------
    fopt : DataFrame
        Columns set_id and fopt.

    Returns
    -------
    list of mapping of full parameter name to value
    """
    if fopt.is_empty():
        return []
    ranked = fopt.sort("fopt", "set_id")
    sets, values = ranked["set_id"].to_numpy(), ranked["fopt"].to_numpy()
    box = Box(design.parameters)
    points = np.stack([box.point(design.values[i]) for i in sets])
    n_near = 2 * len(design.parameters)
    chosen = []
    for i, point in enumerate(points):
        near = np.argsort(np.linalg.norm(points - point, axis=1), kind="stable")[1 : n_near + 1]
        # Sets are in order of Fopt, so a better one has a lower number.
        if not (near < i).any() and values[i] <= WORST * values[0]:
            chosen.append(dict(zip(box.names, design.values[sets[i]].tolist(), strict=True)))
    return chosen[:most]


def accepted_start(problem: Problem, start: FloatArray) -> FloatArray:
    """Move a start that a filter refuses into the middle of what the filters accept.

    That is the accepted point nearest to the mean of all accepted ones, among points that cover the
    ranges of the materials' parameters. What else is searched stays where it is.
    """
    if problem.accepts(start[None])[0]:
        return start
    of_materials = {p.name for p in problem.study.space.parameters}
    moved = np.array([ParameterName.parse(name).shared in of_materials for name in problem.names])
    points = np.tile(start, (1024, 1))
    points[:, moved] = scipy.stats.qmc.Sobol(int(moved.sum()), scramble=False).random(1024)
    accepted = points[problem.accepts(points)]
    if not len(accepted):
        return start
    return accepted[np.argmin(np.linalg.norm(accepted - accepted.mean(axis=0), axis=1))]


def scaled_start(problem: Problem, start: FloatArray) -> FloatArray:
    """Multiply all moduli so that the curves at a start fit best: they are in proportion to them.

    Channels of degree 0 do not count. Where a modulus is fixed or a bound in the way, the start is only
    nearer to the measured curves. It stays as it is where the scaled one cannot be simulated, or a filter
    refuses it.
    """
    start = accepted_start(problem, start)
    (found,) = problem.evaluate([Trial(point=start)])
    if found.residuals is None:
        return start
    at_zero = problem.residuals_of_nothing()
    simulated = found.residuals - at_zero
    for _, name, at, _ in pieces(problem.terms):
        simulated[at] *= problem.study.degree(channel_of(name))
    size = float(simulated @ simulated)
    scale = -float(simulated @ at_zero) / size if size > 0.0 else 1.0
    if not scale > 0.0:
        return start
    is_modulus = np.array([p.kind == "modulus" for p in problem.parameters])
    values = problem.box.values(start)
    accuracy = problem.study.solver.provides.accuracy
    scaled = on_grid(problem.box.point(np.where(is_modulus, scale * values, values)), accuracy)
    # As a search asks for it, so that it costs nothing more.
    (found,) = problem.evaluate([Trial(point=scaled, slopes=problem.study.solver.provides.slopes)])
    return start if found.residuals is None else scaled
