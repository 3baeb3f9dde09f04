"""Advice on what to do next, in one line: by the largest cause of the widest interval."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from palpate.api import Indentation
from palpate_report.marks import Headline
from palpate_report.report_data import ReportData

WRITE_UP = "every parameter is identified: write it up (docs/write-it-up.md), with report/methods.md"
STOP = "see why in the first warning, change the material, the mesh or the data, and run again"

CAUSES: Mapping[str, str] = MappingProxyType(
    {
        "noise": "noise",
        "model": "misfit of the model",
        "mesh": "mesh",
        "zero": "drift",
        "priors": "priors",
        "range": "curves that hardly depend on it",
        "gain": "calibration",
        "onset": "onset of contact",
        "indenter": "radius of the indenter",
        "friction": "friction",
        "tilt": "tilt",
        "position": "position of the spots",
        "bone": "depth of the bone",
        "layers": "thickness of the layers",
    }
)
"""Causes of intervals in words; others, such as fixed parameters, are named as they are."""

REMEDIES: Mapping[str, str] = MappingProxyType(
    {
        "noise": "repeat the measurement; a mean of several has less noise",
        "model": "fit another material, and `palpate compare` both runs",
        "zero": "reduce the drift of the sensor, and set `[budget] zero` to the rest",
        "gain": "calibrate the sensor, and set `[budget] gain` to the rest",
        "onset": "sample more densely at first contact, and set `[budget] onset` to the rest",
        "indenter": "measure the radius, and set `[budget] radius`",
        "friction": "measure it, and set `friction` and `[budget] friction`",
        "tilt": "align the tool with the normal, and set `[budget] tilt` to the rest",
        "position": "locate the spots on the scan better, and set `[budget] position` to the rest",
        "bone": "image the bone at the spots, and set `[budget] bone` to the rest",
        "layers": "measure them at the spots, by ultrasound or MRI, and set `[budget] layers` to the rest",
    }
)
"""What makes each cause smaller."""

FINER = 0.7
"""Edge of the next finer mesh over that of the last one."""

EDGE_IN_RADII = 1.0 / 3.0
"""Edge of the first finer mesh over the indenter's radius."""


def next_step(data: ReportData, estimates: Sequence[Headline], *, is_refused: bool) -> str:
    """Advice that narrows the widest interval, or that there is nothing left to do; one line.

    Parameters
    ----------
    estimates : sequence of Headline
        Parameters of what leads.
    is_refused : bool
        No parameters can be read from the run.
    """
    if data.unfinished:
        return "finish the run: `palpate run RUN`"
    if is_refused:
        return STOP
    if at_end := ", ".join(p.parameter for p in estimates if p.at_bound and p.identifiability != "not"):
        return f"widen the range of {at_end} and run again; what is simulated is kept"
    open_ones = [each for each in estimates if each.identifiability != "well"]
    if not open_ones:
        return WRITE_UP if estimates else ""
    if any(each.level is None for each in open_ones):
        return "search with a fit, which finds 95 % intervals and their causes (docs/fit.md)"
    return _narrower(data, max(open_ones, key=_relative_width))


def _relative_width(value: Headline) -> float:
    if value.lower is None or value.upper is None:
        return float("inf")
    return (value.upper - value.lower) / (abs(value.lower + value.upper) or 1.0)


def _narrower(data: ReportData, worst: Headline) -> str:
    """Advice that makes the largest cause of an interval smaller."""
    budget = data.leading_rows(data.fit.certainty.budget)
    if not budget.is_empty():
        budget = budget.filter(parameter=worst.name).drop_nulls("share").sort("share", descending=True)
    if budget.is_empty():
        return f"{worst.parameter} is {worst.verdict}: read the warnings, the worst first"
    cause, share = budget["cause"][0], f"{100.0 * budget['share'][0]:.0f} %"
    if cause in ("range", "priors"):
        return f"{worst.parameter} hardly changes the curves: {_more(data, worst)}, or fix its value"
    remedy = _finer(data) if cause == "mesh" else REMEDIES.get(cause)
    remedy = remedy or f"measure it elsewhere, and set `[budget.parameters]` (`{cause}`) to what is known"
    return f"{CAUSES.get(cause, cause)}: {share} of the variance of {worst.parameter}; {remedy}"


def _more(data: ReportData, worst: Headline) -> str:
    if data.study.protocol is None:
        return "measure another kind of test"
    return f"press deeper or elsewhere (`palpate next RUN --for {worst.name}` ranks presses)"


def _finer(data: ReportData) -> str:
    """Setting of finer meshes that correct the fit."""
    study = data.study
    shown = data.fit.certainty.mesh_errors
    if shown.height and set(shown["shown_by"]) == {"usual scatter"}:
        return "state what your meshes err by as `mesh` in `[budget]`: finer ones lessen it no more"
    if data.fit.mesh.height and all(spot.fine_edge_mm is None for spot in study.spots):
        return f"raise `fine_nodes` ({study.fine_nodes:,}) in `[fit]`"
    if any(spot.fine_mesh for spot in study.spots) or not isinstance(study.protocol, Indentation):
        return "give finer meshes as `fine_mesh`"
    edges = [spot.fine_edge_mm for spot in study.spots]
    usual_mm = EDGE_IN_RADII * study.protocol.indenter.radius_mm
    # None: refined as usual; 0: not refined.
    edge = FINER * min(each or usual_mm for each in edges) if any(each != 0.0 for each in edges) else usual_mm
    runs = "" if study.fine_runs else "`fine_runs = 1` and "
    return f'set {runs}`fine_edge = "{edge:.2g} mm"` in `[fit]`'
