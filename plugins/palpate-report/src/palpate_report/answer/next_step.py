"""Advice on what to do next, in one line: by the largest cause of the widest interval."""

import tomllib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType

import polars as pl

from palpate.api import Indentation, typed as typed_path
from palpate.api.fit import THRESHOLDS, Adequacy
from palpate.api.mesh import EDGE_OVER_REACH
from palpate_report.answer.failed_checks import failed_checks
from palpate_report.data.marks import Headline, in_words
from palpate_report.data.report_data import ReportData

WRITE_UP = "every parameter is identified; print the material with its intervals: `palpate card {run}`"

_TABLE = tomllib.loads(files("palpate_report").joinpath("answer/causes.toml").read_text(encoding="utf-8"))
CAUSES, SETTINGS, REMEDIES, _COLOURS = (
    MappingProxyType({cause: of[key] for cause, of in _TABLE.items() if key in of})
    for key in ("words", "setting", "remedy", "colour")
)
"""Causes of intervals in words, the key of `[budget]` that states the size of each, what makes it smaller
where no other evidence is needed, and its colour. Others, such as fixed parameters, have their own name."""
COLOURS: Mapping[str, str] = MappingProxyType({CAUSES[cause]: colour for cause, colour in _COLOURS.items()})
"""Colours in figures by the words of a cause."""

OTHER_MATERIAL = "compare other laws: `palpate {plugins}compare {study} --materials all`"

AFTER_REFUSAL: Mapping[str, str] = MappingProxyType(
    {
        "specimen": OTHER_MATERIAL,
        "discrepancy": f"check first contact, friction and sensor by the residuals; then {OTHER_MATERIAL}",
        "ranges": "widen the ranges in {file}, then `palpate run {run} --go-on`",
        "": "check units, signs and columns of the measured curves: "
        "`palpate {plugins}experiment {study} --plots`",
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
        return typed("finish the run: `palpate run {run}`", data)
    if model is Adequacy.FAILS:
        main = (data.together, data.generalising.name)
        failed = (each for each in failed_checks(data) if each.verdict is model)
        return typed(AFTER_REFUSAL[next((e.kind for e in failed if (e.fit, e.scenario) == main), "")], data)
    if at_end := ", ".join(p.parameter for p in estimates if p.at_bound and p.identifiability != "not"):
        return f"widen the range of {at_end} in {data.study.file.name}, {_again(data)}"
    if model is Adequacy.APPROXIMATES and not _describes_each_spot(data):
        return typed(OTHER_MATERIAL, data)
    open_ones = [each for each in estimates if each.identifiability != "well"]
    if not open_ones:
        return typed(WRITE_UP, data) if estimates else ""
    if any(each.level is None for each in open_ones):
        return f'set `search = "least_squares"` in `[fit]` for 95 % intervals, {_again(data)}'
    return _narrower(data, max(open_ones, key=_relative_width))


def typed(advice: str, data: ReportData) -> str:
    """Advice whose command names the folders of run and study, as they are typed here."""
    file = data.study.file
    # A folder is its study.toml; a study file of another name is named.
    study = file.parent if file.name == "study.toml" else file
    paths = {"run": data.folder.resolve(), "study": study}
    here = Path.cwd()

    def from_here(path: Path) -> str:
        return typed_path(path.relative_to(here) if path.is_relative_to(here) else path)

    commands = {key: from_here(path) for key, path in paths.items()}
    commands["plugins"] = "".join(f"--plugin {from_here(path)} " for path in data.study.given_plugins)
    return advice.format(file=file.name, **commands)


def _again(data: ReportData) -> str:
    return typed("then `palpate run {run} --go-on`", data)


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
        reason = typed("the page has the reason: `palpate report {run} --open`", data)
        return f"{worst.parameter} is {worst.verdict}; {reason}"
    cause, share = budget["cause"][0], f"{100.0 * budget['share'][0]:.0f} %"
    if cause in ("range", "priors"):
        why = "is known by its prior alone" if cause == "priors" else "hardly changes the curves"
        return f"{worst.parameter} {why}: {_more(data, worst)}"
    otherwise = "measure it elsewhere, and state its error in `[budget.parameters]`"
    remedy = typed(REMEDIES.get(cause, otherwise), data)
    if cause == "model" or (cause == "mesh" and _is_scatter(data)):
        remedy = _more(data, worst)
    elif cause == "mesh":
        remedy = _finer(data)
    of = f"{CAUSES.get(cause, cause)}{_basis(data, cause)}"
    return f"{worst.parameter} is limited by {of}: {share} of its variance; {remedy}"


def _describes_each_spot(data: ReportData) -> bool:
    """Whether the laws describe each spot alone: errors that differ by spot make the misfit together."""
    checks = data.fit.adequacy.filter(check="discrepancy", scenario=data.generalising.name)
    alone = checks.filter(pl.col("fit") != data.together)
    return bool(alone.height) and set(alone["verdict"]) == {"describes"}


def _shows_misfit(data: ReportData) -> bool:
    """Whether the fit that leads misses more than the study states, though its checks have passed."""
    checks = data.leading_rows(data.fit.adequacy)
    least = checks.filter(check="discrepancy")["probability"].min()
    return isinstance(least, float) and least < THRESHOLDS.misfit


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
    if cause == "layers" and any(spot.layers_mm for spot in data.study.spots):
        return " that `[spot.layers]` states"
    if key in budget.model_fields_set:
        return f" that `[budget] {key}` states"
    files = [file for each in data.measured.values() for file in each.record.get("files", {}).values()]
    if cause in ("onset", "zero") and any("uncertainty" in file for file in files):
        return ", as the log shows it"
    return f" that `[budget] {key}` has by default"


def _more(data: ReportData, worst: Headline) -> str:
    if data.study.protocol is None:
        return "measure another kind of test"
    return typed(f"rank further presses: `palpate next {{run}} --for {worst.name}`", data)


def _is_scatter(data: ReportData) -> bool:
    """Whether a run that refines by itself would stop: the rest falls with the edge alone, and slowly."""
    shown = data.table("mesh_errors")
    return bool(shown.height) and set(shown["shown_by"]) == {"the scatter of other meshes"}


def _finer(data: ReportData) -> str:
    """Setting of finer meshes that correct the fit."""
    study = data.study
    by_itself = all(spot.fine_edge_mm is None for spot in study.spots)
    if data.fit.mesh.height and by_itself and not _is_scatter(data):
        return f"raise `fine_nodes` ({study.fine_nodes:,}) in `[fit]`, {_again(data)}"
    if any(spot.fine_mesh for spot in study.spots) or not isinstance(study.protocol, Indentation):
        return "give finer meshes as `fine_mesh` of the spots"
    edges = [spot.fine_edge_mm for spot in study.spots]
    usual_mm = EDGE_OVER_REACH * study.protocol.indenter.radius_mm
    # None: refined as usual; 0: not refined. Each mesh has 0.7 times the edge of the last one.
    edge = 0.7 * min(each or usual_mm for each in edges) if any(each != 0.0 for each in edges) else usual_mm
    runs = "" if study.fine_runs else "`fine_runs = 1` and "
    return f'set {runs}`fine_edge = "{edge:.2g} mm"` in `[fit]`, {_again(data)}'
