"""Stress over stretch of the fitted material."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate_report.answer.material import PATHS, MaterialCurves, material_curves
from palpate_report.data.report_data import ReportData
from palpate_report.figures.style import LEAST_COLOUR, LINES, MEASURED_COLOUR, finished, panels


def stress_strain(data: ReportData) -> Figure:
    """Draw the stress of each searched region along each path, with its 95 % band."""
    curves = list(material_curves(data, data.generalising.name))
    figure, axes = panels(len(curves), len(PATHS), 65.0, 10.0)
    for axis, each in zip(axes, curves, strict=True):
        _draw(axis, each, data.together)
        of = f" of {each.region}" if len(data.study.space.regions) > 1 else ""
        axis.set(xlabel=each.path.axis, ylabel=f"nominal {each.path.label}{of} ({data.modulus_unit})")
    return finished(figure, axes, data.stamp)


def _draw(axis: Axes, curves: MaterialCurves, leads: str) -> None:
    x = curves.path.amounts
    if curves.lower is not None and curves.upper is not None:
        axis.fill_between(
            x, curves.lower, curves.upper, color=MEASURED_COLOUR, alpha=0.25, linewidth=0, label="95 %"
        )
    looks = {
        leads: {"color": LINES[0][0], "linewidth": 1.6, "zorder": 3.0},
        # Broad and pale behind the fit, which else would be hidden.
        "true value": {"color": LEAST_COLOUR, "linewidth": 3.6, "alpha": 0.35, "zorder": 1.5},
    }
    fits = [label for label in curves.stress if label not in looks]
    for label, stress in curves.stress.items():
        look: dict[str, Any] = looks.get(label, {"color": "0.5", "linestyle": "--", "linewidth": 0.6})
        one_entry = ", ".join(fits[:6]) if label in fits[:1] else "_"
        axis.plot(x, stress, label=label if label in looks else one_entry, **look)
