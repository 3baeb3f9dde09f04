"""Presses, made or only thought of: simulated at likely parameters, and what each would tell."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.api import (
    SILENT,
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    MeshError,
    PalpateError,
    ParameterName,
    Progress,
    Protocol,
    Response,
    Scenario,
    Simulation,
    Status,
)
from palpate.api.fit import (
    Evaluation,
    Fit,
    NotRankedError,
    Problem,
    SpotTerm,
    Trial,
    changed_like,
    channel_of,
    correction_like,
    fine_run,
    path_of,
)
from palpate.api.runs import FINE, Study, finer_limb, load_limbs
from palpate_certainty.api import (
    MESH,
    OF_LIMB,
    SPOTS,
    Columns,
    CurveCoordinates,
    ErrorSource,
    Laplace,
    LinearProblem,
    SpotDifferences,
    SpotMesh,
    columns_of,
    error_budget,
    error_sources_of,
    layout_of,
    linearised,
    n_differences,
    spot_meshes,
)
from palpate_planning.candidates import CandidatePress
from palpate_planning.information import ErrorSizes, FisherInformation, cause_name, press_information

ONSET = "onset"
"""Kind of the cause that shifts the depth of a press."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignProblem:
    """Knowledge before a further press.

    Parameters
    ----------
    problem : Problem
        The joint fit of the presses so far in the scenario.
    columns : Columns
        What error sources add to the presses so far.
    meshes : mapping of spot or press name to SpotMesh
        Those under the presses so far and under candidates; see :func:`press_meshes`.
    limbs : dict of limb name to Limb
        On which jobs are simulated; those that a cause changes are added.
    estimate : (n_parameters,) array, optional
        Values of the fit; by default those at the first point.
    laplace : Laplace, optional
        Density of the fit; None before any press.
    along : CurveCoordinates, optional
        Coordinates in which the curves of the fit are linear.
    between : SpotDifferences, optional
    like_so_far : bool
        Whether causes and meshes are taken to change the curves of a candidate as at the press so far at
        its spot, and are not simulated.
    limited : mapping of channel to tuple of Channel
        Further curves of candidates, for the largest ordinate of a channel along the whole motion.
    """

    study: Study
    scenario: Scenario
    problem: Problem
    measured: Mapping[str, Response]
    errors: ErrorSizes
    columns: Columns = field(default_factory=dict)
    meshes: Mapping[str, SpotMesh] = field(default_factory=dict)
    limbs: dict[str, Limb] = field(default_factory=dict)
    estimate: FloatArray | None = None
    laplace: Laplace | None = None
    along: CurveCoordinates | None = None
    between: SpotDifferences | None = None
    limited: Mapping[str, tuple[Channel, ...]] = field(default_factory=dict)
    like_so_far: bool = False
    progress: Progress = SILENT

    @property
    def shared(self) -> list[int]:
        """Numbers of the searched values that all presses share; the others belong to one spot."""
        return [i for i, name in enumerate(self.problem.names) if not ParameterName.parse(name).spot]

    def term(self, spot: str) -> SpotTerm:
        """Term of the press so far at a spot, or of the first that there is."""
        return next((t for t in self.problem.terms if t.spot == spot), self.problem.terms[0])

    def site(self, spot: str) -> str:
        """Name of the place of a spot: the first spot of the fit that is there."""
        return next((term.site for term in self.problem.terms if term.spot == spot), spot)

    def mesh(self, press: CandidatePress) -> SpotMesh:
        """Mesh under a press, as far as its error goes."""
        return self.meshes.get(press.name, SpotMesh())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressAtPoint:
    """A press at one point of the parameters.

    ``peaks`` are the largest ordinates of a candidate by channel, and its largest ``pressure`` [MPa] where it
    is limited.
    """

    information: FisherInformation
    peaks: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedPress:
    """A press at every point (``at``), or why it cannot be made (``failure``)."""

    press: CandidatePress
    at: tuple[PressAtPoint, ...] = ()
    failure: str = ""

    @property
    def peaks(self) -> dict[str, float]:
        """Largest ordinate of each channel at any of the points."""
        names = dict.fromkeys(name for each in self.at for name in each.peaks)
        return {name: max(each.peaks.get(name, 0.0) for each in self.at) for name in names}


