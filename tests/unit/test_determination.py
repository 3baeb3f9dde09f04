"""What a sweep of the analytic tissue, whose force and torque have one parameter each, can tell."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from palpate.determination import at_measured, determine
from palpate.domain import Response, Status
from palpate.experiment import load_measured
from palpate.refinement import Refined
from palpate.sampling import draw_design
from palpate.scoring import score
from palpate.selection import select
from palpate.simulation import simulate

NOT_REFINED = Refined(table=pl.DataFrame(), responses={})


@pytest.fixture
def determined(make_study, plugins, tmp_path):
    def made(study=None, refined=NOT_REFINED, spread=0.0, change=lambda simulations: simulations):
        study = study or make_study(n_sets=40)
        measured = load_measured(study, plugins.channels)
        measured = {spot: _with_std(response, spread) for spot, response in measured.items()}
        design = draw_design(study.space, study.sampler, study.n_sets, study.seed)
        simulations = change(simulate(study, design, {}, measured, tmp_path / "run"))
        scores = score(simulations, measured, normaliser=study.normaliser, minimum_coverage=0.95)
        chosen = select(scores, study.scenarios, design)
        swept = at_measured(simulations, measured, design.n_sets)
        return determine(study, design, measured, swept, scores, chosen, refined)

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


def test_both_channels_determine_both_parameters_and_one_determines_its_own(determined):
    frame = determined()
    assert len(frame) == 2 * 3 * 2
    for parameter, blind in (("stiffness", "II"), ("grip", "III")):
        assert _row(frame, blind, parameter)["determined"] == "not"
        assert _row(frame, blind, parameter)["share"] == 1.0
        seeing = _row(frame, "I", parameter)
        assert seeing["determined"] in ("well", "roughly")
        assert seeing["lower"] < {"stiffness": 0.4, "grip": 20.0}[parameter] < seeing["upper"]


def test_the_interval_is_that_of_a_curve_in_proportion_to_its_parameter(determined):
    # force = k x^1.5, so NMSE = (k/0.4 − 1)² c: a square root gives the interval.
    row = _row(determined(), "III", "stiffness")
    x = np.linspace(0.0, 10.0, 21) ** 1.5
    c = (x**2).mean() / x.mean() ** 2
    assert row["limit"] == pytest.approx(2.0 * (row["value"] / 0.4 - 1.0) ** 2 * c)
    assert row["upper"] == pytest.approx(0.4 * (1.0 + np.sqrt(row["limit"] / c)))
    assert row["lower"] == pytest.approx(0.4 * (1.0 - np.sqrt(row["limit"] / c)))
    assert row["q2"] == pytest.approx(1.0)


def test_sets_within_the_spread_of_the_presses_are_as_good(determined):
    tight, loose = determined(), determined(spread=0.3)
    one, other = _row(tight, "III", "stiffness"), _row(loose, "III", "stiffness")
    assert other["limit"] == pytest.approx(one["limit"] / 2.0 + 0.09)
    assert other["upper"] - other["lower"] > one["upper"] - one["lower"]
    assert other["n_as_good"] > one["n_as_good"]


def test_a_refined_set_takes_the_place_of_the_sweeps(determined):
    table = pl.DataFrame(
        {"spot": ["p1"], "scenario": ["III"], "fopt": [1e-4], "soft_tissue.stiffness": [0.404],
         "soft_tissue.grip": [20.0]}
    )  # fmt: skip
    row = _row(determined(refined=Refined(table=table, responses={})), "III", "stiffness")
    assert row["value"] == 0.404
    assert row["limit"] == pytest.approx(2e-4)
    assert row["lower"] < 0.4 < row["upper"] < 0.41


def test_a_start_that_was_not_refined_stays_what_the_sweep_found(determined):
    table = pl.DataFrame(
        {"spot": ["p1"], "scenario": ["III"], "message": ["could not"]}
        | {"fopt": [None], "soft_tissue.stiffness": [None], "soft_tissue.grip": [None]}
    )
    assert determined(refined=Refined(table=table, responses={})).equals(determined())


def test_failed_sets_and_few_sets_are_not_guessed_from(determined, make_study):
    def mostly_failed(simulations):
        return tuple(
            replace(s, status=Status.DIVERGED, message="x") if s.job.set_id > 2 else s for s in simulations
        )

    frame = determined(change=mostly_failed)
    assert set(frame["determined"]) == {"unclear"}
    assert frame["lower"].null_count() == len(frame)


def test_an_interval_stays_in_its_range_and_holds_its_value(determined):
    told = determined().drop_nulls("lower")
    assert (told["lower"] <= told["value"]).all()
    assert (told["value"] <= told["upper"]).all()
    assert told["share"].is_between(0.0, 1.0).all()


def test_a_logarithmic_range_has_its_ends_as_numbers(determined, make_study, space):
    region = space.regions[0]
    searched = tuple(replace(p, scale="log") for p in region.searched)
    study = make_study(n_sets=40, space=replace(space, regions=(replace(region, searched=searched),)))
    row = _row(determined(study), "II", "stiffness")
    assert (row["lower"], row["upper"]) == (pytest.approx(0.1), pytest.approx(1.0))
