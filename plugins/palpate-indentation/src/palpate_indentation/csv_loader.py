"""Loader of curves in delimited text files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal, Protocol, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from palpate.api import (
    EQUILIBRIUM_CHANNELS,
    Curve,
    CurveError,
    ExperimentLoader,
    FloatArray,
    IntArray,
    Response,
    Settings,
)
from palpate.api.files import (
    DELIMITERS,
    Column as TableColumn,
    Kind,
    TextFormat,
    TextTable,
    factor_to_base,
    factors_of,
    kind_of,
    unit_in,
)
from palpate.api.runs import moving_span
from palpate_indentation.measures import STRAINS, Strain, Stress, nominal_factor, problem_of

_LARGEST = 1e150
_FARTHEST_SHARE, _CYCLE_SHARE = 0.999, 0.1
"""Shares of the way at which it is at its end, and that is a cycle once the abscissa is back."""


def _not_zero(scale: float | None) -> float | None:
    if scale == 0.0:
        raise ValueError("a scale of 0 erases the column; give another factor")
    return scale


class Column(Settings):
    """A column of the file, with scale and offset to the channel's unit."""

    name: str = Field(min_length=1, description="Name of the column in the header line.")
    scale: Annotated[float | None, AfterValidator(_not_zero)] = Field(
        default=None,
        description="Factor from the file's unit to the channel's; left out: by the file's unit.",
    )
    offset: float = Field(default=0.0, description="Added after scaling; 1 converts a strain to a stretch.")


def _named(given: object) -> object:
    return {"name": given} if isinstance(given, str) else given


ColumnChoice = Annotated[Column, BeforeValidator(_named, json_schema_input_type=str | Column)]


class ChannelColumns(Settings):
    """The columns of a channel's curve."""

    abscissa: ColumnChoice = Field(description="Column name, or a table of name, scale and offset.")
    ordinate: ColumnChoice = Field(description="Column name, or a table of name, scale and offset.")
    std: ColumnChoice | None = Field(
        default=None, description="Column of the ordinate's standard deviation; its offset is 0."
    )
    time: ColumnChoice | None = Field(default=None, description="Column of the time; scale is to seconds.")
    strain: Strain = Field(
        default="stretch",
        description="Measure of the scaled abscissa of a homogeneous test: stretch, or a strain to convert, "
        "logarithmic or of Green and Lagrange. A nominal strain is a stretch with offset = 1.",
    )
    stress: Stress = Field(
        default="nominal",
        description="Measure of the scaled ordinate of a homogeneous test: nominal, true (Cauchy) or pk2 "
        "(second Piola-Kirchhoff), which are converted as of a specimen that keeps its volume.",
    )
    rows: Literal["all", "loading"] = Field(
        default="all",
        description="loading: rows to where the abscissa is farthest from its first value, from the last at "
        "or below 0, or from the last cycle's begin; no approach, cycle before or way back.",
    )

    @property
    def by_field(self) -> dict[str, Column]:
        """Columns by the field of the curve; without a standard deviation or a time where there is none."""
        known = {"abscissa": self.abscissa, "ordinate": self.ordinate, "std": self.std, "time_s": self.time}
        return {field: column for field, column in known.items() if column is not None}


def _columns(abscissa: str, ordinate: str) -> ChannelColumns:
    return ChannelColumns(abscissa=Column(name=abscissa), ordinate=Column(name=ordinate))


FOREARM = MappingProxyType(
    {"force": _columns("depth_mm", "force_N"), "torque": _columns("angle_deg", "torque_Nmm")}
)
"""Columns of one file with both of the forearm's channels."""

HOMOGENEOUS = MappingProxyType(
    {
        **{
            mode: _columns("stretch", "stress_MPa")
            for mode in ("uniaxial", "equibiaxial", "pure_shear", "confined_compression")
        },
        "simple_shear": _columns("shear", "stress_MPa"),
    }
)
"""Columns of a file with the one channel of a homogeneous test."""

