"""The tables of a fit: where each search ended, how it got there, and what the mesh does to it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.domain import FloatArray, Response, channel_of, weighed_phases
from palpate.fit.running import Fit
from palpate.fit.spot_term import SpotTerm
from palpate.fit.stage import Case
from palpate.plugins.parametrisation import at_spot
from palpate.plugins.score import weighted
from palpate.run.result import UNSETTLED, FitResult
from palpate.run.tables import DECLARED
from palpate.scoring.scores import relative_variance
from palpate.simulation.sweep import Simulations


def fit_result(cases: Sequence[Case], simulations: Simulations) -> FitResult:
    """Put the cases of a study into tables.

    Parameters
    ----------
    cases : sequence of Case
        Every search has ended.
    simulations : Simulations
        Where their jobs were simulated.
    """
    phases = weighed_phases(case.scenario for case in cases)
    n_runs = _n_runs(cases, simulations)
    rows: list[dict[str, Any]] = []
    responses: dict[tuple[str, str, str], Response] = {}
    for case in cases:
        end = case.end
        if end is None or end.best is None:
            spent = {"n_runs": _spent(case, n_runs), "n_fine": case.n_fine}
            rows.append(_about(case) | {"message": _message(case)} | spent)
            continue
        for term in end.problem.terms:
            values = fitted_values(end, term)
            rows.append(_row(case, end, term, values, phases) | {"n_runs": _spent(case, n_runs)})
            responses[case.label, case.scenario.name, term.spot] = measured_like(term, values)
    traces = [row for case in cases for row in _trace(case, n_runs)]
    meshes = [row for case in cases for row in _mesh(case)]
    made = {"fit": rows, "fit_trace": traces, "fit_mesh": meshes}
    table, trace, mesh = (DECLARED["fit"][name].frame(rows) for name, rows in made.items())
    return FitResult(table=table, trace=trace, mesh=mesh, responses=responses)


def _n_runs(cases: Sequence[Case], simulations: Simulations) -> dict[int, list[int]]:
    """Count the simulations that no case before had asked for, after each job that a problem asked for.

    By problem: the first number is 0, or what the earlier problems of the case have cost.
    """
    seen: set[str] = set()
    counts = {}
    for case in cases:
        n_before = len(seen)
        for problem in {id(fit.problem): fit.problem for fit in case.fits}.values():
            counts[id(problem)] = [len(seen) - n_before]
            for job in problem.asked:
                seen.add(simulations.key(job))
                counts[id(problem)].append(len(seen) - n_before)
    return counts


def _spent(case: Case, n_runs: Mapping[int, Sequence[int]]) -> int:
    return n_runs[id(case.fits[-1].problem)][-1] if case.fits else 0


def _about(case: Case) -> dict[str, Any]:
    return {"fit": case.label, "scenario": case.scenario.name}


def _message(case: Case) -> str:
    """Reasons why the last searches ended, each once."""
    last = case.fits[-1].problem
    messages = dict.fromkeys(fit.message for fit in case.fits if fit.problem is last)
    if not case.is_settled:
        messages[UNSETTLED] = None
    return "; ".join(messages)


def fitted_values(end: Fit, term: SpotTerm) -> dict[str, FloatArray]:
    """Fitted ordinates (n,) at the measured points by channel, as the residuals have them."""
    assert end.best is not None
    inputs = end.problem.inputs(term.spot, end.best.point)
    simulation = end.problem.simulated(term, inputs)
    return {name: term.values(simulation, inputs, name) for name in term.measured}


def _row(
    case: Case, end: Fit, term: SpotTerm, values: Mapping[str, FloatArray], phases: Sequence[str]
) -> dict[str, Any]:
    row: dict[str, Any] = _about(case) | {"spot": term.spot}
    if state := end.problem.study.space.states.get(term.spot):
        row["state"] = state
    row |= errors_at(term, values, phases)
    row |= {
        "n_evaluations": sum(len(fit.trace) for fit in case.fits),
        "n_fine": case.n_fine,
        "at_bound": ", ".join(each.name for each, _ in end.at_bounds()),
        "message": _message(case),
    }
    assert end.best is not None
    space = end.problem.study.space
    written = space.written(end.problem.inputs(term.spot, end.best.point).thetas)
    return (
        row | at_spot(case.values(), term.spot, space.states) | {name: written[name] for name in space.ties}
    )


def errors_at(
    term: SpotTerm, values: Mapping[str, FloatArray], phases: Sequence[str]
) -> dict[str, float | None]:
    """Fopt of ordinates (n,) at the measured points by channel, and NMSE and R² of each channel and phase."""
    names = [*values, *(name for name in phases if channel_of(name) in values)]
    nmse, found = {}, dict[str, float | None]()
    for name in names:
        fitted, curve = values[channel_of(name)], term.measured[channel_of(name)]
        used = np.isfinite(fitted) & term.counted(name)
        nmse[name] = float((weighted(term.rules.score, curve, fitted, used, 1.0) ** 2).sum())
        r2 = 1.0 - nmse[name] / relative_variance(curve, term.rules.score, name)
        found |= {f"nmse_{name}": nmse[name], f"r2_{name}": r2 if np.isfinite(r2) else None}
    return {"fopt": sum(weight * nmse[name] for name, weight in term.weights.items())} | found


def measured_like(term: SpotTerm, values: Mapping[str, FloatArray]) -> Response:
    """Simulated curves along the measured abscissae, as far as they reach."""
    curves = {}
    for name, fitted in values.items():
        covered = np.isfinite(fitted)
        if covered.sum() > 1:
            curve = term.measured[name]
            x, y = curve.abscissa[covered], fitted[covered]
            curves[name] = replace(curve, abscissa=x, ordinate=y, std=None, time_s=None)
    return Response(curves=curves)


def _trace(case: Case, n_runs: Mapping[int, Sequence[int]]) -> Iterator[dict[str, Any]]:
    problems = list(dict.fromkeys(id(fit.problem) for fit in case.fits))
    for number, fit in enumerate(case.fits):
        for step, each in enumerate(fit.trace):
            values = dict(zip(fit.problem.names, fit.problem.box.values(each.point).tolist(), strict=True))
            finite = np.isfinite(each.fopt)
            yield {
                **_about(case),
                "search": number,
                "correction": problems.index(id(fit.problem)),
                "step": step,
                "n_runs": n_runs[id(fit.problem)][fit.n_asked[step]],
                "fopt": each.fopt if finite else None,
                "objective": each.objective if finite else None,
                "message": each.failure,
                **values,
            }


def _mesh(case: Case) -> Iterator[dict[str, Any]]:
    """Values that the coarse meshes, and the corrected ones, give."""
    if case.coarse and case.n_fine:
        for name, value in case.values().items():
            yield {**_about(case), "parameter": name, "coarse": case.coarse[name], "corrected": value}
