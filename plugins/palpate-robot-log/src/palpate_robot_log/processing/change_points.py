"""Places where a signal changes: least squares over everything but the place itself.

For each candidate place a description is linear in its coefficients; the place kept is the one
with the least squared residual, found on grids that close in on it. Its standard deviation is from
the linearised problem, with the noise that the residual shows.

Near the end t* of a stroke a position is  x(t) = c + Σ aₖ τᵏ,  τ = max(t* - t, 0), with
k = p … p + 2: p = 1 is a stop at full speed, p = 2 a constant deceleration or a cosine,
p = 3 a minimum-jerk profile; or with a short constant deceleration after another motion,
as robots with trapezoidal speed profiles move. At a turn both sides move, each with its
own coefficients.

Of two descriptions the smoother one is kept unless the other explains the data
significantly better, since a free kink imitates a smooth end at another instant.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.api import FloatArray
from palpate_robot_log.recording import block_means, noise_std

# Columns (m, n, k) of a description at n abscissae for m candidate places.
Design = Callable[[FloatArray, FloatArray], FloatArray]
_Seek = Callable[[FloatArray, FloatArray, tuple[float, float]], "ChangePoint"]

FINE = (31, 9, 9, 9)  # places on each grid, from the whole interval to the last step
COARSE = (31, 9, 5)  # enough to compare descriptions
MAX_ROWS = 300  # rows that a fit needs at most; more are averaged in blocks
SIGNIFICANT = 12.0  # drop of χ² that makes a less smooth description the better one
_NO_WORSE = 1.25  # ratio of residual variances from which the longer window misses something
_N_FREE = 5  # unknowns of an end: its instant, the rest's value, and three of the motion before
_N_FREE_OF_TURN = 8
_FEWEST = 12  # rows below which no kink can be found


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

    def mirrored(self) -> "Transition":
        """The same instant of the signal that runs backwards."""
        return replace(self, time_s=-self.time_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangePoint:
    """A place, its standard deviation and the squared residual there."""

    at: float
    std: float
    squares: float
    n_rows: int
    kind: Literal["kink", "smooth"] = "smooth"

    def variance(self, n_free: int) -> float:
        """Residual variance of a description with so many unknowns."""
        return self.squares / max(self.n_rows - n_free, 1)

    @property
    def transition(self) -> Transition:
        """The place as an instant."""
        return Transition(time_s=self.at, std_s=self.std, kind=self.kind)


def profile(
    abscissa: FloatArray,
    values: FloatArray,
    between: tuple[float, float],
    design: Design,
    zoom: Sequence[int] = FINE,
    rising: int | None = None,
) -> ChangePoint:
    """Place of the change of a signal (n,), sought in the interval ``between``.

    The design is called with the abscissae scaled to a range of length 1, and with candidate places on
    that scale; ``zoom`` are the numbers of places on the grids that close in. The coefficient with the number
    ``rising`` is not negative.
    """
    middle, scale = float(abscissa.mean()), float(np.ptp(abscissa)) or 1.0
    x, y = (abscissa - middle) / scale, values - values.mean()
    low, high = ((place - middle) / scale for place in between)
    best, coefficients, least = (low + high) / 2.0, np.empty(0), np.inf
    whole, at_whole = np.linspace(low, high, zoom[0]), np.empty(0)
    for n_places in zoom:
        grid = np.linspace(low, high, n_places)
        found, squares = _rising(design(x, grid), y, rising)
        at_whole = at_whole if at_whole.size else squares
        index = int(np.argmin(squares))
        best, coefficients, least = float(grid[index]), found[index], float(squares[index])
        step = (high - low) / (n_places - 1)
        low, high = max(low, best - step), min(high, best + step)
    # The part of ∂values/∂place that no coefficient imitates.
    step = 1e-4
    pair = design(x, np.array([best - step, best + step])) @ coefficients
    here = design(x, np.array([best]))
    if rising is not None and coefficients[rising] <= 0.0:
        here[:, :, rising] = 0.0
    left_over = float(_residuals(here, (pair[1] - pair[0]) / (2.0 * step))[1][0])
    variance = least / max(x.size - here.shape[2] - 1, 1)
    std = float(np.sqrt(variance / left_over)) if left_over > 0.0 else float(np.ptp(x))
    # Where coefficients nearly imitate the place, its misfit bounds it, and no derivative does.
    likely = whole[at_whole <= least + variance]
    std = min(std, float(np.abs(likely - best).max(initial=0.0) + whole[1] - whole[0]))
    return ChangePoint(at=middle + scale * best, std=scale * std, squares=least, n_rows=y.size)


def _rising(designs: FloatArray, y: FloatArray, rising: int | None) -> tuple[FloatArray, FloatArray]:
    """Coefficients and squared residuals as of :func:`_residuals`, a falling one left out."""
    found, squares = _residuals(designs, y)
    if rising is not None and (falls := found[:, rising] < 0.0).any():
        designs[falls, :, rising] = 0.0
        found[falls], squares[falls] = _residuals(designs[falls], y)
        found[falls, rising] = 0.0
    return found, squares


def _residuals(designs: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients (m, k) and squared residuals (m,) of designs (m, n, k)."""
    across = designs.swapaxes(1, 2)
    normal = across @ designs
    # A ridge far below the noise keeps a place at the interval's edge solvable.
    ridge = 1e-13 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(normal.shape[1])
    coefficients = np.linalg.solve(normal + ridge, across @ y[:, None])
    misfit = y[:, None] - designs @ coefficients
    return coefficients[..., 0], np.einsum("mni,mni->m", misfit, misfit)


