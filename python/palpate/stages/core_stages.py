"""The core's stages, in the paper's order: what each reads, what decides it, and what it makes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial

import polars as pl

from palpate.answer.table import OF_ANSWER
from palpate.domain import FINE, Design, weighed_phases
from palpate.domain.curves import abscissae_of
from palpate.errors import FirstAnswerError, PalpateError, StoppedError, StudyError
from palpate.experiment.measured import load_measured
from palpate.fit.searches import BestSet
from palpate.fit.stage import Case, FitStage
from palpate.fit.surfaces import simulate_surfaces
from palpate.fit.tables import fit_result
from palpate.limb.loading import fine_meshes, refinement
from palpate.plugins.guard import answering_for
from palpate.plugins.sections import Summary
from palpate.progress import Progress
from palpate.run.directory import design_files, measured_files
from palpate.run.fit_state import FitState, write_fit_state
from palpate.run.keys import identity
from palpate.run.provenance import described, sha256
from palpate.run.result import FIRST_ANSWER, FitResult, SelectionResult
from palpate.run.result_files import Files, curves_of
from palpate.run.tables import DECLARED
from palpate.sampling.study_design import draw_study
from palpate.scoring import scores as scoring, selection
from palpate.scoring.completeness import completeness, described as named, without_result
from palpate.scoring.generalisation import generalise
from palpate.simulation import jobs as simulation
from palpate.simulation.cost import WORTH_SAYING_S, n_of_fit
from palpate.simulation.sweep import KeptSimulations, Simulations
from palpate.simulation.verification import verify
from palpate.stages.order import stages_of_run
from palpate.stages.stage import Run, Stage
from palpate.study.reading import Study


class CoreStage(Stage):
    """A stage of palpate itself."""

    code_decides = False
    is_on_page = True


class OfEveryRun(CoreStage):
    """A stage without which there is no run."""

    may_fail = False
    of_every_run = True


class Experiment(OfEveryRun):
    """Measured curves."""

    name, summary = "experiment", "Read the measured curves."
    tables = DECLARED[name]

    def decides(self, study: Study) -> Mapping[str, object]:
        """Files and loader of each spot; None for files that are not there any more."""
        found: dict[str, object] = {}
        for spot in study.spots:
            files = {
                channel or "": [sha256(path.read_bytes()) if path.is_file() else "" for path in paths]
                for channel, paths in spot.measured.items()
            }
            is_whole = all(each for sums in files.values() for each in sums)
            found[f"files of spot '{spot.spot.name}'"] = files if is_whole else None
            found[f"loader of spot '{spot.spot.name}'"] = described(study.loader_at(spot.spot.name))
        return found

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Points of each curve, and how they came about."""
        return measured_files(
            inputs.measured if inputs.fresh else load_measured(inputs.study, inputs.channels)
        )


class Sample(OfEveryRun):
    """Parameter sets."""

    name, summary = "sample", "Draw the parameter sets."
    tables = DECLARED[name]

    def decides(self, study: Study) -> Mapping[str, object]:
        """Settings that decide the first ``n_sets`` sets of the design."""
        return {
            "ranges": [asdict(replace(p, prior=None, by=None)) for p in study.space.parameters],
            "materials": [
                (
                    r.region,
                    described(r.material, study),
                    r.convention,
                    {**r.fixed, **{name: tie.plain for name, tie in r.tied.items()}},
                )
                for r in study.space.regions
            ],
            "sampler": described(study.sampler),
            "filters": [described(keep) for keep in study.filters],
            "n_sets, max_draws or seed": [study.n_sets, study.max_draws, study.seed],
        }

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Values of each set, and how they were drawn."""
        return design_files(inputs.design if inputs.fresh else draw_study(inputs.study, inputs.directory))

    def summarise(self, inputs: Run) -> Summary:
        """Number of sets that the filters kept."""
        design = inputs.directory.design()
        kept = f"{design.n_drawn} sets drawn, {design.n_sets} kept by the filters (seed {design.seed})"
        earlier = f"the first {design.n_kept} are of an earlier design with wider ranges"
        return Summary(lines=(kept, earlier) if design.n_kept else (kept,))


class Simulate(OfEveryRun):
    """Simulations of the sweep, which the ledger holds."""

    name, summary = "simulate", "Simulate every set at every spot; each result is stored as it comes."
    needs = ("experiment", "sample")

    def usual_simulations(self, inputs: Run) -> Mapping[str, int]:
        """Number of sets, on the mesh of each spot."""
        n_sets = inputs.design.n_sets
        return dict.fromkeys(inputs.study.spot_names, n_sets) if n_sets else {}

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Simulate; the ledger has the results."""
        study, jobs = inputs.study, inputs.inputs.jobs
        if inputs.fresh is None:
            jobs = simulation.jobs(study, inputs.design, inputs.measured)
            simulation.check_jobs(study, jobs, inputs.limbs)
        inputs.simulations.plan(jobs)
        inputs.shared[self.name] = tuple(inputs.simulations.of(jobs))
        return {}


