"""The pipeline: the stages of a study, one after the other or alone.

Each stage reads the results of the stages before it from the run directory and writes
its result there, so it can run alone; :func:`run_study` runs all of them. Inputs are
checked before the first file is written.
"""

import contextlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Design, Limb, Response, Simulation
from palpate.domain.curves import abscissae_of
from palpate.errors import FirstAnswerError, PalpateError, StoppedError, StudyError
from palpate.executors.attempts import simulate_alone
from palpate.experiment.cycles import cycle_warnings
from palpate.experiment.measured import draw_files, load_measured, load_presses, mean, measured_warnings
from palpate.experiment.relaxation import relaxation_warnings
from palpate.fit.checks import check_fit
from palpate.fit.searches import BestSet
from palpate.limb.loading import limb_warnings, load_limbs, press_warnings
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.plugins.optional import ExperimentDrawer, PressDrawer
from palpate.plugins.sections import Summary
from palpate.progress import SILENT, Progress
from palpate.run.directory import RunDirectory, measured_files
from palpate.run.fit_state import remove_fit_state
from palpate.run.ledger import Ledger
from palpate.run.manifest import Changed, changed, manifest
from palpate.run.ownership import drawing_in
from palpate.run.result import FitResult, SelectionResult, StudyInputs
from palpate.sampling.study_design import draw_study
from palpate.scoring import scores as scoring
from palpate.simulation import jobs as simulation
from palpate.simulation.forecast import Part
from palpate.stages.core_stages import selected
from palpate.stages.order import in_order, stages_of_run
from palpate.stages.stage import Run, Stage, read_run, stages_of
from palpate.study.checks import setting_warnings, unedited_warnings
from palpate.study.reading import Study


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """Everything a run found.

    ``summary`` is the summary of its last stage, and ``report`` all that it has left in
    memory for others; None where it has left nothing. ``is_first_answer`` is True if the run stopped there.
    """

    folder: Path
    measured: Mapping[str, Response]
    design: Design
    simulations: tuple[Simulation, ...]
    scores: pl.DataFrame
    selected: SelectionResult
    fit: FitResult
    summary: Summary = field(default_factory=Summary)
    report: Any = None
    is_first_answer: bool = False

    def __repr__(self) -> str:
        chosen = self.selected.selection.height
        return f"RunResult({self.folder}: {len(self.simulations)} simulations, {chosen} chosen sets)"


