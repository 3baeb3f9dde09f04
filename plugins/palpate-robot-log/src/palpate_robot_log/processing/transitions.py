"""Instants at which a motion starts, ends or turns, from least squares on both sides.

Near the end t* of a stroke a position is  x(t) = c + Σ aₖ τᵏ,  τ = max(t* - t, 0), with
k = p … p + 2: p = 1 is a stop at full speed, p = 2 a constant deceleration or a cosine,
p = 3 a minimum-jerk profile; or with a short constant deceleration after another motion,
as robots with trapezoidal speed profiles move. At a turn both sides move, each with its
own coefficients.

Of two descriptions the smoother one is kept unless the other explains the data
significantly better, since a free kink imitates a smooth end at another instant.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.processing.change_point import COARSE, Design, Fit, profile
from palpate_robot_log.processing.noise import noise_std
from palpate_robot_log.processing.thinning import block_means

_Again = Callable[[FloatArray, FloatArray, tuple[float, float]], Fit]

MAX_ROWS = 300
"""Rows that a fit needs at most; more are averaged in blocks."""

SIGNIFICANT = 12.0
"""Drop of χ² that makes a less smooth description the better one."""

_SHARES = (0.5, 0.35, 0.25, 0.15)
"""Windows, as shares of the stroke, from which the end of the stroke is read."""

_SPARE = 0.15
"""Share of the stroke by which the earliest instant that is tried precedes the likely one."""

_NO_WORSE = 1.25
"""Residual variance of a longer window over that of a shorter one, from which it misses something."""

_FINEST = 1e-5
"""Share of a motion below which no description needs to explain it."""

_N_FREE = 5
"""Unknowns of an end: its instant, the rest's value, and three of the motion before."""

_FEWEST = 12
"""Rows below which no kink can be found."""


