"""The fit of a study: jointly over its spots and at each of them, in every scenario.

The joint fit of the scenario that generalises comes first, from the answer of an earlier run if there is
one, and from the basins of the sweep; without either, from where a search of one spot ends. Where spots
have a finer mesh, its answers correct the curves of the coarse one until what these may be wrong by moves
no parameter by much of its standard deviation. The other scenarios start where the first has ended, with
its corrections, and each spot where the joint fit of its scenario has. A range at whose end the first ends
is widened up to physical limits, for as long as that gains.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import polars as pl

from palpate.domain import (
    FINE,
    Design,
    FloatArray,
    Parameter,
    ParameterName,
    Refinement,
    Response,
    Scenario,
    Simulation,
    channel_of,
)
from palpate.errors import PalpateError, StoppedError
from palpate.fit.alike import correction_like
from palpate.fit.mesh_correction import NEAR, EndSlopes, FineRun, errors_of, fine_run
from palpate.fit.problem import Problem
from palpate.fit.running import Fit, run_searches
from palpate.fit.spot_term import Correction, NotRankedError, SpotTerm, pieces, term_of
from palpate.fit.starts import basins, scaled_start
from palpate.plugins.parametrisation import SpotInputs, at_spot
from palpate.progress import SILENT, Progress
from palpate.run.fit_state import FitState
from palpate.run.result import ALL_SPOTS, WIDENED
from palpate.scoring.selection import objectives
from palpate.simulation.sweep import Simulations
from palpate.study.reading import Study


@dataclass(slots=True, eq=False)
class Case:
    """One fit: some spots in one scenario.

    Attributes
    ----------
    fits : list of Fit
        The searches, in order: all of one start, then the searches that go on with better corrections.
    coarse : mapping of name to value
        Where the coarse mesh alone would end; empty where it was not tried.
    is_settled : bool
        Whether the corrections by finer meshes are near enough to where it has ended.
    """

    label: str
    spots: tuple[str, ...]
    scenario: Scenario
    fits: list[Fit] = field(default_factory=list)
    coarse: dict[str, float] = field(default_factory=dict)
    n_fine: int = 0
    is_settled: bool = True

    @property
    def end(self) -> Fit | None:
        """The search that ended best, under the corrections known last; None where all failed."""
        last = self.fits[-1].problem if self.fits else None
        ended = [fit for fit in self.fits if fit.problem is last and fit.best is not None]
        return min(ended, key=lambda fit: fit.objective, default=None)

    def values(self) -> dict[str, float]:
        """Searched values at the end, by name; empty where every search failed."""
        end = self.end
        if end is None or end.best is None:
            return {}
        at = end.problem.box.values(end.best.point)
        return dict(zip(end.problem.names, at.tolist(), strict=True))


@dataclass(kw_only=True, eq=False)
class FitStage:
    """Fits every case of a study.

    Parameters
    ----------
    scores : DataFrame
        Of the sweep; empty where there was none.
    simulations : Simulations
        Where jobs are simulated and kept.
    on_progress : callable
        Called with how far the fit is, after each step.
    on_first : callable
        Called with the first case once its search has converged, before any finer mesh.
    first_start : mapping of parameter name to value
        Where the joint fit starts before the basins of the sweep; empty: only there.
    refinement : mapping of spot name to Refinement
        Of the spots that have a finer mesh.
    """

    study: Study
    design: Design
    measured: Mapping[str, Response]
    scores: pl.DataFrame
    simulations: Simulations
    abscissae: Mapping[str, str]
    progress: Progress = SILENT
    on_progress: Callable[[FitState], None] = lambda state: None
    on_first: Callable[[Case], None] = lambda case: None
    first_start: Mapping[str, float] = field(default_factory=dict)
    refinement: Mapping[str, Refinement] = field(default_factory=dict)
    _cases: list[Case] = field(default_factory=list)
    _n_known: int = 0
    _fine: dict[str, list[FineRun]] = field(default_factory=dict)
    _n_fine: Counter[str] = field(default_factory=Counter)
    _wider: dict[str, Parameter] = field(default_factory=dict)

    def run(self) -> list[Case]:
        """Fit jointly, then at each spot."""
        study = self.study
        main = study.generalising
        spots = study.spot_names
        label = ALL_SPOTS if len(spots) > 1 else spots[0]
        self.progress.begin("fit", 0)
        self._n_known = len(self.simulations.known)
        first = Case(label, self._weighed_spots(main), main)
        starts = self._starts(first) or self._by_one_spot(first)
        self._search([first], {id(first): starts}, are_rough=any(map(self._has_finer, first.spots)))
        self.on_first(first)
        self._correct([first])  # an error of the mesh may lead to an end of a range
        if remark := self._widen(first):
            self._correct([first])
            first.fits[-1].message += f"; {remark}"
        cases = [first, *(Case(label, self._weighed_spots(s), s) for s in study.scenarios if s is not main)]
        self._search(cases[1:], {id(case): [first.values()] for case in cases[1:]})
        self._correct(cases[1:])
        states = study.space.states
        if len(spots) > 1:
            of_spots = [
                (
                    Case(spot, (spot,), case.scenario),
                    {**case.values(), **at_spot(case.values(), spot, states)},
                )
                for case in cases
                for spot in case.spots
            ]
            cases += [case for case, _ in of_spots]
            self._search([case for case, _ in of_spots], {id(case): [start] for case, start in of_spots})
            self._correct([case for case, _ in of_spots])
        order = {scenario.name: i for i, scenario in enumerate(study.scenarios)}
        labels = [label, *spots]
        return sorted(cases, key=lambda case: (labels.index(case.label), order[case.scenario.name]))

    def so_far(self) -> list[Case]:
        """Cases that have an evaluation by the simulations at hand, where one more stops the fit."""
        try:
            return self.run()
        except StoppedError:
            begun = [case for case in self._cases if case.end is not None]
        for fit in (fit for case in begun for fit in case.fits):
            fit.message = fit.message or "has not ended"
        return begun

    def _weighed_spots(self, scenario: Scenario) -> tuple[str, ...]:
        """Spots that measure a channel of a scenario."""
        weighted = set(map(channel_of, scenario.weighed))
        return tuple(spot for spot in self.study.spot_names if weighted & self.measured[spot].curves.keys())

    # ------------------------------------------------------------------ searching

    def problem(self, case: Case, corrections: Mapping[str, Mapping[str, Correction]]) -> Problem:
        """State a case with corrections by spot and channel."""
        study, scenario = self.study, case.scenario
        terms = [
            term_of(study, spot, scenario, self.measured[spot], self.abscissae, corrections.get(spot, {}))
            for spot in case.spots
        ]
        return Problem(
            study, terms, self.simulations.of, study.parametrisation, noise=study.noise, wider=self._wider
        )

    def _widen(self, case: Case) -> str:
        """Widen ranges of materials where a case ends and search on, again if it gains; return a remark."""
        of_materials, most = {p.name for p in self.study.space.parameters}, np.inf
        for _ in range(4 if self.study.search.local else 0):
            end = case.end
            ends = end.at_bounds() if end and end.objective < most else ()
            at = {p: low for p, low in ends if ParameterName.parse(p.name).shared in of_materials}
            if end is None or not at:
                break
            most = 0.99 * end.objective
            self._wider |= {p.name: p.wider(below=below) for p, below in at.items()}
            self.progress.note(f"ranges of {', '.join(p.name for p in at)} are widened: the fit goes on")
            self._search([case], {id(case): [case.values()]})
        return "; ".join(
            f"{WIDENED} {old.name} widened from {old.lower:.4g}…{old.upper:.4g} to {new.lower:.4g}…"
            f"{new.upper:.4g} {old.unit}".rstrip()
            for old in case.fits[0].problem.parameters
            if (new := self._wider.get(old.name))
        )

    def _by_one_spot(self, case: Case) -> list[Mapping[str, float]]:
        """Start of a joint fit where a search of one spot ends; none where spots or simulations are few.

        Far from the answer every spot asks for about the same steps, and one spot takes them for less.
        """
        is_costly = self.study.solver.provides.mesh and self.study.search.local
        if len(case.spots) < 2 or self.study.space.states or not is_costly:
            return []
        most = max(case.spots, key=lambda spot: len(self.measured[spot].curves))
        one = Case(most, (most,), case.scenario)
        try:
            self._search([one], {id(one): []}, are_rough=True)
        finally:
            self._cases = [case for case in self._cases if case is not one]  # it is no result
        return [one.values()] if one.end is not None else []

    def _search(
        self,
        cases: Sequence[Case],
        starts: Mapping[int, Sequence[Mapping[str, float]]],
        *,
        are_rough: bool = False,
    ) -> None:
        """Search from each start, without the finer meshes' answers unless they are known already."""
        fits = []
        for case in cases:
            problem = self.problem(case, {spot: self._nearest(spot) for spot in case.spots})
            self._cases += [case] if case not in self._cases else []
            for start in starts[id(case)] or [{}]:
                point = problem.point_of(start)
                case.fits.append(Fit(problem, point if start else scaled_start(problem, point), are_rough))
            fits += case.fits
        run_searches(self.study.search, fits, self.simulations.of, self.study.seed, self._stepped)

    def _stepped(self, fit: Fit) -> None:
        case = next(case for case in self._cases if fit in case.fits)
        self.on_progress(
            FitState(
                fit=case.label,
                scenario=case.scenario.name,
                step=len(fit.trace),
                fopt=None if fit.best is None else fit.best.fopt,
                n_simulations=len(self.simulations.known) - self._n_known,
            )
        )

    def _starts(self, case: Case) -> list[Mapping[str, float]]:
        # Most starts of the searches of a case.
        most = 3 if self.study.search.local else 1
        first = [self.first_start] if self.first_start else []
        return [*first, *self._basins(case, most)][:most]

    def _basins(self, case: Case, most: int) -> list[dict[str, float]]:
        if self.scores.is_empty():
            return []
        rows = objectives(self.scores, [case.scenario]).filter(pl.col("spot").is_in(case.spots))
        means = rows.group_by("set_id").agg(pl.len().alias("n"), pl.col("fopt").mean())
        whole = means.filter(pl.col("n") == len(case.spots))
        return basins(self.design, whole, most)

    # ----------------------------------------------------------------- finer meshes

    def _nearest(self, spot: str) -> dict[str, Correction]:
        runs = self._fine.get(spot)
        return runs[-1].corrections if runs else {}

    def _correct(self, cases: Sequence[Case]) -> None:
        """Fit again with the finer meshes' answers at each end, until those at hand are near enough."""
        active = [case for case in cases if any(map(self._has_finer, case.spots))]
        for case in active:
            is_bare = case.end is not None and not any(t.corrections for t in case.end.problem.terms)
            case.coarse = case.values() if is_bare else {}
        may_restate = True  # without a new simulation once: two known corrections might take turns
        while (has_run := self._run_fine(active)) or may_restate:
            may_restate = has_run
            again = [case.fits[-1] for case in active if self._restate(case)]
            run_searches(self.study.search, again, self.simulations.of, self.study.seed, self._stepped)
        for case in active:
            shifts = [end.shift for end in self._ends(case) if self._has_finer(end.spot)]
            case.is_settled = not shifts or float(np.mean(shifts)) <= NEAR

    def _has_finer(self, spot: str) -> bool:
        return f"{spot}{FINE}" in self.simulations.limbs

    def _run_fine(self, cases: Sequence[Case]) -> bool:
        """Simulate finer meshes where what is known may be wrong by too much; whether there were any.

        That is one set a spot, and at first one spot: until the others have been simulated, too, which is
        done once a fit has ended with it, its correction is theirs.
        """
        wanted: dict[str, _End] = {}
        for case in cases:
            for end in self._ends(case):
                is_left = self._n_fine[end.spot] < self.study.fine_runs and self._has_finer(end.spot)
                is_first = bool(self._n_fine) or not wanted
                if end.spot not in wanted and is_left and is_first and not end.is_near:
                    wanted[end.spot] = end
                    case.n_fine += 1
        self._n_fine.update(wanted.keys())
        slopes = self.study.solver.provides.slopes
        jobs = [end.term.job(end.inputs, -1, slopes=slopes, fine=True) for end in wanted.values()]
        for end, fine in zip(wanted.values(), self.simulations.of(jobs), strict=True):
            try:
                left_over = self.study.left_over(self.refinement.get(end.spot, Refinement()))
                found = fine_run(end.term, end.inputs, end.coarse, fine, left_over)
                self._fine.setdefault(end.spot, []).append(found)
            except NotRankedError as error:
                self._n_fine[end.spot] = self.study.fine_runs  # it would fail again
                self.progress.note(f"warning: no correction by the finer mesh: {error}")
        return bool(wanted)

    def _restate(self, case: Case) -> bool:
        """State a case with the corrections nearest to its end; whether there is more to search."""
        end = case.end
        nearest = {each.spot: each.corrections for each in self._ends(case)}
        if end is None or end.best is None:
            return False
        is_known = all(_same(nearest[term.spot], term.corrections) for term in end.problem.terms)
        if is_known and not case.fits[-1].is_rough:
            return False
        case.fits.append(Fit(self.problem(case, nearest), end.best.point))
        return True

    def _ends(self, case: Case) -> list["_End"]:
        """End of a case at each spot, and the correction that is nearest to it."""
        end = case.end
        if end is None or end.best is None:
            return []
        try:
            slopes = EndSlopes.of(end)
        except PalpateError as error:
            self.progress.note(f"warning: {case.label}: whether its corrections are near is unknown: {error}")
            slopes = None
        ends = []
        for term in end.problem.terms:
            inputs = end.problem.inputs(term.spot, end.best.point)
            coarse = end.problem.simulated(term, inputs)
            bare = replace(term, corrections={})
            channels = map(channel_of, term.weights)
            curves = {channel: bare.values(coarse, inputs, channel) for channel in channels}
            runs = [
                (_shift(slopes, end, term.spot, errors_of(run, bare, inputs, curves)), run)
                for run in self._fine.get(term.spot, [])
            ]
            used = [each for each in runs if _same(each[1].corrections, term.corrections)]
            # A correction that is near enough is kept: another one would be one more search.
            near = [each for each in used if each[0] <= NEAR] or runs
            if near:
                shift, run = min(near, key=lambda each: each[0])
                ends.append(_End(bare, inputs, coarse, run.corrections, shift=shift))
            else:
                ends.append(_End(bare, inputs, coarse, self._borrowed(term, end, curves)))
        return ends

    def _borrowed(self, term: SpotTerm, end: Fit, curves: Mapping[str, FloatArray]) -> dict[str, Correction]:
        """Corrections of another spot for coarse curves of one whose finer mesh is not simulated yet."""
        lenders = (each for each in end.problem.terms if each.spot in self._fine)
        if self._n_fine[term.spot] or not self._has_finer(term.spot):
            return {}
        if (lender := next(lenders, None)) is None:
            return {}
        known = replace(lender, corrections=self._fine[lender.spot][-1].corrections)
        shared = curves.keys() & known.corrections.keys()
        return {
            name: correction_like(known, name, term.measured[name].abscissa, curves[name])
            for name in sorted(shared)
        }