def check_study(study: Study, plugins: Plugins, earlier: RunDirectory | None = None) -> StudyInputs:
    """Read and check every input of the study without writing or simulating anything.

    Parameters
    ----------
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
    jobs = simulation.jobs(study, design, measured)
    simulation.check_jobs(study, jobs or simulation.middle_jobs(study, measured), limbs)
    if not isinstance(study.search, BestSet):
        check_fit(study, measured, abscissae_of(plugins.channels))
    of_curves = _measured_warnings(study, measured)
    of_presses = (*limb_warnings(study, limbs), *press_warnings(study, limbs))
    of_study = (*unedited_warnings(study), *setting_warnings(study))
    warnings = (*of_study, *of_curves, *of_presses)
    return StudyInputs(measured=measured, limbs=limbs, design=design, warnings=warnings, jobs=jobs)


def parts_of(study: Study, inputs: StudyInputs, plugins: Plugins) -> list[Part]:
    """Usual simulations of each stage of a whole run of a study, which has been checked."""
    run = read_run(study, RunDirectory(study.folder), plugins, is_copy=False)
    run = replace(run, fresh=inputs)
    return run.parts(stages_of_run(study, run.stages))


def _measured_warnings(study: Study, measured: Mapping[str, Response]) -> tuple[str, ...]:
    law, found = study.parametrisation, (*measured_warnings(measured), *cycle_warnings(study, measured))
    if all(map(study.models_relaxation, study.scenarios)):
        return found
    return (*found, *relaxation_warnings(measured, study.budget.gain, law.relaxing))


def run_study(
    study: Study,
    run_folder: Path | str,
    plugins: Plugins | None = None,
    progress: Progress = SILENT,
    *,
    forked_from: Path | None = None,
    trust: Collection[str] = (),
    confirm: Callable[[Changed], None] = lambda changed: None,
    adopt: bool = False,
    fit_start: Mapping[str, float] | None = None,
    without: Collection[str] = (),
    is_quick: bool = False,
) -> RunResult:
    """Results of a whole study, from measured curves to identified parameters.

    Parameters
    ----------
    run_folder : Path or str
        Made where it is missing; simulations already in it are not computed again.
    plugins : Plugins, optional
        The installed ones when left out.
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
    without : collection of str
        Stages that are left out, such as ``report``.
    is_quick : bool
        Whether to stop after the first answer.

    Raises
    ------
    PalpateError
        Something in the input is wrong; nothing has been written.
    NothingSelectableError
        Every simulation failed.
    """
    run_folder, plugins = Path(run_folder), plugins or Plugins.load()
    directory, before = RunDirectory(run_folder), RunDirectory(forked_from or run_folder)
    directory.refuse_other(study, adopt=adopt)
    has_answer = directory.records.has("answer") and bool(directory.result())
    if is_complete := has_answer and not directory.records.is_going_on:
        progress.note(f"{run_folder} is complete: simulations are reused, fit and report made again")
    progress.begin("check", 1)
    run = read_run(study, directory, plugins, progress, is_copy=False)
    stages = run.stages
    wanted = [stage for stage in stages_of_run(study, stages) if stage.name not in without]
    made_from = run.made_from(stages["experiment"])  # before the files are read: a later change is noticed
    inputs = check_study(study, plugins, before)
    progress.step()
    for text in inputs.warnings:
        progress.note(f"warning: {text}")
    study = before.with_trusted_code(study, trust)
    changes = _changed(study, inputs, before, plugins)
    confirm(changes)
    is_again = is_complete and not changes.changes
    if is_quick and is_again:
        is_quick = False
        progress.note("--quick is ignored: the run is complete, and its page has more than a first answer")
    with directory.locked(study, plugins.channels, adopt=adopt) as check_lock:
        if forked_from is not None:
            with Ledger(forked_from) as ledger:
                ledger.copy_to(run_folder)
        directory.initialise(study, plugins.channels, simulating=True, fit_start=fit_start)
        directory.records.write("whole run", (), {})  # until it ends
        if n_kept := inputs.design.n_kept:
            progress.note(f"the first {n_kept} sets of the design are from an earlier one with wider ranges")
        given = replace(
            run, study=study, fresh=inputs, check_lock=check_lock, is_quick=is_quick, is_again=is_again
        )
        with given as run, _showing_so_far(run, wanted):
            return _made(run, inputs, wanted, made_from)


def _made(run: Run, inputs: StudyInputs, wanted: Sequence[Stage], made_from: Mapping[str, str]) -> RunResult:
    """Result of all stages, made in turn, and again where a later one asks for it."""
    folder, is_first_answer = run.directory.folder, False
    try:
        for i, stage in enumerate(wanted):
            if stage.comes_last:
                remove_fit_state(folder)
            run.expect(wanted[i:])
            _make(run, stage, made_from if stage.name == "experiment" else None)
            if stage.needs:
                run = _again(run, stage, wanted)
        remove_fit_state(folder)
        run.directory.records.forget("whole run")
    except FirstAnswerError:
        is_first_answer = True
    run.spent.write()
    return RunResult(
        folder=folder,
        measured=inputs.measured,
        design=inputs.design,
        simulations=run.swept(),
        scores=run.table("scores"),
        selected=selected(run),
        fit=run.fit(),
        summary=wanted[-1].summarise(run),
        report=run.shared.get(wanted[-1].name),
        is_first_answer=is_first_answer,
    )


@contextlib.contextmanager
def _showing_so_far(run: Run, wanted: Sequence[Stage]) -> Iterator[None]:
    """Let the stages show what a run has found so far where the user stops it."""
    try:
        yield
    except (StoppedError, KeyboardInterrupt):
        with contextlib.suppress(PalpateError):  # nothing to show
            for stage in wanted:
                with answering_for(stage, "showing the run so far"):
                    stage.show_so_far(run)
        raise


def _make(run: Run, stage: Stage, made_from: Mapping[str, str] | None) -> None:
    """Run a stage of a whole run; one that the run can do without may fail."""
    try:
        run.make(stage, made_from)
    except StoppedError:
        raise
    except PalpateError as error:
        if not stage.may_fail:
            raise
        run.progress.note(f"warning: no results of `palpate {stage.name}`: {error}")
    if made_from is not None:
        run.check(stage.name)
        run.directory.write_measured_to_manifest(run.study)
    if not stage.comes_last and not run.progress.should_continue():
        raise StoppedError(f"stopped after `palpate {stage.name}`; run the same command to continue")


def _again(run: Run, last: Stage, wanted: Sequence[Stage]) -> Run:
    """Run whose stages from the fit to ``last`` are made again with the inputs that ``last`` asks for."""
    names = [stage.name for stage in wanted]
    while inputs := last.again(run):
        run = run.with_inputs(inputs)
        for i in range(names.index("fit"), names.index(last.name) + 1):
            run.expect(wanted[i:])
            _make(run, wanted[i], None)
    return run


def _changed(study: Study, inputs: StudyInputs, run: RunDirectory, plugins: Plugins) -> Changed:
    """Differences of the study from the one that a folder was written for."""
    if not run.exists:
        return Changed(changes=(), n_finished=0, n_valid=0)
    keys = simulation.keys(study, inputs.jobs, inputs.limbs)
    with Ledger(run.folder) as ledger:
        return changed(ledger, run.manifest(), manifest(study, plugins.channels), keys)


# --------------------------------------------------------------- single stages


@contextlib.contextmanager
def locked_run(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    *,
    needs: Collection[str] = (),
    more_limbs: Mapping[str, Limb] | None = None,
) -> Iterator[Run]:
    """Lock a run directory and read it back, refused where what is needed is missing or stale.

    Parameters
    ----------
    needs : collection of str
        Stages whose results are read.
    more_limbs : mapping of limb name to Limb, optional
        Those that are simulated besides the study's.
    """
    directory = RunDirectory(run_folder)
    read_run(study, directory, plugins).require(*needs)  # before a folder is made
    with (
        directory.locked(study, plugins.channels) as check_lock,
        read_run(
            study,
            directory,
            plugins,
            progress,
            is_copy=False,
            check_lock=check_lock,
            more_limbs=more_limbs or {},
        ) as run,
    ):
        run.check(*needs)
        yield run
        remove_fit_state(run_folder)


def run_stage(
    name: str, study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT
) -> Run:
    """Run directory after one stage alone, whose needed stages have been run.

    A PluginError where there is no such stage; a StudyError where results of a needed one are missing or
    stale.
    """
    stages = stages_of(study, plugins)
    stage = in_order(stages, [name])[-1]
    with locked_run(study, run_folder, plugins, progress, needs=stage.needs) as run:
        run.directory.initialise(study, plugins.channels, simulating=name == "simulate")
        progress.begin(name, 1)
        run.expect([stage])
        run.make(stage)
        progress.step()
        return run


def measure(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT, *, plots: bool = False
) -> Mapping[str, Response]:
    """Read the measured curves into ``measured/<spot>.parquet``.

    With ``plots`` every step from file to curve is drawn into ``measured/plots/<spot>/``,
    also for a refused file, up to the step that fails; ``measured/curves.html`` shows all curves.
    """
    progress.begin("measure", 1)
    directory, stages = RunDirectory(run_folder), stages_of(study, plugins)
    with contextlib.ExitStack() as drawn:
        folders: dict[str, Path] = {}
        if plots:
            drawn.enter_context(directory.locked(study, plugins.channels))
            for name in study.spot_names:
                folders[name] = drawn.enter_context(drawing_in(directory.plots(name)))
        for spot in study.spots if plots else ():
            draw_files(study, spot, folders[spot.spot.name])
        run = read_run(study, directory, plugins, is_copy=False)
        made_from = run.made_from(stages["experiment"])  # before the files are read: a later change counts
        presses = load_presses(study, plugins.channels)
        measured = {spot: mean(found) for spot, found in presses.items()}
        scoring.check_scorable(measured, study.scoring, study.scenarios)
        if not plots:  # a file that is refused leaves no folder behind
            drawn.enter_context(directory.locked(study, plugins.channels))
        directory.initialise(study, plugins.channels)
        directory.write_stage("experiment", measured_files(measured), made_from)
        directory.write_measured_to_manifest(study)
        every = {name: found.responses for name, found in presses.items()}
        shown = plugins.channels, study.notice
        for stage in stages.values() if plots else ():
            if isinstance(stage, PressDrawer):
                for name, folder in folders.items():
                    stage.draw_presses(name, every[name], measured[name], *shown, folder)
            if isinstance(stage, ExperimentDrawer):
                stage.draw_experiment(study.name, every, folders, *shown, directory.curves_page)
    for text in _measured_warnings(study, measured):
        progress.note(f"warning: {text}")
    progress.step()
    return measured


def simulate_one(study: Study, run_folder: Path, plugins: Plugins, spot: str, set_id: int) -> Simulation:
    """Simulate one set of the stored design at one spot, in this process; nothing is stored.

    An exception of the solver is a status, with the whole traceback in the diagnostics. A StudyError where
    the study has no such spot, or the design no such set.
    """
    run = read_run(study, RunDirectory(run_folder), plugins, is_copy=False)
    spots, n_sets = study.spot_names, run.design.n_sets
    if spot not in spots or not 0 <= set_id < n_sets:
        raise StudyError(
            f"{run_folder}: no job '{spot}/{set_id}'; name one of the spots {', '.join(spots)} and a set "
            f"from 0 to {n_sets - 1}"
        )
    every = simulation.jobs(study, run.design, run.measured)
    job = next(job for job in every if job.spot == spot and job.set_id == set_id)
    return simulate_alone(study.solver, job, run.limbs.get(job.limb_name))
