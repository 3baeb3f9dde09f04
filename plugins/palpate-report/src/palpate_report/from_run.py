"""The report of a run directory, and what it is made of."""

import contextlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

from palpate.api import SILENT, PluginError, Progress, Run, StudyError, Summary, about
from palpate.api.files import write_atomically
from palpate.api.fit import FitResult
from palpate.api.runs import (
    FIRST_ANSWER,
    RESULT,
    Ledger,
    Plugins,
    RunDirectory,
    Study,
    StudySpot,
    answering_for,
    best_sets,
    fit_so_far,
    keep_only,
    living_runner_of,
    processor_time,
    read_fit_state,
    read_run,
    score,
)
from palpate_report.answer.headline import with_verdicts
from palpate_report.answer.paper_tables import materials_of, paper_tables
from palpate_report.answer.result import Report, make_conclusion
from palpate_report.data.display_units import in_display_units
from palpate_report.data.report_data import ReportData, by_spot
from palpate_report.data.showable import checked
from palpate_report.data.table_files import write_tables
from palpate_report.data.tables import make_tables
from palpate_report.settings import BY_ITSELF, ReportSettings

READ = ("measured", "design", "scores", "selection", "generalisation", "verification", "surface", "answer")
"""Tables that are fields of the data, or made for them."""


def write_report(data: ReportData, folder: Path, *, draws: bool = True) -> Report:
    """Write ``tables/*.csv|tex|md``, ``figures/*.svg|pdf|png`` and ``index.html``, in the study's units.

    Without ``draws`` there are no files of figures; the page draws its own. Files of an earlier report that
    this one does not have are removed afterwards.
    """
    from palpate_report.page.html import write_page

    data = in_display_units(data)
    tables = with_verdicts(data, make_tables(data))
    conclusion = make_conclusion(data, tables)
    paper = paper_tables({materials_of(data): data})
    failures = [conclusion.failure] if conclusion.failure else []
    written = write_tables(tables, folder / "tables", paper, failures)
    figures = write_figures(data, folder / "figures") if draws else ()
    files = (*written, *figures)
    pictures = {file.stem: file.read_bytes() for file in figures if file.suffix == ".svg"}
    texts = {"methods.md": conclusion.methods, RESULT: json.dumps(conclusion.lines(data.study), indent=2)}
    for name, text in texts.items():
        write_atomically(folder / name, text.encode())
    files = (*files, *(folder / name for name in texts))
    page = write_page(data, tables, conclusion, files, folder, pictures)
    keep_only(folder, (*files, page))
    return Report(tables=tables, files=(*files, page), conclusion=conclusion)


def write_figures(data: ReportData, folder: Path) -> tuple[Path, ...]:
    """Draw every figure: see :func:`palpate_report.figures.drawings.write_figures`."""
    from palpate_report.figures import drawings

    return drawings.write_figures(data, folder)


def report_data(run: Run, *, unfinished: str = "") -> ReportData:
    """Everything that a report shows; of an unfinished run, the best sets so far."""
    study, inputs, swept = run.study, run.inputs, run.swept()
    tables: dict[str, pl.DataFrame] = {}
    if unfinished:
        fit = run.shared.get(FIRST_ANSWER) or _fit_so_far(run, is_swept=bool(swept))
        scores = score(swept, inputs.measured, study.scoring, study.scenarios)
        chosen, general = best_sets(study, inputs.design, scores)
    else:
        run.check("select")
        scores = run.table("scores", "score")
        chosen, general = (run.table(name, "select") for name in ("selection", "generalisation"))
        fit = run.fit()
        names = (name for stage in run.stages.values() for name in stage.tables)
        tables = {name: run.current(name) for name in names if name not in READ}
    return ReportData(
        study=study,
        folder=run.directory.folder,
        channels=run.channels,
        sections=run.sections,
        note=run.progress.note,
        pictures={spot.spot.name: _pictures(run, spot) for spot in study.spots},
        measured=inputs.measured,
        design=inputs.design,
        scores=scores,
        selection=chosen,
        generalisation=general,
        fit=fit,
        responses={(s.job.spot, s.job.set_id): s.response for s in swept if s.response is not None},
        tables=tables,
        convergence=by_spot(swept),
        limbs=inputs.limbs,
        manifest=run.directory.manifest(),
        verification=pl.DataFrame() if unfinished else run.table("verification"),
        unfinished=unfinished,
        **_simulated(run.directory.folder),
        surfaces=run.surfaces(),
        summaries={} if unfinished else _summaries(run),
        processor_time=processor_time(run.directory.folder),
        settings=next(
            (s for each in run.stages.values() if isinstance(s := each.settings, ReportSettings)), BY_ITSELF
        ),
    )


