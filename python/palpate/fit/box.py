"""Searched values as coordinates of the unit box."""

from collections.abc import Sequence

import numpy as np

from palpate.domain import FloatArray, Parameter


class Box:
    """Goes between values and the unit box, in logarithms where a modulus has a range above zero."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = tuple(parameters)
        self.log = np.array([p.in_logarithms for p in self.parameters], dtype=bool)
        self.lower = np.array([p.lower for p in self.parameters], dtype=np.float64)
        self.upper = np.array([p.upper for p in self.parameters], dtype=np.float64)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    def values(self, point: FloatArray) -> FloatArray:
        """Values (n_parameters,) at a point of the box, or of points (n, n_parameters)."""
        lower, upper = np.where(self.log, self.lower, 1.0), np.where(self.log, self.upper, 1.0)
        values = np.where(self.log, lower * (upper / lower) ** point, self.linear(point))
        # Rounding may carry them past a bound, or leave them short of the upper one.
        return np.where(point >= 1.0, self.upper, np.clip(values, self.lower, self.upper))

    def linear(self, shares: FloatArray) -> FloatArray:
        """Values at shares of their ranges, without logarithms."""
        return self.lower + shares * (self.upper - self.lower)

    def point(self, values: FloatArray) -> FloatArray:
        """Point of the box of values (n_parameters,) or (n, n_parameters); on its edge if outside."""
        return np.clip(self.coordinates(np.clip(values, self.lower, self.upper)), 0.0, 1.0)

    def coordinates(self, values: FloatArray) -> FloatArray:
        """Coordinates of values, which may be outside of the box."""
        share = (values - self.lower) / (self.upper - self.lower)
        lower, upper, at = (np.where(self.log, x, 2.0) for x in (self.lower, self.upper, values))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.log, np.log(at / lower) / np.log(upper / lower), share)

    def exact_point(self, values: FloatArray) -> FloatArray:
        """Point (n_parameters,) of values within their ranges, which it has to the last bit if any near does.

        So what was simulated with these values is found, and not simulated again.
        """
        point = self.point(values)
        # What one step of rounding, of the coordinate or of its value, is worth. Below a power of two
        # coordinates are half as far apart as above it.
        step = np.spacing(np.nextafter(point, 0.0))
        unit = np.maximum(step, 0.5 * np.spacing(np.abs(values)) / self.rates(point))
        # Steps of rounding by which a coordinate may be off on the way to a value and back; none comes first.
        steps = np.array(sorted(range(-8, 9), key=abs), dtype=np.float64)
        near = np.clip(point + np.outer(steps, unit), 0.0, 1.0)
        hits = self.values(near) == values
        return np.take_along_axis(near, hits.argmax(axis=0)[None], axis=0)[0]

    def rates(self, point: FloatArray) -> FloatArray:
        """Derivative (n_parameters,) of each value in its coordinate, or (n, n_parameters) at points."""
        return self.rates_at(self.values(point))

    def rates_at(self, values: FloatArray) -> FloatArray:
        """Derivatives of values, which may be outside of the box, in their coordinates."""
        lower, upper = np.where(self.log, self.lower, 1.0), np.where(self.log, self.upper, np.e)
        return np.where(self.log, values * np.log(upper / lower), self.upper - self.lower)


def on_grid(point: FloatArray, accuracy: float) -> FloatArray:
    """Nearest point (n_parameters,) of a grid in the unit box, far finer than a solver's relative accuracy.

    Rounding errors differ between processes. A fit that goes on in another one asks for the same points of
    the grid, whose simulations are kept.
    """
    spacing = 2.0 ** np.floor(np.log2(1e-3 * accuracy))
    return np.round(point / spacing) * spacing