_Stated = tuple[Problem, dict[str, float]]
"""A problem with simulated curves as measured, and the largest ordinate of each channel."""


def press_meshes(
    study: Study, presses: Sequence[CandidatePress]
) -> tuple[dict[str, SpotMesh], dict[str, Limb]]:
    """Meshes under presses as far as their errors go, by press name; and their finer ones by limb name.

    A finer one is made as for a spot of the study, at the edge of the contact of each press.
    """
    limbs, places = load_limbs(study), {each.spot.name: each for each in study.spots}
    meshes: dict[str, SpotMesh] = {}
    finer: dict[str, Limb] = {}
    for press in presses if limbs else ():
        spot = replace(places[press.spot], protocol=press.protocol)
        pressed, under = replace(study, spots=(spot,)), dict(limbs)
        fine = None
        with contextlib.suppress(MeshError):  # one that cannot be refined is pressed as it is
            fine = finer_limb(pressed, spot, limbs) if study.fine_runs else None
        under.pop(f"{press.spot}{FINE}", None)
        if fine is not None:
            under[f"{press.spot}{FINE}"] = finer[f"{press.name}{FINE}"] = fine
        meshes[press.name] = spot_meshes(pressed, under, is_refined=True).get(press.spot, SpotMesh())
    return meshes, finer


def presses_so_far(design: DesignProblem, points: FloatArray) -> tuple[list[SimulatedPress], FloatArray]:
    """Information of the presses of the fit, at points (n_points, n_parameters) of the box of the fit.

    Returns
    -------
    list of SimulatedPress
    points : (n, n_parameters) array
        Those at which every press can be simulated; the first is among them.

    Raises
    ------
    PalpateError
        A press cannot be simulated at the first point.
    """
    terms = design.problem.terms
    problems = [design.problem.restated([term]) for term in terms]
    asked = [(problem, point_in(design, problem, point)) for problem in problems for point in points]
    found = np.array(slopes_of(asked), dtype=object).reshape(len(terms), len(points))
    ended = np.array([[each.jacobian is not None for each in row] for row in found])
    if failed := [i for i in range(len(terms)) if not ended[i, 0]]:
        raise PalpateError(f"spot '{terms[failed[0]].spot}': {found[failed[0], 0].failure}")
    used = np.flatnonzero(ended.all(axis=0))
    simulated = []
    for term, problem, row in zip(terms, problems, found, strict=True):
        press = CandidatePress(name=term.spot, spot=term.spot, protocol=term.protocol)
        found_at = [_information(design, press, problem, row[k], design.columns) for k in used]
        at = tuple(PressAtPoint(information=information) for information in found_at)
        simulated.append(SimulatedPress(press=press, at=at))
    return simulated, points[used]


def simulated_presses(
    design: DesignProblem, presses: Sequence[CandidatePress], points: FloatArray
) -> list[SimulatedPress]:
    """Simulate presses at points (n_points, n_parameters) of the box; causes are taken at the first."""
    problems = _stated(design, presses, points)
    whole = {press: found for press, found in problems.items() if not isinstance(found, str)}
    evaluated = iter(
        slopes_of(
            [
                (problem, point_in(design, problem, p))
                for found in whole.values()
                for (problem, _), p in zip(found, points, strict=True)
            ]
        )
    )
    results = {}
    for press, found in whole.items():
        ended = [next(evaluated) for _ in points]
        results[press] = _simulated(design, press, found, ended)
    return [
        results[press] if press in results else SimulatedPress(press=press, failure=str(problems[press]))
        for press in presses
    ]


