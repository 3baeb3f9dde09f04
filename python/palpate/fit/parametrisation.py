"""The parametrisation of a study by itself: the materials' searched parameters, friction, onset and gains."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.domain import Parameter, ParameterSpace, Protocol
from palpate.plugins.parametrisation import Parametrisation, SpotInputs


class StandardParametrisation(Parametrisation):
    """The searched parameters of the study's materials, one value for all spots or one for each."""

    name = "standard"
    summary = "the materials' parameters; on request friction, onset of contact and gains of channels"

    def parameters(self, space: ParameterSpace, spots: Sequence[str]) -> tuple[Parameter, ...]:
        """Parameters of the study, those ``by_spot`` once for each spot as ``<name>@<spot>``."""
        return tuple(self._expanded(space.parameters, spots))

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """Materials' parameters at a spot."""
        row = np.array([values[self._name(p, spot, values)] for p in space.parameters])
        return SpotInputs(thetas=space.thetas(row), protocol=protocol)

    @staticmethod
    def _expanded(parameters: Sequence[Parameter], spots: Sequence[str]) -> Iterator[Parameter]:
        for parameter in parameters:
            if parameter.by_spot and len(spots) > 1:
                yield from (replace(parameter, name=f"{parameter.name}@{spot}") for spot in spots)
            else:
                yield parameter

    @staticmethod
    def _name(parameter: Parameter, spot: str, values: Mapping[str, float]) -> str:
        return parameter.name if parameter.name in values else f"{parameter.name}@{spot}"