def _shift(slopes: EndSlopes | None, end: Fit, spot: str, errors: Mapping[str, FloatArray]) -> float:
    """Shift of the parameters by errors of the curves of a spot, if the other spots' were as wrong."""
    if slopes is None:
        return np.inf
    rows = np.zeros((len(errors), slopes.gain.shape[1]))
    of_spot = (each for each in pieces(end.problem.terms) if each[0].spot == spot)
    for row, (term, name, at, scale) in zip(rows, of_spot, strict=True):
        row[at] = (scale * errors[name])[term.counted(name)]
    return len(end.problem.terms) * slopes.shift(rows)


@dataclass(frozen=True, slots=True, eq=False)
class _End:
    """End of a case at one spot, and how far its correction, or the nearest, may shift it.

    The shift is the largest of a parameter over its standard deviation.
    """

    term: SpotTerm
    inputs: SpotInputs
    coarse: Simulation
    corrections: Mapping[str, Correction]
    shift: float = np.inf

    @property
    def is_near(self) -> bool:
        return self.shift <= NEAR

    @property
    def spot(self) -> str:
        return self.term.spot


def _same(one: Mapping[str, Correction], other: Mapping[str, Correction]) -> bool:
    return one.keys() == other.keys() and all(one[name].is_same(other[name]) for name in one)