def _simulated(
    design: DesignProblem, press: CandidatePress, stated: Sequence[_Stated], ended: Sequence[Evaluation]
) -> SimulatedPress:
    if failure := next((each.failure for each in ended if each.jacobian is None), ""):
        return SimulatedPress(press=press, failure=failure)
    try:
        columns = _columns(design, press, first := stated[0][0], ended[0])
    except PalpateError as error:
        return SimulatedPress(press=press, failure=str(error))
    at = []
    for (problem, peaks), each in zip(stated, ended, strict=True):
        scaled = {
            (spot, name): {cause: _as_large(column, problem, first, name) for cause, column in of.items()}
            for (spot, name), of in columns.items()
        }
        information = _information(design, press, problem, each, scaled)
        at.append(PressAtPoint(information=information, peaks=peaks))
    return SimulatedPress(press=press, at=tuple(at))


def _as_large(column: FloatArray, problem: Problem, first: Problem, channel: str) -> FloatArray:
    """Change by a cause of a curve that is larger or smaller than at the first point."""
    here, there = (np.abs(p.terms[0].measured[channel].ordinate).max() for p in (problem, first))
    return column * (here / there)


def _stated(
    design: DesignProblem, presses: Sequence[CandidatePress], points: FloatArray
) -> dict[CandidatePress, list[_Stated] | str]:
    """State a problem for each press and point, its simulated curves as measured; or why there is none.

    What a finer mesh adds is simulated at the first point.
    """
    bare = {press: bare_problem(design, press) for press in presses}
    jobs = [job_of(design, problem, point) for problem in bare.values() for point in points]
    finer = [p for p in bare if design.mesh(p).refinement.ratio > 1.0 and not design.like_so_far]
    jobs += [replace(job_of(design, bare[p], points[0]), spot=p.name).on_finer_mesh() for p in finer]
    n_more = sum(_n_differences(design, problem, len(points)) for problem in bare.values())
    more = f", then up to {n_more} for slopes and the error budget" if n_more else ""
    once_more = f" and {len(finer)} finer meshes" if finer else ""
    design.progress.note(
        f"{len(bare)} presses × {len(points)} parameter values{once_more} = {len(jobs)} simulations{more}"
    )
    design.progress.begin("candidates", len(jobs))
    ended = iter(design.problem.simulate(jobs))
    design.progress.begin("rank", 0)
    coarse = {press: [next(ended) for _ in points] for press in bare}
    fine = dict(zip(finer, ended, strict=True))
    return {
        press: _restated(design, press, problem, points, coarse[press], fine.get(press))
        for press, problem in bare.items()
    }


def _n_differences(design: DesignProblem, bare: Problem, n_points: int) -> int:
    """Most simulations of a press for what is no slope of the solver: causes at one point, values at all."""
    values = 0 if design.study.solver.provides.slopes else 2 * len(bare.names) * n_points
    of_causes = n_differences(_causes(design, bare), design.study)
    return values if design.like_so_far else values + of_causes


def _restated(
    design: DesignProblem,
    press: CandidatePress,
    bare: Problem,
    points: FloatArray,
    coarse: Sequence[Simulation],
    fine: Simulation | None,
) -> list[_Stated] | str:
    for each in coarse:
        # A partial curve ends before its peak, so that it would pass any limit.
        if each.response is None or each.status is not Status.OK:
            return f"{each.status}: {each.message or each.status.remedy}"
    shown = [observed(bare, point_in(design, bare, p), each) for p, each in zip(points, coarse, strict=True)]
    terms = [_term(design, press, _as_measured(design, press, each)) for each in shown]
    if not terms[0].weights:
        return f"it shows no channel of scenario '{design.scenario.name}'"
    known = design.term(press.spot) if design.like_so_far else terms[0]
    if fine is not None:
        inputs = bare.inputs(known.spot, point_in(design, bare, points[0]))
        with contextlib.suppress(NotRankedError):  # its error is that of one mesh then
            left_over = design.study.left_over(design.mesh(press).refinement)
            run = fine_run(known, inputs, coarse[0], fine, left_over)
            known = replace(known, corrections=run.corrections)
    stated = []
    for term, each in zip(terms, shown, strict=True):
        curves = {name: each for name, each in term.measured.curves.items() if name in known.corrections}
        corrections = {n: correction_like(known, n, of.abscissa, of.ordinate) for n, of in curves.items()}
        corrected = replace(term, corrections=corrections)
        stated.append((bare.restated([corrected]), _peaks(design, each)))
    return stated


