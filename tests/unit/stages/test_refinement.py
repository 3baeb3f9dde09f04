"""Refinement: from the sweep's best set to the bottom of its valley, within the ranges."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import (
    ParameterSpace,
    PointWeighting,
    Response,
    Scenario,
    ScoringRules,
    Simulation,
    Status,
)
from palpate.stages import scoring, selection, simulation
from palpate.stages.experiment import load_measured
from palpate.stages.refinement import _Search, refine
from palpate.stages.sampling import draw_design


def refined(study, plugins, tmp_path):
    measured = load_measured(study, plugins.channels)
    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    swept = simulation.simulate(study, design, {}, measured, tmp_path / "run")
    scores = scoring.score(swept, measured, study.scoring)
    chosen = selection.select(scores, study.scenarios, design)
    return chosen, refine(study, chosen, design, {}, measured)


def unsure(response):
    """Curves whose first points are surer than their last."""
    return Response(
        curves={n: replace(c, std=np.linspace(0.1, 0.3, c.abscissa.size)) for n, c in response.curves.items()}
    )


def test_the_truth_is_found_far_closer_than_by_the_sweep(make_study, plugins, tmp_path):
    _, found = refined(make_study(), plugins, tmp_path)
    for spot, truth in (("p1", (0.4, 20.0)), ("p2", (0.5, 25.0))):
        row = found.table.row(by_predicate=_is(spot, "I"), named=True)
        assert row["soft_tissue.stiffness"] == pytest.approx(truth[0], rel=1e-5)
        assert row["soft_tissue.grip"] == pytest.approx(truth[1], rel=1e-5)
        assert row["fopt"] < 1e-10
        assert row["n_simulations"] > 3


def test_no_row_is_worse_than_where_it_began(make_study, plugins, tmp_path):
    chosen, found = refined(make_study(), plugins, tmp_path)
    assert found.table["start_fopt"].to_list() == chosen["fopt"].to_list()
    assert found.table["start_set_id"].to_list() == chosen["set_id"].to_list()
    assert (found.table["fopt"] <= found.table["start_fopt"]).all()


@pytest.mark.parametrize("weights", PointWeighting)
def test_the_squares_that_are_minimised_sum_to_fopt(make_study, plugins, weights):
    """With other numbers of points, weights and sizes in the two channels."""
    scenario = Scenario(name="I", weights={"force": 3.0, "torque": 0.5})
    rules = ScoringRules(point_weighting=weights, minimum_coverage=1.0)
    study = make_study(scenarios=(scenario,), scoring=rules)
    measured = {spot: unsure(response) for spot, response in load_measured(study, plugins.channels).items()}
    design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
    search = _Search(study=study, spot="p1", scenario=scenario, limb=None, measured=measured["p1"])
    jobs = simulation.jobs(study, design, measured)[: design.n_sets]
    scores = scoring.score(
        [study.solver.simulate(job, None) for job in jobs],
        {"p1": measured["p1"]},
        study.scoring,
    )
    fopt = selection.objectives(scores, [scenario])["fopt"].to_list()
    for values, expected in zip(design.values, fopt, strict=True):
        residuals = search.residuals(values)
        assert residuals @ residuals == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("std", "ranked"), [((0.1, 0.3), True), ((0.3, 0.1), False)])
def test_whoever_is_ranked_is_searched_from(make_study, plugins, tissue, std, ranked):
    """A curve that stops early covers more of the weight than of the points, or less."""

    class Short(tissue.Analytic):
        def simulate(self, job, limb):
            whole = super().simulate(job, limb)
            force = whole.response["force"]
            n = int(0.9 * force.abscissa.size)
            short = replace(force, abscissa=force.abscissa[:n], ordinate=force.ordinate[:n])
            return replace(whole, response=Response(curves={"force": short}))

    scenario = Scenario(name="III", weights={"force": 1.0})
    study = make_study(
        solver=Short(),
        scenarios=(scenario,),
        scoring=ScoringRules(point_weighting=PointWeighting.STD, minimum_coverage=0.9),
    )
    whole = load_measured(study, plugins.channels)["p1"]["force"]
    force = replace(whole, std=np.linspace(*std, whole.abscissa.size))
    measured = Response(curves={"force": force})
    search = _Search(study=study, spot="p1", scenario=scenario, limb=None, measured=measured)
    design = draw_design(study.space, study.sampler, 1, study.seed)
    job = simulation.jobs(study, design, {"p1": measured})[0]
    scores = scoring.score(
        [study.solver.simulate(job, None)],
        {"p1": measured},
        study.scoring,
    )
    assert scores["nmse"].is_not_null().to_list() == [ranked]
    assert (search.residuals(design.values[0]) is not None) == ranked


def test_a_channel_without_weight_does_not_pull(make_study, plugins, tmp_path):
    chosen, found = refined(make_study(), plugins, tmp_path)
    start = chosen.row(by_predicate=_is("p1", "III"), named=True)
    end = found.table.row(by_predicate=_is("p1", "III"), named=True)
    assert end["soft_tissue.stiffness"] == pytest.approx(0.4, rel=1e-5)
    assert end["soft_tissue.grip"] == pytest.approx(start["soft_tissue.grip"], rel=1e-12)


def test_no_step_of_the_search_takes_the_number_of_a_set(make_study, plugins, tmp_path, tissue):
    class Noting(tissue.Analytic):
        def simulate(self, job, limb):
            numbers.append(job.set_id)
            return super().simulate(job, limb)

    numbers = []
    study = make_study(solver=Noting())
    refined(study, plugins, tmp_path)
    # The spots have the same jobs, so the sweep does each once.
    assert sorted(number for number in numbers if number >= 0) == [*range(study.n_sets)]
    assert len(numbers) > 2 * study.n_sets


def test_the_search_stays_in_the_ranges(make_study, plugins, tmp_path, space):
    region = space.regions[0]
    narrow = (replace(region.searched[0], upper=0.35), region.searched[1])
    study = make_study(space=ParameterSpace(regions=(replace(region, searched=narrow),)))
    _, found = refined(study, plugins, tmp_path)
    row = found.table.row(by_predicate=_is("p1", "III"), named=True)
    assert row["soft_tissue.stiffness"] == pytest.approx(0.35, rel=1e-6)
    assert row["soft_tissue.stiffness"] <= 0.35


def test_a_neighbour_that_fails_ends_the_search_at_the_best_so_far(make_study, plugins, tmp_path, tissue):
    class Fragile(tissue.Analytic):
        def simulate(self, job, limb):
            if job.thetas["soft_tissue"][0] < 0.38:
                return Simulation(job=job, status=Status.DIVERGED, response=None)
            return super().simulate(job, limb)

    study = make_study(solver=Fragile(), scenarios=(Scenario(name="I", weights={"torque": 1.0}),))
    chosen, found = refined(study, plugins, tmp_path)
    assert (found.table["fopt"] <= chosen["fopt"]).all()
    assert (found.table["soft_tissue.stiffness"] >= 0.38).all()


def test_a_start_that_fails_again_is_a_row_with_its_message(make_study, plugins, tmp_path, tissue):
    class Once(tissue.Analytic):
        def simulate(self, job, limb):
            if len(seen) == 12:
                return Simulation(job=job, status=Status.CRASHED, response=None)
            seen.append(job.set_id)
            return super().simulate(job, limb)

    seen = []
    study = make_study(solver=Once(), scenarios=(Scenario(name="I", weights={"force": 1.0}),))
    _, found = refined(study, plugins, tmp_path)
    assert all("could not be simulated again" in message for message in found.table["message"])
    assert found.responses == {}


def test_a_solver_that_raises_ends_its_search_and_not_the_run(make_study, plugins, tmp_path, tissue):
    class Raising(tissue.Analytic):
        def simulate(self, job, limb):
            if job.set_id < 0 and job.thetas["soft_tissue"][0] < 0.38:
                raise ZeroDivisionError("no contact")
            return super().simulate(job, limb)

    chosen, found = refined(make_study(solver=Raising()), plugins, tmp_path)
    assert found.table.height == chosen.height
    assert found.table["message"].str.contains("crashed: ZeroDivisionError: no contact").any()


def test_what_a_diverged_simulation_reached_is_searched_where_the_study_ranks_it(
    make_study, plugins, tmp_path, tissue
):
    class Diverging(tissue.Analytic):
        def behave(self, job):
            return replace(super().behave(job), status=Status.DIVERGED, message="stopped at the end")

    _, found = refined(
        make_study(solver=Diverging(), scoring=ScoringRules(rank_partial=True)), plugins, tmp_path
    )
    row = found.table.filter(_is("p1", "I")).row(0, named=True)
    assert row["message"] == "converged"
    assert row["soft_tissue.stiffness"] == pytest.approx(0.4, rel=1e-5)


def test_a_search_ends_at_the_solver_s_rounding(make_study, plugins, tmp_path, tissue):
    class Rough(tissue.Analytic):
        def simulate(self, job, limb):
            whole = super().simulate(job, limb)
            rough = {
                n: replace(
                    c, ordinate=c.ordinate * (1 + 1e-4 * np.sin(1e6 * job.thetas["soft_tissue"].sum()))
                )
                for n, c in whole.response.curves.items()
            }
            return replace(whole, response=Response(curves=rough))

    _, found = refined(make_study(solver=Rough()), plugins, tmp_path)
    assert (found.table["message"] == "converged").all()
    assert found.table["n_simulations"].max() <= 40
    assert (found.table["fopt"] < 1e-6).all()


def _is(spot, scenario):
    return (pl.col("spot") == spot) & (pl.col("scenario") == scenario)
