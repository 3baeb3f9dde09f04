"""The pipeline: the stages of the method, in the paper's order.

Each stage reads the results of the stages before it from the run directory and writes
its result there, so it can run alone; :func:`run_study` runs all of them. Inputs are
checked before the first file is written.
"""

import contextlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

import polars as pl

from palpate.certainty.posterior_stage import PosteriorStage
from palpate.certainty.posterior_tables import posterior_result
from palpate.certainty.tables import certainty_result
from palpate.domain import Design, Response, Simulation
from palpate.errors import SolverError, StudyError
from palpate.executors.attempts import simulate_alone
from palpate.fit.checks import check_fit
from palpate.fit.searches import BestSet
from palpate.fit.tables import fit_result
from palpate.opened_fit import NO_INTERVALS, abscissae_of, cases_of, certainty_stage, fit_time, opened_fit
from palpate.plugins.catalogue import Plugins
from palpate.progress import SILENT, Progress
from palpate.report import ReportData, draw_presses, write_report
from palpate.report.result import Report, RunResult
from palpate.run.directory import RunDirectory
from palpate.run.fit_state import read_fit_state
from palpate.run.keys import answers_key
from palpate.run.ledger import Ledger
from palpate.run.lock import living_runner_of
from palpate.run.manifest import manifest
from palpate.run.ownership import drawing_in
from palpate.run.result import FitResult, PosteriorResult, SelectionResult, StudyInputs
from palpate.run.stage_records import design_from, fit_from, measured_from, scores_from, selection_from
from palpate.run.study_diff import Changed, changed
from palpate.stages import scoring, selection, simulation
from palpate.stages.completeness import completeness, without_result
from palpate.stages.experiment import draw_files, load_measured, load_presses, mean, measured_warnings
from palpate.stages.limb import limb_warnings, load_limbs
from palpate.stages.relaxation import relaxation_warnings
from palpate.stages.stiffness_scaling import best_scaled_sets
from palpate.stages.study_design import draw_study
from palpate.stages.sweep import Simulations
from palpate.stages.verification import verify
from palpate.stored import StoredRun, best_sets, opened_run
from palpate.study.checks import odd_settings
from palpate.study.reading import Study


def check_study(study: Study, plugins: Plugins, earlier: RunDirectory | None = None) -> StudyInputs:
    """Read and check every input of the study without writing or simulating anything.

    Parameters
    ----------
    study : Study
    plugins : Plugins
    earlier : RunDirectory, optional
        If its ranges were wider, its finished sets are the first of the design.

    Raises
    ------
    PalpateError
    """
    measured = load_measured(study, plugins.channels)
    scoring.check_scorable(measured, study.scoring, study.scenarios)
    limbs = load_limbs(study)
    design = draw_study(study, earlier)
    to_do = simulation.jobs(study, design, measured) or simulation.middle_jobs(study, measured)
    simulation.check_jobs(study, to_do, limbs)
    if not isinstance(study.search, BestSet):
        check_fit(study, measured, abscissae_of(plugins))
    of_curves = _measured_warnings(study, measured)
    warnings = (*odd_settings(study), *of_curves, *limb_warnings(study, limbs))
    return StudyInputs(measured=measured, limbs=limbs, design=design, warnings=warnings)


def _measured_warnings(study: Study, measured: Mapping[str, Response]) -> tuple[str, ...]:
    return (*measured_warnings(measured), *relaxation_warnings(measured, study.budget.gain))


