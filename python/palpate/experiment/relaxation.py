"""Relaxation of a tissue in the rests of its presses, against what a model without time can describe."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from palpate.domain import Relaxation, Response
from palpate.domain.thresholds import THRESHOLDS

REMEDY = (
    "The relaxation changes the parameters by more than their intervals show. Press and twist slower, rest "
    "longer before each motion, and report the rate with the values."
)
"""What it means where the fall is larger, and what to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestRelaxation:
    """The rest of one or several spots that is worst for a model without time.

    Parameters
    ----------
    share : float
        Fall over the peak of the channel's curve.
    place : str
        Spot, where there are several; else empty.
    is_beyond : bool
        Whether the fall is more than the budget allows, and more than noise.
    """

    rest: Relaxation
    share: float
    place: str
    is_beyond: bool

    @property
    def probability(self) -> float:
        """Probability of such a fall, or a larger one, by noise alone."""
        if self.rest.fall_std > 0.0:
            return 0.5 * math.erfc(self.rest.fall / self.rest.fall_std / math.sqrt(2.0))
        return 0.0 if self.rest.fall > 0.0 else 1.0

    @property
    def sentence(self) -> str:
        """Sentence on the fall, and on the fitted moduli, which are apparent ones."""
        at = f" at {self.place}" if self.place else ""
        return (
            f"the tissue{at} relaxed by {100.0 * self.share:.2g} % in {self.rest.duration_s:.2g} s; "
            "these are apparent moduli of this rate"
        )


def relaxation_of(measured: Mapping[str, Response], gain: float) -> LargestRelaxation | None:
    """Return the worst rest of measured responses by spot; None where no rest was measured.

    Parameters
    ----------
    gain : float
        Standard deviation of a channel's calibration in the budget, relative.
    """
    found = []
    for spot, response in measured.items():
        for rest in response.relaxations:
            share = rest.fall / _peak(response, rest) if rest.fall else 0.0
            is_beyond = rest.is_significant and share > THRESHOLDS.relaxed * gain
            place = spot if len(measured) > 1 else ""
            found.append(LargestRelaxation(rest=rest, share=share, place=place, is_beyond=is_beyond))
    return max(found, key=lambda each: (each.is_beyond, each.share), default=None)


def relaxation_warnings(
    measured: Mapping[str, Response], gain: float, modelled: Collection[str] = ()
) -> tuple[str, ...]:
    """Warn of spots whose tissue relaxed by more than the budget allows, and of what the model has of it."""
    found = relaxation_of(measured, gain)
    has = f"Only {', '.join(sorted(modelled))} relax in the model" if modelled else "The model has no time"
    return (f"{found.sentence}. {has}. {REMEDY}",) if found and found.is_beyond else ()


def _peak(response: Response, rest: Relaxation) -> float:
    """Largest magnitude of a channel: of its curve, or where a rest starts."""
    curve = response.curves.get(rest.channel)
    peak = 0.0 if curve is None else float(np.abs(curve.ordinate).max())
    return max(peak, abs(rest.start_value)) or math.inf
