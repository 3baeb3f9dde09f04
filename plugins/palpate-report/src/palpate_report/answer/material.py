"""The material that was found, as stress over stretch."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from palpate.api import FloatArray, IsotropicMaterial, RegionMaterial, convert
from palpate.api.fit import every_value
from palpate.api.mechanics import nominal_stress
from palpate.api.report import rounded
from palpate_report.answer.headline import draws_of
from palpate_report.answer.law import searched_regions
from palpate_report.data.marks import in_words
from palpate_report.data.report_data import ReportData


@dataclass(frozen=True, slots=True)
class Path:
    """A way to deform a body without a change of volume: label, axis, mode and its amounts (n,)."""

    label: str
    axis: str
    mode: str
    amounts: FloatArray


PATHS = (
    Path("uniaxial stress", "stretch", "uniaxial", np.linspace(0.7, 1.3, 31)),
    Path("shear stress", "amount of shear", "simple_shear", np.linspace(0.0, 0.6, 25)),
)
"""What is drawn of a material."""

SHOWN = {"stretch": (0.7, 0.8, 0.9, 1.1, 1.2, 1.3), "amount of shear": (0.2, 0.4, 0.6)}
"""Amounts in the table, at each of which the law is evaluated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MaterialCurves:
    """Stress of one region along one path, in the modulus unit of the report.

    Parameters
    ----------
    stress : mapping of label to (n,) array
        Of each fit, and of the true value.
    lower, upper : (n,) array or None
        Band of the fit that leads.
    """

    region: str
    path: Path
    stress: Mapping[str, FloatArray]
    lower: FloatArray | None = None
    upper: FloatArray | None = None


def material_curves(data: ReportData, scenario: str) -> Iterator[MaterialCurves]:
    """Stress of each searched isotropic material, for the fits of a scenario."""
    if data.fit.ends.is_empty():
        return
    rows = {row["fit"]: row for row in data.fit.ends.filter(scenario=scenario).iter_rows(named=True)}
    found = {fit: rows[fit] for fit in (data.together, *data.spots) if fit in rows}
    if data.study.truth:
        found["true value"] = dict(data.study.truth)
    draws = draws_of(data, scenario, 200).to_dicts()
    unit = convert(f"1 {data.modulus_unit}", "MPa")
    for region, path in product(searched_regions(data.study.space), _paths(data)):
        every = {fit: _stress(data, region, path, row) / unit for fit, row in found.items()}
        stress = {fit: values for fit, values in every.items() if np.isfinite(values).all()}
        band = np.array([_stress(data, region, path, row) / unit for row in draws])
        is_known = band.size and np.isfinite(band).all()
        # 95 % of the draws.
        ends = np.quantile(band, (0.025, 0.975), axis=0) if is_known else (None, None)
        if stress:
            yield MaterialCurves(region=region.region, path=path, stress=stress, lower=ends[0], upper=ends[1])


def _paths(data: ReportData) -> tuple[Path, ...]:
    """Paths, in a test of a specimen as far as it was stretched."""
    if data.study.protocol is not None:
        return PATHS
    curves = (curve for each in data.measured.values() for curve in each.curves.values())
    stretches = [curve.abscissa for curve in curves if curve.channel != "simple_shear"]
    low, high = min([0.7, *map(np.min, stretches)]), max([1.3, *map(np.max, stretches)])
    amounts = np.union1d(np.linspace(low, high, PATHS[0].amounts.size), SHOWN[PATHS[0].axis])
    return replace(PATHS[0], amounts=amounts), *PATHS[1:]


def _stress(data: ReportData, region: RegionMaterial, path: Path, row: Mapping[str, Any]) -> FloatArray:
    """Nominal stress (n,) [MPa], the slope of the energy along the path; NaN with directions."""
    if not isinstance(region.material, IsotropicMaterial):
        return np.full(path.amounts.size, np.nan)
    every = every_value(data.study.space, row, data.factors)
    theta = region.theta({p.name: every[region.name_of(p.name)] for p in region.material.parameters})
    return nominal_stress(region.material, theta, path.mode, path.amounts)


def rows_of(curves: MaterialCurves, leads: str) -> Iterator[list[str | None]]:
    """Rows of a table: region, stress, amount, then value and band of the fit that leads."""
    if leads not in curves.stress:
        return
    every = [curves.stress[leads], curves.lower, curves.upper]
    for amount in SHOWN[curves.path.axis]:
        k = int(np.argmin(np.abs(curves.path.amounts - amount)))
        values = [None if each is None else float(each[k]) for each in every]
        texts = (None if each is None else rounded(each, *values[1:]) for each in values)
        yield [in_words(curves.region), curves.path.label, f"{curves.path.axis} {amount:g}", *texts]
