"""Predictions under another tool: one simulation for each spot, and a band by its slopes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import polars as pl

from palpate.api import (
    FORCE,
    Channel,
    Curve,
    FloatArray,
    Indentation,
    Job,
    Limb,
    Progress,
    Refinement,
    Run,
    Simulation,
    SolverError,
    Status,
    StudyError,
    SurfaceStates,
)
from palpate.api.fit import (
    Adequacy,
    Fitted,
    SpotInputs,
    at_spot,
    inputs_at,
    job_of,
    relaxing_space,
    relaxing_thetas,
)
from palpate.api.mesh import automatic_edge_mm, contact_edge_mm, refined
from palpate.api.runs import Plugins, RunDirectory, Simulations, Study, Tool, check_jobs, load_limbs, read_run
from palpate_certainty.api import ASSUMED, usual_error
from palpate_prediction.bands import (
    SpotValues,
    Thetas,
    check_shared,
    ends,
    exceedances,
    frame_rows,
    linear,
    values_at,
    with_model_error,
)
from palpate_prediction.summary import (
    QUANTITIES,
    PressStates,
    curve_errors,
    ends_by_force,
    force_error,
    mesh_errors,
    press_states,
    stiffer_by,
    summary_rows,
    with_mesh,
)

AS_IS = "/as is"
"""Added to the name of a spot: its mesh without the refinement under the tool."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotPrediction:
    """The prediction at one spot.

    Parameters
    ----------
    simulation : Simulation
        With the fitted values; partial where it has diverged.
    bands : mapping of channel to (2, n) array
        Ends of the linear band of a curve; none without draws.
    by_force : bool
        Whether the largest force was to be reached, so that the depth is predicted.
    mesh : mapping of quantity to float
        Relative standard deviation of its error by the mesh.
    mesh_unknown : str
        Why this is what the study states, and not measured; empty where it is.
    source : str
        Fit of its values, where that is another one than the fit of the run.
    drawn_as_is : bool
        Whether draws were simulated on the mesh as it is, and changed by what the refined one changes.
    n_asked, n_ended : int
        Draws that were to be simulated, and those whose simulation did not fail: the solved bands hold these.
    """

    simulation: Simulation
    pressed: PressStates
    bands: Mapping[str, FloatArray]
    summary: list[dict[str, Any]]
    by_force: bool
    mesh: Mapping[str, float]
    mesh_unknown: str
    source: str
    drawn_as_is: bool
    n_asked: int
    n_ended: int

    @property
    def states(self) -> SurfaceStates:
        """The skin at the equilibrium states."""
        assert self.simulation.surface is not None
        return self.simulation.surface

    @property
    def at(self) -> int:
        """The state with the largest force."""
        return self.pressed.at


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """A tool on the fitted limb, at one spot or more.

    Parameters
    ----------
    model_errors : DataFrame
        Rows of the model error of each fitted channel; empty where none is known.
    record_s : float
        Time of the longest motion of the experiment, where the tissue relaxes; else 0.
    """

    tool: Tool
    fitted: Fitted
    spots: Mapping[str, SpotPrediction]
    strains: pl.DataFrame
    n_draws: int
    model_errors: pl.DataFrame
    verdict: Adequacy = Adequacy.DESCRIBES
    record_s: float = 0.0

    @property
    def summary(self) -> pl.DataFrame:
        """One row per spot and quantity: value, ends of the linear band, and of the band of solved draws."""
        return frame_rows([row for each in self.spots.values() for row in each.summary])

    @property
    def curves(self) -> pl.DataFrame:
        """One row per spot, channel and point: abscissa, ordinate, lower and upper."""
        return frame_rows([row for spot, each in self.spots.items() for row in _curve_rows(spot, each)])

    @property
    def states(self) -> pl.DataFrame:
        """One row per spot and equilibrium state: its place, force and contact."""
        return frame_rows([row for spot, each in self.spots.items() for row in _state_rows(spot, each)])


