"""Words and marks for a value: how well it is identified, by which model, and whether it is a result."""

from collections.abc import Iterable, Mapping
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from palpate.domain import Parameter
from palpate.domain.thresholds import THRESHOLDS

WORDS: tuple[tuple[float, str], ...] = (
    (THRESHOLDS.well, "well"),
    (THRESHOLDS.roughly, "roughly"),
    (THRESHOLDS.poorly, "poorly"),
    (np.inf, "not"),
)
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
    """Position of a value in its range, 0 to 1; by logarithms if these are spread evenly."""
    if parameter.scale == "log":
        return float(np.log(value / parameter.lower) / np.log(parameter.upper / parameter.lower))
    return (value - parameter.lower) / (parameter.upper - parameter.lower)


REFUSED, AT_END, TIED, NOT = "refused", "end of range", "tied", "not identified"
EFFECTIVE = "effective"
OTHER_RATE = "other rate"
"""Words of a verdict besides those of :data:`WORDS`."""

MARKS: Mapping[str, tuple[tuple[str, ...], str]] = MappingProxyType(
    {
        "†": (
            ("poorly", NOT, UNCLEAR, REFUSED),
            "poorly or not identified, unclear, or refused: not a result",
        ),
        "‡": ((AT_END,), "at an end of the range that was searched"),
        "¶": ((EFFECTIVE,), "effective: of a law that approximates these curves, and for their range alone"),
        "§": ((OTHER_RATE,), "of other rates: moduli that are not comparable"),
    }
)
"""The words that each mark is put at, and what it means."""


def verdict_of(word: str, *, at_bound: bool = False, model: Adequacy = Adequacy.DESCRIBES) -> str:
    """Verdict on a value whose identifiability has this word, by a model with this verdict."""
    words = (
        REFUSED if model is Adequacy.FAILS else NOT if word == "not" else word,
        AT_END if at_bound else "",
        EFFECTIVE if model is Adequacy.APPROXIMATES else "",
    )
    return ", ".join(each for each in words if each)


def mark_of(verdict: str) -> str:
    """Marks of a value with this verdict; empty where it is a result."""
    words = verdict.split(", ")
    return "".join(mark for mark, (at, _) in MARKS.items() if any(word in at for word in words))


def explained(marks: Iterable[str]) -> str:
    """Sentence on the marks that occur; empty where none does."""
    seen = set("".join(marks))
    texts = [f"{mark} {meaning}" for mark, (_, meaning) in MARKS.items() if mark in seen]
    return f"{'; '.join(texts)}." if texts else ""
