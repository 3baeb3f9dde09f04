"""Curves, measured or simulated, with points in the order travelled."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from inspect import isfunction
from itertools import pairwise
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate import _core
from palpate.domain.mesh_convergence import MeshConvergence
from palpate.errors import CurveError, ScoringError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

PHASES = ("load", "unload")
"""Parts of a path: where the abscissa's magnitude grows, and where it falls."""

SIGNIFICANT = 3.0
"""Standard deviations that a fall must exceed to be more than noise."""


def channel_of(name: str) -> str:
    """Channel of a name that has a weight: ``torque`` of ``torque`` and of ``torque/unload``.

    Raises
    ------
    ScoringError
        There is no such phase.
    """
    channel, slash, phase = name.partition("/")
    if slash and phase not in PHASES:
        raise ScoringError(f"'{name}': unknown phase '{phase}' of a channel (known: {', '.join(PHASES)})")
    return channel


def frozen_floats(values: ArrayLike) -> FloatArray:
    """Copy numbers into a read-only array of doubles.

    Raises
    ------
    CurveError
        They are not real numbers, or rows have unequal lengths.
    """
    try:
        given = np.asarray(values)
        if given.dtype.kind not in "biufO":  # text and complex numbers would be converted silently
            raise TypeError(f"values of type {given.dtype}")
        array = np.array(given, dtype=np.float64, copy=True)
    except (TypeError, ValueError) as error:
        raise CurveError(f"not an array of real numbers: {error}") from error
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """Kind of a curve: one quantity over another.

    ``abscissa`` and ``ordinate`` are column names that carry their unit, such as
    ``depth_mm`` and ``force_N``; the labels are for figures. ``degree`` is the degree of the ordinate in
    the moduli: 1 if it doubles when all of them double (a force, a torque, a
    stress), 0 if it does not change (a displacement, an angle, a ratio).

    The other declarations are checked on each measured curve of any loader: ``non_negative``
    ordinates; an ordinate that is ``zero_at_start``; ``dissipative``: the curve never returns
    more work (integral of the ordinate over the abscissa) than was put in; and ``length_power``:
    the peak is compared with modulus × length^n, 2 for a force and 3 for a moment.

    A solver that gives equilibrium states (:class:`palpate.api.experiment.EquilibriumStates`) computes every
    channel whose ``abscissa`` and ``ordinate`` are columns of theirs. For another ordinate, ``observe``
    makes it (k,) of the columns (k,) by name that ``needs`` lists, such as the quotient of two. Write it
    with the arrays' own namespace, so that JAX differentiates it: slopes follow. ``mirrored`` is by what
    the ordinate is multiplied where a shift, tilt or rotation has the other sign, on a symmetric body:
    −1 for a torque (odd), 1 for a normal force (even). ``mesh`` is its error by the mesh.
    """

    name: str
    abscissa: str
    ordinate: str
    abscissa_label: str
    ordinate_label: str
    degree: Literal[0, 1] = 1
    non_negative: bool = False
    zero_at_start: bool = False
    dissipative: bool = False
    length_power: Literal[2, 3] | None = None
    mirrored: Literal[-1, 1] | None = None
    needs: tuple[str, ...] = ()
    observe: Callable[[Mapping[str, Any]], Any] | None = None
    mesh: MeshConvergence = field(default_factory=MeshConvergence)

    def __post_init__(self) -> None:
        if "/" in self.name:
            raise CurveError(
                f"channel '{self.name}': a slash is for phases, such as torque/unload; rename it"
            )
        if bool(self.needs) != (self.observe is not None):
            raise CurveError(
                f"channel '{self.name}': `needs` and `observe` belong together; give both or none"
            )
        if not (self.observe is None or isfunction(self.observe)):  # keys need its name and its file
            raise CurveError(
                f"channel '{self.name}': `observe` is of class {type(self.observe).__name__}; give a "
                "function defined at the top of a module"
            )

    @property
    def columns(self) -> frozenset[str]:
        """Columns of equilibrium states that it is made of."""
        return frozenset({self.abscissa, *(self.needs or (self.ordinate,))})

    @property
    def units(self) -> tuple[str, str]:
        """Units of abscissa and ordinate, from the ends of their names; empty for a name of one word."""
        along, of = (name.rpartition("_")[::2] for name in (self.abscissa, self.ordinate))
        return along[1] if along[0] else "", of[1] if of[0] else ""


