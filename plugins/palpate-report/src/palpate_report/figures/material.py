"""Stress over stretch of the fitted material."""

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
    looks = {leads: (LINES[0][0], "-", 1.6), "true value": (LEAST_COLOUR, ":", 1.2)}
    for label, stress in curves.stress.items():
        colour, dash, width = looks.get(label, ("0.5", "--", 0.6))
        axis.plot(x, stress, color=colour, linestyle=dash, linewidth=width, label=label)
