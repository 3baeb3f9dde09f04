"""A value as every output shows it: its digits, its interval and its verdict."""

import re
from dataclasses import dataclass

from palpate.api import Parameter
from palpate.api.fit import Adequacy, verdict_of
from palpate.api.report import rounded


def with_minus(text: str) -> str:
    """Text with true minus signs in front of numbers, not within names and dates."""
    return re.sub(r"(?<![\w.-])-(?=\d)", "−", text)


def in_words(name: str) -> str:
    """Name of a channel or part for readers, as ``pure shear``."""
    return name.replace("_", " ")


def with_unit(text: str, unit: str) -> str:
    """A number and its unit, if it has one."""
    return text if unit in ("", "1") else f"{text} {unit}"


def range_of(parameter: Parameter) -> str:
    """Name of a parameter with its range and unit."""
    return with_unit(f"{parameter.name} {parameter.lower:.4g} to {parameter.upper:.4g}", parameter.unit)


@dataclass(frozen=True, slots=True, kw_only=True)
class Headline:
    """A value with what may be read of it.

    Parameters
    ----------
    parameter : str
        Brief name; ``<name>@<spot>`` where each spot has its own; or the name of a modulus.
    name : str
        Full name of a parameter.
    value, optimum, lower, upper : float or None
        None where they are unknown, and the value where it differs from spot to spot. The optimum is that
        between the sets of a sweep, one of which need not be in the interval.
    identifiability : str
        Word of :mod:`palpate.answer.words`; empty where none is known.
    level : float or None
        0.95 for the interval of a fit; None for the values that fit about as well in the sweep.
    at_bound : bool
        The value is at an end of its range.
    model : Adequacy
        Verdict on the model of its fit.
    """

    parameter: str
    unit: str
    value: float | None
    name: str = ""
    optimum: float | None = None
    lower: float | None = None
    upper: float | None = None
    identifiability: str = ""
    level: float | None = None
    at_bound: bool = False
    model: Adequacy = Adequacy.DESCRIBES

    @property
    def verdict(self) -> str:
        """Verdict on the value, in words; empty where nothing is known."""
        return verdict_of(self.identifiability, at_bound=self.at_bound, model=self.model)

    @property
    def is_in_interval(self) -> bool:
        """Whether the interval holds the value, where both are known."""
        if self.value is None or self.lower is None or self.upper is None:
            return True
        return self.lower <= self.value <= self.upper

    @property
    def label(self) -> str:
        """Name with its unit."""
        return self.parameter if self.unit in ("", "1") else f"{self.parameter} ({self.unit})"

    @property
    def text(self) -> str:
        """The value, with the digits that its interval determines."""
        return "by spot" if self.value is None else rounded(self.value, self.lower, self.upper)

    @property
    def interval(self) -> str:
        """The ends of the interval; empty where there is none."""
        if self.lower is None or self.upper is None:
            return ""
        lower, upper = (rounded(end, self.lower, self.upper) for end in (self.lower, self.upper))
        return f"{lower} to {upper}"

    def __str__(self) -> str:
        value = self.text if self.value is None else f"= {with_unit(self.text, self.unit)}"
        known = ", ".join(text for text in (self.interval, self.verdict) if text)
        return f"{self.parameter} {value}" + (f" ({known})" if known else "")
