"""Repeated presses of one spot: their mean along the path, and their spread."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from palpate import _core
from palpate.domain import Curve, FloatArray
from palpate.errors import CurveError

POOLED_SHARE = 0.1
"""Share of a branch over which the variance between presses is averaged.

A few presses give a poor estimate of the variance at one point: it would be zero where
two of them cross.
"""


def average(repeats: Mapping[str, Curve]) -> Curve:
    """Mean of repeated presses of one channel, by file name, at equal abscissae, branch by branch.

    The mean runs along the abscissae of the first press, from turning point to turning
    point as far as every press has come. Its ``std`` is that between presses,
    √(Σ(y − ȳ)²/(n − 1)), with the variance averaged over ``POOLED_SHARE`` of a branch;
    if every press has a standard deviation, it is no less than their
    root mean square. Times are averaged too, if every press has them. A single press is returned as it is.

    A CurveError names the file whose path turns otherwise than the path of the first file.
    """
    (first_file, first), *others = repeats.items()
    if not others:
        return first
    for file, curve in others:
        if _directions(curve) != _directions(first):
            raise CurveError(
                f"{file}: channel '{curve.channel}' turns {len(curve.branches) - 1} times and starts "
                f"{_way(curve)}, where the first press {first_file} turns {len(first.branches) - 1} times "
                f"and starts {_way(first)}; presses of one spot follow one path; list the other as a "
                "separate spot"
            )
    curves = list(repeats.values())
    abscissa = _common(curves)
    ordinates = np.stack([_at(curve, curve.ordinate, abscissa) for curve in curves])
    std = _between(ordinates, abscissa)
    if all(curve.std is not None for curve in curves):
        own = np.stack([_at(c, c.std, abscissa) for c in curves if c.std is not None])
        std = np.maximum(std, np.sqrt(np.mean(own**2, axis=0)))
    times = [_at(curve, curve.time_s, abscissa) for curve in curves if curve.time_s is not None]
    return Curve(
        channel=first.channel,
        abscissa=abscissa,
        ordinate=ordinates.mean(axis=0),
        std=std,
        time_s=np.maximum.accumulate(np.mean(times, axis=0)) if len(times) == len(curves) else None,
    )


def described(mean: Curve, repeats: Mapping[str, Curve]) -> dict[str, Any]:
    """Record of the :func:`average` of ``repeats``.

    It has ``n_presses``, ``largest_std`` in the unit of the ordinate, and ``nmse_from_mean`` by file, with
    the mean of |ordinate| as the normaliser.
    """
    assert mean.std is not None, "the mean of several presses has a standard deviation"
    apart = {file: _at(curve, curve.ordinate, mean.abscissa) for file, curve in repeats.items()}
    scale = float(np.abs(mean.ordinate).mean()) or 1.0
    return {
        "n_presses": len(repeats),
        "largest_std": float(mean.std.max()),
        "nmse_from_mean": {
            file: float(np.mean((values - mean.ordinate) ** 2)) / scale**2 for file, values in apart.items()
        },
    }


def _directions(curve: Curve) -> list[bool]:
    x = curve.abscissa
    return [bool(x[stop - 1] > x[start]) for start, stop in curve.branches]


def _way(curve: Curve) -> str:
    return "upwards" if _directions(curve)[0] else "downwards"


def _common(curves: Sequence[Curve]) -> FloatArray:
    """Abscissae of the first curve, between turning points that every curve has reached."""
    first, rises = curves[0], _directions(curves[0])
    # The turning points are the least of the maxima and the largest of the minima.
    starts = [max if rise else min for rise in rises]
    ends = [min if rise else max for rise in rises]
    turns = [starts[0](float(c.abscissa[c.branches[0][0]]) for c in curves)]
    turns += [end(float(c.abscissa[c.branches[k][1] - 1]) for c in curves) for k, end in enumerate(ends)]
    parts = [np.array(turns[:1])]
    for k, (start, stop) in enumerate(first.branches):
        low, high = sorted(turns[k : k + 2])
        if (turns[k + 1] > turns[k]) != rises[k]:
            raise CurveError(
                f"channel '{first.channel}': the presses have no abscissa in common on branch {k + 1}; "
                "leave out the one that stops early"
            )
        inside = first.abscissa[start:stop]
        parts += [inside[(inside > low) & (inside < high)], np.array(turns[k + 1 : k + 2])]
    return np.concatenate(parts)


def _at(curve: Curve, values: FloatArray, abscissa: FloatArray) -> FloatArray:
    found, _ = _core.interpolate(curve.abscissa, np.ascontiguousarray(values), abscissa)
    return found


def _between(ordinates: FloatArray, abscissa: FloatArray) -> FloatArray:
    """Standard deviation between presses (n_presses, n) at each abscissa: (n,)."""
    variance = ordinates.var(axis=0, ddof=1)
    pooled = np.empty_like(variance)
    for start, stop in _core.branches(abscissa):
        reach = int(POOLED_SHARE * (stop - start) / 2.0)
        # Sums of non-negative terms never decrease, so no difference is below zero.
        total = np.concatenate([[0.0], np.cumsum(variance[start:stop])])
        place = np.arange(stop - start)
        low, high = np.maximum(place - reach, 0), np.minimum(place + reach + 1, stop - start)
        pooled[start:stop] = (total[high] - total[low]) / (high - low)
    return np.sqrt(pooled)
