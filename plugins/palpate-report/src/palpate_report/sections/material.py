"""The material that was found, as stress over stretch."""

from collections.abc import Iterator

import numpy as np

from palpate.api.report import Block, Figure, Paragraph, Section, Table
from palpate_report.material_curves import MaterialCurves, material_curves
from palpate_report.report_data import ReportData
from palpate_report.result import Report

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