def predict(stored: Run, tool: Tool, n_solved: int = 0) -> Prediction:
    """Simulate a tool with the fitted material of a run; the caller holds the lock on the folder.

    Parameters
    ----------
    n_solved : int
        Draws of the fitted values that are simulated too, for a band without the linear assumption.

    Raises
    ------
    StudyError
        The solver gives no surface, or no slopes where no draw is simulated, or the tool's spots have no
        fitted values.
    SolverError
        The tool could not be pressed at any depth.
    """
    study, found, run = stored.study, stored.fitted(), stored.directory
    pressed = replace(tool.study(study), space=relaxing_space(study))
    values = {spot: values_at(spot, found, stored.current) for spot in pressed.spot_names}
    n_draws = min(len(each.draws) for each in values.values())
    _check(stored, n_draws, n_solved)
    experiment = _experiment(stored)
    limbs = refined_limbs(pressed, tool)
    observed = tuple(c for c in stored.channels.values() if c.columns <= set(study.solver.provides.columns))
    errors = stored.current("model_errors")
    errors = errors.filter(fit=found.fit, scenario=found.scenario) if errors.width else errors
    with Simulations(pressed, run.folder, limbs, stored.progress, stored.check_lock) as simulations:
        spots = {}
        for spot in pressed.spot_names:
            plan = _Plan(stored, pressed, tool, found, spot, observed, errors)
            spots[spot] = _at_spot(plan, simulations, values[spot], n_solved)
    strains = exceedances(experiment, {spot: each.simulation for spot, each in spots.items()})
    return Prediction(
        tool=tool,
        fitted=found,
        spots=spots,
        strains=strains,
        n_draws=n_draws,
        model_errors=errors,
        verdict=Adequacy(stored.answer().filter("reported")["model"][0]),
        record_s=study.record_s if study.relaxes else 0.0,
    )


def _check(stored: Run, n_draws: int, n_solved: int) -> None:
    study, provides = stored.study, stored.study.solver.provides
    if not provides.surface:
        raise StudyError(
            f"{study.file}: solver '{study.solver.name}' does not give the states of the skin; use 'jax'"
        )
    if n_solved and not n_draws:
        raise StudyError(
            f"{stored.directory.folder}: has no draws of the fitted values; run `palpate fit` with a search"
        )
    if n_draws and not n_solved and not provides.slopes:
        raise StudyError(
            f"{study.file}: solver '{study.solver.name}' gives no slopes, so that a band needs simulations; "
            "add --draws 20"
        )


def _experiment(stored: Run) -> dict[str, Any]:
    """Strains of the experiment by spot and region; simulates what `palpate surface` would."""
    if not stored.strains():
        limbs = load_limbs(replace(stored.study, fine_runs=0))
        with replace(stored, fresh=replace(stored.inputs, limbs=limbs)) as run:
            run.make(run.stages["surface"])
    return stored.strains()


def refined_limbs(study: Study, tool: Tool) -> dict[str, Limb]:
    """Limbs of a study of the tool by spot, refined where the tool may touch, and these as they are."""
    limbs = load_limbs(study)
    for name, limb in list(limbs.items()):
        edge_mm = tool.fine_edge_mm
        if edge_mm is None:
            edge_mm = automatic_edge_mm(limb, tool.protocol.reach_mm, tool.refined_mm)
        if edge_mm:
            limbs |= {name: refined(limb, tool.refined_mm, edge_mm), f"{name}{AS_IS}": limb}
    return limbs


