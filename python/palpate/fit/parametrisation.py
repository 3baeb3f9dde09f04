"""The parametrisation of a study by itself: the materials' searched parameters, friction, onset and gains."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from palpate.domain import (
    FRICTION,
    FloatArray,
    Indentation,
    Parameter,
    ParameterName,
    ParameterSpace,
    Prior,
    Protocol,
)
from palpate.domain.component import Settings
from palpate.errors import PalpateError, StudyError
from palpate.plugins.parametrisation import Parametrisation, SpotInputs, at_spot, for_each_spot, states_of
from palpate.units import Quantity

Ratio = Annotated[float, Quantity("1")]
Length = Annotated[float, Quantity("mm")]

OFFSET, GAIN, STIFFNESS = "depth_offset_mm", "gain", "stiffness"
"""Names of what is searched besides the materials; that of a gain is followed by its channel, that of a
factor on moduli by its region."""


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
    prior: KnownRatio | None = Field(default=None, description="Prior knowledge of the value.")
    by: Literal["spot", "state", "all"] | None = Field(
        default=None,
        description="One value for each spot (by itself for offset and gains), for each state of the person "
        "(stiffness), or one for all (friction).",
    )

    def parameter(self, name: str, description: str, by: Literal["spot", "state", "all"]) -> Parameter:
        """Make what is searched, by what it names or by itself ``by``."""
        by = self.by or by
        return Parameter(
            name=name,
            unit=self.unit,
            lower=self.lower,
            upper=self.upper,
            kind="shape",
            description=description,
            prior=Prior(value=self.prior.value, sd=self.prior.sd) if self.prior else None,
            by=None if by == "all" else by,
        )

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        try:
            self.parameter("searched", "", "all")
        except PalpateError as error:
            raise ValueError(str(error)) from None
        return self


class LengthRange(RatioRange):
    """The two ends between which a length is searched."""

    unit: ClassVar[str] = "mm"

    lower: Length = Field(description="Lower end, with its unit.")
    upper: Length = Field(description="Upper end, with its unit.")
    prior: KnownLength | None = Field(default=None, description="Prior knowledge of the value.")


class StandardSettings(Settings):
    """Quantities that are searched besides the materials' parameters."""

    friction: RatioRange | None = Field(default=None, description="Range of the Coulomb coefficient.")
    depth_offset: LengthRange | None = Field(
        default=None, description="Range of the depth at which the measured curves begin; above 0: too late."
    )
    gains: dict[str, RatioRange] = Field(
        default={}, description="Range of the factor from simulated to measured ordinates, by channel."
    )
    stiffness: dict[str, RatioRange] = Field(
        default={},
        description="Range of the factor on all moduli of a region, by region: of each state of the person "
        "over the first one.",
    )

    @field_validator("stiffness")
    @classmethod
    def _over_the_first_state(cls, stiffness: dict[str, RatioRange]) -> dict[str, RatioRange]:
        if any(each.by not in (None, "state") for each in stiffness.values()):
            raise ValueError("a factor on moduli is by state; leave `by` out")
        return stiffness


class StandardParametrisation(Parametrisation[StandardSettings]):
    """The searched parameters of the study's materials, and what a press may add to them."""

    name = "standard"
    summary = "the materials' parameters; on request friction, onset of contact and gains of channels"

    def parameters(self, space: ParameterSpace, spots: Sequence[str]) -> tuple[Parameter, ...]:
        """Parameters of the study, those by spot or state once for each, as ``<name>@<spot>``.

        A factor on moduli is 1 in the first state.

        Raises
        ------
        StudyError
            Something is by state and the spots have none, or a factor is of no region.
        """
        searched = [*space.parameters, *self._own()]
        self._check_states(space, searched)
        every = for_each_spot(searched, spots, space.states)
        first = ["", *states_of(spots, space.states)[:1]]
        factors = {
            str(ParameterName(STIFFNESS, r, state)) for r in self.settings.stiffness for state in first
        }
        return tuple(each for each in every if each.name not in factors)

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """Materials' parameters, friction and depth, onset and gains at a spot."""
        at = at_spot(values, spot, space.states)
        row = np.array([at[name] for name in space.names])
        thetas, offset = space.thetas(row), at.get(OFFSET, 0.0)
        if isinstance(protocol, Indentation) and (offset or FRICTION in at):
            path = protocol.path.copy()
            path[path[:, 0] > 0.0, 0] += offset
            protocol = replace(protocol, path=path, friction=at.get(FRICTION, protocol.friction))
        return SpotInputs(
            thetas={region: self._stiffened(space, region, of, at) for region, of in thetas.items()},
            protocol=protocol,
            offsets={"depth_mm": offset} if OFFSET in at else {},
            gains={channel: at[f"{GAIN}.{channel}"] for channel in self.settings.gains},
        )

    def _check_states(self, space: ParameterSpace, searched: Sequence[Parameter]) -> None:
        by_state = [each.name for each in searched if each.by == "state"]
        if by_state and not space.states:
            raise StudyError(
                f"{', '.join(by_state)}: is by state, and no spot has one; give each [[spot]] one, such as "
                'state = "rest"'
            )
        regions = [each.region for each in space.regions]
        if other := [region for region in self.settings.stiffness if region not in regions]:
            raise StudyError(
                f"fit.searched.stiffness: no region '{other[0]}' (known: {', '.join(regions)}); correct the "
                "name"
            )

    @staticmethod
    def _stiffened(
        space: ParameterSpace, region: str, theta: FloatArray, at: Mapping[str, float]
    ) -> FloatArray:
        """Values of a region's material, all moduli times the factor of the state."""
        if (factor := at.get(f"{STIFFNESS}.{region}")) is None:
            return theta
        (material,) = (each.material for each in space.regions if each.region == region)
        return np.array(
            [
                factor * x if p.kind == "modulus" else x
                for p, x in zip(material.parameters, theta, strict=True)
            ]
        )

    def start(self, protocols: Mapping[str, Protocol]) -> dict[str, float]:
        """The study's own friction, no offset, and gains of 1."""
        frictions = {spot: p.friction for spot, p in protocols.items() if isinstance(p, Indentation)}
        start = {str(ParameterName("", FRICTION, spot)): friction for spot, friction in frictions.items()}
        if frictions:
            start[FRICTION] = float(np.mean(list(frictions.values())))
        start |= {OFFSET: 0.0} | {f"{GAIN}.{channel}": 1.0 for channel in self.settings.gains}
        start |= {f"{STIFFNESS}.{region}": 1.0 for region in self.settings.stiffness}
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
            yield given.friction.parameter(FRICTION, "Coulomb coefficient", "all")
        if given.depth_offset:
            yield given.depth_offset.parameter(OFFSET, "depth where the measured curves begin", "spot")
        for channel, gain in given.gains.items():
            yield gain.parameter(f"{GAIN}.{channel}", f"factor on '{channel}'", "spot")
        for region, factor in given.stiffness.items():
            yield factor.parameter(f"{STIFFNESS}.{region}", f"factor on all moduli of '{region}'", "state")
