"""The parametrisation of a study by itself: the materials' searched parameters, friction, onset and gains."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from palpate.domain import Indentation, Parameter, ParameterName, ParameterSpace, Prior, Protocol
from palpate.domain.component import Settings
from palpate.errors import PalpateError
from palpate.plugins.parametrisation import Parametrisation, SpotInputs, at_spot, for_each_spot
from palpate.units import Quantity

Ratio = Annotated[float, Quantity("1")]
Length = Annotated[float, Quantity("mm")]

FRICTION, OFFSET, GAIN = "friction", "depth_offset_mm", "gain"
"""Names of what is searched besides the materials; a gain's is followed by its channel."""


class KnownRatio(Settings):
    """Prior of a ratio."""

    value: Ratio = Field(description="The value expected.")
    sd: Ratio = Field(gt=0.0, description="Its standard deviation.")


class KnownLength(KnownRatio):
    """Prior of a length."""

    value: Length = Field(description="The length expected, with its unit.")
    sd: Length = Field(gt=0.0, description="Its standard deviation, with its unit.")


class RatioRange(Settings):
    """The two ends between which a ratio is searched."""

    unit: ClassVar[str] = "1"

    lower: Ratio = Field(ge=0.0, description="Lower end.")
    upper: Ratio = Field(description="Upper end.")
    prior: KnownRatio | None = Field(default=None, description="What is known of it.")
    by: Literal["spot", "all"] | None = Field(
        default=None,
        description="One value for each spot (by itself for offset and gains), or one for all (friction).",
    )

    def parameter(self, name: str, description: str, *, by_spot: bool) -> Parameter:
        """Make what is searched."""
        return Parameter(
            name=name,
            unit=self.unit,
            lower=self.lower,
            upper=self.upper,
            kind="shape",
            description=description,
            prior=Prior(value=self.prior.value, sd=self.prior.sd) if self.prior else None,
            by_spot=by_spot,
        )

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        try:
            self.parameter("searched", "", by_spot=False)
        except PalpateError as error:
            raise ValueError(str(error)) from None
        return self


class LengthRange(RatioRange):
    """The two ends between which a length is searched."""

    unit: ClassVar[str] = "mm"

    lower: Length = Field(description="Lower end, with its unit.")
    upper: Length = Field(description="Upper end, with its unit.")
    prior: KnownLength | None = Field(default=None, description="What is known of it.")


class StandardSettings(Settings):
    """Quantities that are searched besides the materials' parameters."""

    friction: RatioRange | None = Field(default=None, description="Range of the Coulomb coefficient.")
    depth_offset: LengthRange | None = Field(
        default=None, description="Range of the depth at which the measured curves begin; above 0: too late."
    )
    gains: dict[str, RatioRange] = Field(
        default={}, description="Range of the factor from simulated to measured ordinates, by channel."
    )


class StandardParametrisation(Parametrisation[StandardSettings]):
    """The searched parameters of the study's materials, and what a press may add to them."""

    name = "standard"
    summary = "the materials' parameters; on request friction, onset of contact and gains of channels"

    def parameters(self, space: ParameterSpace, spots: Sequence[str]) -> tuple[Parameter, ...]:
        """Parameters of the study, those ``by_spot`` once for each spot as ``<name>@<spot>``."""
        return for_each_spot([*space.parameters, *self._own()], spots)

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """Materials' parameters, friction and depth, onset and gains at a spot."""
        at = at_spot(values, spot)
        row = np.array([at[name] for name in space.names])
        offset = at.get(OFFSET, 0.0)
        if isinstance(protocol, Indentation) and (offset or FRICTION in at):
            path = protocol.path.copy()
            path[path[:, 0] > 0.0, 0] += offset
            protocol = replace(protocol, path=path, friction=at.get(FRICTION, protocol.friction))
        return SpotInputs(
            thetas=space.thetas(row),
            protocol=protocol,
            offsets={"depth_mm": offset} if OFFSET in at else {},
            gains={channel: at[f"{GAIN}.{channel}"] for channel in self.settings.gains},
        )

    def start(self, protocols: Mapping[str, Protocol]) -> dict[str, float]:
        """The study's own friction, no offset, and gains of 1."""
        frictions = {spot: p.friction for spot, p in protocols.items() if isinstance(p, Indentation)}
        start = {str(ParameterName("", FRICTION, spot)): friction for spot, friction in frictions.items()}
        if frictions:
            start[FRICTION] = float(np.mean(list(frictions.values())))
        start |= {OFFSET: 0.0} | {f"{GAIN}.{channel}": 1.0 for channel in self.settings.gains}
        searched = {p.name for p in self._own()}
        return {name: value for name, value in start.items() if ParameterName.parse(name).shared in searched}

    def unusable(self, channels: Sequence[str], *, indents: bool) -> Iterator[tuple[tuple[str, ...], str]]:
        """Friction and onset of homogeneous tests, and gains of channels that no curve shows."""
        for key in ("friction", "depth_offset") if not indents else ():
            if getattr(self.settings, key) is not None:
                yield (key,), "homogeneous tests have none; remove the table, or give the study a [protocol]"
        for channel in self.settings.gains.keys() - set(channels) if channels else ():
            yield (
                ("gains", channel),
                f"no spot measures '{channel}', or no scenario weighs it (searched may be "
                f"{', '.join(channels)}); correct the name, or remove it",
            )

    def _own(self) -> Iterator[Parameter]:
        given = self.settings
        if given.friction:
            friction, by_spot = given.friction, given.friction.by == "spot"
            yield friction.parameter(FRICTION, "Coulomb coefficient", by_spot=by_spot)
        if given.depth_offset:
            onset, by_spot = given.depth_offset, given.depth_offset.by != "all"
            yield onset.parameter(OFFSET, "depth where the measured curves begin", by_spot=by_spot)
        for channel, gain in given.gains.items():
            yield gain.parameter(f"{GAIN}.{channel}", f"factor on '{channel}'", by_spot=gain.by != "all")