def _peaks(design: DesignProblem, simulation: Simulation) -> dict[str, float]:
    """Largest ordinate of each channel, and of a limited one along the whole motion."""
    channel_of_curve = {each.name: name for name, of in design.limited.items() for each in of}
    found: dict[str, float] = {}
    assert simulation.response is not None
    for name, curve in simulation.response.curves.items():
        channel = channel_of_curve.get(name, name)
        found[channel] = max(found.get(channel, 0.0), float(np.abs(curve.ordinate).max()))
    return found


def bare_problem(design: DesignProblem, press: CandidatePress) -> Problem:
    """State the problem of a press without any measured curve."""
    return design.problem.restated([_term(design, press, Response(curves={}))])


def job_of(design: DesignProblem, problem: Problem, point: FloatArray) -> Job:
    """Make the job of a problem of one term, at a point (n_parameters,) of the box of the fit."""
    (term,) = problem.terms
    inputs = problem.inputs(term.spot, point_in(design, problem, point))
    return term.job(inputs, -1, slopes=design.study.solver.provides.slopes, fine=False)


def observed(problem: Problem, point: FloatArray, simulation: Simulation) -> Simulation:
    """Simulation as the parametrisation has its curves, such as relaxed, at a point of a one-term problem."""
    (term,) = problem.terms
    observe = problem.inputs(term.spot, point).observe
    if simulation.response is None or observe is None:
        return simulation
    return replace(simulation, response=observe(simulation.response))


def point_in(design: DesignProblem, problem: Problem, point: FloatArray) -> FloatArray:
    """Find a point of the box of the fit in the box of another problem, by the names of the values."""
    values = dict(zip(design.problem.names, design.problem.box.values(point).tolist(), strict=True))
    return problem.point_of(values)


def _term(design: DesignProblem, press: CandidatePress, measured: Response) -> SpotTerm:
    like = design.term(press.spot)
    assert press.protocol is not None
    weights = {n: w for n, w in design.scenario.weighed.items() if channel_of(n) in measured.curves}
    # What the spot has not shown yet, such as a slide, counts too where the scenario weighs it.
    weighed = design.study.observed([channel_of(name) for name in design.scenario.weighed])
    limited = (each for of in design.limited.values() for each in of)
    return replace(
        like,
        spot=press.spot,
        protocol=press.protocol,
        measured=measured,
        weights=weights,
        corrections={},
        channels=(*dict.fromkeys((*like.channels, *weighed)), *limited),
    )


def _as_measured(design: DesignProblem, press: CandidatePress, simulation: Simulation) -> Response:
    """Simulated curves as they would be measured: with as many points as the measured curves of the spot."""
    assert simulation.response is not None
    known = design.measured.get(press.spot) or next(iter(design.measured.values()), Response(curves={}))
    curves, further = {}, {each.name for of in design.limited.values() for each in of}
    for name, curve in simulation.response.curves.items():
        if name in further:
            continue
        # Points of a curve where no measured one shows how many there are.
        n = known[name].abscissa.size if name in known.curves else 100
        path = path_of(curve.abscissa)
        along = np.linspace(0.0, path[-1], max(n, path.size))
        curves[name] = Curve(
            channel=name,
            abscissa=np.interp(along, path, curve.abscissa),
            ordinate=np.interp(along, path, curve.ordinate),
        )
    return Response(curves=curves, record=known.record)