_UNITS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        **{
            channel.name: (
                channel.abscissa_label.rpartition("(")[2].removesuffix(")"),
                channel.ordinate_label.rpartition("(")[2].removesuffix(")"),
            )
            for channel in EQUILIBRIUM_CHANNELS
        },
        **dict.fromkeys(HOMOGENEOUS, ("1", "MPa")),
    }
)


def units_of(channel: str) -> tuple[str, str]:
    """Units of abscissa and ordinate of a channel, also over time; empty for a channel of another plugin."""
    base = channel.removesuffix("_over_time")
    along, of = _UNITS.get(base, ("", ""))
    return (along if base == channel or not of else "s"), of


class CurveSettings(Settings):
    """Columns of curves in a table of any format."""

    channels: dict[str, ChannelColumns] = Field(
        default_factory=lambda: dict(FOREARM),
        min_length=1,
        description="Columns of each channel. A file that the study gives for one channel uses that entry.",
    )

    @model_validator(mode="after")
    def _check_measures(self) -> Self:
        for channel, columns in self.channels.items():
            if problem := problem_of(channel, columns.strain, columns.stress):
                raise ValueError(f"channels.{channel}: {problem}")
        return self


class CsvSettings(TextFormat, CurveSettings):
    """Settings of :class:`CsvLoader`."""


class Table(Protocol):
    """Numbers under names, such as a :class:`TextTable`."""

    @property
    def row_word(self) -> str:
        """Name of a row in messages: line, or row."""

    @property
    def path(self) -> Path:
        """File that it was read from."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""

    def read(self, wanted: Sequence[str]) -> tuple[IntArray, Mapping[str, TableColumn]]:
        """Number of each row, and the wanted columns; a CurveError where they are not there."""


def read_curves(table: Table, known: Mapping[str, ChannelColumns], channel: str | None) -> Response:
    """Curves in a table, by the columns of each channel, or of the only channel of the file.

    Raises
    ------
    CurveError
        With file, row and column.
    """
    wanted = known if channel is None else {channel: _columns_of(channel, known, table)}
    curves = {}
    for name, columns in wanted.items():
        rows, read = table.read(list(dict.fromkeys(column.name for column in columns.by_field.values())))
        curves[name] = _curve(table, name, columns, rows, read)
    return Response(curves=curves)


class CsvLoader(ExperimentLoader[CsvSettings]):
    """Processed curves in CSV, TSV or semicolon-separated text.

    Rows are in the order travelled. Each channel keeps the rows between the
    first and the last movement of its abscissa: the force while the depth moves,
    the torque while the rotation does.

    By default a file has the columns ``depth_mm``, ``force_N``,
    ``angle_deg`` and ``torque_Nmm``. A file that the study gives for one channel
    has that channel's columns: ``stretch`` and ``stress_MPa`` (``shear`` in
    simple shear) for homogeneous tests. For any other channel without settings, it has
    two columns in the channel's units, first the abscissa, then the ordinate.
    """

    name = "csv"
    summary = "processed curves in CSV or TSV, with an optional preamble and unit factors"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Curves of one file, of its one ``channel`` or of all channels of the settings.

        A CurveError with file, line and column where it cannot be read.
        """
        return read_curves(TextTable(path, self.settings), self.settings.channels, channel)

    def save(self, path: Path, response: Response, channel: str | None = None) -> None:
        """Write curves in the columns that the settings name.

        Where one channel moves, the columns of the others are constant, and
        :meth:`load` skips them there.

        Parameters
        ----------
        channel : str, optional
            The only channel of the file.

        Raises
        ------
        CurveError
            The settings have no columns for a channel, columns for one that the curves
            lack, or one column for two of them.
        """
        import polars as pl

        settings = self.settings
        wanted = dict(settings.channels)
        if channel is not None:
            wanted = {channel: ({**HOMOGENEOUS, **wanted}).get(channel, _columns("abscissa", "ordinate"))}
        if set(response) != set(wanted):
            raise CurveError(
                f"{path}: the curves are {', '.join(response)}, and the loader's settings name columns for "
                f"{', '.join(wanted)}; name the same channels under channels, or use a separate file for each"
            )
        if settings.names is not None:
            raise CurveError(f"{path}: curves are written with a header line; remove the setting names")
        names = _header(path, {name: wanted[name] for name in response})
        written = [
            pl.DataFrame(_written(path, curve, wanted[name])) for name, curve in response.curves.items()
        ]
        # While one channel moves, the others keep their last value, or the first that they will have.
        rows = pl.concat(written, how="diagonal")
        rows = rows.select(pl.col(names).fill_null(strategy="forward").fill_null(strategy="backward"))
        decimal = settings.decimal or "."
        delimiter = DELIMITERS[settings.delimiter or (";" if decimal == "," else ",")]
        comment = "#" if settings.comment is None else settings.comment or "preamble"
        lines = [*[comment] * (settings.skip_lines or 0), delimiter.join(names)]
        lines += [delimiter.join(repr(x).replace(".", decimal) for x in row) for row in rows.iter_rows()]
        path.write_text("\n".join(lines) + "\n", encoding=settings.encoding or "utf-8")


