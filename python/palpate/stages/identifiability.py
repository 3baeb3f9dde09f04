"""Words for how well a parameter is identified, by the width of its interval."""

import numpy as np

from palpate.domain import Parameter

WORDS: tuple[tuple[float, str], ...] = ((0.1, "well"), (0.3, "roughly"), (0.8, "poorly"), (np.inf, "not"))
"""Word for an interval up to each relative width."""

UNCLEAR = "unclear"
"""Word where no interval is known, or the model does not describe the curves."""


def word_of(relative_width: float) -> str:
    """Word for an interval of a relative width."""
    return next(word for most, word in WORDS if relative_width <= most)


def share_of_range(parameter: Parameter, value: float) -> float:
    """Position of a value in its range, 0 to 1, or in that of its logarithm if that is spread evenly."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.lower) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.lower) / (parameter.upper - parameter.lower)