@dataclass(frozen=True, slots=True)
class _Plan:
    """Plan by which values become jobs of a tool at a spot."""

    stored: Run
    pressed: Study
    tool: Tool
    found: Fitted
    spot: str
    channels: tuple[Channel, ...]
    model_errors: pl.DataFrame

    def thetas(self, values: Mapping[str, float]) -> Thetas:
        """Textbook values of the materials; friction and offsets are the tool's own."""
        study = self.stored.study
        if self.spot in self.found.spots:
            thetas = inputs_at(study, self.spot, values, self.stored.inputs.measured).thetas
        else:
            check_shared(values, study.space, self.spot)
            known = at_spot(values, self.spot, study.space.states)
            thetas = study.space.thetas(np.array([known[name] for name in study.space.names]))
        return relaxing_thetas(study, thetas, values)

    @property
    def friction_sd(self) -> float:
        """Standard deviation of the tool's friction, in proportion to the experiment's."""
        sd, protocol, friction = (
            self.stored.study.budget.friction,
            self.stored.study.protocol,
            self.tool.protocol.friction,
        )
        if sd is None or not isinstance(protocol, Indentation) or not protocol.friction:
            return ASSUMED.relative * friction
        return sd / protocol.friction * friction

    def off(self, lines: FloatArray, curve: Curve) -> FloatArray:
        """Draws of a curve that are off by a model error each."""
        return with_model_error(lines, curve, self.model_errors)

    def refinement(self, limbs: Mapping[str, Limb], depth_mm: float) -> float:
        """Size of the elements under the tool at a depth over that on the refined mesh."""
        near = self.tool.contact_mm(depth_mm)
        sizes = [contact_edge_mm(limbs[name], near) for name in (f"{self.spot}{AS_IS}", self.spot)]
        return sizes[0] / sizes[1]

    def job(self, thetas: Thetas, *, slopes: bool = False, as_is: bool = False) -> Job:
        name = f"{self.spot}{AS_IS}" if as_is else self.spot
        inputs = SpotInputs(thetas=thetas, protocol=self.tool.protocol)
        made = job_of(self.pressed, name, inputs, surface=True)
        return replace(made, slopes=slopes and self.pressed.solver.provides.slopes, channels=self.channels)


def _at_spot(plan: _Plan, simulations: Simulations, known: SpotValues, n_solved: int) -> SpotPrediction:
    best = plan.thetas(known.values)
    drawn = [plan.thetas(values) for values in known.draws]
    simulation, as_is, solved = _simulated(plan, simulations, best, drawn, n_solved)
    assert simulation.response is not None
    threshold, space = plan.tool.threshold_MPa, plan.pressed.space
    pressed = press_states(simulation, threshold)
    coarser = press_states(as_is, threshold) if as_is is not None and _both_end(simulation, as_is) else None
    ended = [s for s in solved if s.status is Status.OK and s.surface is not None]
    curves = simulation.response.curves
    force = curves.get(FORCE.name)
    lines = {n: plan.off(linear(c, best, drawn, space, plan.friction_sd), c) for n, c in curves.items()}
    apart = None if force is None else plan.off(np.tile(force.ordinate, (len(ended), 1)), force)
    by_force = ends_by_force(plan.tool.protocol, simulation.status, pressed)
    errors = _mesh_errors(plan, simulations.limbs, simulation, pressed, as_is, coarser, by_force=by_force)
    summary = summary_rows(
        plan.spot,
        pressed,
        stiffer_by(force, lines.get(FORCE.name)),
        [press_states(each, threshold) for each in ended],
        apart=stiffer_by(force, apart),
        by_force=by_force,
        coarser=coarser,
        mesh=errors.quantities,
        pressure_unit=plan.tool.pressure_unit,
    )
    return SpotPrediction(
        simulation=simulation,
        pressed=pressed,
        bands={
            name: np.array(ends(with_mesh(lines[name], sd)))
            for name, sd in errors.curves.items()
            if len(lines[name])
        },
        summary=list(summary),
        by_force=by_force,
        mesh=errors.quantities,
        mesh_unknown=errors.unknown,
        drawn_as_is=coarser is not None,
        source=known.source,
        n_asked=len(solved),
        n_ended=len(ended),
    )


class _MeshErrors(NamedTuple):
    """Relative standard deviations by the mesh, of quantities and curves; why they are not measured."""

    quantities: Mapping[str, float]
    curves: Mapping[str, float]
    unknown: str