def slopes_of(asked: Sequence[tuple[Problem, FloatArray]]) -> list[Evaluation]:
    """Evaluate a point of each problem with slopes; what all of them need is simulated side by side."""
    jobs: list[Job] = []
    finishing = [problem.begin([Trial(point=point, slopes=True)], jobs) for problem, point in asked]
    ended = asked[0][0].simulate(jobs) if asked else []
    return [finish(ended)[0] for finish in finishing]


def _causes(design: DesignProblem, problem: Problem) -> list[ErrorSource]:
    """Causes that change the curves of a press."""
    (term,) = problem.terms
    causes = error_sources_of(design.study, {**design.measured, term.spot: term.measured}, problem.names)
    return [cause for cause in causes if cause.is_at(term.spot)]


def _columns(
    design: DesignProblem, press: CandidatePress, problem: Problem, evaluation: Evaluation
) -> Columns:
    """Change of the curves of a press by each cause; refuse it where the effect of its motion is unknown."""
    (term,) = problem.terms
    weighed = [name for name in term.measured if design.scenario.fits(name)]
    so_far = design.term(press.spot)
    if design.like_so_far and all((term.spot, name) in design.columns for name in weighed):
        # An error of the depth matters less, the deeper the press.
        deeper = _depth_mm(so_far.protocol) / _depth_mm(term.protocol)
        by_depth = {cause.name: deeper for cause in _causes(design, problem) if cause.kind == ONSET}
        return {
            (term.spot, name): {
                cause: by_depth.get(cause, 1.0)
                * changed_like(
                    column, known := so_far.measured[name], known.ordinate, of.abscissa, of.ordinate
                )
                for cause, column in design.columns[term.spot, name].items()
            }
            for name in weighed
            for of in [term.measured[name]]
        }
    fit = Fit(problem, evaluation.point, best=evaluation)
    columns, failures = columns_of(fit, _causes(design, problem), weighed, design.limbs)
    for cause, why in failures.items():
        if cause.kind not in OF_LIMB:
            raise PalpateError(f"{cause.name}: {why}")
        design.progress.note(f"warning: {press.name} is ranked without the cause '{cause.name}': {why}")
    return columns


def _depth_mm(given: Protocol | None) -> float:
    return float(np.ptp(given.waypoints.pose[:, 0])) if isinstance(given, Indentation) else 1.0


def _information(
    design: DesignProblem, press: CandidatePress, problem: Problem, evaluation: Evaluation, columns: Columns
) -> FisherInformation:
    (term,) = problem.terms
    residuals, slopes = (each[: term.n_points] for each in linearised(problem.box, evaluation)[:2])
    rows, channels = layout_of([term], term.n_points)
    measured = {**design.measured, term.spot: term.measured}
    meshes = {term.spot: design.mesh(press)}
    found = error_budget(design.study, measured, [term], residuals, columns, meshes)
    if design.between is not None:  # presses at one place have values of their own around the means
        sizes = dict(zip(design.problem.names, design.between.sizes, strict=True))
        each = ((name, column) for name, column in zip(problem.names, slopes.T, strict=True) if name in sizes)
        found[SPOTS] = {f"{name} {term.site}": sizes[name] * column for name, column in each}
    linear = LinearProblem(
        point=evaluation.point,
        residuals=residuals,
        jacobian=slopes,
        rows=rows,
        known={
            _name(label, name, press): column[:, None]
            for label, of_label in found.items()
            for name, column in of_label.items()
            if column.any()
        },
        channels=channels,
        expected={},
    )
    own = np.array([bool(ParameterName.parse(name).spot) for name in problem.names])
    return press_information(linear.averaged(), own, design.errors, site=term.site)


def _name(label: str, name: str, press: CandidatePress) -> str:
    """Name of a cause among all presses."""
    # Kinds of causes that act on one press only.
    if label in (ONSET, "tilt", "zero"):
        return cause_name(label, name, press.name)
    of_spot = f"{press.spot} "
    # The fit will have the press as a spot of its own, with the error of its own mesh.
    is_own = label == MESH and name.startswith(of_spot)
    return cause_name(label, f"{press.name} {name.removeprefix(of_spot)}" if is_own else name)
