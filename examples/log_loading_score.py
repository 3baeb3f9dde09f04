"""Logarithm of the loading branch: a score in one file.

With ``score = "log_loading"`` under ``[scoring]`` of study.toml, and ``--plugin log_loading_score.py`` on the
command line, sets are ranked and fitted by it: 10 % too stiff counts the same at every depth, and unloading
does not count.
"""

import numpy as np
from pydantic import Field

from palpate.api import BoolArray, Curve, FloatArray, Settings, hookimpl
from palpate.api.scores import Score


class LogLoadingSettings(Settings):
    """Settings of the score."""

    floor: float = Field(
        default=0.02, gt=0.0, lt=1.0, description="Share of the largest ordinate from which points count."
    )


class LogLoading(Score[LogLoadingSettings]):
    """log |simulated / measured| on the first branch, over √n of its points."""

    name = "log_loading"
    summary = "logarithm of simulated over measured, along the loading branch"

    def weights(self, measured: Curve) -> FloatArray:
        """1 on the first branch, as far as it is above the floor."""
        start, stop = measured.branches[0]
        first = np.zeros(measured.ordinate.size)
        first[start:stop] = np.abs(measured.ordinate[start:stop]) >= self._least(measured)
        return first

    def residuals(self, measured: Curve, simulated: FloatArray, used: BoolArray) -> FloatArray:
        """Logarithms; a simulated ordinate below the floor counts as if it were there."""
        least = self._least(measured)
        here, there = (np.maximum(np.abs(y), least) for y in (simulated, measured.ordinate))
        residuals: FloatArray = np.log(here / there) / np.sqrt(used.sum())
        return residuals

    def _least(self, measured: Curve) -> float:
        return self.settings.floor * float(np.abs(measured.ordinate).max())


@hookimpl
def palpate_scores() -> list[type[Score]]:
    """Provide the score."""
    return [LogLoading]