def _columns_of(channel: str, given: Mapping[str, ChannelColumns], table: Table) -> ChannelColumns:
    """Columns of the one channel of a file: of the settings, of its test, or the only two."""
    known, names = {**HOMOGENEOUS, **given}, table.names
    if channel not in known and len(names) != 2:
        raise CurveError(
            f"{table.path}: {len(names)} columns ({', '.join(names)}) for channel "
            f"'{channel}', whose columns are not set; keep two columns, or name them "
            f"under channels.{channel} in the loader's settings"
        )
    return known[channel] if channel in known else _columns(*names)


def _scale(where: str, column: Column, unit: str, channel: str, field: str) -> float:
    """Factor of a column to the channel's unit: as the study gives it, or by the unit that the file gives."""
    known = factors_of(unit) if unit else {}
    kind = "time" if field == "time_s" else kind_of(units_of(channel)[field != "abscissa"])
    if column.scale is None:
        if unit and not known:
            raise CurveError(f"{where}: the file gives the unit '{unit}', which is not known; give scale")
        own: Kind = kind or ("force" if "force" in known else kind_of(unit) or "other")
        return _to_channel(own, factor_to_base(unit, own, where)) if unit and own != "other" else 1.0
    factor = _to_channel(kind, known[kind]) if kind is not None and kind in known else abs(column.scale)
    if not np.isclose(abs(column.scale), factor, rtol=1e-6):
        raise CurveError(
            f"{where}: scale = {column.scale!r} where the file gives the unit '{unit}', "
            f"whose factor is {factor:.10g}; leave scale out, or correct the unit of the file under names"
        )
    return column.scale


def _to_channel(kind: Kind, factor: float) -> float:
    """Factor to a channel's unit from one to the base unit of a kind: angles of channels are in degrees."""
    return float(f"{np.degrees(factor):.15g}") if kind == "angle" else factor


def _fields(
    table: Table, channel: str, columns: ChannelColumns, rows: IntArray, read: Mapping[str, TableColumn]
) -> dict[str, FloatArray]:
    """Numbers of a channel by field, scaled to its units."""
    path, fields = table.path, {}
    for field, column in columns.by_field.items():
        where, values = f"{path}: column '{column.name}'", read[column.name].values
        scale = _scale(where, column, read[column.name].shown_unit, channel, field)
        with np.errstate(over="ignore"):
            fields[field] = scale * values + column.offset
        # The square of a larger number is infinite, and scores are sums of squares.
        for row in np.flatnonzero(~(np.abs(fields[field]) <= _LARGEST))[:1]:
            where = f"{path}: {table.row_word} {rows[row]}, column '{column.name}'"
            if np.isnan(values[row]):
                raise CurveError(f"{where}: no number, the cell is empty or NaN; fill it or remove the row")
            raise CurveError(f"{where}: too large once scaled by {scale}; correct the scale or the row")
    return fields