class TooFewRowsError(ValueError):
    """A start or stop of a motion has too few rows around it to be timed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transition:
    """An instant, its standard deviation, and how it came about.

    ``cut`` is where the log itself begins or ends; it has no uncertainty of its own.
    """

    time_s: float
    std_s: float
    kind: Literal["kink", "smooth", "cut", "crossing"]


def stroke_end(
    time_s: FloatArray, values: FloatArray, between_s: tuple[float, float], moving_s: float
) -> Transition:
    """When a motion comes to rest.

    The longest of a few windows is used in which the description leaves no more than noise, or
    no more than in shorter ones.

    Parameters
    ----------
    time_s, values : (n,) array
        The last half of the stroke and the rest after it.
    between_s : tuple of float
        Where the instant is.
    moving_s : float
        How long the whole stroke takes.

    Raises
    ------
    TooFewRowsError
        No window has more rows than there are unknowns.
    """
    tried: list[Fit] = []
    for share in _SHARES:
        first = int(np.searchsorted(time_s, between_s[0] + (_SPARE - share) * moving_s))
        time, value = _averaged(time_s[first:], values[first:])
        if value.size <= _N_FREE:
            break
        tried.append(_ending(time, value, between_s, moving_s * share))
        if _explains(tried[-1].squares, value):
            break
    if not tried:
        raise TooFewRowsError
    allowed = max(_NO_WORSE * min(_variance(fit) for fit in tried), (_FINEST * float(np.ptp(values))) ** 2)
    chosen = next(fit for fit in tried if _variance(fit) <= allowed)

    def again(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> Fit:
        return _ending(time, value, between_s, float(chosen.at - time[0]))

    return _as_transition(_sharpened(chosen, time_s, values, again))


def _variance(fit: Fit) -> float:
    return fit.squares / max(fit.n_rows - _N_FREE, 1)


def _as_transition(fit: Fit) -> Transition:
    return Transition(time_s=fit.at, std_s=fit.std, kind=fit.kind)


def _ending(time: FloatArray, value: FloatArray, between_s: tuple[float, float], moving_s: float) -> Fit:
    fits = [profile(time, value, between_s, _stopping(order)) for order in (3, 2)]
    fits.append(_braking(time, value, between_s, moving_s))
    fits.append(replace(profile(time, value, between_s, _stopping(1)), kind="kink"))
    return _smoothest(fits, value, _N_FREE)


def _sharpened(fit: Fit, time_s: FloatArray, values: FloatArray, again: _Again) -> Fit:
    """A sharp place sought again among single rows: averages round a kink off.

    Where noise leaves the place less certain than an average is long, there is nothing to gain.
    """
    block_s = float(np.ptp(time_s)) / MAX_ROWS
    if fit.kind == "smooth" or time_s.size <= MAX_ROWS or fit.std > block_s:
        return fit
    middle = int(np.searchsorted(time_s, fit.at))
    near = slice(max(middle - MAX_ROWS // 2, 0), middle + MAX_ROWS // 2)
    time, value = time_s[near], values[near]
    between_s = (fit.at - 3.0 * block_s, fit.at + 3.0 * block_s)
    if time.size < _FEWEST or not time[0] < between_s[0] < between_s[1] < time[-1]:
        return fit
    found = again(time, value, between_s)
    return found if abs(found.at - fit.at) < 2.9 * block_s else fit


def turning(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float]) -> Transition:
    """When a motion changes direction, without a rest in between.

    Parameters are those of :func:`stroke_end`.
    """
    return _as_transition(_found(time_s, values, between_s, _turned))


def is_turning(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float]) -> bool:
    """Whether a turn without a rest describes a motion to within its noise.

    Parameters are those of :func:`stroke_end`.
    """
    time, value = _averaged(time_s, values)
    noise = max(noise_std(value), _FINEST * float(np.ptp(value)))
    fit = _turned(time, value, between_s)
    return fit.squares / max(fit.n_rows - 8, 1) <= _NO_WORSE * noise**2


def speed_change(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float]) -> Transition | None:
    """When a motion changes its speed at once, None where it is smooth.

    Parameters are those of :func:`stroke_end`.
    """
    if time_s.size < _FEWEST:
        return None
    found = _found(time_s, values, between_s, _bent)
    return _as_transition(found) if found.kind == "kink" else None


def _found(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float], seek: _Again) -> Fit:
    return _sharpened(seek(*_averaged(time_s, values), between_s), time_s, values, seek)


def _turned(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> Fit:
    """A turn: one polynomial, both sides slowing down to rest and going on, or a kink."""
    fits = [_vertex(time, value, between_s)]
    fits += [profile(time, value, between_s, _two_sided(order)) for order in (3, 2)]
    fits.append(replace(profile(time, value, between_s, _two_sided(1)), kind="kink"))
    return _smoothest(fits, value, 8)


def _bent(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> Fit:
    """A change of speed: none in one polynomial, or a kink."""
    kink = replace(profile(time, value, between_s, _two_sided(1)), kind="kink")
    return _smoothest([_vertex(time, value, between_s), kink], value, 8)


def _smoothest(fits: list[Fit], value: FloatArray, parameters: int) -> Fit:
    """First fit, from smooth to sharp, that none of the others betters significantly."""
    least = _FINEST * float(np.ptp(value))
    best = min(fits, key=lambda fit: fit.squares)
    variance = max(best.squares / max(best.n_rows - parameters, 1), least**2)
    return next(fit for fit in fits if fit.squares <= best.squares + SIGNIFICANT * variance)


def _explains(squares: float, value: FloatArray) -> bool:
    """Whether residuals are no larger than the noise that second differences show."""
    bends = np.diff(value, 2)
    noise = max(float(bends @ bends) / (6.0 * bends.size), (_FINEST * float(np.ptp(value))) ** 2)
    n_free = value.size - _N_FREE
    return bool(squares / n_free <= noise * (1.0 + 4.0 * np.sqrt(2.0 / n_free)))


def _stopping(order: int) -> Design:
    def design(time: FloatArray, at: FloatArray) -> FloatArray:
        tau = np.maximum(at[:, None] - time, 0.0)
        columns = [np.ones_like(tau), *(tau**k for k in range(order, order + 3))]
        return np.stack(columns, axis=-1)

    return design


def _braking(time: FloatArray, value: FloatArray, between_s: tuple[float, float], moving_s: float) -> Fit:
    """Stop after a constant deceleration whose length is sought too."""

    def braked(brake_s: float) -> Design:
        return _braked(brake_s / (float(np.ptp(time)) or 1.0))

    def squares(brake_s: float) -> float:
        return profile(time, value, between_s, braked(brake_s), COARSE).squares

    tried = {length: squares(length) for length in map(float, moving_s * np.geomspace(0.008, 0.8, 9))}
    best = min(tried, key=tried.__getitem__)
    for ratio in (1.3, 1.12):
        tried |= {length: squares(length) for length in (best / ratio, best * ratio)}
        best = min(tried, key=tried.__getitem__)
    row_s = float(np.ptp(time)) / max(time.size - 1, 1)
    kind: Literal["kink", "smooth"] = "kink" if best < 8.0 * row_s else "smooth"
    return replace(profile(time, value, between_s, braked(best)), kind=kind)


def _braked(brake: float) -> Design:
    def design(time: FloatArray, at: FloatArray) -> FloatArray:
        tau = np.maximum(at[:, None] - time, 0.0)
        beyond = np.maximum(tau - brake, 0.0)
        # A parabola that goes on as its tangent, and a change of speed before the braking.
        return np.stack([np.ones_like(tau), tau**2 - beyond**2, beyond**2, beyond**3], axis=-1)

    return design


def _two_sided(order: int) -> Design:
    def design(time: FloatArray, at: FloatArray) -> FloatArray:
        sides = (np.maximum(at[:, None] - time, 0.0), np.maximum(time - at[:, None], 0.0))
        powers = [side**k for side in sides for k in range(order, order + 3)]
        return np.stack([np.ones_like(sides[0]), *powers], axis=-1)

    return design


def _vertex(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> Fit:
    """Extremum of one polynomial through all rows."""
    middle, scale = float(time.mean()), float(np.ptp(time)) / 2.0 or 1.0
    x = (time - middle) / scale
    basis = np.polynomial.legendre.legvander(x, 6)
    coefficients, *_ = np.linalg.lstsq(basis, value, rcond=None)
    misfit = value - basis @ coefficients
    squares = float(misfit @ misfit)
    low, high = ((t - middle) / scale for t in between_s)
    grid = np.linspace(low, high, 2001)
    slope = np.polynomial.legendre.legval(grid, np.polynomial.legendre.legder(coefficients))
    bend = np.polynomial.legendre.legval(grid, np.polynomial.legendre.legder(coefficients, 2))
    index = int(np.argmin(np.abs(slope)))
    noise = np.sqrt(squares / max(x.size - 7, 1) / x.size)
    # The slope of a fit of degree 6 is some six times less certain than its value.
    std = scale * 6.0 * noise / max(abs(float(bend[index])), 1e-300)
    return Fit(
        at=middle + scale * float(grid[index]),
        std=min(float(std), 2.0 * scale),
        squares=squares,
        n_rows=x.size,
    )


def _averaged(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    block = -(-time_s.size // MAX_ROWS)
    return block_means(time_s, block), block_means(values, block)
