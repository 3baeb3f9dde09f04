"""Parametrisations: from searched numbers to what is simulated at each spot."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

from palpate.domain import (
    FloatArray,
    Parameter,
    ParameterName,
    ParameterSpace,
    Protocol,
    Response,
    Scenario,
    channel_of,
)
from palpate.domain.component import Component, SettingsT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotInputs:
    """Inputs of the simulation at a spot, and how the answer is compared with the measurement.

    Parameters
    ----------
    thetas : mapping of region to (n_parameters,) array
        Textbook values in the order of the material's parameters.
    protocol : Protocol
        The study's, or one with another friction or path.
    offsets : mapping of abscissa to float
        Added to the measured abscissae of that name, such as ``depth_mm``, in its unit.
    gains : mapping of channel to float
        Factors on the simulated ordinates.
    observe : callable, optional
        From the simulated response to that which is measured, smooth in the searched values, such as by a
        law of relaxation. By itself both are the same.
    mesh : str
        Name of another mesh of the spot, as of :class:`~palpate.domain.Job`.
    """

    thetas: Mapping[str, FloatArray]
    protocol: Protocol
    offsets: Mapping[str, float] = field(default_factory=dict)
    gains: Mapping[str, float] = field(default_factory=dict)
    observe: Callable[[Response], Response] | None = None
    mesh: str = ""


class Parametrisation(Component[SettingsT]):
    """Meaning of the searched parameters at each spot."""

    relaxing: ClassVar[frozenset[str]] = frozenset()
    """Channels whose relaxation is part of the model."""

    @property
    def times_s(self) -> Mapping[str, float]:
        """Time constants, by the names of the searched shares of all moduli that relax with them."""
        return {}

    def models_relaxation(self, scenario: Scenario) -> bool:
        """True if the model has the relaxation of all that a scenario weighs: none is then warned of."""
        return set(map(channel_of, scenario.weighed)) <= self.relaxing

    @abstractmethod
    def parameters(self, space: ParameterSpace, spots: Sequence[str]) -> tuple[Parameter, ...]:
        """Everything that is searched at these spots together, with its bounds and prior.

        Parameters
        ----------
        space : ParameterSpace
            Materials of the study and which of their parameters are searched.
        spots : sequence of str
            Whose curves are fitted together; a parameter that each has for itself is here once for each.
        """

    @abstractmethod
    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """Inputs of the simulation at a spot for these values, by the names of :meth:`parameters`.

        A smooth function of the values: it is differentiated by differences.
        """

    def start(self, protocols: Mapping[str, Protocol]) -> Mapping[str, float]:
        """Values by name at which a search starts where neither a sweep nor a prior gives them.

        A name without ``@<spot>`` serves every spot; what is not named starts in the middle of its range.

        Parameters
        ----------
        protocols : mapping of spot name to Protocol
            As the study has them.
        """
        return {}

    def unusable(self, channels: Sequence[str], *, indents: bool) -> Iterator[tuple[tuple[str, ...], str]]:
        """Settings that mean nothing in a study, refused before anything is simulated.

        Parameters
        ----------
        channels : sequence of str
            Those that its spots measure and its scenarios weigh; empty where that is not known yet.
        indents : bool
            Whether it has a protocol, and not homogeneous tests.

        Yields
        ------
        tuple
            Key inside the settings, and why it is refused.
        """
        yield from ()


def for_each_spot(
    parameters: Sequence[Parameter], spots: Sequence[str], states: Mapping[str, str] = MappingProxyType({})
) -> tuple[Parameter, ...]:
    """Parameters, those by spot or state once for each of several, as ``<name>@<spot>`` or ``@<state>``."""
    each = {None: [""], "spot": list(spots), "state": states_of(spots, states)}
    return tuple(
        replace(parameter, name=str(ParameterName.parse(parameter.name).at(one)))
        for parameter in parameters
        for one in (each[parameter.by] if len(each[parameter.by]) > 1 else [""])
    )


def states_of(spots: Sequence[str], states: Mapping[str, str]) -> list[str]:
    """Different states of these spots, in the study's order."""
    return list(dict.fromkeys(state for spot, state in states.items() if spot in spots))


def at_spot(
    values: Mapping[str, float], spot: str, states: Mapping[str, str] = MappingProxyType({})
) -> dict[str, float]:
    """Values that count at a spot in its state, by name without ``@<spot>``."""
    named = ((ParameterName.parse(name), value) for name, value in values.items())
    return {name.shared: value for name, value in named if name.counts_at(spot, states)}
