"""The core's samplers: Latin hypercubes, plain and optimised, and a Sobol' sequence."""

from typing import Literal

import numpy as np
from pydantic import Field

from palpate import _core
from palpate.domain import FloatArray
from palpate.domain.component import Settings
from palpate.plugins.interfaces import Sampler


class LatinHypercubeSettings(Settings):
    """Settings of :class:`LatinHypercube`."""

    centred: bool = Field(
        default=False, description="Put each point at the centre of its cell instead of a random place in it."
    )


class LatinHypercube(Sampler[LatinHypercubeSettings]):
    """Latin hypercube: one point in each of ``n_sets`` equal slices of every parameter."""

    name = "lhs"
    summary = "Latin hypercube: one point in every slice of every parameter"

    def draw(self, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
        """Points (n_sets, n_parameters) in (0, 1); the same seed gives the same bits."""
        return _core.latin_hypercube(n_sets, n_parameters, seed, centred=self.settings.centred)

    def extend(self, points: FloatArray, n_total: int, seed: int) -> FloatArray:
        """Latin hypercube (n_total, n_parameters) that begins with ``points``; a multiple of its rows."""
        return _core.extend_latin_hypercube(points, n_total, seed, centred=self.settings.centred)


class OptimisedLatinHypercubeSettings(LatinHypercubeSettings):
    """Settings of :class:`OptimisedLatinHypercube`."""

    criterion: Literal["cd", "maximin", "correlation"] = Field(
        default="cd",
        description="Criterion that is optimised: cd, least centred discrepancy, so that "
        "every box has its share of the sets; maximin, largest distance of the two closest sets; "
        "correlation, least correlation of the parameters.",
    )
    centred: bool = Field(
        default=True, description="Put each point at the centre of its cell instead of a random place in it."
    )
    n_swaps: int | None = Field(
        default=None,
        ge=0,
        lt=2**63,
        description="Exchanges of two values tried; if left out, 20 for each value of the design, and fewer "
        "in a very large one.",
    )


class OptimisedLatinHypercube(Sampler[OptimisedLatinHypercubeSettings]):
    """Latin hypercube whose values are ordered, within each parameter, so that the sets are far apart.

    A threshold-accepting search exchanges two values of a parameter at a time. Its criterion is never
    worse than the criterion of the plain Latin hypercube with the same seed.
    """

    name = "optimised_lhs"
    summary = "Latin hypercube that fills the box evenly, by discrepancy, distance or correlation"

    def draw(self, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
        """Points (n_sets, n_parameters) in (0, 1); the same seed gives the same bits."""
        drawn = _core.latin_hypercube(n_sets, n_parameters, seed, centred=self.settings.centred)
        return self._optimised(drawn, seed, n_fixed=0)

    def extend(self, points: FloatArray, n_total: int, seed: int) -> FloatArray:
        """Latin hypercube (n_total, n_parameters) that begins with ``points``; only new rows are arranged."""
        extended = _core.extend_latin_hypercube(points, n_total, seed, centred=self.settings.centred)
        return self._optimised(extended, seed, n_fixed=len(points))

    def _optimised(self, points: FloatArray, seed: int, n_fixed: int) -> FloatArray:
        settings = self.settings
        return _core.optimise_design(
            points, settings.criterion, seed, n_swaps=settings.n_swaps, n_fixed=n_fixed
        )


class Sobol(Sampler):
    """Sobol' sequence with Owen's nested uniform scrambling.

    The directions of Joe and Kuo (2008), as SciPy has them, for up to 21201 parameters.
    The balance is best when ``n_sets`` is a power of 2. A longer draw of a seed
    begins with the shorter one.
    """

    name = "sobol"
    summary = "Sobol' sequence, Owen-scrambled: most even at powers of two, and extensible"

    def draw(self, n_sets: int, n_parameters: int, seed: int) -> FloatArray:
        """Points (n_sets, n_parameters) in (0, 1); the same seed gives the same bits."""
        from scipy.stats import qmc

        # Without scrambling SciPy takes no random number; the next power of 2 is free of its warning.
        sequence = qmc.Sobol(n_parameters, scramble=False, bits=32)
        net = sequence.random_base2((n_sets - 1).bit_length())[:n_sets]
        return _core.owen_scramble(np.ascontiguousarray(net, dtype=np.float64), seed)

    def extend(self, points: FloatArray, n_total: int, seed: int) -> FloatArray:
        """Points (n_total, n_parameters) of the same sequence, which begins with ``points``."""
        return self.draw(n_total, points.shape[1], seed)
