"""A study as residuals over its searched values, for notebooks and optimisers of one's own."""

import contextlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from palpate.domain import Response, Scenario
from palpate.domain.curves import abscissae_of
from palpate.errors import StudyError
from palpate.experiment.measured import load_measured
from palpate.fit.problem import Problem
from palpate.fit.spot_term import Correction, SpotTerm, term_of
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.progress import SILENT, Progress
from palpate.run.directory import RunDirectory
from palpate.run.lock import locked
from palpate.run.ownership import claim, writing_in
from palpate.run.result import ALL_SPOTS
from palpate.scoring import scores as scoring
from palpate.simulation import jobs as simulation
from palpate.simulation.sweep import Simulations
from palpate.stages.core_stages import cases_of
from palpate.stages.stage import read_run
from palpate.study.reading import Study


@contextlib.contextmanager
def open_problem(
    study: Study,
    *,
    scenario: str | None = None,
    spots: Sequence[str] | None = None,
    folder: Path | None = None,
    plugins: Plugins | None = None,
    progress: Progress = SILENT,
) -> Iterator[Problem]:
    """Open the study as residuals over its searched values, for an optimiser of your own.

    Parameters
    ----------
    scenario : str, optional
        Whose Fopt is Σ r²; when left out the one that generalises.
    spots : sequence of str, optional
        Spots that are fitted together; all of the study when left out.
    folder : Path, optional
        Run directory where every simulation is kept, so that none is computed twice; nowhere when left out.
        Where it holds a fit of the study, curves have the corrections by finer meshes of that fit, and
        Fopt is the Fopt of its report; elsewhere curves are of the coarse meshes.
    plugins : Plugins, optional
        The installed ones when left out.

    Yields
    ------
    Problem
        With ``names``, ``bounds``, ``start``, ``residuals(values)``, ``jacobian(values)`` and
        ``fopt(values)``; it simulates until the context ends.

    Raises
    ------
    PalpateError
        There is no such scenario or spot, it cannot be simulated, or the folder has another fit.
    """
    plugins = plugins or Plugins.load(study.plugin_files)
    by, chosen = _chosen(study, scenario, spots)
    measured, limbs = load_measured(study, plugins.channels), load_limbs(study)
    scoring.check_scorable(measured, study.scoring)
    simulation.check_jobs(study, simulation.middle_jobs(study, measured), limbs)
    terms = list(_terms(study, by, chosen, measured, folder, plugins))
    with _kept_in(folder) as kept, Simulations(study, kept, limbs, progress) as simulations:
        progress.begin("fit", 0)
        yield Problem(study, terms, simulations.of, study.parametrisation, noise=study.noise)


def _terms(
    study: Study,
    by: Scenario,
    spots: Sequence[str],
    measured: Mapping[str, Response],
    folder: Path | None,
    plugins: Plugins,
) -> Iterator[SpotTerm]:
    """Term of each spot, with the corrections of a fit that the folder has."""
    corrections = _corrections(study, by, spots, folder, plugins) if folder is not None else {}
    abscissae = abscissae_of(plugins.channels)
    for spot in dict.fromkeys(spots):
        term = term_of(study, spot, by, measured[spot], abscissae, corrections.get(spot))
        if not term.weights:
            raise StudyError(f"spot '{spot}' measures no channel of scenario '{by.name}'; leave it out")
        yield term


def _chosen(
    study: Study, scenario: str | None, spots: Sequence[str] | None
) -> tuple[Scenario, tuple[str, ...]]:
    """Scenario and spots of these names; by default the one that generalises, and all spots."""
    scenarios = {each.name: each for each in study.scenarios}
    name, chosen = scenario or study.generalise_by, study.spot_names if spots is None else tuple(spots)
    for kind, given, known in (("scenario", [name], scenarios), ("spot", chosen, study.spot_names)):
        for each in given:
            if each not in known:
                raise StudyError(f"{study.file}: no {kind} '{each}'; name one of {', '.join(known)}")
    return scenarios[name], chosen


def _corrections(
    study: Study, scenario: Scenario, spots: Sequence[str], folder: Path, plugins: Plugins
) -> dict[str, Mapping[str, Correction]]:
    """Corrections by finer meshes, by spot and channel, of the fit in a run directory; none without one.

    The fit of one spot has its own; else the joint fit has them.
    """
    directory = RunDirectory(folder)
    if not directory.records.has("fit"):
        return {}
    with read_run(study, directory, plugins, is_copy=False) as run:
        run.check("fit")
        cases = [case for case in cases_of(run) if case.scenario.name == scenario.name]
    label = spots[0] if len(spots) == 1 else ALL_SPOTS
    case = next((case for case in cases if case.label == label), None)
    if case is None or case.end is None:
        return {}
    return {term.spot: term.corrections for term in case.end.problem.terms}


@contextlib.contextmanager
def _kept_in(folder: Path | None) -> Iterator[Path]:
    if folder is not None:
        with writing_in(folder):
            claim(folder)
            with locked(folder):
                yield folder
        return
    with tempfile.TemporaryDirectory(prefix="palpate-") as temporary:
        yield Path(temporary)
