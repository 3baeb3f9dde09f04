"""Presses of a study, first or further: simulated through its run, ranked, and chosen one after the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy

from palpate.api import SILENT, FloatArray, Limb, Parameter, Progress, Response, Run, Scenario, StudyError
from palpate.api.experiment import abscissae_of
from palpate.api.fit import Adequacy, Problem, Simulate, term_of
from palpate.api.runs import Part, Plugins, RunDirectory, Simulations, Study, Tool, load_limbs, locked_run
from palpate_certainty.api import Assessed, Columns, Laplace, SpotMesh, density_of, joint_assessed
from palpate_planning.candidates import (
    PRESSURE,
    USUAL_PLACES,
    Allowed,
    CandidatePress,
    Limit,
    candidates,
    limited_curves,
    limits_of,
)
from palpate_planning.effort import MOST_POINTS, effort, forecast_first, say_time, simulations_of
from palpate_planning.information import ErrorSizes, ExpectedError, FisherInformation
from palpate_planning.plan import (
    ALL,
    PREDICTION,
    Expected,
    Goal,
    Plan,
    Proposal,
    Step,
    ToolForce,
    check_goal,
    check_tool,
    shares_of,
    tool_forces,
    tool_limbs,
)
from palpate_planning.presses import (
    DesignProblem,
    SimulatedPress,
    press_meshes,
    presses_so_far,
    simulated_presses,
)
from palpate_planning.pressures import with_pressures
from palpate_planning.tables import for_robot


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions:
    """Options of :func:`propose`.

    Parameters
    ----------
    goal : str, optional
        Error to reduce: ``all``, ``worst``, one parameter, or ``prediction``; by default the prediction where
        a tool is given, else all.
    tool : Tool, optional
        Whose force is predicted.
    allowed : Allowed, optional
        Candidates; by default shares of the study's own presses.
    n_presses : int
        Presses to choose, one after the other.
    n_points : int, optional
        Likely parameters at which each candidate is simulated; by default as many as take no longer than the
        run did, up to :data:`MOST_POINTS`.
    is_quick : bool
        Whether one is enough, and causes and meshes change a candidate like the press so far at its spot.
    """

    goal: str | None = None
    tool: Tool | None = None
    allowed: Allowed | None = None
    n_presses: int = 1
    n_points: int | None = None
    is_quick: bool = False

    def __post_init__(self) -> None:
        if self.is_quick and self.n_points is not None:
            raise StudyError("a quick answer has one point; leave out --quick or --points")
        if self.goal == PREDICTION and self.tool is None:
            raise StudyError(f"goal '{PREDICTION}' needs a tool whose force is predicted: --tool FILE")
        if self.tool is not None and self.goal not in (None, PREDICTION):
            raise StudyError(
                f"goal '{self.goal}' needs no tool; leave the tool out, or ask for '{PREDICTION}'"
            )

    @property
    def goal_name(self) -> str:
        """Name of the goal."""
        return self.goal or (ALL if self.tool is None else PREDICTION)


USUAL = PlanOptions()
"""Options where none are given."""


def propose(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    options: PlanOptions = USUAL,
) -> Proposal:
    """Rank presses by the error of the joint fit of a run after each; simulates each at likely parameters.

    Without a fit they are the first presses of the study, over its ranges and priors; none is measured.

    Raises
    ------
    StudyError
        There is a fit without intervals or of single spots, or nothing that is allowed is possible.
    """
    limits = limits_of(options.allowed, study, plugins.channels)
    presses = candidates(study, plugins, options.allowed)
    tool = tool_limbs(study, options.tool)
    if (run_folder / "fit.parquet").exists():
        with locked_run(study, run_folder, plugins, progress, needs=["fit"], more_limbs=tool) as run:
            found = _with_verdict(run, _further_presses(run, presses, limits, options))
            run.directory.write_proposal(for_robot(found, run.limbs))
            return found
    limbs, directory = load_limbs(study), RunDirectory(run_folder)
    meshes, finer = ({}, {}) if options.is_quick else press_meshes(study, presses)
    n_points = options.n_points or (1 if options.is_quick else MOST_POINTS)
    with directory.locked(study, plugins.channels) as check_lock:
        directory.initialise(study, plugins.channels, simulating=True)
        every = {**limbs, **tool, **finer}
        forecast = forecast_first(study, every, presses, n_points)
        say_time(forecast, progress, is_quick=options.is_quick, is_chosen=options.is_quick)
        with Simulations(study, run_folder, every, progress, check_lock, forecast) as simulations:
            design, points = before_any_press(
                study, study.generalising, simulations.of, abscissae_of(plugins.channels), n_points
            )
            check_options(design, options)
            design = replace(design, meshes=meshes, limbs=simulations.limbs, progress=progress)
            found = choose_presses(design, [], presses, points, options, limits)
        directory.write_proposal(for_robot(found, limbs))
        return found


def _further_presses(
    run: Run, presses: Sequence[CandidatePress], limits: Mapping[str, Limit], options: PlanOptions
) -> Proposal:
    """Choose presses after a fit: as many, at as many points, as take no longer than the run did."""
    run.forecast.expect([], run.limbs)
    certain, assessed = joint_assessed(run)
    affordable, n_points, is_quick = effort(
        run, presses, options.n_points, is_quick=options.is_quick, may_drop=options.allowed is None
    )
    meshes, finer = ({}, {}) if is_quick else press_meshes(run.study, affordable)
    run.simulations.limbs.update(finer)
    stage = PlanningStage(
        study=run.study,
        measured=run.measured,
        assessed=assessed,
        columns=certain.columns(assessed.case)[0],
        meshes={**certain.meshes, **meshes},
        limbs=run.simulations.limbs,
        is_quick=is_quick,
        progress=run.progress,
    )
    counts = simulations_of(run, affordable, n_points, is_quick=is_quick)
    run.forecast.expect([Part(stage="next", counts=counts)], run.simulations.limbs)
    say_time(run.forecast, run.progress, is_quick=is_quick, is_chosen=options.is_quick)
    if len(affordable) < len(presses):
        run.progress.note(
            f"{len(affordable)} of {len(presses)} presses, which take no longer than the run did"
        )
    return stage.run(affordable, replace(options, n_points=n_points, is_quick=False), limits)


def _with_verdict(run: Run, found: Proposal) -> Proposal:
    """Proposal that states the failure of the model, and the press to repeat, if it fails the data."""
    reported = run.answer().filter("reported").head(1)
    if reported["model"].to_list() != [Adequacy.FAILS]:
        return found
    worst = run.fit().joint(run.study.generalise_by).sort("fopt")["spot"].to_list()
    check = worst[-1] if worst else run.study.spot_names[0]
    return replace(found, failure=reported["reason"][0], check=check)


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningStage:
    """Ranks candidates for the next presses of a study.

    Parameters
    ----------
    assessed : Assessed
        The joint fit of the scenario that generalises.
    columns : Columns
        What error sources add to its curves.
    is_quick : bool
        Whether error sources and finer meshes are taken to change a candidate like the press so far.
    """

    study: Study
    measured: Mapping[str, Response]
    assessed: Assessed
    columns: Columns
    meshes: Mapping[str, SpotMesh]
    limbs: dict[str, Limb] = field(default_factory=dict)
    is_quick: bool = False
    progress: Progress = SILENT

    def run(
        self, presses: Sequence[CandidatePress], options: PlanOptions, limits: Mapping[str, Limit]
    ) -> Proposal:
        """Simulate the presses at likely parameters, and choose one after the other.

        Raises
        ------
        StudyError
            There is no such goal, or no press can be made.
        """
        design = self.design()
        check_options(design, options)
        self.progress.begin("fit again", 0)
        so_far, points = presses_so_far(design, self._points(options.n_points or MOST_POINTS))
        return choose_presses(design, so_far, presses, points, options, limits)

    def design(self) -> DesignProblem:
        """Knowledge before the press."""
        found, channels = self.assessed.errors.noise, self.assessed.linear.channels
        box = self.assessed.end.problem.box
        errors = ErrorSizes(
            noise={channels[i]: size for i, size in found.noise.items()},
            discrepancy={channels[i]: size for i, size in found.discrepancy.items()},
            correlations=found.correlations,
            lengths={channels[i]: found.lengths(i) for i in found.discrepancy},
            usual=self.study.budget.discrepancy_of,
            common=found.common,
            freedom=self.assessed.errors.scale.freedom,
        )
        return DesignProblem(
            study=self.study,
            scenario=self.assessed.case.scenario,
            problem=self.assessed.end.problem,
            measured=self.measured,
            errors=errors,
            columns=self.columns,
            meshes=self.meshes,
            limbs=self.limbs,
            estimate=box.linear(self.assessed.point),
            laplace=self.assessed.laplace,
            along=self.assessed.along,
            between=self.assessed.errors.between,
            like_so_far=self.is_quick,
            progress=self.progress,
        )

    def _points(self, n: int) -> FloatArray:
        """Point where the fit has ended, and draws (n, n_parameters) of its density, as points of the box."""
        best, problem, box = self.assessed.end.best, self.assessed.end.problem, self.assessed.end.problem.box
        assert best is not None
        drawn = box.point(box.linear(self.assessed.density.draws(n - 1)))
        points = np.concatenate([best.point[None], drawn])
        return points[problem.accepts(points)]


def check_options(design: DesignProblem, options: PlanOptions) -> None:
    """Refuse a goal or a tool, before anything is simulated.

    Raises
    ------
    StudyError
        There is no such goal, or the tool's force is known, or not by what presses share.
    """
    check_goal(options.goal_name, shared_parameters(design))
    if options.tool is not None:
        check_tool(design, options.tool)


def choose_presses(
    design: DesignProblem,
    so_far: Sequence[SimulatedPress],
    presses: Sequence[CandidatePress],
    points: FloatArray,
    options: PlanOptions,
    limits: Mapping[str, Limit],
) -> Proposal:
    """Simulate presses at points (n_points, n_parameters) of the box, and choose one after the other.

    Raises
    ------
    StudyError
        There is no such goal, or no press can be made.
    """
    goal = _goal(design, options, points[0])
    design = replace(design, limited=limited_curves(design.study, limits))
    simulated = simulated_presses(design, presses, points)
    if PRESSURE in limits:
        simulated = with_pressures(design, simulated, points[0])
    refused = {each.press.name: why for each in simulated if (why := _refusal(each, limits))}
    possible = [each for each in simulated if each.press.name not in refused]
    if not possible:
        name, why = next(iter(refused.items()))
        raise StudyError(f"none of {len(simulated)} candidates is possible: {name}: {why}; allow others")
    plan = Plan(so_far, goal, of_priors(design), len(points), design.errors)
    n_places = USUAL_PLACES if options.allowed is None else options.allowed.places
    expected, steps = _expected(design, goal, plan.error), []
    sites, used = {design.site(each.press.spot) for each in so_far}, set[str]()
    for _ in range(options.n_presses):
        others = used or sites
        ranked = plan.ranked(possible)
        if len(others) < n_places:
            ranked.sort(key=lambda each: design.site(each.press.press.spot) in others)  # stable
        steps.append(Step(ranked=tuple(ranked)))
        plan.add(steps[-1].chosen.press)
        used.add(design.site(steps[-1].chosen.press.press.spot))
    return Proposal(goal=goal, expected=expected, steps=tuple(steps), refused=refused)


def shared_parameters(design: DesignProblem) -> tuple[Parameter, ...]:
    """Parameters that all presses share.

    Raises
    ------
    StudyError
        Every searched value belongs to one spot.
    """
    if not design.shared:
        raise StudyError(f"{design.study.file}: every searched value belongs to one spot; presses share none")
    return tuple(design.problem.parameters[i] for i in design.shared)


def _goal(design: DesignProblem, options: PlanOptions, point: FloatArray) -> Goal:
    """Make the goal where the fit has ended, or at a point (n_parameters,) of the box where none is known."""
    box, tool = design.problem.box, options.tool
    values = box.values(point) if design.estimate is None else design.estimate
    predicted: tuple[ToolForce, ...] = ()
    if tool is not None:
        at = box.point(values)
        # The most likely values may be some that no material has.
        predicted = tool_forces(design, tool, at if design.problem.accepts(at[None])[0] else point)
    return Goal(
        name=options.goal_name,
        parameters=shared_parameters(design),
        values=values[design.shared],
        predicted=predicted,
    )


def _expected(design: DesignProblem, goal: Goal, before: ExpectedError) -> Expected:
    """State the density now: of the fit, or around the goal's values before any press."""
    if design.laplace is None:
        usual = Laplace(
            centre=shares_of(goal), covariance=before.covariance, parts={}, freedom=before.freedom
        )
        return Expected(fit=usual, within=Laplace.within, shared=range(usual.centre.size), before=before)
    assert design.along is not None
    within = partial(density_of, problem=design.problem, along=design.along)
    return Expected(fit=design.laplace, within=within, shared=design.shared, before=before)


