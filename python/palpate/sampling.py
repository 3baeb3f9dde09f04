"""One design for all spots: points of the unit cube, put into the ranges and filtered."""

from collections.abc import Sequence

import numpy as np

from palpate.domain import BoolArray, Design, FloatArray, ParameterSpace
from palpate.errors import SamplingError
from palpate.interfaces import Sampler, SetFilter
from palpate.plugins import answering_for


def draw_design(
    space: ParameterSpace,
    sampler: Sampler,
    n_sets: int,
    seed: int,
    filters: Sequence[SetFilter] = (),
) -> Design:
    """Draw ``n_sets`` parameter sets and keep those that every filter accepts.

    Parameters
    ----------
    space : ParameterSpace
    sampler : Sampler
    n_sets : int
        Sets to draw; filters leave fewer.
    seed : int
    filters : sequence of SetFilter
        Applied in order, each to what the ones before it kept.

    Raises
    ------
    SamplingError
        Nothing is searched, the sampler leaves the unit cube, or no set is kept.
    """
    parameters = space.parameters
    if not parameters:
        raise SamplingError("design: every parameter is fixed; give at least one a range to search")
    values = _in_ranges(space, _unit_points(sampler, n_sets, len(parameters), seed))
    for keep in filters:
        accepted = _accepted(keep, space, values)
        if not accepted.any():
            raise SamplingError(
                f"design: filter '{keep.name}' rejects all {len(values)} sets; widen or move the ranges of "
                f"{', '.join(p.name for p in parameters)}, draw more sets, or drop the filter"
            )
        values = values[accepted]
    return Design(parameters=parameters, values=values, seed=seed, n_drawn=n_sets)


def _unit_points(sampler: Sampler, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
    if n_sets < 1:
        raise SamplingError(f"design: {n_sets} sets asked for; ask for at least 1")
    with answering_for(sampler, "drawing the design"):
        points = np.asarray(sampler.draw(n_sets, n_parameters, seed), dtype=np.float64)
    if points.shape != (n_sets, n_parameters) or not ((points >= 0.0) & (points <= 1.0)).all():
        raise SamplingError(
            f"design: sampler '{sampler.name}' returned points of shape {points.shape} in "
            f"[{points.min(initial=np.inf)}, {points.max(initial=-np.inf)}]; it must return "
            f"({n_sets}, {n_parameters}) numbers in the unit cube"
        )
    return points


def _in_ranges(space: ParameterSpace, points: FloatArray) -> FloatArray:
    lower = np.array([p.lower for p in space.parameters])
    upper = np.array([p.upper for p in space.parameters])
    # Rounding may carry lower + (upper - lower) past upper.
    values: FloatArray = np.clip(lower + points * (upper - lower), lower, upper)
    return values


def _accepted(keep: SetFilter, space: ParameterSpace, values: FloatArray) -> BoolArray:
    with answering_for(keep, "filtering the design"):
        accepted = np.asarray(keep.accept(space, values))
    if accepted.shape != (len(values),) or accepted.dtype != np.bool_:
        raise SamplingError(
            f"design: filter '{keep.name}' returned {accepted.dtype} of shape {accepted.shape}; "
            f"it must return ({len(values)},) booleans"
        )
    return accepted
