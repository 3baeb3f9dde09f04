"""The next press of a fitted study: candidates simulated through the run, and ranked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from palpate.certainty.causes import Columns
from palpate.certainty.tables import Assessed
from palpate.domain import FloatArray, Response, Scenario
from palpate.errors import StudyError
from palpate.fit.problem import Problem, Simulate
from palpate.fit.spot_term import term_of
from palpate.planning.evidence import ErrorSizes, Evidence
from palpate.planning.narrowing import Goal, Narrowing, Plan, interval
from palpate.planning.presses import Ground, Press, SimulatedPress, presses_so_far, simulated_presses
from palpate.progress import SILENT, Progress
from palpate.study.reading import Study


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One more press.

    Parameters
    ----------
    ranked : tuple of Narrowing
        Every candidate as this step, the best first.
    """

    ranked: tuple[Narrowing, ...]

    @property
    def chosen(self) -> Narrowing:
        """The one that narrows most."""
        return self.ranked[0]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """What to measure next.

    Parameters
    ----------
    goal : Goal
    before : (n_parameters, n_parameters) array
        Covariance of the presses so far, in shares of the ranges.
    steps : tuple of Step
        One after the other.
    refused : mapping of name to str
        Candidates that cannot be simulated or are beyond a limit, and why.
    failed_checks : tuple of str
        What says that the model does not describe the data.
    check : str
        Spot whose press should be repeated first, where a check has failed; else empty.
    """

    goal: Goal
    before: FloatArray
    steps: tuple[Step, ...]
    refused: Mapping[str, str]
    failed_checks: tuple[str, ...] = ()
    check: str = ""

    def intervals(self) -> list[tuple[FloatArray, FloatArray]]:
        """Ends (n_parameters,) of the 95 % intervals now, and after each step."""
        covariances = [self.before, *(step.chosen.covariance for step in self.steps)]
        return [interval(self.goal, covariance) for covariance in covariances]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningStage:
    """Ranks candidates for the next presses of a study.

    Parameters
    ----------
    study : Study
    measured : mapping of spot name to Response
    assessed : Assessed
        The joint fit of the scenario that generalises.
    columns : Columns
        What causes add to its curves.
    refinement : mapping of spot name to float
    progress : Progress
    """

    study: Study
    measured: Mapping[str, Response]
    assessed: Assessed
    columns: Columns
    refinement: Mapping[str, float]
    progress: Progress = SILENT

    def run(
        self,
        presses: Sequence[Press],
        goal: str,
        *,
        limits: Mapping[str, float],
        n_presses: int = 1,
        n_points: int = 6,
    ) -> Proposal:
        """Simulate the presses at likely parameters, and choose one after the other.

        Raises
        ------
        StudyError
            There is no such goal, or no press can be made.
        """
        ground = self.ground()
        best = self.assessed.end.best
        assert best is not None
        check_goal(ground, goal)
        self.progress.begin("next", 0)
        so_far, points = presses_so_far(ground, self._points(n_points))
        found = planned(
            ground,
            so_far,
            presses,
            points,
            goal,
            limits=limits,
            n_presses=n_presses,
        )
        failed_checks = tuple(check.name for check in self.assessed.checks if check.is_failed)
        return replace(found, failed_checks=failed_checks, check=self._worst_spot() if failed_checks else "")

    def ground(self) -> Ground:
        """What is known before the press."""
        found, channels = self.assessed.errors, self.assessed.channels
        errors = ErrorSizes(
            noise={channels[i]: size for i, size in found.noise.items()},
            discrepancy={channels[i]: size for i, size in found.discrepancy.items()},
            correlations=found.correlations,
            usual=self.study.budget.discrepancy,
        )
        return Ground(
            study=self.study,
            scenario=self.assessed.case.scenario,
            problem=self.assessed.end.problem,
            measured=self.measured,
            errors=errors,
            columns=self.columns,
            refinement=self.refinement,
        )

    def _points(self, n: int) -> FloatArray:
        """Where the fit has ended, and draws (n, n_parameters) of its density, as points of the box."""
        problem, best = self.assessed.end.problem, self.assessed.end.best
        assert best is not None
        box = problem.box
        drawn = [
            box.point(box.lower + (box.upper - box.lower) * s) for s in self.assessed.density.draws(n - 1)
        ]
        points = np.stack([best.point, *drawn])
        accepted: FloatArray = points[problem.accepts(points)]
        return accepted

    def _worst_spot(self) -> str:
        """Spot whose curves the joint fit describes worst."""
        problem, best = self.assessed.end.problem, self.assessed.end.best
        assert best is not None
        assert best.residuals is not None
        sizes, at = {}, 0
        for term in problem.terms:
            sizes[term.spot] = float(np.sum(best.residuals[at : at + term.n_points] ** 2))
            at += term.n_points
        return max(sizes, key=lambda spot: sizes[spot])


