"""What a report is made of, read from a run."""

from collections.abc import Mapping
from pathlib import Path

import polars as pl

from palpate.errors import PluginError, StudyError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.run.result import FitResult, PosteriorResult
from palpate.scoring import scores as scoring
from palpate.stages.core_stages import best_sets
from palpate.stages.identifiability import assess_identifiability, at_measured
from palpate.stages.stage import Run, Summary
from palpate.study.reading import StudySpot
from palpate_report.convergence import by_spot, contact_along
from palpate_report.report_data import ReportData


def report_data(run: Run, plugins: Plugins, *, unfinished: str = "") -> ReportData:
    """Everything that a report shows; of an unfinished run, the best sets so far."""
    study, inputs, swept = run.study, run.inputs, run.swept()
    fit, posterior = FitResult(), PosteriorResult()
    if unfinished:
        if not swept:
            raise StudyError(
                f"{run.directory.folder}: no simulation has ended yet; watch it with `palpate status`"
            )
        scores = scoring.score(swept, inputs.measured, study.scoring, study.scenarios)
        chosen, general = best_sets(study, inputs.design, scores)
    else:
        run.check("select")
        scores = run.table("scores", "score")
        chosen, general = (run.table(name, "select") for name in ("selection", "generalisation"))
        fit, posterior = run.fit(), run.directory.posterior()
    at_points = at_measured(swept, inputs.measured, inputs.design.n_sets)
    identified = assess_identifiability(
        study, inputs.design, inputs.measured, at_points, scores, chosen, general, fit
    )
    return ReportData(
        study=study,
        channels=plugins.channels,
        sections=plugins.sections,
        pictures={spot.spot.name: _pictures(run, spot) for spot in study.spots},
        measured=inputs.measured,
        design=inputs.design,
        scores=scores,
        selection=chosen,
        generalisation=general,
        fit=fit,
        posterior=posterior,
        responses={(s.job.spot, s.job.set_id): s.response for s in swept if s.response is not None},
        swept=at_points,
        identifiability=identified.table,
        disagreements=identified.disagreements,
        convergence=by_spot(swept),
        contact=contact_along(swept),
        limbs=inputs.limbs,
        manifest=run.directory.manifest(),
        verification=pl.DataFrame() if unfinished else run.directory.verification(),
        comparisons=run.directory.comparisons(),
        unfinished=unfinished,
        surfaces=run.surfaces(),
        summaries={} if unfinished else _summaries(run),
    )


def _pictures(run: Run, spot: StudySpot) -> tuple[Path, ...]:
    """Pictures next to the mesh of a spot, and in the run of how its presses were processed."""
    of_limb = [] if spot.mesh is None else [spot.mesh.with_suffix(".png")]
    drawn = sorted(run.directory.plots(spot.spot.name).rglob("*.png"))
    return (*(path for path in of_limb if path.is_file()), *drawn)


def _summaries(run: Run) -> Mapping[str, tuple[str, Summary]]:
    """Summary and title of each stage of a plugin that has been run and is current."""
    found = {}
    for name, stage in run.stages.items():
        if type(stage).__module__.startswith("palpate.") or not run.directory.records.is_current(name):
            continue
        try:
            with answering_for(stage, "summarising its tables"):
                found[name] = (type(stage).summary, stage.summarise(run))
        except PluginError as error:
            found[name] = (type(stage).summary, Summary(lines=(f"This section could not be made: {error}.",)))
    return found