class Score(OfEveryRun):
    """Distances of the simulated curves from the measured ones."""

    name, summary = "score", "Compare simulated with measured curves."
    needs = ("experiment", "sample", "simulate")
    tables = DECLARED[name]

    def decides(self, study: Study) -> Mapping[str, object]:
        """Rules of the comparison."""
        return {**_comparison(study), "phases": weighed_phases(study.scenarios)}

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Scores of every simulation that has ended."""
        study, swept = inputs.study, inputs.swept()
        if inputs.design.n_sets and not swept:
            raise StudyError(
                f"{inputs.directory.folder}: no simulation of this study; run `palpate simulate` first"
            )
        if (score := study.scoring.score).name != "nmse":
            progress.note(f"warning: scored by '{score.name}': misfits by it are in the columns named nmse")
        scores = scoring.score(swept, inputs.measured, study.scoring, study.scenarios)
        _warn_of_missing(inputs, scores, progress)
        return {"scores": scores}


def _comparison(study: Study) -> dict[str, object]:
    """Settings that decide every misfit: the score and its code, and which curves are ranked."""
    rules = study.scoring
    settings = rules.score.settings.model_dump(mode="json")
    return {
        **{f"scoring.{key}": value for key, value in settings.items()},
        "scoring.score": [rules.score.name, identity(rules.score)],
        "coverage or partial": [rules.minimum_coverage, rules.rank_partial],
    }


def _warn_of_missing(inputs: Run, scores: pl.DataFrame, progress: Progress) -> None:
    """Warn of sets that have not been simulated."""
    found = completeness(scores, inputs.study.spot_names, inputs.design)
    if not found.is_complete:
        progress.note(f"warning: incomplete sweep, {found}; `palpate simulate` runs the rest")


class Select(OfEveryRun):
    """Sets with the least Fopt."""

    name, summary = "select", "Choose the best set by scenario and over all spots."
    needs = ("score",)
    tables = DECLARED[name]

    def decides(self, study: Study) -> Mapping[str, object]:
        """Scenarios, and which generalises."""
        return {
            "scenarios": {scenario.name: dict(scenario.weights) for scenario in study.scenarios},
            "generalise_by": study.generalise_by,
        }

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Best sets, with the parameters that are tied to searched parameters."""
        scores = inputs.table("scores")
        chosen, general = best_sets(inputs.study, inputs.design, scores)
        _warn_of_missing(inputs, scores, progress)
        return {"selection": chosen, "generalisation": general}

    def summarise(self, inputs: Run) -> Summary:
        """The tables, and what could not be selected."""
        missing = selected(inputs).without_result
        return Summary(
            tables=super().summarise(inputs).tables,
            missing=f"no set could be selected at {named(missing)}" if missing else "",
        )


