"""Rules by which curves are compared: divisors, weights of points and of channels."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from palpate.domain.curves import PHASES, channel_of
from palpate.errors import ScoringError


class Normaliser(StrEnum):
    """Divisor of the squared error, computed on the measured curve.

    ``MEAN`` is the paper's; over a symmetric twist it is close to zero, and
    scoring refuses it there. ``UNIT`` divides by one: plain mean squared error.
    """

    MEAN_ABS = "mean_abs"
    MEAN = "mean"
    RMS = "rms"
    RANGE = "range"
    STD = "std"
    UNIT = "unit"


class PointWeighting(StrEnum):
    """Weight of each measured point: equal, or 1/std² of its ordinate."""

    EQUAL = "equal"
    STD = "std"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """Weights of channels, or of phases such as ``torque/unload``: Fopt = Σ weight · NMSE."""

    name: str
    weights: Mapping[str, float]
    description: str = ""

    def __post_init__(self) -> None:
        weights = dict(self.weights)
        for name in weights:
            channel_of(name)
        sound = all(np.isfinite(w) and w >= 0.0 for w in weights.values())
        if not sound or not any(weights.values()):
            raise ScoringError(
                f"scenario '{self.name}': weights {weights} must be >= 0, finite, and at least one > 0"
            )
        object.__setattr__(self, "weights", MappingProxyType(weights))

    @property
    def weighed(self) -> dict[str, float]:
        """Weights above zero."""
        return {name: weight for name, weight in self.weights.items() if weight > 0.0}

    def fits(self, name: str) -> bool:
        """Whether every point of a channel, or of a phase of it, has a weight."""
        phases = {f"{name}/{phase}" for phase in PHASES}
        return not {name, channel_of(name)}.isdisjoint(self.weighed) or phases <= self.weighed.keys()


def weighed_phases(scenarios: Iterable[Scenario]) -> tuple[str, ...]:
    """Names of the phases that scenarios weigh, such as ``torque/unload``."""
    names = (name for scenario in scenarios for name in scenario.weighed)
    return tuple(dict.fromkeys(name for name in names if name != channel_of(name)))


def weighed_channels(scenarios: Iterable[Scenario], measured: Iterable[str]) -> list[str]:
    """Measured channels that a scenario weighs, each once."""
    weighed = {channel_of(name) for scenario in scenarios for name in scenario.weighed}
    return [name for name in dict.fromkeys(measured) if name in weighed]
