"""A run opened to go on with it: its simulations, and the searches of its fit."""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import polars as pl

from palpate.certainty.mesh_error import SpotMesh, noted_errors
from palpate.certainty.stage import CertaintyStage
from palpate.domain import Indentation, Limb
from palpate.fit.searches import BestSet
from palpate.fit.stage import Case, FitStage
from palpate.fit.tables import refinement
from palpate.plugins.catalogue import Plugins
from palpate.progress import Progress, ShowsPlace
from palpate.run.fit_state import FitState, remove_fit_state, write_fit_state
from palpate.run.result import StudyInputs
from palpate.run.stage_records import fit_from
from palpate.stages import simulation
from palpate.stages.cost import FitTime
from palpate.stages.limb import size_at_contact
from palpate.stages.sweep import Simulations
from palpate.stored import StoredRun, opened_run
from palpate.study.mesh_note import mesh_note
from palpate.study.reading import Study

NO_INTERVALS = (
    "{run}: no joint fit with intervals in scenario '{scenario}'; set fit.search to a search, or see the "
    "warnings of `palpate fit`"
)
"""What is missing where a stage needs intervals."""


def abscissae_of(plugins: Plugins) -> dict[str, str]:
    """Name of the abscissa of each channel."""
    return {name: channel.abscissa for name, channel in plugins.channels.items()}


def cases_of(
    simulations: Simulations,
    stored: StoredRun,
    plugins: Plugins,
    scores: pl.DataFrame,
    *,
    look: Callable[[], None] = lambda: None,
) -> list[Case]:
    """Fit every case of a study; what is simulated already is not simulated again.

    ``look`` is called before the searches and after each of their steps.
    """
    inputs = stored.inputs
    look()

    def follow(state: FitState) -> None:
        look()
        write_fit_state(stored.run.folder, state)
        if isinstance(simulations.progress, ShowsPlace):
            simulations.progress.at(str(state))

    stage = FitStage(
        study=stored.study,
        design=inputs.design,
        measured=inputs.measured,
        scores=scores,
        simulations=simulations,
        abscissae=abscissae_of(plugins),
        progress=simulations.progress,
        follow=follow,
        first_start=stored.run.fit_start,
    )
    return stage.run()


def fit_time(simulations: Simulations, stored: StoredRun) -> FitTime:
    """Make what says how long the fit of a run takes, whose searches have not been made before."""
    inputs = stored.inputs
    swept = simulation.jobs(stored.study, inputs.design, inputs.measured)
    by_key = {simulations.key(job): job for job in swept}
    return FitTime(stored.study, stored.run.folder, inputs.limbs, by_key, simulations.progress)


@contextlib.contextmanager
def opened_fit(
    study: Study,
    run_folder: Path,
    plugins: Plugins,
    progress: Progress,
    other_limbs: Mapping[str, Limb] = MappingProxyType({}),
) -> Iterator[tuple[StoredRun, Simulations, list[Case]]]:
    """Lock a run that has a fit and repeat its searches, whose simulations are all at hand.

    Parameters
    ----------
    study : Study
    run_folder : Path
    plugins : Plugins
    progress : Progress
    other_limbs : mapping of limb name to Limb
        Those that the caller simulates besides the study's.
    """
    with opened_run(study, run_folder, plugins, needs="fit") as (stored, check_lock):
        study, run = stored.study, stored.run
        scores = stored.scores(stored.swept())
        run.records.check("fit", fit_from(study, run.records))
        limbs = {**stored.inputs.limbs, **other_limbs}
        with Simulations(study, run.folder, limbs, progress, check_lock) as simulations:
            searches = not isinstance(study.search, BestSet)
            cases = cases_of(simulations, stored, plugins, scores) if searches else []
            remove_fit_state(run_folder)
            yield stored, simulations, cases


def certainty_stage(simulations: Simulations, inputs: StudyInputs, cases: Sequence[Case]) -> CertaintyStage:
    """Make the stage that assesses the cases of a run."""
    return CertaintyStage(
        study=simulations.study,
        measured=inputs.measured,
        meshes=_meshes(simulations, is_refined=any(case.n_fine for case in cases)),
        progress=simulations.progress,
    )


def _meshes(simulations: Simulations, *, is_refined: bool) -> dict[str, SpotMesh]:
    study, limbs = simulations.study, simulations.limbs
    ratios = refinement(simulations) if is_refined else {}
    meshes = {}
    for each in study.spots:
        protocol, name = study.protocol_at(each.spot.name), each.spot.name
        if each.mesh is not None and name in limbs and isinstance(protocol, Indentation):
            radius_mm = protocol.indenter.radius_mm
            meshes[name] = SpotMesh(
                edge_over_radius=size_at_contact(study, limbs[name]) / radius_mm,
                noted=noted_errors(mesh_note(each.mesh)),
                refinement=ratios.get(name, 1.0),
            )
    return meshes