class Verify(OfEveryRun):
    """Verification of the selected sets by their solver."""

    name, summary = "verify", "Verify the selected sets, such as with halved steps."
    needs = ("select",)
    tables = DECLARED[name]

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Verification of each selected set that was not verified before."""
        study, stored = inputs.study, inputs.directory
        found = verify(study, stored, inputs.design, inputs.limbs, inputs.measured, progress)
        return {"verification": found}


def best_sets(study: Study, design: Design, scores: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Best set by spot and scenario, and that for all spots."""
    chosen = selection.select(scores, study.scenarios, design)
    general = generalise(scores, study.generalising, design, study.spot_names)
    return selection.with_tied(chosen, study.space), selection.with_tied(general, study.space)


def selected(run: Run) -> SelectionResult:
    """Sentences on the sets that were chosen, and on where none was."""
    study, scores, chosen = run.study, run.table("scores"), run.table("selection", "select")
    return SelectionResult(
        selection=chosen,
        generalisation=run.table("generalisation", "select"),
        verification=run.table("verification"),
        without_result=without_result(scores, chosen, study.scenarios, study.spot_names)
        if run.design.n_sets
        else {},
    )


class SearchForBest(OfEveryRun):
    """The fit."""

    name, summary = "fit", "Search the parameters for which the curves fit best."
    one_after_other = True
    needs = ("select",)
    tables = DECLARED[name]

    def decides(self, study: Study) -> Mapping[str, object]:
        """Search, what is searched, and how meshes are corrected."""
        return {
            **_comparison(study),  # without a sweep no table of scores shows it
            "search": described(study.search),
            "parametrisation": described(study.parametrisation),
            "priors or values by spot": [asdict(p) for p in study.space.parameters],
            **({"states of spots": dict(study.space.states)} if study.space.states else {}),
            "noise, fine_runs, fine_edge or fine_nodes": [
                study.noise,
                study.fine_runs,
                study.fine_nodes,
                [spot.fine_edge_mm for spot in study.spots],
            ],
        }

    def usual_simulations(self, inputs: Run) -> Mapping[str, int] | None:
        """Number for the searches, and one on each finer mesh."""
        study, limbs = inputs.study, inputs.limbs
        if isinstance(study.search, BestSet):
            return {}
        if (n_each := n_of_fit(study)) is None:
            return None
        finer = [f"{name}{FINE}" for name in study.spot_names if study.fine_runs]
        return dict.fromkeys(study.spot_names, n_each) | {name: 1 for name in finer if name in limbs}

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Ends and traces of the searches; nothing where the selection has the answer already."""
        if isinstance(inputs.study.search, BestSet):
            return {}
        found = fit_files(cases_of(inputs, keeps_state=True), inputs)
        inputs.directory.records.forget(FIRST_ANSWER)
        return found


class Surface(CoreStage):
    """The skin under the fitted press."""

    name, summary = "surface", "Simulate the skin under the press with the fitted parameters."
    needs = ("select", "fit")
    tables = DECLARED[name]

    def is_in_run(self, study: Study) -> bool:
        """True if the solver gives the states of the skin."""
        return study.solver.provides.surface

    def usual_simulations(self, inputs: Run) -> Mapping[str, int]:
        """One at each spot."""
        return dict.fromkeys(inputs.study.spot_names, 1)

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Simulations with states of the skin."""
        return {"surface": simulate_surfaces(inputs.simulations, inputs.fitted(), inputs.measured)}


class Answer(OfEveryRun):
    """The answer: what a run has found, and what may be read of it."""

    name, summary = "answer", "List every value that was found, with its interval and its verdict."
    needs = ("select",)
    comes_last = True
    tables = OF_ANSWER

    def run(self, inputs: Run, progress: Progress) -> Files:
        """One row for each fit or set and value."""
        return {"answer": inputs.answer()}

    def summarise(self, inputs: Run) -> Summary:
        """Summary: the values that are reported."""
        shown = ("parameter", "unit", "value", "lower", "upper", "verdict", "reason")
        return Summary(tables={"Reported values": inputs.table("answer").filter("reported").select(shown)})


STAGES: tuple[type[Stage], ...] = (
    Experiment,
    Sample,
    Simulate,
    Score,
    Select,
    Verify,
    SearchForBest,
    Surface,
    Answer,
)
"""In the paper's order."""


