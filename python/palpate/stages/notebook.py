"""The stages as functions of data frames, for notebooks: nothing stays on disk unless asked for.

Each takes a study and the frames of the stages before it, and returns a polars frame that can be
filtered, joined and plotted before it goes on. What the command line keeps in a run directory is
the same tables (:mod:`palpate.stages.pipeline`).
"""

import contextlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import polars as pl

from palpate.domain import Design, Job, Response, Scenario, Simulation, Status
from palpate.domain.curves import abscissae_of
from palpate.errors import StudyError
from palpate.experiment.measured import load_measured
from palpate.fit.problem import Problem
from palpate.fit.spot_term import Correction, SpotTerm, term_of
from palpate.limb.loading import load_limbs
from palpate.plugins.catalogue import Plugins
from palpate.progress import SILENT, Progress
from palpate.run.directory import RunDirectory, design_frame
from palpate.run.lock import locked
from palpate.run.ownership import claim, writing_in
from palpate.run.result import ALL_SPOTS
from palpate.run.result_files import curves_of, frame_of, response_of
from palpate.sampling.study_design import draw_study
from palpate.scoring import scores as scoring, selection
from palpate.scoring.generalisation import generalise as generalise_design
from palpate.simulation import jobs as simulation
from palpate.simulation.sweep import Simulations
from palpate.stages.core_stages import cases_of
from palpate.stages.stage import read_run
from palpate.study.reading import Study

_SIMULATED = ("spot", "set_id", "status", "message", "seconds", "channel", "point", "abscissa", "ordinate")


def measure(study: Study, plugins: Plugins | None = None) -> pl.DataFrame:
    """Read the measured curves.

    Parameters
    ----------
    plugins : Plugins, optional
        The installed ones when left out.

    Returns
    -------
    DataFrame
        A row for each point: spot, channel, point, abscissa, ordinate and, where known, std, in the
        units of the channel.

    Raises
    ------
    PalpateError
    """
    measured = load_measured(study, (plugins or Plugins.load(study.plugin_files)).channels)
    scoring.check_scorable(measured, study.scoring, study.scenarios)
    return curves_of((((spot,), response) for spot, response in measured.items()), ["spot"])


def sample(study: Study) -> pl.DataFrame:
    """Draw the parameter sets.

    Returns
    -------
    DataFrame
        A row for each set: set_id and a column <region.parameter> for each searched parameter, in the
        convention of its region.

    Raises
    ------
    SamplingError
    """
    return design_frame(draw_study(study))


def simulate(
    study: Study,
    design: pl.DataFrame,
    measured: pl.DataFrame,
    *,
    folder: Path | None = None,
    progress: Progress = SILENT,
) -> pl.DataFrame:
    """Simulate every set of the design at every spot.

    Parameters
    ----------
    design : DataFrame
        As :func:`sample` returns it, or any other sets: set_id and a column for each searched parameter.
    measured : DataFrame
        As :func:`measure` returns it; homogeneous tests run along its abscissae.
    folder : Path, optional
        Where results are kept, so that none is computed twice; nowhere when left out.

    Returns
    -------
    DataFrame
        A row for each point of each curve: spot, set_id, status, message, seconds, channel, point,
        abscissa, ordinate; one row without a curve for a simulation that has none.

    Raises
    ------
    PalpateError
        The design is none, or a job cannot be simulated at all.
    """
    drawn, responses = _design(study, design), _responses(measured)
    limbs, ids = load_limbs(study), design["set_id"].to_list()
    with _kept_in(folder) as kept:
        done = simulation.simulate(study, drawn, limbs, responses, kept, progress)
    return pl.concat([_frame_of(each, ids[each.job.set_id]) for each in done])


def score(study: Study, simulated: pl.DataFrame, measured: pl.DataFrame) -> pl.DataFrame:
    """Compare simulated with measured curves.

    Parameters
    ----------
    simulated, measured : DataFrame
        As :func:`simulate` and :func:`measure` return them.

    Returns
    -------
    DataFrame
        A row for each spot, set and channel, or weighted phase such as ``torque/unload``: spot, set_id,
        channel, nmse (null where a set is not ranked), r2, coverage (0 to 1), status, message.

    Raises
    ------
    ScoringError
    """
    _check_columns("simulated curves", simulated, _SIMULATED, "palpate.simulate")
    return scoring.score(_simulations(simulated), _responses(measured), study.scoring, study.scenarios)


