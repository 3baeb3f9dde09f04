"""What a sweep of the analytic tissue, whose force and torque have one parameter each, can tell."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.domain import Response, Status
from palpate.experiment.measured import load_measured
from palpate.run.result import FitResult
from palpate.run.tables import DECLARED
from palpate.sampling.drawing import draw_design
from palpate.scoring.generalisation import generalise
from palpate.scoring.scores import at_measured, score
from palpate.scoring.selection import select
from palpate.simulation.jobs import simulate
from palpate_certainty.identifiability import assess_identifiability

NO_FIT = FitResult()


@pytest.fixture
def identified(found):
    return lambda *given, **named: found(*given, **named)["identifiability"]


@pytest.fixture
def found(make_study, plugins, tmp_path):
    def made(study=None, fit=NO_FIT, spread=0.0, change=lambda simulations: simulations):
        study = study or make_study(n_sets=40)
        measured = load_measured(study, plugins.channels)
        measured = {spot: _with_std(response, spread) for spot, response in measured.items()}
        design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
        simulations = change(simulate(study, design, {}, measured, tmp_path / "run"))
        scores = score(simulations, measured, study.scoring)
        chosen = select(scores, study.scenarios, design)
        swept = at_measured(simulations, measured, design.n_sets)
        all_spots = generalise(scores, study.scenarios[0], design, list(measured))
        return assess_identifiability(study, design, measured, swept, scores, chosen, all_spots, fit)

    return made


def _with_std(response, share):
    if not share:
        return response
    curves = {
        name: replace(curve, std=np.full(curve.ordinate.size, share * np.abs(curve.ordinate).mean()))
        for name, curve in response.curves.items()
    }
    return Response(curves=curves)


def _row(frame, scenario, parameter, spot="p1"):
    return frame.filter(spot=spot, scenario=scenario, parameter=f"soft_tissue.{parameter}").row(0, named=True)


def test_both_channels_identify_both_parameters_and_one_channel_one(identified):
    frame = identified()
    assert len(frame) == (2 * 3 + 1) * 2
    for parameter, blind in (("stiffness", "II"), ("grip", "III")):
        assert _row(frame, blind, parameter)["identifiability"] == "not"
        assert _row(frame, blind, parameter)["relative_width"] == 1.0
        seeing = _row(frame, "I", parameter)
        assert seeing["identifiability"] in ("well", "roughly")
        assert seeing["lower"] < {"stiffness": 0.4, "grip": 20.0}[parameter] < seeing["upper"]


def test_the_interval_is_that_of_a_curve_in_proportion_to_its_parameter(identified):
    # force = k x^1.5, so NMSE = (k/0.4 − 1)² c: a square root gives the interval.
    row = _row(identified(), "III", "stiffness")
    x = np.linspace(0.0, 10.0, 21) ** 1.5
    c = (x**2).mean() / x.mean() ** 2
    assert row["optimum"] == pytest.approx(0.4)
    assert 0.0 < row["fopt_threshold"] < 1e-5  # exact curves: what is left is the floor
    assert row["upper"] == pytest.approx(0.4 * (1.0 + np.sqrt(row["fopt_threshold"] / c)), abs=1e-6)
    assert row["lower"] == pytest.approx(0.4 * (1.0 - np.sqrt(row["fopt_threshold"] / c)), abs=1e-6)
    assert row["q2"] == pytest.approx(1.0)


def test_sets_within_the_spread_of_the_presses_are_as_good(identified):
    tight, loose = identified(), identified(spread=0.3)
    one, other = _row(tight, "III", "stiffness"), _row(loose, "III", "stiffness")
    assert other["fopt_threshold"] == pytest.approx(0.09)
    assert other["upper"] - other["lower"] > one["upper"] - one["lower"]
    assert other["n_as_good"] > one["n_as_good"]


def test_a_fitted_set_takes_the_place_of_the_sweeps(identified):
    table = pl.DataFrame(
        {"fit": ["p1"], "spot": ["p1"], "scenario": ["III"], "fopt": [1e-4], "soft_tissue.stiffness": [0.404],
         "soft_tissue.grip": [20.0]}
    )  # fmt: skip
    row = _row(identified(fit=FitResult(table=table)), "III", "stiffness")
    assert row["value"] == 0.404
    assert row["fopt_threshold"] == pytest.approx(2e-4)
    assert row["lower"] < 0.4 < row["upper"] < 0.41


def test_a_joint_fit_is_the_centre_for_all_spots(identified):
    joint = {"fit": "all spots", "scenario": "I", "soft_tissue.stiffness": 0.45, "soft_tissue.grip": 22.0}
    table = pl.DataFrame([joint | {"spot": spot, "fopt": fopt} for spot, fopt in (("p1", 0.2), ("p2", 0.4))])
    rows = identified(fit=FitResult(table=table)).filter(spot="all spots")
    assert rows["value"].to_list() == [0.45, 22.0]
    assert rows["fopt_threshold"].to_list() == pytest.approx([0.6, 0.6])


@pytest.mark.slow
@pytest.mark.parametrize(("coarse", "moved"), [(21.0, 1.0), (15.0, 5.0)])
@pytest.mark.parametrize("known_of", [{}, {"fit": "all spots"}, {"fit": "p2", "scenario": "II"}])
def test_no_interval_is_narrower_than_finer_meshes_moved_the_value(identified, coarse, moved, known_of):
    values = {"soft_tissue.stiffness": 0.4, "soft_tissue.grip": 20.0}
    about = {"fit": "p1", "scenario": "I"}
    table = pl.DataFrame([about | values | {"spot": "p1", "fopt": 1e-6}])
    grip = {"parameter": "soft_tissue.grip", "coarse": coarse, "corrected": 20.0}
    alone, meshed = (
        identified(fit=FitResult(table=table, mesh=mesh)).filter(spot="p1", scenario="I")
        for mesh in map(DECLARED["fit"]["fit_mesh"].frame, ([], [about | grip | known_of]))
    )
    assert meshed["lower"].to_list() == [alone["lower"][0], pytest.approx(20.0 - moved)]
    assert meshed["upper"].to_list() == [alone["upper"][0], pytest.approx(20.0 + moved)]
    assert alone["relative_width"][1] < meshed["relative_width"][1]


def test_a_fit_with_corrections_of_the_joint_one_counts_what_they_move():
    row = {"fit": "p1", "scenario": "I", "parameter": "c", "coarse": 20.1, "corrected": 20.0}
    joint = row | {"fit": "all spots", "coarse": 16.0}
    fit = FitResult(mesh=pl.DataFrame([row, joint]))
    assert fit.mesh_errors("p1", "I") == {"c": 4.0}
    assert fit.mesh_errors("p2", "II") == {"c": 4.0}


def test_where_no_fit_ended_the_set_of_the_sweep_counts(identified):
    table = pl.DataFrame(
        {"fit": ["p1"], "spot": ["p1"], "scenario": ["III"], "message": ["could not"]}
        | {"fopt": [None], "soft_tissue.stiffness": [None], "soft_tissue.grip": [None]}
    )
    assert identified(fit=FitResult(table=table)).equals(identified())


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("is_fitted", [False, True])
def test_what_a_channel_cannot_see_is_not_identifiable_even_by_exact_curves(identified, noise, is_fitted):
    random = np.random.default_rng(1)

    def bent(simulations):
        """Force that is no polynomial of the stiffness, and the torque as it is."""
        for s in simulations:
            (theta,) = s.job.thetas.values()
            force, torque = s.response["force"], s.response["torque"]
            scale = (theta[0] / 0.4) ** 1.5 + noise * random.normal(size=force.ordinate.size)
            curves = {"force": replace(force, ordinate=force.ordinate * scale), "torque": torque}
            yield replace(s, response=Response(curves=curves))

    table = pl.DataFrame(
        {"fit": ["p1"], "spot": ["p1"], "scenario": ["III"], "fopt": [1e-29], "soft_tissue.stiffness": [0.4],
         "soft_tissue.grip": [45.0]}
    )  # fmt: skip
    fit = FitResult(table=table) if is_fitted else NO_FIT
    frame = identified(change=lambda simulations: tuple(bent(simulations)), fit=fit)
    assert _row(frame, "III", "grip")["identifiability"] == "not"
    seen = _row(frame, "III", "stiffness")
    assert seen["identifiability"] in ("well", "roughly")
    assert seen["lower"] < 0.4 < seen["upper"]


def test_all_spots_together_have_separate_rows(identified):
    row = _row(identified(), "I", "stiffness", spot="all spots")
    # p1 gives 0.4 and p2 0.5, each with the same weight.
    assert row["lower"] < row["optimum"] < row["upper"]
    assert 0.4 < row["optimum"] < 0.5


def test_failed_sets_and_few_sets_are_not_guessed_from(identified, make_study):
    def mostly_failed(simulations):
        return tuple(
            replace(s, status=Status.DIVERGED, message="x") if s.job.set_id > 2 else s for s in simulations
        )

    frame = identified(change=mostly_failed)
    assert set(frame["identifiability"]) == {"unclear"}
    assert frame["lower"].null_count() == len(frame)


def test_an_interval_stays_in_its_range_and_holds_its_optimum(identified):
    rows = identified().drop_nulls("lower")
    assert (rows["lower"] <= rows["optimum"]).all()
    assert (rows["optimum"] <= rows["upper"]).all()
    assert rows["relative_width"].is_between(0.0, 1.0).all()


def test_a_logarithmic_range_has_its_ends_as_numbers(identified, make_study, space):
    region = space.regions[0]
    searched = tuple(replace(p, scale="log") for p in region.searched)
    study = make_study(n_sets=40, space=replace(space, regions=(replace(region, searched=searched),)))
    row = _row(identified(study), "II", "stiffness")
    assert (row["lower"], row["upper"]) == (pytest.approx(0.1), pytest.approx(1.0))
