"""One design for all spots: points of the unit cube, scaled to the ranges and filtered.

The number of points is doubled until enough sets pass the filters. Accepted sets stay the same;
the first sets that pass are the design.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from fractions import Fraction
from math import ceil

import numpy as np

from palpate import _core
from palpate.domain import BoolArray, Design, FloatArray, Parameter, ParameterSpace
from palpate.errors import SamplingError
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import Sampler, SetFilter
from palpate.progress import FIRST_LOOK

DRAWS_EACH = 64
"""Default of the most sets drawn for each accepted one."""

NO_ROW = -1
"""The ``set_id`` of a set that is no row of the design, such as a step of a local search.

So what a solver stores under a ``set_id`` stays that of the design's row.
"""


def draw_design(
    space: ParameterSpace,
    sampler: Sampler,
    n_sets: int,
    seed: int,
    filters: Sequence[SetFilter] = (),
    *,
    max_draws: int = 0,
    n_total: int = 0,
    kept: FloatArray | None = None,
) -> Design:
    """Draw parameter sets and keep those that every filter accepts.

    Parameters
    ----------
    n_sets : int
        Accepted sets; 0 draws none, or just ``n_total``, of which the first ``FIRST_LOOK`` are one design.
    filters : sequence of SetFilter
        Applied in order, each to the sets that the filters before it kept.
    max_draws : int
        Most sets to draw for ``n_sets`` accepted ones, and in proportion for ``n_total``; 0 draws up to
        ``DRAWS_EACH`` for each. No more than ``n_sets`` draws once, and keeps the accepted ones.
    n_total : int
        Sets to which the design of ``n_sets`` is extended, or the first of it that are kept; 0: neither.
    kept : (n, n_parameters) array, optional
        Sets that the design begins with, as :func:`kept_sets` returns them; only the rest is drawn.

    Raises
    ------
    SamplingError
        Nothing is searched, the sampler's points are invalid, or too few sets are accepted.
    """
    parameters, n_wanted = space.parameters, n_total or n_sets
    if not parameters:
        raise SamplingError("design: every parameter is fixed; give at least one a range")
    first = np.empty((0, len(parameters)))
    if kept is not None and kept.size:
        first = kept[accepted_by_all(filters, space, kept)][:n_wanted]
    if len(first) == n_wanted:
        return Design(parameters=parameters, values=first, seed=seed, n_drawn=n_wanted, n_kept=n_wanted)
    points = _unit_points(sampler, n_sets or FIRST_LOOK, len(parameters), seed)
    draws_each = Fraction(max_draws, n_sets or n_total) if max_draws else DRAWS_EACH
    rest = _drawn(space, sampler, points, seed, filters, draws_each, n_wanted - len(first))
    values = np.concatenate([first, rest.values])
    return replace(rest, values=values, n_drawn=rest.n_drawn + len(first), n_kept=len(first))


def kept_sets(
    space: ParameterSpace, seed: int, earlier: Design, finished: Collection[int]
) -> FloatArray | None:
    """First sets of a design with these ranges, from an earlier design; None if there are none.

    If the ranges were narrowed, these are the finished sets inside: they are spread over the narrower
    ranges as evenly as over the wider ones. If the ranges are the same, they are the kept sets of the
    earlier design.

    Parameters
    ----------
    seed : int
        With another seed than the earlier one no sets are kept.
    finished : collection of int
        ``set_id`` of the sets whose simulations are finished.
    """
    now, before = space.parameters, earlier.parameters
    same_kind = [(p.name, p.unit, p.scale) for p in now] == [(p.name, p.unit, p.scale) for p in before]
    if not same_kind or earlier.seed != seed:
        return None
    lower, upper = (np.array([getattr(p, end) for p in now]) for end in ("lower", "upper"))
    wide_lower, wide_upper = (np.array([getattr(p, end) for p in before]) for end in ("lower", "upper"))
    if (lower == wide_lower).all() and (upper == wide_upper).all():
        return earlier.values[: earlier.n_kept]
    if (lower < wide_lower).any() or (upper > wide_upper).any():
        return None
    values = earlier.values[sorted(set(finished) & set(range(earlier.n_sets)))]
    return values[((lower <= values) & (values <= upper)).all(axis=1)]


def _drawn(
    space: ParameterSpace,
    sampler: Sampler,
    points: FloatArray,
    seed: int,
    filters: Sequence[SetFilter],
    draws_each: Fraction | int,
    n_wanted: int,
) -> Design:
    """Double the points until ``n_wanted`` of them pass the filters, or as many are drawn as may be."""
    most = ceil(draws_each * n_wanted)
    accepted = accepted_by_all(filters, space, _in_ranges(space, points[:most]))
    while accepted.sum() < n_wanted and len(points) < most:
        n_known = len(points)
        points = _extended(sampler, points, 2 * n_known, seed)
        new = accepted_by_all(filters, space, _in_ranges(space, points[n_known:most]))
        accepted = np.concatenate([accepted, new])
    kept, n_drawn = np.flatnonzero(accepted)[:n_wanted], len(accepted)
    if kept.size == n_wanted:
        n_drawn = int(kept[-1]) + 1
    elif not kept.size:
        raise _none(space, filters, _in_ranges(space, points[:most]))
    elif draws_each > 1:
        raise _too_few(space, filters, _in_ranges(space, points[:most]), kept.size, n_wanted)
    values = _in_ranges(space, points[kept])
    return Design(parameters=space.parameters, values=values, seed=seed, n_drawn=n_drawn)


def _none(space: ParameterSpace, filters: Sequence[SetFilter], values: FloatArray) -> SamplingError:
    """Error that names the filter that rejects every set that those before it accept."""
    left = [values[accepted_by_all(filters[:n], space, values)] for n in range(len(filters))]
    keep, sets = next(
        (keep, sets)
        for keep, sets in zip(filters, left, strict=True)
        if not _accepted(keep, space, sets).any()
    )
    return SamplingError(
        f"design: filter '{keep.name}' rejects all {len(sets)} sets{_why(keep, space, sets[0])}; widen or "
        f"move the ranges of {', '.join(p.name for p in space.parameters)}, raise "
        "sampling.max_draws, or drop the filter"
    )


def _why(keep: SetFilter, space: ParameterSpace, first: FloatArray) -> str:
    with answering_for(keep, "explaining why a set is dropped"):
        reason = keep.reason(space, first)
    return f" (the first: {reason})" if reason else ""


def _too_few(
    space: ParameterSpace, filters: Sequence[SetFilter], values: FloatArray, n_kept: int, n_sets: int
) -> SamplingError:
    dropped = [(keep, values[~_accepted(keep, space, values)]) for keep in filters]
    keep, sets = max(dropped, key=lambda each: len(each[1]))
    n_drawn = len(values)
    return SamplingError(
        f"design: only {n_kept} of {n_drawn} sets ({100.0 * n_kept / n_drawn:.2g} %) pass "
        f"{', '.join(repr(keep.name) for keep in filters)}, but {n_sets} are requested; '{keep.name}' "
        f"rejects {len(sets)}{_why(keep, space, sets[0])}; narrow or move the ranges of "
        f"{', '.join(p.name for p in space.parameters)}, ask for fewer sets, or set "
        f"sampling.max_draws to {2 * n_drawn} or more"
    )


def _unit_points(sampler: Sampler, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
    if n_sets < 1:
        raise SamplingError(f"design: {n_sets} sets requested; request at least 1")
    with answering_for(sampler, "drawing the design"):
        points = np.asarray(sampler.draw(n_sets, n_parameters, seed), dtype=np.float64)
    return _in_cube(sampler, points, (n_sets, n_parameters))


def _extended(sampler: Sampler, points: FloatArray, n_total: int, seed: int) -> FloatArray:
    with answering_for(sampler, "extending the design"):
        extended = np.asarray(sampler.extend(points, n_total, seed), dtype=np.float64)
    extended = _in_cube(sampler, extended, (n_total, points.shape[1]))
    if not np.array_equal(extended[: len(points)], points):
        raise SamplingError(
            f"design: sampler '{sampler.name}' changed points that it had to extend; its extend must "
            f"return the {len(points)} points it was given, and new ones after them"
        )
    return extended


def _in_cube(sampler: Sampler, points: FloatArray, shape: tuple[int, int]) -> FloatArray:
    if points.shape != shape or not ((points >= 0.0) & (points <= 1.0)).all():
        raise SamplingError(
            f"design: sampler '{sampler.name}' returned points of shape {points.shape} in "
            f"[{points.min(initial=np.inf)}, {points.max(initial=-np.inf)}]; it must return "
            f"{shape} numbers in the unit cube"
        )
    return points


def _in_ranges(space: ParameterSpace, points: FloatArray) -> FloatArray:
    columns = [_in_range(p, points[:, column]) for column, p in enumerate(space.parameters)]
    return np.stack(columns, axis=1)


def _in_range(parameter: Parameter, shares: FloatArray) -> FloatArray:
    lower, upper = parameter.lower, parameter.upper
    if parameter.scale == "log":
        return _core.geometric(shares, lower, upper)
    # By rounding, lower + (upper - lower) may exceed upper.
    return np.clip(lower + shares * (upper - lower), lower, upper)


def accepted_by_all(filters: Sequence[SetFilter], space: ParameterSpace, values: FloatArray) -> BoolArray:
    """Whether each of the sets (n_sets, n_parameters) passes every filter: (n_sets,)."""
    accepted = np.ones(len(values), dtype=bool)
    for keep in filters:
        still = np.flatnonzero(accepted)
        if still.size:
            accepted[still] = _accepted(keep, space, values[still])
    return accepted


def _accepted(keep: SetFilter, space: ParameterSpace, values: FloatArray) -> BoolArray:
    with answering_for(keep, "filtering the design"):
        accepted = np.asarray(keep.accept(space, values))
    if accepted.shape != (len(values),) or accepted.dtype != np.bool_:
        raise SamplingError(
            f"design: filter '{keep.name}' returned {accepted.dtype} of shape {accepted.shape}; "
            f"it must return ({len(values)},) booleans"
        )
    return accepted