def select(study: Study, scores: pl.DataFrame, design: pl.DataFrame) -> pl.DataFrame:
    """Choose the set with the least Fopt for each spot and scenario.

    Parameters
    ----------
    scores, design : DataFrame
        As :func:`score` and :func:`sample` return them.

    Returns
    -------
    DataFrame
        A row for each spot and scenario: spot, scenario, set_id, fopt, nmse_<channel> and r2_<channel>
        of every channel, <region.parameter>; and partial where partial curves were ranked.

    Raises
    ------
    NothingSelectableError
        Every simulation failed.
    """
    drawn, rows = _design(study, design), _by_row(scores, design)
    return _by_id(selection.select(rows, study.scenarios, drawn), design)


def generalise(study: Study, scores: pl.DataFrame, design: pl.DataFrame) -> pl.DataFrame:
    """Find the set with the least mean Fopt over all spots, in the study's scenario for that.

    Arguments as for :func:`select`. A row for each spot with the columns of :func:`select`, fopt_mean and
    fopt_sd (null with one spot); none unless a set has scores at every spot of the study.
    """
    drawn, rows = _design(study, design), _by_row(scores, design)
    return _by_id(generalise_design(rows, study.generalising, drawn, study.spot_names), design)


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


# ------------------------------------------------------------------ frames and values


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


def _check_columns(what: str, frame: pl.DataFrame, needed: tuple[str, ...], maker: str) -> None:
    if missing := [name for name in needed if name not in frame.columns]:
        raise StudyError(
            f"{what}: the frame lacks column '{missing[0]}' (has: {', '.join(frame.columns) or 'none'}); "
            f"make it with {maker}"
        )


def _design(study: Study, frame: pl.DataFrame) -> Design:
    """Sets of a frame, numbered by row."""
    names = tuple(p.name for p in study.space.parameters)
    _check_columns("design", frame, ("set_id", *names), "palpate.sample")
    if frame.is_empty():
        raise StudyError("design: the frame has no row; keep at least one set")
    values = frame.select(pl.col(names).cast(pl.Float64, strict=False)).to_numpy()
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        row, column = bad[0]
        raise StudyError(
            f"design: row {row}, column '{names[column]}' is not a finite number; fill it or drop the row"
        )
    if frame["set_id"].is_duplicated().any():
        twice = frame["set_id"].filter(frame["set_id"].is_duplicated())[0]
        raise StudyError(f"design: duplicate set_id {twice}; set_id must be unique")
    return Design(parameters=study.space.parameters, values=values, seed=study.seed, n_drawn=len(values))


def _by_row(scores: pl.DataFrame, design: pl.DataFrame) -> pl.DataFrame:
    """Scores with a set's row in the design in place of its set_id; rows of other sets are left out."""
    _check_columns("scores", scores, ("spot", "set_id", "channel", "nmse"), "palpate.score")
    rows = design.select("set_id", row=pl.int_range(pl.len()))
    joined = scores.join(rows, on="set_id", how="inner", maintain_order="left")
    return joined.with_columns(set_id="row").select(scores.columns)


def _by_id(chosen: pl.DataFrame, design: pl.DataFrame) -> pl.DataFrame:
    return chosen.with_columns(set_id=design["set_id"].gather(chosen["set_id"]))


def _responses(measured: pl.DataFrame) -> dict[str, Response]:
    needed = ("spot", "channel", "abscissa", "ordinate")
    _check_columns("measured curves", measured, needed, "palpate.measure")
    by_spot = measured.group_by("spot", maintain_order=True)
    return {str(spot): response_of(rows.drop("spot")) for (spot,), rows in by_spot}


def _frame_of(each: Simulation, set_id: int) -> pl.DataFrame:
    curves = frame_of(each.response or Response(curves={}))
    return (
        (curves if curves.height else curves.clear(1))
        .with_columns(
            spot=pl.lit(each.job.spot),
            set_id=pl.lit(set_id, pl.Int64),
            status=pl.lit(each.status.value),
            message=pl.lit(each.message),
            seconds=pl.lit(each.seconds),
        )
        .select(_SIMULATED)
    )


def _simulations(simulated: pl.DataFrame) -> Iterator[Simulation]:
    for (spot, set_id), rows in simulated.group_by("spot", "set_id", maintain_order=True):
        curves, first = rows.drop_nulls("channel"), rows.row(0, named=True)
        yield Simulation(
            job=Job(spot=str(spot), set_id=int(str(set_id))),
            status=Status(first["status"]),
            response=None if curves.is_empty() else response_of(curves),
            message=first["message"],
        )
