"""Words for how well a parameter is identified, by the width of its interval."""

from collections.abc import Iterable
from enum import StrEnum

import numpy as np

from palpate.domain import Parameter

WORDS: tuple[tuple[float, str], ...] = ((0.1, "well"), (0.3, "roughly"), (0.8, "poorly"), (np.inf, "not"))
"""Word for an interval up to each relative width."""

UNCLEAR = "unclear"
"""Word where no interval is known, or the model does not describe the curves."""


class Adequacy(StrEnum):
    """Verdict on a model, the best first: what may be read from its parameters."""

    DESCRIBES = "describes"
    """The curves, within the error budget: parameters are properties of the material."""
    APPROXIMATES = "approximates"
    """Curves that differ by more: parameters are effective ones, of these curves and this range."""
    FAILS = "does not describe"
    """Curves: no parameters can be read."""


def worst_of(verdicts: Iterable[Adequacy | str]) -> Adequacy:
    """Worst of some verdicts on one model; without any, the model describes the curves."""
    return max(map(Adequacy, verdicts), key=list(Adequacy).index, default=Adequacy.DESCRIBES)


def word_of(relative_width: float) -> str:
    """Word for an interval of a relative width."""
    return next(word for most, word in WORDS if relative_width <= most)


def share_of_range(parameter: Parameter, value: float) -> float:
    """Position of a value in its range, 0 to 1, or in that of its logarithm if that is spread evenly."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.lower) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.lower) / (parameter.upper - parameter.lower)
