"""Advice on what to do next, in one line: by the largest cause of the widest interval."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from palpate.api import Indentation
from palpate.api.fit import Adequacy
from palpate_report.answer.failed_checks import failed_checks
from palpate_report.data.marks import Headline, in_words
from palpate_report.data.report_data import ReportData

WRITE_UP = "every parameter is identified; print the material with its intervals: `palpate card runs/{name}`"

CAUSES: Mapping[str, str] = MappingProxyType(
    {
        "noise": "noise",
        "model": "model error",
        "mesh": "mesh error",
        "correction": "correction by finer meshes",
        "zero": "drift",
        "priors": "priors",
        "range": "insensitive curves",
        "gain": "calibration error",
        "onset": "first contact",
        "indenter": "radius of the indenter",
        "friction": "friction",
        "contact": "contact stiffness",
        "tilt": "tilt",
        "position": "position of the spots",
        "spots": "differences between the spots",
        "bone": "depth of the bone",
        "layers": "thickness of the layers",
    }
)
"""Causes of intervals in words; others, such as fixed parameters, are named as they are."""

SETTINGS: Mapping[str, str] = MappingProxyType(
    {"model": "discrepancy", "indenter": "radius"}
    | {name: name for name in ("zero", "gain", "onset", "friction", "tilt", "position", "bone", "layers")}
)
"""Key of `[budget]` that states the size of a cause."""

REMEDIES: Mapping[str, str] = MappingProxyType(
    {
        "noise": "repeat the measurement and average",
        "zero": "reduce the drift of the sensor, and state the remaining drift",
        "gain": "calibrate the sensor, and state the remaining error",
        "onset": "sample more densely at first contact, and state the remaining error",
        "indenter": "measure the radius, and state its error",
        "friction": "measure the friction, and state its error",
        "correction": "set a larger `fine_runs` under `[fit]`: finer meshes nearer to the answer",
        "contact": "set `fine_edge` under `[fit]`: the finer mesh shows a rigid contact",
        "spots": "measure more spots",
        "tilt": "align the tool with the normal, and state the remaining tilt",
        "position": "locate the spots on the scan better, and state the remaining error",
        "bone": "image the bone at the spots, and state the remaining error",
        "layers": "measure the layers by ultrasound or MRI, and state the remaining error",
    }
)
"""How to make a cause smaller that no other evidence is needed for."""

OTHER_MATERIAL = "compare other laws: `palpate compare {name} --materials all`"

AFTER_REFUSAL: Mapping[str, str] = MappingProxyType(
    {
        "specimen": OTHER_MATERIAL,
        "discrepancy": f"check first contact, friction and sensor by the residuals; then {OTHER_MATERIAL}",
        "ranges": "widen the ranges, and run again",
        "": "check units, signs and columns of the measured curves, and run again",
    }
)
"""What to do about a run without parameters, by the check that its model failed; R² is low without one."""


def cause_name(data: ReportData, cause: str) -> str:
    """Name of a cause for readers: in words, or the parameter that is fixed."""
    return CAUSES.get(cause) or f"fixed {data.brief_name(cause)}"


def next_step(data: ReportData, estimates: Sequence[Headline], *, model: Adequacy) -> str:
    """Advice that narrows the widest interval, or that there is nothing left to do; one line.

    Parameters
    ----------
    estimates : sequence of Headline
        Parameters of what leads.
    model : Adequacy
        Verdict on the model of what leads.
    """
    if data.unfinished:
        return f"finish the run: `palpate run runs/{data.study.name}`"
    if model is Adequacy.FAILS:
        main = (data.together, data.generalising.name)
        failed = (each for each in failed_checks(data) if each.verdict is model)
        advice = AFTER_REFUSAL[next((e.kind for e in failed if (e.fit, e.scenario) == main), "")]
        return advice.format(name=data.study.name)
    if at_end := ", ".join(p.parameter for p in estimates if p.at_bound and p.identifiability != "not"):
        return f"widen the range of {at_end} and run again; simulations are kept"
    if model is Adequacy.APPROXIMATES:
        return OTHER_MATERIAL.format(name=data.study.name)
    open_ones = [each for each in estimates if each.identifiability != "well"]
    if not open_ones:
        return WRITE_UP.format(name=data.study.name) if estimates else ""
    if any(each.level is None for each in open_ones):
        return "search with a fit, which finds 95 % intervals and their causes (docs/fit.md)"
    return _narrower(data, max(open_ones, key=_relative_width))


def _relative_width(value: Headline) -> float:
    if value.lower is None or value.upper is None:
        return float("inf")
    return (value.upper - value.lower) / (abs(value.lower + value.upper) or 1.0)


def _narrower(data: ReportData, worst: Headline) -> str:
    """Advice that makes the largest cause of an interval smaller."""
    budget = data.leading_rows(data.table("budget"))
    if not budget.is_empty():
        budget = budget.filter(parameter=worst.name).drop_nulls("share").sort("share", descending=True)
    if budget.is_empty():
        return f"{worst.parameter} is {worst.verdict}: read the warnings, the worst first"
    cause, share = budget["cause"][0], f"{100.0 * budget['share'][0]:.0f} %"
    if cause in ("range", "priors"):
        why = "is known by its prior alone" if cause == "priors" else "hardly changes the curves"
        return f"{worst.parameter} {why}: {_more(data, worst)}"
    remedy = REMEDIES.get(cause, "measure it elsewhere, and state its error in `[budget.parameters]`")
    if cause == "model":
        remedy = _more(data, worst)
    elif cause == "mesh":
        remedy = _more(data, worst) if _is_scatter(data) else _finer(data)
    of = f"{CAUSES.get(cause, cause)}{_basis(data, cause)}"
    return f"{worst.parameter} is limited by {of}: {share} of its variance; {remedy}"


def _shows_misfit(data: ReportData) -> bool:
    """Whether the fit that leads misses more than the study states, though its checks have passed."""
    checks = data.leading_rows(data.fit.adequacy)
    least = checks.filter(check="discrepancy")["probability"].min()
    # Probability of the largest misfit under which the data show more model error than the study states.
    return isinstance(least, float) and least < 0.05


def _basis(data: ReportData, cause: str) -> str:
    """Setting that the size of a cause is from, and whether the study states it; empty where data show it."""
    if (key := SETTINGS.get(cause)) is None:
        return ""
    budget = data.study.budget
    if cause == "model":
        stated = ", ".join(
            f"{in_words(name)} {100.0 * budget.discrepancy_of(name):g} %" for name in data.measured_channels
        )
        return f"{', more than' if _shows_misfit(data) else ' that'} `[budget] discrepancy` states ({stated})"
    return f" that `[budget] {key}` {'states' if key in budget.model_fields_set else 'has by default'}"


def _more(data: ReportData, worst: Headline) -> str:
    if data.study.protocol is None:
        return "measure another kind of test"
    return f"rank further presses: `palpate next runs/{data.study.name} --for {worst.name}`"


def _is_scatter(data: ReportData) -> bool:
    """Whether a run that refines by itself would stop: the rest falls with the edge alone, and slowly."""
    shown = data.table("mesh_errors")
    return bool(shown.height) and set(shown["shown_by"]) == {"usual scatter"}


def _finer(data: ReportData) -> str:
    """Setting of finer meshes that correct the fit."""
    study = data.study
    by_itself = all(spot.fine_edge_mm is None for spot in study.spots)
    if data.fit.mesh.height and by_itself and not _is_scatter(data):
        return f"raise `fine_nodes` ({study.fine_nodes:,}) in `[fit]`"
    if any(spot.fine_mesh for spot in study.spots) or not isinstance(study.protocol, Indentation):
        return "give finer meshes as `fine_mesh`"
    edges = [spot.fine_edge_mm for spot in study.spots]
    # As a run refines by itself.
    usual_mm = 0.24 * study.protocol.indenter.radius_mm
    # None: refined as usual; 0: not refined. Each mesh has 0.7 times the edge of the last one.
    edge = 0.7 * min(each or usual_mm for each in edges) if any(each != 0.0 for each in edges) else usual_mm
    runs = "" if study.fine_runs else "`fine_runs = 1` and "
    return f'set {runs}`fine_edge = "{edge:.2g} mm"` in `[fit]`'
