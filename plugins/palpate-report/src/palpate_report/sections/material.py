"""The material that was found, as stress over stretch."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from palpate.api import FloatArray, IsotropicMaterial, convert
from palpate.api.mechanics import nominal_stress
from palpate.api.report import Block, Figure, Paragraph, Section, Table
from palpate_report.best_sets import every_value
from palpate_report.headline import draws_of
from palpate_report.report_data import ReportData
from palpate_report.result import Report

BAND = (0.025, 0.975)
"""Quantiles of the band: 95 % of the draws."""


@dataclass(frozen=True, slots=True)
class Path:
    """A way to deform a body without a change of volume: label, axis, mode and its amounts (n,)."""

    label: str
    axis: str
    mode: str
    amounts: FloatArray


MOST_DRAWS = 200

PATHS = (
    Path("uniaxial stress", "stretch", "uniaxial", np.linspace(0.7, 1.3, 31)),
    Path("shear stress", "amount of shear", "simple_shear", np.linspace(0.0, 0.6, 25)),
)
"""What is drawn of a material."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MaterialCurves:
    """Stress of one region along one path, in the modulus unit of the report.

    Parameters
    ----------
    region : str
    path : Path
    stress : mapping of label to (n,) array
        Of each fit, and of the known answer.
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
        found["known answer"] = dict(data.study.truth)
    draws = draws_of(data, scenario, MOST_DRAWS).to_dicts()
    unit = convert(f"1 {data.modulus_unit}", "MPa")
    for region, path in product(data.study.space.regions, PATHS):
        if not data.study.space.columns_of(region.region):
            continue
        every = {fit: _stress(data, region.region, path, row) / unit for fit, row in found.items()}
        stress = {fit: values for fit, values in every.items() if np.isfinite(values).all()}
        band = np.array([_stress(data, region.region, path, row) / unit for row in draws])
        ends = np.quantile(band, BAND, axis=0) if band.size and np.isfinite(band).all() else (None, None)
        if stress:
            yield MaterialCurves(region=region.region, path=path, stress=stress, lower=ends[0], upper=ends[1])


def _stress(data: ReportData, name: str, path: Path, row: Mapping[str, Any]) -> FloatArray:
    """Nominal stress (n,) [MPa], the slope of the energy along the path; NaN with directions."""
    (region,) = (each for each in data.study.space.regions if each.region == name)
    if not isinstance(region.material, IsotropicMaterial):
        return np.full(path.amounts.size, np.nan)
    every = every_value(data, row)
    theta = region.theta({p.name: every[f"{name}.{p.name}"] for p in region.material.parameters})
    return nominal_stress(region.material, theta, path.mode, path.amounts)


SHOWN = {"stretch": (0.7, 0.8, 0.9, 1.1, 1.2, 1.3), "amount of shear": (0.2, 0.4, 0.6)}
"""Amounts in the table."""


class MaterialItself(Section):
    """Stress of the fits."""

    name, title, entry = "material", "The material itself", "Material"
    summary = "stress over stretch of the fitted material, with its 95 % band"

    def blocks(self, data: ReportData, report: Report) -> Iterator[Block]:
        """Draw the stress of each region, and list some of it."""
        if report.verdict.failure:
            return
        found = {s.name: list(material_curves(data, s.name)) for s in data.study.scenarios}
        leading = found[data.generalising.name]
        if not leading:
            return
        yield Paragraph(
            "Nominal stress of the fitted law at constant volume, whatever the limb is. The band holds 95 "
            "% of the draws of the fit that leads. Where the limb was stretched less than that, the law "
            "alone decides."
        )
        for scenario, curves in found.items():
            for each in curves:
                yield _figure(data, each, scenario)
        rows = [row for each in leading for row in _rows(each, data.together)]
        heads = ["region", "stress", "at", f"value [{data.modulus_unit}]", "lower", "upper"]
        yield Table(f"Nominal stress of the fit to {data.together}", heads, rows)


def _figure(data: ReportData, curves: MaterialCurves, scenario: str) -> Figure:
    traces = []
    x = curves.path.amounts
    if curves.lower is not None and curves.upper is not None:
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "95 %",
                "x": np.concatenate([x, x[::-1]]),
                "y": np.concatenate([curves.upper, curves.lower[::-1]]),
                "fill": "toself",
                "line": {"color": "--measured", "width": 0},
                "opacity": 0.35,
                "hoverinfo": "skip",
            }
        )
    looks = {data.together: ("--line0", "solid", 2.4), "known answer": ("--least", "dot", 1.6)}
    for label, stress in curves.stress.items():
        colour, dash, width = looks.get(label, ("--soft", "dash", 1))
        look = {"color": colour, "dash": dash, "width": width}
        traces.append({"type": "scatter", "mode": "lines", "name": label, "x": x, "y": stress, "line": look})
    of = f" of {curves.region}" if len(data.study.space.regions) > 1 else ""
    return Figure(
        label=f"{curves.path.label}{of} over {curves.path.axis}; values are in the table",
        traces=traces,
        layout={
            "xaxis": {"title": curves.path.axis},
            "yaxis": {"title": f"{curves.path.label}{of} [{data.modulus_unit}]"},
            "showlegend": True,
        },
        scenario=scenario,
    )


def _rows(curves: MaterialCurves, leads: str) -> Iterator[list[str | float | None]]:
    if leads not in curves.stress:
        return
    every = [curves.stress[leads], curves.lower, curves.upper]
    for amount in SHOWN[curves.path.axis]:
        k = int(np.argmin(np.abs(curves.path.amounts - amount)))
        values = [None if each is None else float(each[k]) for each in every]
        yield [curves.region, curves.path.label, f"{curves.path.axis} {amount:g}", *values]
