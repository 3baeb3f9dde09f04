"""An emulator of a spot's curves between the sets that were simulated, from their values and slopes.

Where all moduli are searched, curves are in proportion to them: S(v) = t R(z), with the total stiffness
t = Σ w_i v_i and the shares z_i = w_i v_i / t, so that one coordinate less is left. The weights w are those
by which the moduli stiffen the curves. Whether this holds is seen in the slopes, by Euler's theorem.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from palpate.api import BoolArray, FloatArray, IntArray, Parameter
from palpate_certainty.gaussian_process import GaussianProcess

IN_PROPORTION = 1e-3
"""Difference from Euler's theorem, over the curves, up to which they are in proportion to the moduli."""

LEAST_COMPONENT = 1e-6
"""Size of a principal component, over the largest one, below which it is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Runs:
    """Simulated sets.

    Parameters
    ----------
    values : (n, n_parameters) array
    ordinates : (n, n_points) array
        NaN where a run has failed.
    slopes : (n, n_points, n_parameters) array
        Per unit of each value; NaN where a run has none.
    """

    values: FloatArray
    ordinates: FloatArray
    slopes: FloatArray

    def and_others(self, others: "Runs") -> "Runs":
        """These runs, then the others."""
        pairs = ((getattr(self, f.name), getattr(others, f.name)) for f in fields(self))
        values, ordinates, slopes = (np.concatenate(pair) for pair in pairs)
        return Runs(values=values, ordinates=ordinates, slopes=slopes)

    def __getitem__(self, chosen: IntArray) -> "Runs":
        """Some of the runs."""
        return Runs(values=self.values[chosen], ordinates=self.ordinates[chosen], slopes=self.slopes[chosen])

    @property
    def ended(self) -> "Runs":
        """Those with a result."""
        return self[np.flatnonzero(np.isfinite(self.ordinates).all(axis=1))]

    @property
    def sloped(self) -> BoolArray:
        """Which runs (n,) have slopes."""
        return np.array([np.isfinite(each).all() for each in self.slopes], dtype=np.bool_)

    def weights(self, is_modulus: BoolArray, scale: FloatArray) -> FloatArray | None:
        """Stiffening by each modulus, (n_parameters,); None where curves are not in proportion to them."""
        sloped = self.sloped
        if not is_modulus.any() or not sloped.any() or (self.values[:, is_modulus] < 0.0).any():
            return None
        slopes, curves = self.slopes[sloped] / scale[:, None], self.ordinates[sloped] / scale
        by_moduli = np.einsum("nkp,np->nk", slopes[:, :, is_modulus], self.values[sloped][:, is_modulus])
        if np.abs(by_moduli - curves).max() > IN_PROPORTION * np.abs(curves).max():
            return None
        effects = np.median(np.linalg.norm(slopes, axis=1), axis=0)
        return np.where(is_modulus & (effects > 0.0), effects, 0.0)


class Emulator:
    """Curves of one spot as functions of the searched values.

    Parameters
    ----------
    parameters : sequence of Parameter
    runs : Runs
    scale : (n_points,) array
        Size of the ordinates, such as the peak of each curve, by which errors count.

    Attributes
    ----------
    left_out : (n, n_points) array
        Ordinates of each run less what the others predict.
    """

    def __init__(self, parameters: Sequence[Parameter], runs: Runs, scale: FloatArray) -> None:
        self.is_modulus = np.array([p.kind == "modulus" for p in parameters])
        self.weights, self.scale = runs.weights(self.is_modulus, scale), scale
        total, free = self._coordinates(runs.values)
        self.lower, self.upper = free.min(axis=0), free.max(axis=0)
        self.upper = np.where(self.upper > self.lower, self.upper, self.lower + 1.0)
        curves = runs.ordinates / scale / total[:, None]
        sloped = np.flatnonzero(runs.sloped)
        rates = self._rates(runs.slopes[sloped] / scale[:, None], total[sloped])
        self.mean = curves.mean(axis=0)
        stacked = np.concatenate([curves - self.mean, *np.moveaxis(rates, 2, 0)])
        _, sizes, axes = np.linalg.svd(stacked, full_matrices=False)
        self.axes = axes[sizes > LEAST_COMPONENT * max(sizes[0], 1e-300)]
        slopes = np.moveaxis(rates, 2, 0) @ self.axes.T
        self.process = GaussianProcess(self._scaled(free), sloped, (curves - self.mean) @ self.axes.T, slopes)
        self.left_out = self.process.left_out @ self.axes * total[:, None] * scale

    def __call__(self, values: FloatArray) -> FloatArray:
        """Ordinates (n, n_points) at values (n, n_parameters)."""
        total, free = self._coordinates(values)
        curves = self.mean + self.process(self._scaled(free)) @ self.axes
        ordinates: FloatArray = curves * total[:, None] * self.scale
        return ordinates

    def variance(self, values: FloatArray) -> FloatArray:
        """Variance (n, n_points) of the ordinates at values (n, n_parameters)."""
        total, free = self._coordinates(values)
        of_curves = self.process.variance(self._scaled(free)) @ self.axes**2
        found: FloatArray = of_curves * (total[:, None] * self.scale) ** 2
        return found

    def _coordinates(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What the curves are in proportion to (n,), and the other coordinates (n, d)."""
        if self.weights is None:
            return np.ones(len(values)), values
        total = values @ self.weights
        shares = values * self.weights / total[:, None]
        return total, np.where(self.is_modulus, shares, values)[:, self._free]

    @property
    def _free(self) -> BoolArray:
        free = np.ones(self.is_modulus.size, dtype=np.bool_)
        if self.weights is not None:
            free[self._last] = False
        return free

    @property
    def _last(self) -> int:
        assert self.weights is not None
        return int(np.flatnonzero(self.weights)[-1])

    def _rates(self, slopes: FloatArray, total: FloatArray) -> FloatArray:
        """Slopes (n, n_points, d) of curves over their total stiffness, in the scaled coordinates."""
        width = (self.upper - self.lower) / 2.0
        if self.weights is None:
            scaled: FloatArray = slopes * width
            return scaled
        # With the total held: what one share gains, the last one loses.
        weights = np.where(self.weights > 0.0, self.weights, 1.0)
        by_share = slopes / weights - slopes[:, :, [self._last]] / weights[self._last]
        rates = np.where(self.is_modulus, by_share, slopes / total[:, None, None])
        found: FloatArray = rates[:, :, self._free] * width
        return found

    def _scaled(self, free: FloatArray) -> FloatArray:
        scaled: FloatArray = 2.0 * (free - self.lower) / (self.upper - self.lower) - 1.0
        return scaled
