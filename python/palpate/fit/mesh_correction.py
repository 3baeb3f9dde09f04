"""What a spot's finer mesh answers, as a correction of the curves of its coarser one.

The fit runs on the coarse mesh. Its curves are corrected by the difference that the fine mesh makes at a
set near the optimum, scaled by the size of the coarse curve, and the fit is repeated until that set is near
enough (space mapping: Bandler et al., IEEE Trans. Microw. Theory Tech. 52, 2004).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from palpate.domain import FloatArray, Simulation, channel_of
from palpate.fit.spot_term import Correction, NotRankedError, SpotTerm
from palpate.plugins.parametrisation import SpotInputs

NEAR = 0.2
"""Error of a correction, over the misfit that is left, up to which a set is near enough."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FineRun:
    """One set at one spot on both meshes: ordinates (n,) at the measured points by channel.

    Parameters
    ----------
    coarse, fine : mapping of channel to (n,) array
        NaN where a curve does not cover a point.
    """

    coarse: Mapping[str, FloatArray]
    fine: Mapping[str, FloatArray]

    @property
    def corrections(self) -> dict[str, Correction]:
        """What the fine mesh adds at each measured point; nothing where a curve is missing."""
        return {
            name: Correction(added=np.nan_to_num(self.fine[name] - coarse), coarse=coarse)
            for name, coarse in self.coarse.items()
        }


def fine_run(term: SpotTerm, inputs: SpotInputs, coarse: Simulation, fine: Simulation) -> FineRun:
    """Compare the meshes at one set.

    Raises
    ------
    NotRankedError
        The finer mesh could not be simulated.
    """
    bare = replace(term, corrections={})
    bare.residuals(fine, inputs)  # what is not to be ranked corrects nothing
    return FineRun(
        coarse={name: bare.values(coarse, inputs, name) for name in term.measured},
        fine={name: bare.values(fine, inputs, name) for name in term.measured},
    )


def error_of(run: FineRun, term: SpotTerm, coarse: Mapping[str, FloatArray]) -> float:
    """Root of the Fopt by which a correction may be wrong at other coarse curves.

    Their size is accounted for: it may be wrong by as much of itself as their shape has changed.
    """
    squares, corrections = 0.0, run.corrections
    for name, weight in term.weights.items():
        channel = channel_of(name)
        there, here = run.coarse[channel], coarse[channel]
        known = np.isfinite(there) & np.isfinite(here) & np.isfinite(run.fine[channel])
        known &= term.counted(name)
        size = float(np.linalg.norm(there[known]))
        if size == 0.0:
            continue
        ratio = float(np.linalg.norm(here[known])) / size
        changed = float(np.linalg.norm(here[known] - ratio * there[known])) / size
        wrong = changed * np.where(known, corrections[channel].added, 0.0)
        scaled = wrong * term.scale(name, weight, known)
        squares += float(scaled @ scaled)
    return float(np.sqrt(squares))


__all__ = ["NEAR", "FineRun", "NotRankedError", "error_of", "fine_run"]
