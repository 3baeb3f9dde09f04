"""Stages of how certain parameters are: intervals of fits, posteriors, and what a sweep allows."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl

from palpate.api import Indentation, Limb, Progress, Refinement, Run, Stage, StudyError, Summary
from palpate.api.fit import BestSet, Case, cases_of, refinement, reported_fits
from palpate.api.runs import (
    FIRST_ANSWER,
    Files,
    Study,
    StudyInputs,
    at_measured,
    job_for,
    mesh_note,
    size_at_contact,
)
from palpate_certainty.assessment import Assessment
from palpate_certainty.declared import DECLARED
from palpate_certainty.error_sources import MESH, error_sources_of, n_differences
from palpate_certainty.finer_meshes import finer_inputs
from palpate_certainty.held_out import held_out, sentence
from palpate_certainty.identifiability import assess_identifiability
from palpate_certainty.mesh_error import SpotMesh, noted_errors
from palpate_certainty.posterior_sampling import PosteriorSampling
from palpate_certainty.posterior_tables import posterior_tables
from palpate_certainty.profiles import planes_of_fits
from palpate_certainty.tables import Assessed, certainty_tables

ASSESSED = "assessed"
"""Key of the assessed fits among what stages of one run share."""


class Intervals(Stage):
    """Intervals of the fit."""

    name, summary = "intervals", "Compute 95 % intervals of the fitted parameters and their error sources."
    needs = ("fit",)
    is_on_page = True
    may_fail = False
    of_every_run = True
    tables = DECLARED[name]

    def decides(self, study: Study) -> Mapping[str, object]:
        """Errors of the curves and the model, as the budget states them."""
        layers = {spot.spot.name: dict(spot.layers_mm) for spot in study.spots}
        return {"budget": study.budget.model_dump(mode="json"), "layers": layers}

    def usual_simulations(self, inputs: Run) -> dict[str, int]:
        """Fits at their reported values, and differences for causes that have no exact slope."""
        study, measured = inputs.study, inputs.measured
        if isinstance(study.search, BestSet):
            return {}
        parameters = study.parametrisation.parameters(study.space, study.spot_names)
        causes = error_sources_of(study, measured, [p.name for p in parameters])
        found = {}
        for spot in study.spot_names:
            # On meshes only the leading fit is simulated there, where its surface is the same simulation.
            n_fits = len(study.scenarios) * (2 if len(study.spots) > 1 else 1)
            if study.solver.provides.mesh:
                n_fits = 0 if study.solver.provides.surface else 1
            here = (cause for cause in causes if not cause.spots or spot in cause.spots)
            found[spot] = n_fits + n_differences(here, study)
        return found

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Intervals, their causes, checks and draws, and curves of the values; nothing without a search."""
        if isinstance(inputs.study.search, BestSet):
            return {}
        cases = cases_of(inputs)
        stage = assessment_of(inputs, cases)
        assessed = inputs.shared[ASSESSED] = stage.assessed(cases)
        reported, curves = reported_fits([(each.case, each.values) for each in assessed], progress)
        found = certainty_tables(assessed, inputs.study)
        return {**found, "reported": reported, "reported_curves": curves}

    def show_so_far(self, inputs: Run, first: Case | None = None) -> None:
        """Add intervals by linearisation to a first answer, without error sources to be simulated."""
        if first is None:
            return
        with assessment_of(inputs, [first]).noting("intervals of the first answer") as stage:
            found = certainty_tables([stage.assess(first, {})], inputs.study)
            of_fit = {name: found[name] for name in ("intervals", "adequacy")}
            inputs.shared[FIRST_ANSWER] = replace(inputs.shared[FIRST_ANSWER], **of_fit)

    def again(self, inputs: Run) -> StudyInputs | None:
        """Inputs with finer meshes, where their error is much of the variance of a reported parameter."""
        fit, budget, mesh_errors = inputs.fit(), inputs.table("budget"), inputs.table("mesh_errors")
        if fit.intervals.is_empty():
            return None
        lead = inputs.fitted()
        of_lead = {"fit": lead.fit, "scenario": lead.scenario}
        # Share of the mesh in the variance of a parameter above which meshes are refined.
        shares = budget.filter(pl.col("share") > 0.2, **of_lead, cause=MESH).sort("share")
        # A finer mesh lessens the error that two meshes show; the scatter between meshes of one size stays.
        if shares.is_empty() or mesh_errors.filter(**of_lead, shown_by="two meshes").is_empty():
            return None
        share, parameter = shares.select("share", "parameter").row(-1)
        return finer_inputs(inputs, f"the mesh is {100.0 * share:.0f} % of the variance of {parameter}")


