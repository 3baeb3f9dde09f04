"""The channel map: which columns of a log are time, pose and wrench, and in what form."""

import re
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from palpate.api import CurveError, Quantity, Settings

Length = Annotated[float, Quantity("mm")]
Angle = Annotated[float, Quantity("deg")]
Seconds = Annotated[float, Quantity("s")]

NO_COLUMN = "0"  # written for a column where the sensor has no such axis: zero throughout
N_COLUMNS = {"quaternion": 4, "euler": 3, "axis_angle": 3, "rotation_matrix": 9, "fixed": 0}


class Time(Settings):
    """The column of time."""

    column: str = Field(min_length=1, description="Name of the column; in every stream that is used.")
    unit: str | None = Field(default=None, description="Its unit, when its name does not show it.")
    rate: Annotated[float, Quantity("Hz")] | None = Field(
        default=None, gt=0.0, description="Rate of the rows, where the column counts them."
    )
    nanoseconds: str | None = Field(
        default=None, description="Column of nanoseconds to add, where the other has whole seconds."
    )

    @model_validator(mode="after")
    def _check_rate(self) -> Self:
        if self.rate is not None and (self.unit is not None or self.nanoseconds is not None):
            raise ValueError("rate is of a column that counts rows; leave unit and nanoseconds out")
        return self

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of its columns."""
        return (self.column,) if self.nanoseconds is None else (self.column, self.nanoseconds)


def _named(given: object) -> object:
    return {"column": given} if isinstance(given, str) else given


class Source(Settings):
    """Source of columns."""

    stream: str | None = Field(
        default=None, description="Topic of a bag, when several have columns of these names."
    )
    time: Annotated[Time | None, BeforeValidator(_named, json_schema_input_type=str | Time | None)] = Field(
        default=None, description="Column of time of these columns, when it is not the map's own."
    )
    unit: str | None = Field(
        default=None, description="Unit of the columns, when their names do not show it."
    )


class Vector(Source):
    """Three columns that are x, y and z of a vector."""

    @field_validator("columns")
    @classmethod
    def _once(cls, columns: list[str]) -> list[str]:
        names = [name.removeprefix("-") for name in columns if name != NO_COLUMN]
        for name in (each for each in names if names.count(each) > 1):
            raise ValueError(f"'{name}' is named twice; give x, y and z their own columns")
        return columns

    columns: list[str] = Field(
        min_length=3,
        max_length=3,
        description='Columns of x, y, z. A minus before a name turns its sign; "0": no such axis.',
    )


class Orientation(Source):
    """Columns that give the tool's orientation."""

    form: Literal["quaternion", "euler", "axis_angle", "rotation_matrix", "fixed"] = Field(
        default="quaternion",
        description="quaternion: columns of x, y, z, w in this order. euler: three angles in the order of "
        "sequence. axis_angle: rotation vector. rotation_matrix: nine columns, row by row. "
        "fixed: no columns, the tool keeps the quaternion of value.",
    )
    columns: list[str] = Field(default=[], description="The columns, as form defines them.")
    sequence: str = Field(
        default="xyz",
        pattern=r"^([xyz]{3}|[XYZ]{3})$",
        description="Axes of Euler angles: xyz about fixed axes, XYZ about axes that turn along.",
    )
    value: list[float] = Field(
        default=[0.0, 0.0, 0.0, 1.0],
        min_length=4,
        max_length=4,
        description="Quaternion x, y, z, w of fixed.",
    )
    inverse: bool = Field(
        default=False, description="The columns turn base into tool instead of tool into base."
    )

    @model_validator(mode="after")
    def _check_columns(self) -> Self:
        needed = N_COLUMNS[self.form]
        if len(self.columns) != needed:
            raise ValueError(f"form '{self.form}' needs {needed} columns, not {len(self.columns)}; name them")
        return self


class LogFiles(Settings):
    """Names of the two files of each press."""

    pose: str = Field(description='Measured file of the study, such as "{}_pose.csv"; {} is any text.')
    wrench: str = Field(description='The other file, in its folder, such as "{}_ft.csv", with the same text.')

    @field_validator("pose", "wrench")
    @classmethod
    def _one_place(cls, name: str) -> str:
        if name.count("{}") > 1 or "/" in name or "\\" in name:
            raise ValueError("must be a file name with {} once at most")
        return name

    def wrench_of(self, pose: Path) -> Path:
        """File of the wrench next to the file of the pose; a CurveError where the name does not fit."""
        found = re.fullmatch(re.escape(self.pose).replace(re.escape("{}"), "(.*)"), pose.name)
        if found is None:
            raise CurveError(
                f"{pose}: the name does not fit files.pose = '{self.pose}'; give the file of the pose as "
                "measured, or correct files"
            )
        return pose.with_name(self.wrench.replace("{}", found[1] if found.groups() else ""))

    @classmethod
    def of(cls, pose: Path, wrench: Path) -> "LogFiles":
        """Names with the beginning that both share, or else the end of their stems, left open."""
        if n := _n_alike(pose.stem, wrench.stem):
            names = ["{}" + file.name[n:] for file in (pose, wrench)]
        elif n := _n_alike(pose.stem[::-1], wrench.stem[::-1]):
            names = [file.stem[:-n] + "{}" + file.suffix for file in (pose, wrench)]
        else:
            names = [pose.name, wrench.name]
        return cls(pose=names[0], wrench=names[1])


