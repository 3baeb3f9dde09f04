"""Effort of a plan: how many simulations it takes, which are no more than the run took, and how long."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from palpate.api import Limb, Progress, Run, about
from palpate.api.runs import FINE, Forecast, Ledger, Part, Study, n_workers, work_of
from palpate_planning.candidates import CandidatePress

MOST_POINTS = 6
"""Likely parameters at which each candidate is simulated, where that takes no longer than the run did."""

EFFORTS = ((MOST_POINTS, False), (3, False), (1, False), (3, True), (1, True))
"""Points and whether it is quick, the most careful first."""


class Effort(NamedTuple):
    """Candidates that are simulated, at how many points, and whether the answer is quick."""

    presses: Sequence[CandidatePress]
    n_points: int
    is_quick: bool


def effort(
    run: Run, presses: Sequence[CandidatePress], n_points: int | None, *, is_quick: bool, may_drop: bool
) -> Effort:
    """Effort that is asked for, else the most careful one that takes no longer than the run.

    With ``may_drop`` some of the candidates are left out where one simulation of each would take longer.
    """
    if n_points is not None:
        return Effort(presses, n_points, is_quick=False)
    efforts = EFFORTS[-1:] if is_quick else EFFORTS
    counted = run.parts(stage for stage in run.stages.values() if stage.is_in_run(run.study))
    if any(part.counts is None for part in counted):
        return Effort(presses, *efforts[0])
    most, n_most = sum(_work(run, part.counts or {}) for part in counted), sum(part.n for part in counted)
    with Ledger(run.directory.folder) as ledger:
        n_most = min(n_most, len(ledger.seconds()))
    every = [Effort(presses, *each) for each in efforts]
    if may_drop:  # the last are whole presses
        every += [Effort(presses[::-step][::-1], *EFFORTS[-1]) for step in range(2, len(presses))]
    for each in every:
        counts = simulations_of(run, each.presses, each.n_points, is_quick=each.is_quick)
        if _work(run, counts) <= most and counts.total() <= n_most:
            return each
    return every[-1]


def simulations_of(
    run: Run, presses: Sequence[CandidatePress], n_points: int, *, is_quick: bool
) -> Counter[str]:
    """Usual number of simulations for a plan by limb name; a finer mesh is like the one of the spot."""
    study, counts = run.study, Counter[str]()
    n_searched = len(study.parametrisation.parameters(study.space, study.spot_names))
    n_each = n_points * (1 if study.solver.provides.slopes else 1 + 2 * n_searched)
    of_causes = run.stages["intervals"].usual_simulations(run) or {}
    for press in presses:
        counts[press.spot] += n_each + (0 if is_quick else of_causes.get(press.spot, 0))
        if f"{press.spot}{FINE}" in run.limbs and not is_quick:
            counts[f"{press.spot}{FINE}"] += 1
    counts.update(dict.fromkeys(study.spot_names, n_each - n_each // n_points))
    return counts


def forecast_first(
    study: Study, limbs: Mapping[str, Limb], presses: Sequence[CandidatePress], n_points: int
) -> Forecast:
    """Forecast of a plan before any press: every press at each point, with slopes or by differences."""
    n_searched = len(study.parametrisation.parameters(study.space, study.spot_names))
    counts = Counter[str]()
    for press in presses:
        counts[press.spot] += n_points * (1 if study.solver.provides.slopes else 1 + 2 * n_searched)
    forecast = Forecast(n_workers=n_workers(study))
    forecast.expect([Part(stage="next", counts=counts)], limbs)
    return forecast


def _work(run: Run, counts: Mapping[str, int]) -> float:
    return sum(n * work_of(name, run.limbs) for name, n in counts.items())


def say_time(forecast: Forecast, progress: Progress, *, is_quick: bool, is_chosen: bool) -> None:
    """Report how long a plan takes, and what would make it shorter."""
    seconds, n = forecast.seconds_left, forecast.n_left
    how = "quick: error sources and finer meshes as at the press so far" if is_quick else "--quick is shorter"
    if is_quick and not is_chosen:
        how += "; --points 6 simulates them"
    progress.note(f"about {n} simulations{'' if seconds is None else f', {about(seconds)}'} ({how})")