class ProfilePlanes(Stage):
    """Contours of Fopt."""

    name, summary = "contours", "Compute Fopt in the planes of two parameters, the others fitted again."
    needs = ("intervals",)
    is_on_page = True
    of_every_run = True
    tables = DECLARED[name]

    def usual_simulations(self, inputs: Run) -> dict[str, int]:
        """No new simulations; the stage reads the simulations of the fit again."""
        return dict.fromkeys(inputs.study.spot_names, 0)

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Planes of the joint fits by emulated curves; simulates nothing."""
        if isinstance(inputs.study.search, BestSet):
            return {}
        stage, assessed = assessed_fits(inputs)
        with stage.noting("contours of Fopt"):
            main = inputs.study.generalise_by
            return {"profile_planes": planes_of_fits(assessed, inputs.design, inputs.swept(), main=main)}
        return {"profile_planes": pl.DataFrame()}


class Validation(Stage):
    """Held-out presses, or the channels of one press."""

    name, summary = "validate", "Predict each press, or each channel of one press, from the others."
    needs = ("intervals",)
    tables = DECLARED[name]

    def is_in_run(self, study: Study) -> bool:
        """True where there are enough spots that leaving one out tells something, and a fit."""
        # Spots from which on every run holds each of them out in turn.
        return len(study.spots) >= 3 and not isinstance(study.search, BestSet)

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Predictions by the slopes of the joint fit; simulates nothing new."""
        _, assessed = joint_assessed(inputs)
        try:
            return {"held_out": held_out(assessed)}
        except np.linalg.LinAlgError as error:
            raise StudyError(
                f"no prediction of held-out curves: {error}; see the warnings of `palpate intervals`"
            ) from error

    def summarise(self, inputs: Run) -> Summary:
        """Summary: curves inside of their bands, and the one that is farthest off."""
        table = inputs.table("held_out")
        if table.is_empty():
            return Summary(lines=["One curve alone: nothing predicts it."])
        text = sentence(table)
        percents = {f"{name}_percent": 100.0 * pl.col(name) for name in ("difference", "band")}
        shown = table.select("spot", "channel", "inside", **percents)
        caption = "Held-out curves; difference and 90 % band in % of the peak"
        return Summary(lines=[f"{text}."], labelled={"Held out": text}, tables={caption: shown})


class Posteriors(Stage):
    """Posteriors of the joint fits."""

    name, summary = "certainty", "Draw the posteriors of the joint fits; simulates some more sets."
    needs = ("intervals",)
    is_on_page = True
    tables = DECLARED[name]

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Draws of the posteriors, and what follows from them."""
        study = inputs.study
        stage = PosteriorSampling(study=study, design=inputs.design, swept=inputs.swept(), progress=progress)
        if (sampled := stage.run(cases_of(inputs), assessed_fits(inputs)[1])) is None:
            raise no_intervals(inputs)
        return posterior_tables(sampled, study.seed)

    def summarise(self, inputs: Run) -> Summary:
        """The short tables."""
        titles = {
            "Posterior": "posterior",
            "Ends of profiles": "profile_ends",
            "Volumes of posteriors": "volumes",
            "Errors of emulated curves": "emulator",
        }
        return Summary(tables={title: inputs.table(name) for title, name in titles.items()})


class Identifiability(Stage):
    """Intervals that the sweep allows: of the best sets, and of the fits on the same scale."""

    name, summary = "identifiability", "Find how well the curves of the sweep identify each parameter."
    needs = ("score", "select", "intervals")
    is_on_page = True
    of_every_run = True
    tables = DECLARED[name]

    def run(self, inputs: Run, progress: Progress) -> Files:
        """Intervals by the simulated curves; simulates nothing."""
        return assess_identifiability(
            inputs.study,
            inputs.design,
            inputs.measured,
            at_measured(inputs.swept(), inputs.measured, inputs.design.n_sets),
            inputs.table("scores", "score"),
            inputs.table("selection", "select"),
            inputs.table("generalisation", "select"),
            inputs.fit(),
        )


def assessment_of(inputs: Run, cases: Sequence[Case]) -> Assessment:
    """Assessor of the cases of a run."""
    return Assessment(
        study=inputs.study,
        measured=inputs.measured,
        meshes=spot_meshes(
            inputs.study, inputs.simulations.limbs, is_refined=any(case.n_fine for case in cases)
        ),
        limbs=inputs.simulations.limbs,
        progress=inputs.progress,
    )


def assessed_fits(inputs: Run, *, joint_only: bool = False) -> tuple[Assessment, list[Assessed]]:
    """Assessor of the fits of a run, and these with their certainty, assessed once in a command."""
    cases = cases_of(inputs)
    stage = assessment_of(inputs, cases)
    return stage, inputs.shared.get(ASSESSED) or stage.assessed(cases, joint_only=joint_only)


def joint_assessed(inputs: Run) -> tuple[Assessment, Assessed]:
    """Certainty of the joint fit of a run, for stages that go on from it.

    Raises
    ------
    StudyError
        There is no joint fit with intervals.
    """
    stage, made = assessed_fits(inputs, joint_only=True)
    assessed = next((each for each in made if each.case.scenario.name == inputs.study.generalise_by), None)
    if assessed is None or len(assessed.case.spots) < min(2, len(inputs.study.spots)):
        raise no_intervals(inputs)
    return stage, assessed


def no_intervals(inputs: Run) -> StudyError:
    """Error of a run without a joint fit with intervals."""
    return StudyError(
        f"{inputs.directory.folder}: no joint fit with intervals in scenario '{inputs.study.generalise_by}'; "
        "set fit.search to a search, or see the warnings of `palpate fit`"
    )


def spot_meshes(study: Study, limbs: Mapping[str, Limb], *, is_refined: bool) -> dict[str, SpotMesh]:
    """Mesh of each spot that has one, as far as its error goes; its finer one counts where ``is_refined``."""
    refined = refinement(study, limbs) if is_refined else {}
    meshes, middle = {}, np.array([0.5 * (p.lower + p.upper) for p in study.space.parameters])
    for each in study.spots:
        protocol, name = study.protocol_at(each.spot.name), each.spot.name
        if each.mesh is not None and name in limbs and isinstance(protocol, Indentation):
            meshes[name] = SpotMesh(
                edge_over_radius=size_at_contact(study, limbs[name]) / protocol.indenter.radius_mm,
                noted=noted_errors(mesh_note(each.mesh)),
                refinement=refined.get(name, Refinement()),
                locking=study.solver.locking(job_for(study, name, 0, middle, {}), limbs[name]),
            )
    return meshes
