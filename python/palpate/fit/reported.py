"""Curves of fits at the values that are reported, and their errors.

The fit that leads is simulated once more at each spot, with the skin that `palpate surface` shows. On a mesh
the curves of other fits go along the slopes that their search has left, which costs nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import polars as pl

from palpate.domain import FloatArray, Response, Simulation, weighed_phases
from palpate.fit.problem import Problem
from palpate.fit.spot_term import NotRankedError, SpotTerm, along_slopes, is_along_slopes
from palpate.fit.stage import Case
from palpate.fit.tables import errors_at, measured_like
from palpate.plugins.parametrisation import SpotInputs
from palpate.progress import Progress
from palpate.run.result import ALL_SPOTS
from palpate.run.result_files import FIT_KEYS, curves_of


def reported_fits(
    cases: Sequence[tuple[Case, FloatArray]], progress: Progress
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Errors and curves of fits at reported values, as ``reported`` and ``reported_curves`` have them.

    Parameters
    ----------
    cases : sequence of (Case, (n_parameters,) array)
        Fits that have a result, and the reported values of each, in the order of its problem.
    """
    phases = weighed_phases(case.scenario for case, _ in cases)
    rows, curves = [], dict[tuple[str, str, str], Response]()
    for case, at in cases:
        found = []
        try:
            for term, inputs, simulation in _at_values(case, at):
                term.residuals(simulation, inputs)  # raises for a simulation without a rank
                found.append((term, {name: term.values(simulation, inputs, name) for name in term.measured}))
        except NotRankedError as error:
            progress.note(
                f"warning: {case.label}, scenario {case.scenario.name}: Fopt, R² and curves are of the least "
                f"Fopt, not of the reported values, which cannot be simulated: {error}"
            )
            continue
        for term, values in found:
            key = (case.label, case.scenario.name, term.spot)
            rows.append(dict(zip(FIT_KEYS, key, strict=True)) | errors_at(term, values, phases))
            curves[key] = measured_like(term, values)
    return pl.DataFrame(rows, infer_schema_length=None), curves_of(curves.items())


def _at_values(case: Case, at: FloatArray) -> Iterator[tuple[SpotTerm, SpotInputs, Simulation]]:
    """Each spot of a fit, its inputs at these values, and its simulation there."""
    problem = case.fits[-1].problem
    study, terms = problem.study, problem.terms
    inputs = {term.spot: problem.inputs_at(term, at) for term in terms}
    leads = case.scenario is study.generalising and (case.label == ALL_SPOTS or len(study.spots) == 1)
    found = {} if leads or not study.solver.provides.mesh else _along(case, problem, inputs)
    if not found:
        # The skin of a tissue that relaxes is that of another job.
        surface = leads and study.solver.provides.surface and not study.parametrisation.times_s
        jobs = [
            replace(term.job(inputs[term.spot], -1, slopes=False, fine=problem.fine), surface=surface)
            for term in terms
        ]
        found = dict(zip(inputs, problem.simulate(jobs), strict=True))
    return ((term, inputs[term.spot], found[term.spot]) for term in terms)


def _along(case: Case, problem: Problem, inputs: Mapping[str, SpotInputs]) -> dict[str, Simulation]:
    """Simulation of each spot by the slopes where a search has ended; none where they do not lead there."""
    found = {}
    assert case.end is not None
    assert case.end.best is not None
    for term in problem.terms:
        base = problem.inputs(term.spot, case.end.best.point)
        if not is_along_slopes(base, inputs[term.spot]):
            return {}
        try:
            here = problem.simulated(term, base)
            found[term.spot] = along_slopes(here, base, inputs[term.spot], list(term.measured))
        except NotRankedError:
            return {}
    return found