def planned(
    ground: Ground,
    so_far: Sequence[SimulatedPress],
    presses: Sequence[Press],
    points: FloatArray,
    goal: str,
    *,
    limits: Mapping[str, float],
    n_presses: int,
) -> Proposal:
    """Simulate presses at points (n_points, n_parameters) of the box, and choose one after the other.

    Raises
    ------
    StudyError
        There is no such goal, or no press can be made.
    """
    problem = ground.problem
    aim = check_goal(ground, goal, points[0])
    simulated = simulated_presses(ground, presses, points)
    refused = {each.press.name: why for each in simulated if (why := _refusal(each, limits))}
    possible = [each for each in simulated if each.press.name not in refused]
    if not possible:
        name, why = next(iter(refused.items()))
        raise StudyError(f"none of {len(simulated)} candidates is possible: {name}: {why}; allow others")
    plan = Plan(so_far, aim, of_priors(problem, ground.shared), len(points))
    before, steps = plan.covariance, []
    for _ in range(n_presses):
        steps.append(Step(ranked=tuple(plan.ranked(possible))))
        plan.add(steps[-1].chosen.press)
    return Proposal(goal=aim, before=before, steps=tuple(steps), refused=refused)


def check_goal(ground: Ground, goal: str, point: FloatArray | None = None) -> Goal:
    """Make a goal at a point (n_parameters,) of the box.

    Raises
    ------
    StudyError
        There is no such goal, or every searched value belongs to one spot.
    """
    problem, shared = ground.problem, ground.shared
    if not shared:
        raise StudyError(f"{ground.study.file}: every searched value belongs to one spot; presses share none")
    values = problem.box.values(problem.point_of({}) if point is None else point)
    return Goal(name=goal, parameters=tuple(problem.parameters[i] for i in shared), values=values[shared])


def before_any_press(
    study: Study,
    scenario: Scenario,
    simulate: Simulate,
    abscissae: Mapping[str, str],
    n_points: int,
) -> tuple[Ground, FloatArray]:
    """What a study knows before its first press, and points (n_points, n_parameters) over its ranges.

    Parameters
    ----------
    study : Study
    scenario : Scenario
    simulate : callable
        From jobs to their simulations.
    abscissae : mapping of channel to str
    n_points : int
        The first is where a search would start.
    """
    nothing = Response(curves={})
    terms = [replace(term_of(study, s, scenario, nothing, abscissae), weights={}) for s in study.spot_names]
    problem = Problem(study, terms, simulate, study.parametrisation, noise=study.noise)
    spread = qmc.Halton(len(problem.parameters), rng=study.seed).random(64 * n_points)
    accepted = spread[problem.accepts(spread)][: n_points - 1]
    errors = ErrorSizes(noise={}, discrepancy={}, usual=study.budget.discrepancy)
    ground = Ground(study=study, scenario=scenario, problem=problem, measured={}, errors=errors)
    return ground, np.concatenate([problem.point_of({})[None], accepted])


def of_priors(problem: Problem, shared: Sequence[int]) -> Evidence:
    """What the priors of a problem tell of the values that all presses share."""
    box, n = problem.box, len(shared)
    rows = np.zeros(n)
    for i, number in enumerate(shared):
        prior = problem.parameters[number].prior
        if prior is not None:
            rows[i] = problem.noise * (box.upper - box.lower)[number] / prior.sd * np.sqrt(len(problem.terms))
    sd = problem.noise * np.sqrt(len(problem.terms))
    return Evidence(information=np.diag(rows**2), noise=np.diag((rows * sd) ** 2), causes={})


def _refusal(press: SimulatedPress, limits: Mapping[str, float]) -> str:
    """Why a press cannot be made; empty where it can."""
    over = {name: peak for name, peak in press.peaks.items() if peak > limits.get(name, np.inf)}
    name = next(iter(over), "")
    beyond = f"the {name} reaches {over[name]:.3g}, over the limit of {limits[name]:.3g}" if over else ""
    return press.failure or beyond