def _simulated(
    plan: _Plan, simulations: Simulations, best: Thetas, drawn: Sequence[Thetas], n_solved: int
) -> tuple[Simulation, Simulation | None, list[Simulation]]:
    """Press with the fitted values, on the mesh as it is too where it was refined, and with some draws.

    Raises
    ------
    SolverError
        The tool cannot be pressed.
    """
    asked = [drawn[i] for i in np.linspace(0, len(drawn) - 1, min(n_solved, len(drawn))).astype(int)]
    jobs = [plan.job(best, slopes=True)]
    check_jobs(simulations.study, jobs, simulations.limbs)
    jobs += [plan.job(best, as_is=True)] if f"{plan.spot}{AS_IS}" in simulations.limbs else []
    simulations.progress.begin(f"predict {plan.spot}", len(jobs) + len(asked))
    simulation, *others = simulations.of(jobs)
    if simulation.response is None or simulation.surface is None or not len(simulation.surface.depth_mm):
        raise SolverError(
            f"spot '{plan.spot}': {plan.tool.name} cannot be pressed: "
            f"{simulation.message or 'no equilibrium state'}"
        )
    as_is = next(iter(others), None)
    # Relative to the value, a finer mesh changes as much at other materials: draws need the coarse one alone.
    coarse_is_enough = as_is is not None and _both_end(simulation, as_is)
    return simulation, as_is, simulations.of([plan.job(each, as_is=coarse_is_enough) for each in asked])


def _both_end(*simulations: Simulation) -> bool:
    return all(each.status is Status.OK for each in simulations)


def _mesh_errors(
    plan: _Plan,
    limbs: Mapping[str, Limb],
    simulation: Simulation,
    pressed: PressStates,
    as_is: Simulation | None,
    coarser: PressStates | None,
    *,
    by_force: bool,
) -> _MeshErrors:
    """Compare a simulation with that on the mesh as it is; what the study states where that shows nothing."""
    stated, refinement, unknown, others = plan.stored.study.budget.mesh, 1.0, "", None
    if as_is is None:
        unknown = "no mesh was refined under the tool"
    elif coarser is None:
        unknown = "on the mesh as it is, or on the refined one, the press has not come to its end"
    # Ratio of the sizes of two meshes below which their difference does not tell the error.
    elif (refinement := plan.refinement(limbs, pressed.depth_mm[pressed.at])) < 1.1:
        refinement, unknown = 1.0, "its mesh is hardly refined under the tool; set a shorter fine_edge"
    else:
        assert as_is.response is not None
        others = as_is.response.curves
    assert simulation.response is not None
    study, between = plan.stored.study, Refinement(ratio=refinement)
    least_of_force = usual_error(FORCE.name, FORCE.mesh, stated)
    quantities = mesh_errors(pressed, coarser, between.left_over(FORCE.mesh), least_of_force)
    convergence = {name: study.mesh_convergence(name) for name in simulation.response.curves}
    least = {name: usual_error(name, each, stated) for name, each in convergence.items()}
    left_over = {name: between.left_over(each) for name, each in convergence.items()}
    curves = curve_errors(simulation.response.curves, others, left_over, least)
    if by_force and FORCE.name in curves:
        sd = force_error(pressed, quantities)
        del curves[FORCE.name]
        curves |= {} if sd is None else {FORCE.name: sd}
    return _MeshErrors(quantities, curves, unknown)


def _curve_rows(spot: str, each: SpotPrediction) -> Iterator[dict[str, Any]]:
    assert each.simulation.response is not None
    for name, curve in each.simulation.response.curves.items():
        band = each.bands.get(name)
        for i, (x, y) in enumerate(zip(curve.abscissa.tolist(), curve.ordinate.tolist(), strict=True)):
            lower, upper = (None, None) if band is None else band[:, i].tolist()
            yield {"spot": spot, "channel": name, "point": i, "abscissa": x, "ordinate": y,
                   "lower": lower, "upper": upper}  # fmt: skip


def _state_rows(spot: str, each: SpotPrediction) -> Iterator[dict[str, Any]]:
    for i in range(len(each.pressed.force_N)):
        row: dict[str, Any] = {"spot": spot, "state": i, "rotation_deg": float(each.states.rotation_deg[i])}
        values = ((q.attribute, each.pressed.along(q.attribute)) for q in QUANTITIES)
        yield row | {name: float(of_states[i]) for name, of_states in values if of_states is not None}


def run_prediction(
    study: Study, directory: RunDirectory, tool: Tool, plugins: Plugins, progress: Progress, n_solved: int = 0
) -> Prediction:
    """Prediction of a run that is read by its own copy of the study, under its lock."""
    with directory.locked(study, plugins.channels, adopt=True) as check_lock:
        run = read_run(study, directory, plugins, progress, check_lock=check_lock)
        return predict(run, tool, n_solved)