def run_study(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    forked_from: Path | None = None,
    trust: Collection[str] = (),
    confirm: Callable[[Changed], None] = lambda changed: None,
    adopt: bool = False,
    fit_start: Mapping[str, float] | None = None,
) -> RunResult:
    """From measured curves to identified parameters.

    Parameters
    ----------
    study : Study
    run_folder : Path
        Made where it is missing; simulations already in it are not computed again.
    plugins : Plugins
    progress : Progress
    forked_from : Path, optional
        A run directory whose finished simulations are copied to this one first.
    trust : collection of str
        Components whose results of earlier code are accepted: ``material:NAME``, ``solver:NAME``.
    confirm : callable
        Called with the difference between the study and the folder, before anything is written;
        raises to stop.
    adopt : bool
        Whether the run of another study file may be continued with this one.
    fit_start : mapping of parameter name to value, optional
        Where the joint fit starts first; the run directory keeps it.

    Raises
    ------
    PalpateError
        Something in the input is wrong; nothing has been written.
    NothingSelectableError
        Every simulation failed.
    """
    run, before = RunDirectory(run_folder), RunDirectory(forked_from or run_folder)
    run.refuse_other(study, adopt=adopt)
    progress.begin("check", 1)
    made_from = measured_from(study)  # before the files are read: a later change is then noticed
    inputs = check_study(study, plugins, before)
    progress.step()
    for text in inputs.warnings:
        progress.note(f"warning: {text}")
    study = before.trusting(study, trust)
    confirm(_changed(study, inputs, before, plugins))
    with run.locked(study, plugins.channels, adopt=adopt) as check_lock:
        if forked_from is not None:
            with Ledger(forked_from) as ledger:
                ledger.copy_to(run_folder)
        run.initialise(study, plugins.channels, simulating=True, fit_start=fit_start)
        run.write_measured(inputs.measured, made_from)
        run.records.check("measured", measured_from(study))
        run.write_design(inputs.design, design_from(study))
        if n_kept := inputs.design.n_kept:
            progress.note(
                f"the first {n_kept} sets of the design are those of an earlier one with wider ranges"
            )
        stored = StoredRun(study=study, run=run, inputs=inputs)
        with stored.simulations(progress, check_lock) as simulations:
            swept = simulation.run_sweep(simulations, inputs.design, inputs.measured)
            scores = _score(stored, swept)
            selected = _select(simulations, stored, swept, scores)
            fitted = _fit(simulations, stored, plugins, swept, scores)
            if study.solver.provides.surface:
                _show_surface(simulations, stored)
        return RunResult(
            folder=run_folder,
            measured=inputs.measured,
            design=inputs.design,
            simulations=swept,
            scores=scores,
            selected=selected,
            fit=fitted,
            report=_report(stored, plugins, progress),
        )


def _changed(study: Study, inputs: StudyInputs, run: RunDirectory, plugins: Plugins) -> Changed:
    """How the study differs from the one that a folder was written for."""
    if not run.exists:
        return Changed(changes=(), n_finished=0, n_valid=0)
    to_do = simulation.jobs(study, inputs.design, inputs.measured)
    keys = simulation.keys(study, to_do, inputs.limbs)
    with Ledger(run.folder) as ledger:
        return changed(ledger, run.manifest(), manifest(study, plugins.channels), keys)


# --------------------------------------------------------------- single stages


def measure(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    plots: bool = False,
) -> Mapping[str, Response]:
    """Read the measured curves into ``measured/<spot>.parquet``.

    With ``plots`` every step from file to curve is drawn into ``measured/plots/<spot>/``,
    also for a refused file, up to the step that fails.
    """
    progress.begin("measure", 1)
    run = RunDirectory(run_folder)
    with contextlib.ExitStack() as drawn:
        folders: dict[str, Path] = {}
        if plots:
            drawn.enter_context(run.locked(study, plugins.channels))
            for name in study.spot_names:
                folders[name] = drawn.enter_context(drawing_in(run.plots(name)))
        for spot in study.spots if plots else ():
            draw_files(study, spot, folders[spot.spot.name])
        made_from = measured_from(study)  # before the files are read: a later change is then noticed
        presses = load_presses(study, plugins.channels)
        measured = {spot: mean(found) for spot, found in presses.items()}
        scoring.check_scorable(measured, study.scoring, study.scenarios)
        if not plots:  # a file that is refused leaves no folder behind
            drawn.enter_context(run.locked(study, plugins.channels))
        run.initialise(study, plugins.channels)
        run.write_measured(measured, made_from)
        for name, folder in folders.items():
            draw_presses(presses[name], measured[name], plugins.channels, study.notice, folder)
    for text in _measured_warnings(study, measured):
        progress.note(f"warning: {text}")
    progress.step()
    return measured