# ------------------------------------------------------------------ what the fit's stages share


def cases_of(inputs: Run, *, keeps_state: bool = False) -> list[Case]:
    """Fits of every case of a study; a fit that was made before has all its simulations at hand.

    Parameters
    ----------
    keeps_state : bool
        Whether the folder keeps how far the fit is: for the stage that makes it, not for one that reads it
        again.
    """
    if "cases" in inputs.shared:
        return list(inputs.shared["cases"])
    if isinstance(inputs.study.search, BestSet):
        return []

    def show(state: FitState) -> None:
        if keeps_state:
            known = inputs.forecast.n_left if inputs.forecast.is_whole else None
            left = replace(state, n_left=known, seconds_left=inputs.forecast.seconds_left)
            write_fit_state(inputs.directory.folder, left)
        inputs.progress.at(str(state))

    stage = _fit_stage(inputs, inputs.simulations)
    stage.on_progress = show
    if keeps_state:
        stage.on_first = partial(show_first_answer, inputs)
    inputs.shared["cases"] = stage.run()
    return list(inputs.shared["cases"])


def show_first_answer(inputs: Run, case: Case) -> None:
    """Let the stages of the run assess and show the first fit, where the whole run takes much longer.

    Raises
    ------
    FirstAnswerError
        Only this was asked for.
    """
    is_long = (inputs.forecast.seconds_left or 0.0) > WORTH_SAYING_S
    if case.end is None or inputs.inputs.edges_mm or not (is_long or inputs.is_quick):
        return
    with inputs.spent.charging(FIRST_ANSWER):
        inputs.shared[FIRST_ANSWER] = fit_result([case], inputs.simulations)
        for stage in stages_of_run(inputs.study, inputs.stages):
            try:
                with answering_for(stage, "showing the first answer"):
                    stage.show_so_far(inputs, case)
            except PalpateError as error:
                if inputs.is_quick or isinstance(error, StoppedError):
                    raise
                inputs.progress.note(f"warning: no first answer by `palpate {stage.name}`: {error}")
        first = inputs.shared[FIRST_ANSWER]
        tables = fit_tables(first) | {"intervals": first.intervals, "adequacy": first.adequacy}
        files = {f"first_answer/{name}": table for name, table in tables.items()}
        inputs.directory.write_stage(FIRST_ANSWER, files, inputs.made_from(inputs.stages["fit"]))
    if inputs.is_quick:
        raise FirstAnswerError("stopped after the first answer")


def _fit_stage(inputs: Run, simulations: Simulations) -> FitStage:
    return FitStage(
        study=inputs.study,
        design=inputs.design,
        measured=inputs.measured,
        scores=inputs.table("scores"),
        simulations=simulations,
        abscissae=abscissae_of(inputs.channels),
        progress=inputs.progress,
        first_start=inputs.directory.fit_start,
        refinement=refinement(inputs.study, simulations.limbs),
    )


def fit_so_far(inputs: Run) -> FitResult:
    """Fit of a run that has not ended, as far as its simulations lead; empty before the first evaluation."""
    if isinstance(inputs.study.search, BestSet):
        return FitResult()
    with KeptSimulations(inputs.study, inputs.directory.folder, inputs.limbs) as kept:
        cases = _fit_stage(inputs, kept).so_far()
        return fit_result(cases, kept) if cases else FitResult()


def fit_files(cases: Sequence[Case], inputs: Run) -> Files:
    """Tables of the fit, with the fitted curves by fit, scenario and spot."""
    meshes = fine_meshes(inputs.study, inputs.limbs, inputs.inputs.edges_mm)
    return fit_tables(fit_result(cases, inputs.simulations)) | {"fine_meshes": meshes}


def fit_tables(found: FitResult) -> dict[str, pl.DataFrame]:
    """Tables of a search by name."""
    curves = curves_of(found.responses.items())
    return {"fit": found.table, "fit_trace": found.trace, "fit_mesh": found.mesh, "fit_curves": curves}