def _n_alike(first: str, second: str) -> int:
    """Number of characters at the beginning that are the same, without separators at their end."""
    pairs = takewhile(lambda pair: pair[0] == pair[1], zip(first, second, strict=False))
    return len("".join(letter for letter, _ in pairs).rstrip("_-. "))


class Plausible(Settings):
    """Bounds beyond which a unit is taken to be wrong. Widen them where the set-up calls for it."""

    longest_step: Seconds = Field(default=2.0, gt=0.0, description="Median time from row to row, at most.")
    shortest_step: Seconds = Field(default=1e-5, gt=0.0, description="Median time from row to row, at least.")
    travel: tuple[Length, Length] = Field(
        default=(0.1, 3000.0), description="Least and largest extent of the tip's way."
    )
    reach: Length = Field(default=20_000.0, gt=0.0, description="Largest distance of the tip from the base.")
    force: tuple[Annotated[float, Quantity("N")], Annotated[float, Quantity("N")]] = Field(
        default=(0.05, 2000.0), description="Least and largest range of the force over the log."
    )
    lever: tuple[Length, Length] = Field(
        default=(0.02, 1500.0), description="Least and largest range of moment over force."
    )
    small_angles: bool = Field(
        default=False, description="Angles in degrees are all below 2π and are degrees all the same."
    )


class ChannelMap(Settings):
    """Columns of a log that are time, pose and wrench, and what they mean."""

    time: Annotated[Time, BeforeValidator(_named, json_schema_input_type=str | Time)] = Field(
        description="Column of time, or a table of column and unit."
    )
    position: Vector = Field(description="Tool tip in the base frame.")
    orientation: Orientation = Field(description="How the tool is turned, from tool to base.")
    force: Vector = Field(description="Force on the sensor.")
    moment: Vector = Field(description="Moment about the sensor's origin.")
    acts_on: Literal["tool", "tissue"] = Field(
        default="tool", description="Whether the tissue's wrench on the tool was logged, or its reaction."
    )
    wrench_frame: Literal["sensor", "base"] = Field(
        default="sensor", description="Frame in which the wrench is written."
    )
    sensor_turned: list[Angle] = Field(
        default=[0.0, 0.0, 0.0],
        min_length=3,
        max_length=3,
        description="Turns of the sensor's frame in the tool's: about the tool's x, y and z in this order.",
    )
    tip: list[Length] = Field(
        default=[0.0, 0.0, 0.0],
        min_length=3,
        max_length=3,
        description="Tool tip in the frame whose position is logged, such as the flange's.",
    )
    clocks: Literal["common", "own"] = Field(
        default="common",
        description="Whether pose and wrench have one clock; own: press and push give the shift.",
    )
    common_time: Literal["wrench", "pose"] = Field(
        default="wrench", description="Whose time stamps are kept when the two have their own."
    )
    header_units: bool = Field(
        default=True, description="Believe units that the file shows; false: only the units of this map."
    )
    missing: Literal["refuse", "skip"] = Field(
        default="refuse", description="Rows without a value: an error, or passed over and interpolated."
    )
    repeated_time: Literal["refuse", "keep_first"] = Field(
        default="refuse", description="Rows with the time of the row before: an error, or left out."
    )
    max_gap: Seconds | None = Field(
        default=None,
        gt=0.0,
        description="Longest time without a row; ten usual steps, at least 20 ms, if left out.",
    )
    force_limit: Annotated[float, Quantity("N")] | None = Field(
        default=None,
        gt=0.0,
        description="Range of the sensor's force axes; a value that reaches it is refused.",
    )
    moment_limit: Annotated[float, Quantity("N·mm")] | None = Field(
        default=None,
        gt=0.0,
        description="Range of the sensor's moment axes; a value that reaches it is refused.",
    )
    stuck: Seconds = Field(
        default=0.25, gt=0.0, description="Longest time for which the wrench may repeat to the last digit."
    )
    plausible: Plausible = Field(default=Plausible(), description="Bounds beyond which a unit must be wrong.")
