"""Propose further presses of a run."""

from pathlib import Path

from palpate.domain.curves import abscissae_of
from palpate.errors import StudyError
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.progress import SILENT, Progress
from palpate.run.directory import RunDirectory
from palpate.simulation.sweep import Simulations
from palpate.stages.core_stages import joint_assessed
from palpate.stages.pipeline import locked_run
from palpate.study.reading import Study
from palpate_planning.candidates import candidates, limits_of
from palpate_planning.options import PlanOptions
from palpate_planning.stage import PlanningStage, Proposal, before_any_press, check_options, choose_presses
from palpate_planning.tables import for_robot
from palpate_planning.tool_force import tool_limbs

USUAL = PlanOptions()
"""Options where none are given."""


def propose(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    options: PlanOptions = USUAL,
) -> Proposal:
    """Rank further presses by how much they would narrow the joint fit; simulates each at likely parameters.

    Raises
    ------
    StudyError
        There is no joint fit with intervals, or nothing that is allowed is possible.
    """
    allowed = options.allowed
    limits, presses = limits_of(allowed, study, plugins.channels), candidates(study, plugins, allowed)
    tool = tool_limbs(study, options.tool)
    with locked_run(study, run_folder, plugins, progress, needs=["fit"], more_limbs=tool) as run:
        certain, assessed = joint_assessed(run)
        stage = PlanningStage(
            study=run.study,
            measured=run.measured,
            assessed=assessed,
            columns=certain.columns(assessed.case)[0],
            meshes=certain.meshes,
            progress=progress,
        )
        proposal = stage.run(presses, options, limits)
        run.directory.write_proposal(for_robot(proposal, run.limbs))
        return proposal


def plan(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress = SILENT,
    options: PlanOptions = USUAL,
) -> Proposal:
    """Rank the first presses of a study, over its ranges and priors; none needs to be measured.

    Raises
    ------
    StudyError
        Nothing that is allowed is possible.
    """
    allowed = options.allowed
    limits, presses = limits_of(allowed, study, plugins.channels), candidates(study, plugins, allowed)
    tool = tool_limbs(study, options.tool)
    limbs, run = load_limbs(study), RunDirectory(run_folder)
    if (run_folder / "fit.parquet").exists():
        raise StudyError(
            f"{run_folder}: has a fit; `palpate next {run_folder}` plans further presses; name another folder"
        )
    scenario = next(s for s in study.scenarios if s.name == study.generalise_by)
    abscissae = abscissae_of(plugins.channels)
    with run.locked(study, plugins.channels) as check_lock:
        run.initialise(study, plugins.channels, simulating=True)
        with Simulations(study, run_folder, {**limbs, **tool}, progress, check_lock) as simulations:
            design, points = before_any_press(study, scenario, simulations.of, abscissae, options.n_points)
            check_options(design, options)
            progress.begin("plan", 0)
            found = choose_presses(design, [], presses, points, options, limits)
        run.write_proposal(for_robot(found, limbs))
        return found
