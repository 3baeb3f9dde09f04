"""A run directory read back: what its stages have found, refused where it is another study's."""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import polars as pl

from palpate.domain import Design, Simulation, SurfaceStates
from palpate.errors import StudyError
from palpate.plugins.catalogue import Plugins
from palpate.progress import Progress
from palpate.report import ReportData, by_spot, contact_along
from palpate.run.directory import RunDirectory
from palpate.run.keys import answers_key
from palpate.run.result import FitResult, PosteriorResult, StudyInputs
from palpate.run.stage_records import design_from, measured_from, scores_from, selection_from
from palpate.run.surface_files import surface_path
from palpate.stages import scoring, selection, simulation
from palpate.stages.fitted import Fitted, fitted
from palpate.stages.generalisation import generalise
from palpate.stages.identifiability import assess_identifiability, at_measured
from palpate.stages.limb import load_limbs
from palpate.stages.surfaces import simulate_surfaces, stored_strains, stored_surfaces
from palpate.stages.sweep import Simulations
from palpate.study.reading import Study, StudySpot


def best_sets(study: Study, design: Design, scores: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Best set by spot and scenario, and that for all spots."""
    chosen = selection.select(scores, study.scenarios, design)
    for_all = next(s for s in study.scenarios if s.name == study.generalise_by)
    general = generalise(scores, for_all, design, study.spot_names)
    return selection.with_tied(chosen, study.space), selection.with_tied(general, study.space)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StoredRun:
    """A run directory, by the study that it is read with.

    Attributes
    ----------
    study : Study
        With the answers of earlier code that the run trusts.
    run : RunDirectory
    inputs : StudyInputs
        Design and measured curves as they were stored, limbs as their files are now.
    """

    study: Study
    run: RunDirectory
    inputs: StudyInputs

    @classmethod
    def by_files(cls, study: Study, run: RunDirectory) -> Self:
        """Read the results of the earlier stages; refuse those of other inputs than the study's now."""
        study = run.trusting(study)
        design, measured = run.design(), run.measured(study.spot_names)
        run.records.check("design", design_from(study))
        run.records.check("measured", measured_from(study))
        inputs = StudyInputs(measured=measured, limbs=load_limbs(study), design=design)
        return cls(study=study, run=run, inputs=inputs)

    @classmethod
    def alone(cls, study: Study, run: RunDirectory, progress: Progress) -> Self:
        """Read the results by the run's own copy of the study, and the meshes that still exist."""
        study = run.trusting(study)
        design, measured = run.design(), run.measured(study.spot_names)
        limbs = load_limbs(study, to_show=True)
        for name in study.spot_names if study.solver.provides.mesh else ():
            if name not in limbs:
                progress.note(f"warning: no limb is shown at spot '{name}': its mesh is missing")
        inputs = StudyInputs(measured=measured, limbs=limbs, design=design, of_last_sweep=True)
        return cls(study=study, run=run, inputs=inputs)

    def swept(self) -> tuple[Simulation, ...]:
        """Simulations of the sweep that have ended."""
        inputs = self.inputs
        limbs = None if inputs.of_last_sweep else inputs.limbs
        return simulation.stored(self.study, inputs.design, limbs, inputs.measured, self.run.folder)

    def scores(self, swept: tuple[Simulation, ...]) -> pl.DataFrame:
        """Read the scores.

        Raises
        ------
        StudyError
            They are those of other simulations or rules than the study's.
        """
        scores = self.run.scores()
        n_found, n_scored = len(swept), scores.select("spot", "set_id").n_unique()
        if n_found < n_scored:
            raise StudyError(
                f"{self.run.folder}: {n_scored - n_found} of {n_scored} scored simulations are not those of "
                "the present study: a mesh, a material, the solver, its settings or a version has changed "
                "since; run `palpate run` again; add `--fork FOLDER` to keep this run"
            )
        self.run.records.check("scores", scores_from(self.study, self.run.records, answers_key(swept)))
        return scores

    def fitted(self) -> Fitted:
        """What the run has found for all spots together."""
        run = self.run
        run.records.check("selection", selection_from(self.study, run.records))
        return fitted(self.study, run.selection(), run.generalisation(), run.fit())

    def simulate_surfaces(self, simulations: Simulations) -> pl.DataFrame:
        """Simulate the skin with what the run has found, and write which simulations have it."""
        table = simulate_surfaces(simulations, self.fitted(), self.inputs.measured)
        files = [surface_path(self.run.folder, key) for key in table["key"]]
        self.run.write_surface(table, [file for file in files if file.exists()])
        return table

    def surfaces(self) -> Mapping[str, SurfaceStates]:
        """States of the skin by spot, as ``palpate surface`` has simulated them; empty where it has not."""
        return stored_surfaces(self.run.folder, self.run.surface())

    def strains(self) -> dict[str, dict[str, Any]]:
        """Strains by spot and region under that press; empty without ``palpate surface``."""
        return stored_strains(self.run.folder, self.run.surface())

    def simulations(self, progress: Progress, check_lock: Callable[[], None]) -> Simulations:
        """Open its simulations, as a context; the caller holds the lock on the folder."""
        return Simulations(self.study, self.run.folder, self.inputs.limbs, progress, check_lock)

    def report_data(self, plugins: Plugins, *, unfinished: str = "") -> ReportData:
        """Read everything that a report shows; of an unfinished run, the best sets so far."""
        found = self._found_so_far() if unfinished else self._found()
        study, inputs = self.study, self.inputs
        swept = at_measured(found.swept, inputs.measured, inputs.design.n_sets)
        identified = assess_identifiability(
            study,
            inputs.design,
            inputs.measured,
            swept,
            found.scores,
            found.selection,
            found.generalisation,
            found.fit,
        )
        return ReportData(
            study=study,
            channels=plugins.channels,
            sections=plugins.sections,
            pictures={spot.spot.name: self._pictures(spot) for spot in study.spots},
            measured=inputs.measured,
            design=inputs.design,
            scores=found.scores,
            selection=found.selection,
            generalisation=found.generalisation,
            fit=found.fit,
            posterior=found.posterior,
            stiffness_scaling=found.stiffness_scaling,
            responses={(s.job.spot, s.job.set_id): s.response for s in found.swept if s.response is not None},
            swept=swept,
            identifiability=identified.table,
            disagreements=identified.disagreements,
            convergence=by_spot(found.swept),
            contact=contact_along(found.swept),
            limbs=inputs.limbs,
            manifest=self.run.manifest(),
            verification=found.verification,
            comparisons=self.run.comparisons(),
            unfinished=unfinished,
            surfaces=self.surfaces(),
        )

    def _pictures(self, spot: StudySpot) -> tuple[Path, ...]:
        """Pictures next to the mesh of a spot, and in the run of how its presses were processed."""
        of_limb = [] if spot.mesh is None else [spot.mesh.with_suffix(".png")]
        drawn = sorted(self.run.plots(spot.spot.name).rglob("*.png"))
        return (*(path for path in of_limb if path.is_file()), *drawn)

    def _found(self) -> "_Found":
        run, swept = self.run, self.swept()
        scores, chosen, fitted = self.scores(swept), run.selection(), run.fit()
        run.records.check("selection", selection_from(self.study, run.records))
        return _Found(
            swept=swept,
            scores=scores,
            selection=chosen,
            generalisation=run.generalisation(),
            stiffness_scaling=run.stiffness_scaling(),
            verification=run.verification(),
            fit=fitted,
            posterior=run.posterior(),
        )

    def _found_so_far(self) -> "_Found":
        study, swept = self.study, self.swept()
        if not swept:
            raise StudyError(
                f"{self.run.folder}: no simulation has ended yet; watch it with `palpate status`"
            )
        scores = scoring.score(swept, self.inputs.measured, study.scoring, study.scenarios)
        chosen, general = best_sets(study, self.inputs.design, scores)
        return _Found(swept=swept, scores=scores, selection=chosen, generalisation=general)


@contextlib.contextmanager
def opened_run(
    study: Study, run_folder: Path, plugins: Plugins, *, needs: str
) -> Iterator[tuple[StoredRun, Callable[[], None]]]:
    """Lock a run and read it back; yields it, and what raises where the lock is lost."""
    run = RunDirectory(run_folder)
    run.require(needs)
    with run.locked(study, plugins.channels) as check_lock:
        yield StoredRun.by_files(study, run), check_lock


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """What the stages before the report have found."""

    swept: tuple[Simulation, ...]
    scores: pl.DataFrame
    selection: pl.DataFrame
    generalisation: pl.DataFrame
    stiffness_scaling: pl.DataFrame = field(default_factory=pl.DataFrame)
    verification: pl.DataFrame = field(default_factory=pl.DataFrame)
    fit: FitResult = field(default_factory=FitResult)
    posterior: PosteriorResult = field(default_factory=PosteriorResult)