def before_any_press(
    study: Study, scenario: Scenario, simulate: Simulate, abscissae: Mapping[str, str], n_points: int
) -> tuple[DesignProblem, FloatArray]:
    """Knowledge of a study before its first press, and points (n_points, n_parameters) over its ranges.

    The first point is where a search would start.
    """
    nothing = Response(curves={})
    terms = [replace(term_of(study, s, scenario, nothing, abscissae), weights={}) for s in study.spot_names]
    problem = Problem(study, terms, simulate, study.parametrisation, noise=study.noise)
    spread = scipy.stats.qmc.Halton(len(problem.parameters), rng=study.seed).random(64 * n_points)
    accepted = spread[problem.accepts(spread)][: n_points - 1]
    errors = ErrorSizes(noise={}, discrepancy={}, usual=study.budget.discrepancy_of)
    design = DesignProblem(study=study, scenario=scenario, problem=problem, measured={}, errors=errors)
    return design, np.concatenate([problem.point_of({})[None], accepted])


def of_priors(design: DesignProblem) -> FisherInformation:
    """Information of the priors of a problem on the values that all presses share."""
    problem, shared = design.problem, design.shared
    rates = np.zeros(len(shared))
    for i, number in enumerate(shared):
        prior = problem.parameters[number].prior
        if prior is not None:
            rates[i] = (problem.box.upper - problem.box.lower)[number] / prior.sd
    return FisherInformation.of(np.diag(rates), {"prior": np.zeros((len(shared), 0))})


def _refusal(press: SimulatedPress, limits: Mapping[str, Limit]) -> str:
    """Reason why a press cannot be made; empty where it can."""
    if press.failure:
        return press.failure
    for name, (most, unit) in limits.items():
        if (peak := press.peaks.get(name, 0.0)) > most:
            return f"the {name} reaches {peak:.3g} {unit}, over the limit of {most:.3g} {unit}"
    return ""
