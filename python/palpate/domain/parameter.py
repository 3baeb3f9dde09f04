"""One parameter: its full name, unit, physical range and prior."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, Self

import numpy as np

from palpate.errors import ParameterError
from palpate.units import convert


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Prior of a number: a value and its standard deviation."""

    value: float
    sd: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.sd) and self.sd > 0.0):
            raise ParameterError(f"a prior of {self.value} with sd {self.sd}; give a finite value and sd > 0")


@dataclass(frozen=True, slots=True)
class ParameterName:
    """Full name of a parameter, ``region.name@spot`` in tables and files.

    Parameters
    ----------
    region : str
        Whose material it is of, or ``gain``; empty for what belongs to no region, such as friction.
    name : str
        Name in the material, or the channel of a gain.
    spot : str
        The only spot whose value it is, or the state of the spots; empty where all spots share it.
    """

    region: str
    name: str
    spot: str = ""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Name as it is in a table or a file."""
        shared, _, spot = text.partition("@")
        region, dot, name = shared.partition(".")
        return cls(region, name, spot) if dot else cls("", region, spot)

    def __str__(self) -> str:
        return f"{self.shared}@{self.spot}" if self.spot else self.shared

    @property
    def shared(self) -> str:
        """``region.name``, the name without its spot."""
        return f"{self.region}.{self.name}" if self.region else self.name

    def at(self, spot: str) -> Self:
        """Name of the same parameter at a spot; with an empty one, at all spots."""
        return type(self)(self.region, self.name, spot)

    def counts_at(self, spot: str, states: Mapping[str, str] = MappingProxyType({})) -> bool:
        """True if its value belongs to the spot, to the spot's state, or to all spots."""
        return self.spot in ("", spot, states.get(spot, spot))


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One number that is searched, or that a material needs.

    ``lower`` and ``upper`` are the default range of a sweep (region of interest);
    ``physical_lower`` and ``physical_upper`` are the limits of physical meaning.
    ``kind`` is ``modulus`` if it scales with stiffness, in a unit of pressure such as ``MPa``, and
    ``shape`` otherwise: a number without unit (``1``), or a time constant (``s``). A sweep spreads the
    value evenly, or its logarithm (``scale``). ``prior`` is what a fit knows of it before; ``by`` names
    what a fit of several spots finds one value for each of.
    """

    name: str
    unit: str
    lower: float
    upper: float
    kind: Literal["modulus", "shape"]
    description: str
    physical_lower: float = -np.inf
    physical_upper: float = np.inf
    scale: Literal["linear", "log"] = "linear"
    prior: Prior | None = None
    by: Literal["spot", "state"] | None = None

    def __post_init__(self) -> None:
        self._check_unit()
        if not self.lower < self.upper:
            raise ParameterError(
                f"parameter '{self.name}': lower {self.lower} must be less than upper {self.upper} "
                f"{self.unit}; swap them"
            )
        if self.scale == "log" and self.lower <= 0.0 <= self.upper:
            raise ParameterError(
                f"'{self.name}': log scale needs bounds > 0, got {self.lower:g} to {self.upper:g}"
            )
        for bound in (self.lower, self.upper):
            self.check(bound)
        if self.prior is not None:
            self._check_prior(self.prior)

    def _check_unit(self) -> None:
        if self.kind not in (kinds := ("modulus", "shape")):
            raise ParameterError(
                f"parameter '{self.name}': unknown kind {self.kind!r}; choose one of: {', '.join(kinds)}"
            )
        if self.kind == "modulus":
            try:
                convert(f"1 {self.unit}", "MPa")
            except ValueError:
                raise ParameterError(
                    f"parameter '{self.name}': a modulus in unit '{self.unit}', no unit of pressure; "
                    'use unit="MPa", or kind="shape" for another quantity'
                ) from None

    def _check_prior(self, prior: Prior) -> None:
        outside = max(self.lower - prior.value, prior.value - self.upper) / prior.sd
        # Standard deviations from a range to a prior's value beyond which they contradict each other.
        if outside > 3.0:
            raise ParameterError(
                f"'{self.name}': a prior of {prior.value:g} with sd {prior.sd:g} {self.unit} is "
                f"{outside:.3g} sd outside the range, {self.lower:g} to {self.upper:g}; correct either"
            )

    def check(self, value: float) -> None:
        """Refuse a value outside the physical range, or one that is not finite.

        Raises
        ------
        ParameterError
        """
        if not (np.isfinite(value) and self.physical_lower <= value <= self.physical_upper):
            raise ParameterError(
                f"parameter '{self.name}' = {value} {self.unit} is outside its physical range "
                f"{self._physical_range}; give a value inside it"
            )

    @property
    def in_logarithms(self) -> bool:
        """True if a search steps in the logarithm of the value."""
        return self.scale == "log" or (self.kind == "modulus" and self.lower > 0.0)

    def wider(self, *, below: bool) -> Self:
        """Parameter whose range goes on beyond one end as far again, within its physical limits."""
        lower, upper = self.lower, self.upper
        down, up = 2.0 * lower - upper, 2.0 * upper - lower
        if self.in_logarithms:
            down, up = lower * (lower / upper), upper * (upper / lower)
        if below:
            return replace(self, lower=max(down, self.physical_lower))
        return replace(self, upper=min(up, self.physical_upper))

    @property
    def _physical_range(self) -> str:
        # The least positive number is how an open lower limit of zero is written.
        if self.physical_lower == sys.float_info.min and self.physical_upper == np.inf:
            return f"(> 0 {self.unit})"
        return f"[{self.physical_lower}, {self.physical_upper}] {self.unit}"