def sample(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> Design:
    """Draw the parameter sets into ``design.parquet``."""
    progress.begin("sample", 1)
    run = RunDirectory(run_folder)
    with run.locked(study, plugins.channels):
        design = draw_study(study, run)
        run.initialise(study, plugins.channels)
        run.write_design(design, design_from(study))
    progress.step()
    return design


def simulate(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT
) -> tuple[Simulation, ...]:
    """Simulate every set at every spot; each result is stored as it comes."""
    with opened_run(study, run_folder, plugins, needs="design") as (stored, check_lock):
        study, inputs = stored.study, stored.inputs
        simulation.check_jobs(study, simulation.jobs(study, inputs.design, inputs.measured), inputs.limbs)
        stored.run.initialise(study, plugins.channels, simulating=True)
        return simulation.simulate(
            study, inputs.design, inputs.limbs, inputs.measured, run_folder, progress, check_lock
        )


def simulate_one(study: Study, run_folder: Path, spot: str, set_id: int) -> Simulation:
    """Simulate one set of the stored design at one spot, in this process; nothing is stored.

    An exception of the solver is a status, with the whole traceback in the diagnostics.

    Raises
    ------
    StudyError
        The study has no such spot, or the design no such set.
    """
    inputs = StoredRun.by_files(study, RunDirectory(run_folder)).inputs
    spots, n_sets = study.spot_names, inputs.design.n_sets
    if spot not in spots or not 0 <= set_id < n_sets:
        raise StudyError(
            f"{run_folder}: no job '{spot}/{set_id}'; name one of the spots {', '.join(spots)} and a set "
            f"from 0 to {n_sets - 1}"
        )
    every = simulation.jobs(study, inputs.design, inputs.measured)
    job = next(job for job in every if job.spot == spot and job.set_id == set_id)
    return simulate_alone(study.solver, job, inputs.limbs.get(job.limb_name))


def score(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> pl.DataFrame:
    """Compare simulated with measured curves into ``scores.parquet``."""
    with opened_run(study, run_folder, plugins, needs="design") as (stored, _):
        study, inputs = stored.study, stored.inputs
        scoring.check_scorable(inputs.measured, study.scoring, study.scenarios)
        progress.begin("score", 1)
        swept = stored.swept()
        if inputs.design.n_sets and not swept:
            raise StudyError(f"{run_folder}: no simulation of this study; run `palpate simulate` first")
        stored.run.initialise(study, plugins.channels)
        scores = _score(stored, swept)
        _warn_of_missing(stored, scores, progress)
    progress.step()
    return scores


def select(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> SelectionResult:
    """Select the best set by scenario and over all spots.

    Raises
    ------
    NothingSelectableError
        Every simulation failed.
    """
    with opened_run(study, run_folder, plugins, needs="scores") as (stored, check_lock):
        swept = stored.swept()
        scores = stored.scores(swept)
        progress.begin("select", 1)
        stored.run.initialise(stored.study, plugins.channels)
        with stored.simulations(progress, check_lock) as simulations:
            selected = _select(simulations, stored, swept, scores)
        _warn_of_missing(stored, scores, progress)
    progress.step()
    return selected


def fit(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> FitResult:
    """Search the parameters for which the curves fit best, from the selected sets."""
    with opened_run(study, run_folder, plugins, needs="scores") as (stored, check_lock):
        run, swept = stored.run, stored.swept()
        scores = stored.scores(swept)
        run.records.check("selection", selection_from(stored.study, run.records))
        run.initialise(stored.study, plugins.channels)
        with stored.simulations(progress, check_lock) as simulations:
            return _fit(simulations, stored, plugins, swept, scores)


def certainty(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT
) -> PosteriorResult:
    """Draw the posteriors of the joint fits, and what follows from them; simulates some more sets.

    Raises
    ------
    StudyError
        There is no fit, or none with intervals, or they are those of generalised least squares.
    """
    if study.budget.is_gls:
        raise StudyError(
            f'{study.file}: posteriors are around the least Fopt, and the intervals of estimator = "gls" are '
            "around the most likely values; leave [budget] estimator out to draw posteriors"
        )
    with opened_fit(study, run_folder, plugins, progress) as (stored, simulations, cases):
        study, run, inputs = stored.study, stored.run, stored.inputs
        assessed = certainty_stage(simulations, inputs, cases).assessed(cases)
        stage = PosteriorStage(study=study, design=inputs.design, swept=stored.swept(), progress=progress)
        sampled = stage.run(cases, assessed)
        if sampled is None:
            raise StudyError(NO_INTERVALS.format(run=run_folder, scenario=study.generalise_by))
        found = posterior_result(sampled, study.seed)
        run.write_posterior(found)
        return found


def surface(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> pl.DataFrame:
    """Simulate the skin under the press with what the run has found, once for each spot.

    Returns
    -------
    DataFrame
        As :func:`palpate.stages.surfaces.simulate_surfaces` returns it; the states are read back by
        :meth:`palpate.stored.StoredRun.surfaces`.
    """
    with (
        opened_run(study, run_folder, plugins, needs="selection") as (stored, check_lock),
        stored.simulations(progress, check_lock) as simulations,
    ):
        return stored.simulate_surfaces(simulations)


def report(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT, *, as_run: bool = False
) -> Report:
    """Write tables and figures under ``report/``; recomputes nothing.

    With ``as_run`` the study is the copy in the folder: neither its files nor its meshes need exist,
    and the simulations are those of the folder's last sweep. Of a run that has not ended, the best sets
    are those of the simulations so far.
    """
    run = RunDirectory(run_folder)
    run.require("design")
    runs_now = as_run and living_runner_of(run_folder) is not None
    with contextlib.nullcontext() if runs_now else run.locked(study, plugins.channels):
        if not as_run:
            return _report(StoredRun.by_files(study, run), plugins, progress)
        stored = StoredRun.alone(study, run, progress)
        return _report(stored, plugins, progress, unfinished=_unfinished(run, runs_now=runs_now))


def read_results(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> ReportData:
    """Read what a run found, by the copy of its study; writes nothing."""
    run = RunDirectory(run_folder)
    run.require("design")
    unfinished = _unfinished(run, runs_now=living_runner_of(run_folder) is not None)
    return StoredRun.alone(study, run, progress).report_data(plugins, unfinished=unfinished)


# -------------------------------------------------------------------- internals


def _unfinished(run: RunDirectory, *, runs_now: bool) -> str:
    """How far a run is that has not ended; empty where it has."""
    with Ledger(run.folder) as ledger:
        counts = ledger.counts()
    n_left, state = counts.get("left", 0), read_fit_state(run.folder)
    if not (runs_now or n_left or state):
        return ""
    sweep = f"{sum(counts.values()) - n_left} of {sum(counts.values())} simulations of the sweep"
    return sweep if state is None else f"{sweep}; fit: {state}"


def _warn_of_missing(stored: StoredRun, scores: pl.DataFrame, progress: Progress) -> None:
    found = completeness(scores, stored.study.spot_names, stored.inputs.design)
    if not found.is_complete:
        progress.note(f"warning: incomplete sweep, {found}; `palpate simulate` runs the rest")


def _score(stored: StoredRun, swept: tuple[Simulation, ...]) -> pl.DataFrame:
    study, run = stored.study, stored.run
    scores = scoring.score(swept, stored.inputs.measured, study.scoring, study.scenarios)
    run.write_scores(scores, scores_from(study, run.records, answers_key(swept)))
    return scores


def _select(
    simulations: Simulations, stored: StoredRun, swept: tuple[Simulation, ...], scores: pl.DataFrame
) -> SelectionResult:
    study, run, inputs = stored.study, stored.run, stored.inputs
    design, limbs, measured = inputs.design, inputs.limbs, inputs.measured
    chosen, generalisation = best_sets(study, design, scores)
    scaled = pl.DataFrame()
    if study.stiffness_scaling:
        scaled = selection.with_tied(best_scaled_sets(simulations, swept, design, measured), study.space)
    run.write_selection(chosen, generalisation, scaled, selection_from(study, run.records))
    return SelectionResult(
        selection=chosen,
        generalisation=generalisation,
        stiffness_scaling=scaled,
        verification=verify(study, run, design, limbs, measured, simulations.progress),
        without_result=without_result(scores, chosen, study.scenarios, study.spot_names)
        if design.n_sets
        else {},
    )


def _show_surface(simulations: Simulations, stored: StoredRun) -> None:
    """Simulate the skin for the page, if there is anything to simulate it with."""
    try:
        stored.simulate_surfaces(simulations)
    except (StudyError, SolverError) as error:
        simulations.progress.note(f"warning: the limb under the press is not shown: {error}")


def _fit(
    simulations: Simulations,
    stored: StoredRun,
    plugins: Plugins,
    swept: tuple[Simulation, ...],
    scores: pl.DataFrame,
) -> FitResult:
    study, run, found = stored.study, stored.run, FitResult()
    if not isinstance(study.search, BestSet):  # else the selection has it already
        look = fit_time(simulations, stored).look
        cases = cases_of(simulations, stored, plugins, scores, look=look)
        stage = certainty_stage(simulations, stored.inputs, cases)
        assessed = stage.assessed(cases)
        planes = stage.planes(assessed, stored.inputs.design, swept)
        certainty = replace(certainty_result(assessed, study), planes=planes)
        found = replace(fit_result(cases, simulations), certainty=certainty)
    run.write_fit(found, fit_from(study, run.records))
    return found


def _report(stored: StoredRun, plugins: Plugins, progress: Progress, *, unfinished: str = "") -> Report:
    progress.begin("report", 1)
    made = write_report(stored.report_data(plugins, unfinished=unfinished), stored.run.report)
    progress.step()
    return made