def stroke_end(
    time_s: FloatArray, values: FloatArray, between_s: tuple[float, float], moving_s: float
) -> Transition:
    """Time when a motion comes to rest.

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
    tried: list[ChangePoint] = []
    for share in (0.5, 0.35, 0.25, 0.15):  # windows of a stroke from which its end is read
        # share of the stroke by which the earliest instant that is tried precedes the likely one
        first = int(np.searchsorted(time_s, between_s[0] + (0.15 - share) * moving_s))
        time, value = _averaged(time_s[first:], values[first:])
        n_free = value.size - _N_FREE
        if n_free <= 0:
            break
        tried.append(_ending(time, value, between_s, moving_s * share))
        # No more is left than the noise that second differences show.
        bends = np.diff(value, 2)
        noise = max(float(bends @ bends) / (6.0 * bends.size), _least(value) ** 2)
        if tried[-1].squares / n_free <= noise * (1.0 + 4.0 * np.sqrt(2.0 / n_free)):
            break
    if not tried:
        raise TooFewRowsError
    allowed = max(_NO_WORSE * min(fit.variance(_N_FREE) for fit in tried), _least(values) ** 2)
    chosen = next(fit for fit in tried if fit.variance(_N_FREE) <= allowed)

    def again(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> ChangePoint:
        return _ending(time, value, between_s, float(chosen.at - time[0]))

    return _sharpened(chosen, time_s, values, again).transition


def turning(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float]) -> Transition:
    """Time when a motion changes direction, without a rest in between.

    Parameters as in :func:`stroke_end`.
    """
    return _found(time_s, values, between_s, _turned).transition


def is_turning(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float]) -> bool:
    """Whether a turn without a rest describes a motion to within its noise.

    Parameters as in :func:`stroke_end`.
    """
    time, value = _averaged(time_s, values)
    noise = max(noise_std(value), _least(value))
    return _turned(time, value, between_s).variance(_N_FREE_OF_TURN) <= _NO_WORSE * noise**2


def speed_change(time_s: FloatArray, values: FloatArray, between_s: tuple[float, float]) -> Transition | None:
    """Time when a motion changes its speed at once, None where it is smooth.

    Parameters as in :func:`stroke_end`.
    """
    if time_s.size < _FEWEST:
        return None
    found = _found(time_s, values, between_s, _bent)
    return found.transition if found.kind == "kink" else None


def _found(
    time_s: FloatArray, values: FloatArray, between_s: tuple[float, float], seek: _Seek
) -> ChangePoint:
    return _sharpened(seek(*_averaged(time_s, values), between_s), time_s, values, seek)


def _sharpened(fit: ChangePoint, time_s: FloatArray, values: FloatArray, again: _Seek) -> ChangePoint:
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


def _averaged(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    block = -(-time_s.size // MAX_ROWS)
    return block_means(time_s, block), block_means(values, block)


def _least(values: FloatArray) -> float:
    # share of a motion below which no description needs to explain it
    return 1e-5 * float(np.ptp(values))


def _ending(
    time: FloatArray, value: FloatArray, between_s: tuple[float, float], moving_s: float
) -> ChangePoint:
    fits = [profile(time, value, between_s, _moving(order)) for order in (3, 2)]
    fits.append(_braking(time, value, between_s, moving_s))
    fits.append(replace(profile(time, value, between_s, _moving(1)), kind="kink"))
    return _smoothest(fits, value, _N_FREE)


def _turned(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> ChangePoint:
    """A turn: one polynomial, both sides slowing down to rest and going on, or a kink."""
    smooth = [profile(time, value, between_s, _moving(order, after=True)) for order in (3, 2)]
    return _smoothest(
        [_vertex(time, value, between_s), *smooth, _kink(time, value, between_s)], value, _N_FREE_OF_TURN
    )


def _bent(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> ChangePoint:
    """A change of speed: none in one polynomial, or a kink."""
    fits = [_vertex(time, value, between_s), _kink(time, value, between_s)]
    return _smoothest(fits, value, _N_FREE_OF_TURN)


def _smoothest(fits: list[ChangePoint], value: FloatArray, n_free: int) -> ChangePoint:
    """First fit, from smooth to sharp, that none of the others betters significantly."""
    best = min(fits, key=lambda fit: fit.squares)
    variance = max(best.variance(n_free), _least(value) ** 2)
    return next(fit for fit in fits if fit.squares <= best.squares + SIGNIFICANT * variance)


def _kink(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> ChangePoint:
    return replace(profile(time, value, between_s, _moving(1, after=True)), kind="kink")


def _moving(order: int, *, after: bool = False) -> Design:
    """Powers from ``order`` on of the time that is left to the place and, with ``after``, since then."""

    def design(time: FloatArray, at: FloatArray) -> FloatArray:
        left = at[:, None] - time
        sides = [np.maximum(side, 0.0) for side in ((left, -left) if after else (left,))]
        powers = [side**k for side in sides for k in range(order, order + 3)]
        return np.stack([np.ones_like(left), *powers], axis=-1)

    return design


def _braking(
    time: FloatArray, value: FloatArray, between_s: tuple[float, float], moving_s: float
) -> ChangePoint:
    """Stop after a constant deceleration whose length is sought too."""
    whole_s = float(np.ptp(time)) or 1.0

    def stop(brake_s: float, zoom: Sequence[int] = COARSE) -> ChangePoint:
        brake = brake_s / whole_s

        def design(time: FloatArray, at: FloatArray) -> FloatArray:
            tau = np.maximum(at[:, None] - time, 0.0)
            beyond = np.maximum(tau - brake, 0.0)
            # A parabola that goes on as its tangent, and a change of speed before the braking.
            return np.stack([np.ones_like(tau), tau**2 - beyond**2, beyond**2, beyond**3], axis=-1)

        return profile(time, value, between_s, design, zoom)

    tried = {length: stop(length).squares for length in map(float, moving_s * np.geomspace(0.008, 0.8, 9))}
    best = min(tried, key=tried.__getitem__)
    for ratio in (1.3, 1.12):
        tried |= {length: stop(length).squares for length in (best / ratio, best * ratio)}
        best = min(tried, key=tried.__getitem__)
    row_s = float(np.ptp(time)) / max(time.size - 1, 1)
    return replace(stop(best, FINE), kind="kink" if best < 8.0 * row_s else "smooth")


def _vertex(time: FloatArray, value: FloatArray, between_s: tuple[float, float]) -> ChangePoint:
    """Extremum of one polynomial through all rows."""
    middle, scale = float(time.mean()), float(np.ptp(time)) / 2.0 or 1.0
    x = (time - middle) / scale
    basis = np.polynomial.legendre.legvander(x, 6)
    coefficients, *_ = np.linalg.lstsq(basis, value, rcond=None)
    misfit = value - basis @ coefficients
    squares = float(misfit @ misfit)
    low, high = ((t - middle) / scale for t in between_s)
    grid = np.linspace(low, high, 2001)
    slope, bend = (
        np.polynomial.legendre.legval(grid, np.polynomial.legendre.legder(coefficients, m)) for m in (1, 2)
    )
    index = int(np.argmin(np.abs(slope)))
    noise = np.sqrt(squares / max(x.size - 7, 1) / x.size)
    # The slope of a fit of degree 6 is some six times less certain than its value.
    std = min(float(scale * 6.0 * noise / max(abs(float(bend[index])), 1e-300)), 2.0 * scale)
    return ChangePoint(at=middle + scale * float(grid[index]), std=std, squares=squares, n_rows=x.size)