def _fit_so_far(run: Run, *, is_swept: bool) -> FitResult:
    """First answer, or the fit as far as it is without a sweep; a StudyError before its first evaluation."""
    if run.is_first_answer:
        return run.fit()
    if is_swept:
        return FitResult()
    fit = fit_so_far(run)
    if fit.table.is_empty():
        n = int(_simulated(run.directory.folder).get("n_simulations", 0))
        ended = f"{n} simulations have ended, too few for a fit" if n else "no simulation has ended yet"
        raise StudyError(f"{run.directory.folder}: {ended}; watch it with `palpate status`")
    return fit


def report(
    study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT, *, as_run: bool = False
) -> Report:
    """Write tables and figures under ``report/``; recomputes nothing.

    With ``as_run`` the study is the copy in the folder: neither its files nor its meshes need exist,
    and the simulations are the folder's last sweep. A run that has not ended shows its best sets so far.
    """
    directory = RunDirectory(run_folder)
    read_run(study, directory, plugins).require("sample")  # before a folder is made
    runs_now = as_run and living_runner_of(run_folder) is not None  # before this process is the one
    with contextlib.nullcontext() if runs_now else directory.locked(study, plugins.channels):
        run = read_run(study, directory, plugins, progress, is_copy=as_run)
        return written(run, progress, unfinished=_unfinished(run, runs_now=runs_now) if as_run else "")


def written(run: Run, progress: Progress, *, unfinished: str = "") -> Report:
    """Report of a run, written to its directory."""
    progress.begin("report", 1)
    made = write_report(report_data(run, unfinished=unfinished), run.directory.report)
    progress.step()
    return made


def show_so_far(run: Run) -> Report:
    """Report of a run that goes on or was stopped, without files of figures; it is a first answer or less."""
    unfinished = _unfinished(run, runs_now=True)
    return write_report(report_data(run, unfinished=unfinished), run.directory.report, draws=False)


def read_results(study: Study, run_folder: Path, plugins: Plugins, progress: Progress = SILENT) -> ReportData:
    """Results of a run, by the copy of its study; writes nothing."""
    run = read_run(study, RunDirectory(run_folder), plugins, progress)
    run.require("sample")
    runs_now = living_runner_of(run_folder) is not None
    return report_data(run, unfinished=_unfinished(run, runs_now=runs_now))


def _unfinished(run: Run, *, runs_now: bool) -> str:
    """Progress of a run that has not ended; empty where it has."""
    directory, is_swept = run.directory, run.study.n_sets > 0
    with Ledger(directory.folder) as ledger:
        counts = ledger.counts()
    n_left, state = counts.get("left", 0), read_fit_state(directory.folder)
    is_left = runs_now or n_left or state or directory.records.is_going_on
    # Without a sweep there is nothing to report before the fit.
    if not is_left and (is_swept or directory.records.has("fit")):
        return ""
    sweep = f"{sum(counts.values()) - n_left} of {sum(counts.values())} simulations of the sweep"
    if not is_swept:
        sweep = f"{_simulated(directory.folder).get('n_simulations', 0)} simulations"
    return sweep if state is None else f"{sweep}; fit: {state}"


def _simulated(folder: Path) -> dict[str, Any]:
    """Number of simulations, with the day of the last and the processor time of the run in words."""
    with Ledger(folder) as ledger:
        ended = ledger.frame().select("finished_at")
    if ended.is_empty():
        return {}
    count = "1 simulation" if ended.height == 1 else f"{ended.height} simulations"
    spent = f"{about(float(processor_time(folder)['processor_s'].sum()))} of processor time"
    return {"simulated": f"{max(ended['finished_at'])[:10]}: {count}, {spent}", "n_simulations": ended.height}


def _pictures(run: Run, spot: StudySpot) -> tuple[Path, ...]:
    """Pictures next to the mesh of a spot, and in the run of how its presses were processed."""
    of_limb = [] if spot.mesh is None else [spot.mesh.with_suffix(".png")]
    drawn = sorted(run.directory.plots(spot.spot.name).rglob("*.png"))
    return (*(path for path in of_limb if path.is_file()), *drawn)


def _summaries(run: Run) -> Mapping[str, tuple[str, Summary]]:
    """Summary and title of each stage of a plugin that has been run and is current."""
    found = {}
    for name, stage in run.stages.items():
        if stage.is_on_page or not run.directory.records.is_current(name):
            continue
        try:
            with answering_for(stage, "summarising its tables"):
                made = stage.summarise(run)
                checked(stage, made.figures)
                found[name] = (type(stage).summary, made)
        except PluginError as error:
            run.progress.note(f"warning: section '{name}' of the page could not be made: {error}")
            found[name] = (type(stage).summary, Summary(lines=(f"This section could not be made: {error}.",)))
    return found