def abscissae_of(channels: Mapping[str, Channel]) -> dict[str, str]:
    """Name of the abscissa of each channel."""
    return {name: channel.abscissa for name, channel in channels.items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A path in the order in which it was travelled.

    Parameters
    ----------
    channel : str
        Name of the channel, for example ``"force"``.
    abscissa, ordinate : (n,) array
        In the units of the channel; at least two points, all finite.
    std : (n,) array, optional
        Standard deviation of each ordinate, in its unit: the spread of single measurements
        of this point. None if unknown.
    time_s : (n,) array, optional
        When each point was passed, never decreasing; the curves of one press have one clock. None if unknown.
    slopes : mapping of name to (n,) array
        Derivative of a simulated ordinate in each textbook parameter, named ``region.parameter``, and
        in the coefficient of ``friction``; per unit of the parameter. Empty if not requested.

    Raises
    ------
    CurveError
        Shapes differ, fewer than two points, a value that is not finite, a negative
        standard deviation, a time that goes back, or an abscissa that never moves.
    """

    channel: str
    abscissa: FloatArray
    ordinate: FloatArray
    std: FloatArray | None = None
    time_s: FloatArray | None = None
    slopes: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("abscissa", "ordinate", "std", "time_s"):
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen_floats(values))
        slopes = {name: frozen_floats(values) for name, values in self.slopes.items()}
        object.__setattr__(self, "slopes", MappingProxyType(slopes))
        self._check_points()
        named = {f"slopes in '{name}'": values for name, values in slopes.items()}
        for name, values in {"std": self.std, "time_s": self.time_s, **named}.items():
            if values is not None:
                self._check_more(name, values)

    def __repr__(self) -> str:
        x, y, n = self.abscissa, self.ordinate, len(self.branches)
        return (
            f"Curve({self.channel!r}: {x.size} points, {n} branch{'' if n == 1 else 'es'}, "
            f"{x.min():.4g} … {x.max():.4g}; {y.min():.4g} … {y.max():.4g})"
        )

    def _check_points(self) -> None:
        where = f"curve '{self.channel}'"
        if self.abscissa.ndim != 1 or self.abscissa.shape != self.ordinate.shape:
            raise CurveError(
                f"{where}: abscissa {self.abscissa.shape} and ordinate {self.ordinate.shape} "
                "must be one-dimensional and of one length"
            )
        for name, values in (("abscissa", self.abscissa), ("ordinate", self.ordinate)):
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise CurveError(
                    f"{where}: {name}[{bad[0]}] is {values[bad[0]]}; "
                    "remove or repair the row, every value must be finite"
                )
        if self.abscissa.size < 2 or np.ptp(self.abscissa) == 0.0:
            raise CurveError(
                f"{where}: {self.abscissa.size} point(s) whose abscissa never moves; "
                "a curve needs at least two different abscissae"
            )

    def _check_more(self, name: str, values: FloatArray) -> None:
        """Refuse standard deviations, times or slopes that the points cannot have."""
        if values.shape != self.ordinate.shape:
            what = {"std": "standard deviations", "time_s": "times"}.get(name, name)
            raise CurveError(
                f"curve '{self.channel}': {values.shape} {what} for {self.ordinate.shape} points; "
                "give one for each point, or none"
            )
        bad, rule = ~np.isfinite(values), "a slope is finite"
        if name == "std":
            bad, rule = bad | (values < 0.0), "a standard deviation is finite and not negative"
        elif name == "time_s":
            bad = bad | (np.diff(values, prepend=-np.inf) < 0.0)
            rule = "a time is finite and never before the previous one"
        if bad.any():
            row = int(bad.argmax())
            raise CurveError(f"curve '{self.channel}': {name}[{row}] is {values[row]}; {rule}")

    def cut(self, rows: slice) -> "Curve":
        """Keep some of the points, each with its standard deviation and time."""
        return Curve(
            channel=self.channel,
            abscissa=self.abscissa[rows],
            ordinate=self.ordinate[rows],
            std=None if self.std is None else self.std[rows],
            time_s=None if self.time_s is None else self.time_s[rows],
            slopes={name: values[rows] for name, values in self.slopes.items()},
        )

    @cached_property
    def branches(self) -> tuple[tuple[int, int], ...]:
        """Maximal monotone runs as (start, stop); adjacent runs share the turning point."""
        return tuple((int(a), int(b)) for a, b in _core.branches(self.abscissa))

    def densified(self, n_between: int) -> "Curve":
        """Curve with ``n_between`` more points in each interval, on cubics along each branch.

        At its points a cubic has the steepness of the parabola through three neighbours, at most three times
        the smaller steepness next to a point of ordinates that only rise or only fall, so that cubics do too
        (Fritsch and Carlson 1980). Slopes are derivatives of the new ordinates. An interval in which the
        abscissa rests gets no points. Standard deviations and times are linear between points.
        """
        x, columns = self.abscissa, np.column_stack([self.ordinate, *self.slopes.values()])
        share = np.arange(n_between + 1) / (n_between + 1)
        rests = np.flatnonzero(np.diff(x) == 0.0)
        ends = sorted({0, *rests, *(rests + 1), *(stop - 1 for _, stop in self.branches)})
        found, places = [], []
        for start, stop in pairwise(ends):
            rows = slice(start, stop + 1)
            moves = x[stop] != x[start]
            at = (np.arange(start, stop)[:, None] + (share if moves else share[:1])).ravel()
            new = np.interp(at, np.arange(x.size), x)
            places.append(at)
            if moves:
                new = np.column_stack([new, _on_cubics(x[rows], columns[rows], new)])
            else:
                new = np.column_stack([new, columns[start:stop]])
            found.append(new)
        last = np.concatenate([x[-1:], columns[-1]])
        values = np.vstack([*found, last])
        at = np.append(np.concatenate(places), x.size - 1)
        own = np.arange(x.size)
        std, time_s = (None if each is None else np.interp(at, own, each) for each in (self.std, self.time_s))
        return replace(
            self,
            abscissa=values[:, 0],
            ordinate=values[:, 1],
            std=std,
            time_s=time_s,
            slopes=dict(zip(self.slopes, values[:, 2:].T, strict=True)),
        )

    def counted(self, name: str) -> BoolArray:
        """Points (n,) that a weight counts: all for a channel, the phase's own for ``torque/unload``.

        A turning point, and the point where the abscissa comes back to zero, belong to the earlier phase.
        """
        x, phase = self.abscissa, name.partition("/")[2]
        if not phase:
            return np.ones(x.size, dtype=np.bool_)
        loading = np.zeros(x.size, dtype=np.bool_)
        for start, stop in self.branches:
            own = slice(start + (start > 0), stop)
            loading[own] = x[own] * (x[stop - 1] - x[start]) > 0.0
        loading[: np.argmax(x != 0.0)] = True  # at rest, before the first load
        return loading if phase == "load" else ~loading


def _on_cubics(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Values (m, k) of cubics through points x (n,), y (n, k) of a branch, ``at`` (m,); lines through two.

    The first column has the ordinates; the others are its derivatives.
    """
    if x.size == 2:
        return np.asarray(y[0] + ((at - x[0]) / (x[1] - x[0]))[:, None] * (y[1] - y[0]))
    rates = _rates(x, y)
    up = np.sign(x[-1] - x[0])
    left = np.clip(np.searchsorted(up * x, up * at, side="right") - 1, 0, x.size - 2)
    width = (x[left + 1] - x[left])[:, None]
    t = (at[:, None] - x[left, None]) / width
    first, other = y[left], y[left + 1]
    return (
        (1 + 2 * t) * (1 - t) ** 2 * first
        + t * (1 - t) ** 2 * width * rates[left]
        + t**2 * (3 - 2 * t) * other
        + t**2 * (t - 1) * width * rates[left + 1]
    )


def _rates(x: FloatArray, y: FloatArray) -> FloatArray:
    """Steepness (n, k) at points x (n,), y (n, k), where y's first column only rises or falls so limited."""
    rates, secants = np.gradient(y, x, axis=0, edge_order=2), np.diff(y, axis=0) / np.diff(x)[:, None]
    before, after = np.vstack([secants[:1], secants]), np.vstack([secants, secants[-1:]])
    least = np.where(np.abs(before[:, :1]) < np.abs(after[:, :1]), before, after)
    goes_on = before[:, 0] * after[:, 0] >= 0.0
    rates[goes_on & (rates[:, 0] * least[:, 0] < 0.0)] = 0.0
    steep = goes_on & (np.abs(rates[:, 0]) > 3.0 * np.abs(least[:, 0]))
    rates[steep] = 3.0 * least[steep]
    return rates


def moving_span(abscissa: FloatArray) -> slice:
    """Rows between the first and the last movement of an abscissa, both ends included.

    While one channel moves, the other is constant (depth during the twist); the rows at
    rest before and after have no abscissa to compare at.

    Parameters
    ----------
    abscissa : (n,) array
        In the order in which it was travelled.

    Raises
    ------
    CurveError
        The abscissa never moves.
    """
    moves = np.flatnonzero(np.diff(abscissa) != 0.0)
    if moves.size == 0:
        raise CurveError("the abscissa never moves, so there is no path to compare along")
    return slice(int(moves[0]), int(moves[-1]) + 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """Fall of a channel while the indenter rested in contact.

    Parameters
    ----------
    phase : str
        Name of the rest, such as ``dwell_1``.
    duration_s : float
        Of the rest.
    start_value : float
        At the start of the rest, in the unit of the ordinate.
    fall : float
        By how much the magnitude is smaller at the end of the rest; negative where it is larger.
    fall_std : float
        Standard deviation of the fall.
    time_constant_s : float, optional
        Of one exponential; None if unknown.

    Raises
    ------
    CurveError
        A value that is not finite, a negative standard deviation, or a rest of no duration.
    """

    channel: str
    phase: str
    duration_s: float
    start_value: float
    fall: float
    fall_std: float
    time_constant_s: float | None = None

    def __post_init__(self) -> None:
        where = f"relaxation of '{self.channel}' in '{self.phase}'"
        optional = () if self.time_constant_s is None else ("time_constant_s",)
        for name in ("duration_s", "start_value", "fall", "fall_std", *optional):
            value = float(getattr(self, name))
            object.__setattr__(self, name, value)  # a file holds no scalars of arrays
            if not np.isfinite(value):
                raise CurveError(f"{where}: {name} is {value}; give a finite number")
        if self.fall_std < 0.0:
            raise CurveError(f"{where}: fall_std is {self.fall_std}; a standard deviation is not negative")
        if not self.duration_s > 0.0:
            raise CurveError(f"{where}: duration_s is {self.duration_s}; a rest lasts longer than 0 s")

    @property
    def share(self) -> float:
        """Fall over the magnitude at the start; 0 where that is zero."""
        return self.fall / abs(self.start_value) if self.start_value else 0.0

    @property
    def is_significant(self) -> bool:
        """True if noise alone does not make such a fall, or rise."""
        return abs(self.fall) > SIGNIFICANT * self.fall_std


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """Curves by channel name: the response of a limb, measured or simulated.

    Parameters
    ----------
    relaxations : sequence of Relaxation, optional
        Falls of channels in the rests of measured presses.
    record : mapping, optional
        How the curves were obtained, as numbers, text, lists and tables. The manifest
        of a run keeps it for each file of a loader. A loader's ``warnings``, a list of
        sentences, are printed.
    """

    curves: Mapping[str, Curve]
    relaxations: Sequence[Relaxation] = ()
    record: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "curves", MappingProxyType(dict(self.curves)))
        object.__setattr__(self, "relaxations", tuple(self.relaxations))
        object.__setattr__(self, "record", MappingProxyType(dict(self.record)))

    def __repr__(self) -> str:
        return f"Response({', '.join(map(repr, self.curves.values()))})"

    def densified(self, n_between: int) -> "Response":
        """Response with ``n_between`` more points between neighbours of each curve."""
        return replace(self, curves={name: curve.densified(n_between) for name, curve in self.curves.items()})

    def __getitem__(self, channel: str) -> Curve:
        return self.curves[channel]

    def __iter__(self) -> Iterator[str]:
        return iter(self.curves)
