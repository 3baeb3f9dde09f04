"""Settings of every step between a recording and its curves."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from palpate.api import Quantity, Settings

Seconds = Annotated[float, Quantity("s")]
Length = Annotated[float, Quantity("mm")]
Weight = Annotated[float, Quantity("N")]
Direction = tuple[float, float, float]
Offset = tuple[Length, Length, Length]


class Switch(Settings):
    """A step that is done or left out."""

    enabled: bool = Field(default=True, description="Whether the step is done.")


class Window(Settings):
    """Part of the log that is used."""

    start: Seconds | None = Field(default=None, description="Rows before this time stamp are left out.")
    stop: Seconds | None = Field(default=None, description="Rows after this time stamp are left out.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.start is not None and self.stop is not None and not self.start < self.stop:
            raise ValueError("start must be less than stop")
        return self


class Thinning(Settings):
    """Averages of neighbouring rows in very long logs."""

    enabled: bool = Field(default=True, description="Average neighbouring rows of a log with too many.")
    max_rows: int = Field(default=50_000, ge=1000, description="Rows that are kept at most.")


class Alignment(Settings):
    """Lag of the wrench behind the pose."""

    enabled: bool = Field(default=True, description="Estimate the lag and take it out where significant.")
    lag: Seconds | None = Field(default=None, description="Known lag of the wrench; estimated when left out.")


class Gravity(Settings):
    """Weight of the tool."""

    method: Literal["off", "known", "fit"] = Field(
        default="off",
        description="off: the weight stays in the bias; known: weight and centre; fit: from poses in air.",
    )
    weight: Weight | None = Field(default=None, description="Weight of all that the sensor carries.")
    centre: Offset = Field(
        default=(0.0, 0.0, 0.0), description="Its centre in the sensor's frame, from where moments are about."
    )
    direction: Direction = Field(
        default=(0.0, 0.0, -1.0), description="Direction of gravity in the base frame."
    )

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.method == "known" and self.weight is None:
            raise ValueError("method = 'known' needs weight")
        if self.method != "known" and self.weight is not None:
            raise ValueError("weight is used with method = 'known' only")
        if not any(self.direction):
            raise ValueError("direction must not be zero")
        return self


class NormalChoice(Settings):
    """Normal of the spot."""

    method: Literal["path", "tool_axis", "given"] = Field(
        default="path", description="path: of the press; tool_axis: against the sensor's z; given: vector."
    )
    vector: Direction | None = Field(default=None, description="Outward normal in the base frame.")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.method == "given") != (self.vector is not None):
            raise ValueError("vector goes with method = 'given'")
        if self.vector is not None and not any(self.vector):
            raise ValueError("vector must not be zero")
        return self


class SpotFrame(Settings):
    """Frame of the wrench."""

    sensor_to_tip: Offset = Field(
        default=(0.0, 0.0, 0.0),
        description="Tool tip in the sensor's frame, from the point that moments are about.",
    )


class OnsetChoice(Settings):
    """First contact."""

    method: Literal["law", "given"] = Field(
        default="law", description="law: fit of a contact law to the rising force; given: time."
    )
    exponent: float = Field(
        default=1.5,
        ge=1.0,
        le=3.0,
        description="Of the law: sphere 1.5, sphere on skin over softer tissue 1.3, flat punch 1, cone 2.",
    )
    time: Seconds | None = Field(default=None, description="Time stamp of first contact.")

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.method == "given") != (self.time is not None):
            raise ValueError("time goes with method = 'given'")
        return self


class Smoothing(Settings):
    """Smoothing within each branch."""

    method: Literal["savgol", "none"] = Field(default="savgol", description="Savitzky-Golay, or none.")
    window: Seconds | None = Field(
        default=None, gt=0.0, description="Savitzky-Golay window; as long as its bias allows when left out."
    )
    order: int = Field(default=3, ge=1, le=5, description="Degree of the Savitzky-Golay polynomial.")


class Resampling(Settings):
    """Points of the curves."""

    enabled: bool = Field(
        default=True, description="Even steps of depth and rotation; else the rows of the log."
    )
    points: int = Field(default=61, ge=5, le=2001, description="Points of each branch.")


class ProcessingSettings(Settings):
    """Every step, in the order in which they are done."""

    window: Window = Field(default_factory=Window, description="Part of the log that is used.")
    thinning: Thinning = Field(default_factory=Thinning, description="Averaging of very long logs.")
    spikes: Switch = Field(
        default_factory=Switch, description="Replace spikes of the wrench by their neighbours' median."
    )
    alignment: Alignment = Field(default_factory=Alignment, description="Lag of the wrench behind the pose.")
    normal: NormalChoice = Field(default_factory=NormalChoice, description="Normal of the spot.")
    gravity: Gravity = Field(default_factory=Gravity, description="Weight of the tool.")
    drift: Switch = Field(
        default_factory=Switch,
        description="Drift of the sensor: take out a line through the rows in free air before and after the "
        "press.",
    )
    tare: Switch = Field(
        default_factory=Switch, description="Bias of the sensor: take out the mean wrench in free air."
    )
    frame: SpotFrame = Field(default_factory=SpotFrame, description="Frame and axis of the wrench.")
    onset: OnsetChoice = Field(default_factory=OnsetChoice, description="First contact.")
    smoothing: Smoothing = Field(default_factory=Smoothing, description="Smoothing of each branch.")
    resampling: Resampling = Field(default_factory=Resampling, description="Points of the curves.")
    slide: Switch = Field(
        default=Switch(enabled=False),
        description="Slide along the skin after the press: gives `lateral_force`. Moments are then about the "
        "tip, which leaves the contact axis.",
    )
    over_time: Switch = Field(
        default=Switch(enabled=False),
        description="Force from first contact to the end of the rest after the press: `force_over_time`.",
    )
    relaxation: Switch = Field(
        default_factory=Switch, description="Measure how far force and torque fall in each dwell."
    )
