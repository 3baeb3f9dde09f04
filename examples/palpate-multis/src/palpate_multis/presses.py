"""Tables of presses of living limbs."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from palpate.api import CurveError, FloatArray, IntArray

StrArray = NDArray[np.str_]

WIDTH_MM = {360: 8.0, 675: 15.0}
"""Of the probe's face, by its area [mm²]."""

KNOWN = ("max_force_N", "area_mm2", "skin_mm", "fat_mm", "muscle_mm")
"""Columns that a prediction needs."""

MEASURED = ("fat_compression_mm", "muscle_compression_mm", "stiffness_MPa_per_mm")
"""Further columns, which a fit needs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Presses:
    """Presses of several people.

    Parameters
    ----------
    person : (n,) array of int
        Number of the person, counted from 0.
    layers_mm : (n, 3) array
        Skin, fat and muscle at rest.
    width_mm : (n,) array
        Of the probe's face.
    force_N : (n,) array
        The largest.
    compliance : (n,) array
        Compression over force per area [mm/MPa].
    fat_share : (n,) array
        Of the compression of fat and muscle.
    site : (n,) array of str
        As the table names it; empty where it does not.
    """

    person: IntArray
    layers_mm: FloatArray
    width_mm: FloatArray
    force_N: FloatArray
    compliance: FloatArray
    fat_share: FloatArray
    site: StrArray

    def __getitem__(self, chosen: IntArray | list[int]) -> "Presses":
        """Some of the presses."""
        return Presses(**{name: getattr(self, name)[chosen] for name in self.__slots__})

    @property
    def n_people(self) -> int:
        """Number of people."""
        return int(self.person.max()) + 1


def of_multis() -> Traversable:
    """The table of MULTIS."""
    return files("palpate_multis") / "data" / "presses.csv"


def read_presses(path: Path | None = None, *, measured: bool = True) -> Presses:
    """Read a table of presses in the columns of the data that come with the plugin.

    Parameters
    ----------
    path : Path, optional
        A CSV file; the 552 presses of MULTIS by default.
    measured : bool
        Whether it has compliances; without them these and the shares are NaN, and the person is 0. A column
        ``site`` is read where there is one.

    Raises
    ------
    CurveError
        The file cannot be read, lacks a column, or has a value that is missing or not > 0; with its row.
    """
    where = path or of_multis()
    try:
        with where.open("rb") as stream:
            table = pl.read_csv(stream, infer_schema=False)
    except (OSError, pl.exceptions.PolarsError) as error:
        raise CurveError(f"{where}: not a table of presses ({error}); give a CSV file") from None
    numbers = (*KNOWN, *MEASURED) if measured else KNOWN
    wanted = ("person", *numbers) if measured else numbers
    missing = [name for name in wanted if name not in table.columns]
    if missing or table.is_empty():
        lacks = f"no column '{missing[0]}'" if missing else "no rows"
        raise CurveError(f"{where}: {lacks}; the columns are {', '.join(wanted)}")
    columns = {name: table[name].cast(pl.Float64, strict=False).to_numpy() for name in numbers}
    _check(str(where), table, columns)
    if measured:
        person = np.unique(table["person"].to_numpy(), return_inverse=True)[1].astype(np.int64)
        fat, muscle = columns["fat_compression_mm"], columns["muscle_compression_mm"]
        compliance, share = 1.0 / columns["stiffness_MPa_per_mm"], fat / (fat + muscle)
    else:
        person = np.zeros(table.height, dtype=np.int64)
        compliance = share = np.full(table.height, np.nan)
    return Presses(
        person=person,
        layers_mm=np.column_stack([columns[f"{layer}_mm"] for layer in ("skin", "fat", "muscle")]),
        width_mm=np.array([WIDTH_MM[int(area)] for area in columns["area_mm2"]]),
        force_N=columns["max_force_N"],
        compliance=compliance,
        fat_share=share,
        site=_sites(str(where), table),
    )


def _sites(where: str, table: pl.DataFrame) -> StrArray:
    """Sites (n,), each with a name or none."""
    if "site" not in table.columns:
        return np.full(table.height, "")
    missing = np.flatnonzero(table["site"].is_null().to_numpy())
    if missing.size:
        raise CurveError(f"{where}, row {missing[0] + 2}: no site; name it, or leave the column out")
    return table["site"].to_numpy().astype(np.str_)


def _check(where: str, table: pl.DataFrame, columns: Mapping[str, FloatArray]) -> None:
    for name, values in columns.items():
        least = -np.inf if "compression" in name else 0.0  # the images' noise exceeds a small compression
        bad = np.flatnonzero(~(np.isfinite(values) & (values > least)))
        if bad.size:
            raise CurveError(f"{where}, row {bad[0] + 2}: {name} is '{table[name][int(bad[0])]}'; correct it")
    other = np.flatnonzero(~np.isin(columns["area_mm2"], list(WIDTH_MM)))
    if other.size:
        area = columns["area_mm2"][other[0]]
        raise CurveError(f"{where}, row {other[0] + 2}: area_mm2 is {area:g}; the probes have 360 and 675")