def _curve(
    table: Table, channel: str, columns: ChannelColumns, rows: IntArray, read: Mapping[str, TableColumn]
) -> Curve:
    """Curve of a channel: in stretch and nominal stress, and cut to where its abscissa moves."""
    fields = _fields(table, channel, columns, rows, read)
    x, where = fields["abscissa"], f"{table.path}: channel '{channel}', column '{columns.abscissa.name}'"
    with np.errstate(invalid="ignore", over="ignore"):
        fields["abscissa"] = STRAINS[columns.strain].to_stretch(x)
        factor = nominal_factor(channel, columns.stress, fields["abscissa"])
        fields |= {name: factor * fields[name] for name in ("ordinate", "std") if name in fields}
    if not all(np.isfinite(values).all() for values in fields.values()):
        raise CurveError(
            f"{where}: {x.min():.4g} to {x.max():.4g} once scaled are no stretches by "
            f'strain = "{columns.strain}"; correct scale, offset or strain'
        )
    try:
        span = moving_span(fields["abscissa"])
        if columns.rows == "loading":
            away = np.abs(fields["abscissa"] - fields["abscissa"][span.start])
            farthest = int(np.argmax(away >= _FARTHEST_SHARE * away.max()))
            first = _begin_of_loading(fields["abscissa"], span.start, farthest)
            span = slice(first, max(farthest + 1, first + 2))
        return Curve(
            channel=channel,
            abscissa=fields["abscissa"][span],
            ordinate=fields["ordinate"][span],
            std=fields["std"][span] if "std" in fields else None,
            time_s=fields["time_s"][span] if "time_s" in fields else None,
        )
    except CurveError as error:
        raise CurveError(
            f"{where}: {error}; check that this is the column of the prescribed motion"
        ) from None


def _begin_of_loading(x: FloatArray, start: int, farthest: int) -> int:
    """Row of the last value at or before 0 on the way to the farthest, or at the begin of the last cycle."""
    way = x[start : farthest + 1] * np.sign(x[farthest] - x[start])
    if way[0] < 0.0 < way[-1]:
        return start + int(np.flatnonzero(way <= 0.0)[-1])
    near = (1.0 - _FARTHEST_SHARE) * (way[-1] - way[0])
    is_away = np.maximum.accumulate(way - way[0]) > _CYCLE_SHARE * (way[-1] - way[0])
    back = np.flatnonzero(is_away & (way - way[0] <= near))
    return start + int(back[-1]) if back.size else start


def _header(path: Path, wanted: Mapping[str, ChannelColumns]) -> list[str]:
    """Columns of a file: abscissae first, then ordinates, then deviations; curves may share their times."""
    fields = ("abscissa", "ordinate", "std", "time_s")
    known = [
        (field, each.by_field[field].name)
        for field in fields
        for each in wanted.values()
        if field in each.by_field
    ]
    names = [name for field, name in known if field != "time_s"]
    names += dict.fromkeys(name for field, name in known if field == "time_s")
    if len(set(names)) < len(names):
        raise CurveError(
            f"{path}: two curves need one column ({', '.join(names)}); use a separate file for each"
        )
    return names


def _written(path: Path, curve: Curve, columns: ChannelColumns) -> dict[str, FloatArray]:
    """Values (n,) by column in the file's units, without the rest at both ends."""
    for key, what, given, column in (
        ("std", "standard deviation", curve.std, columns.std),
        ("time", "time", curve.time_s, columns.time),
    ):
        if (given is None) != (column is None):
            has, remedy = ("no", "remove") if given is None else ("a", "name a column under")
            raise CurveError(
                f"{path}: channel '{curve.channel}' has {has} {what}; {remedy} "
                f"channels.{curve.channel}.{key} in the loader's settings"
            )
    part = curve.cut(moving_span(curve.abscissa))
    factor = nominal_factor(curve.channel, columns.stress, part.abscissa)
    written = {}
    for field, column in columns.by_field.items():
        values = getattr(part, field) / (factor if field in ("ordinate", "std") else 1.0)
        values = STRAINS[columns.strain].from_stretch(values) if field == "abscissa" else values
        where = f"{path}: column '{column.name}'"
        scale = _scale(where, column, unit_in(column.name)[1], curve.channel, field)
        written[column.name] = (values - column.offset) / scale
    return written
