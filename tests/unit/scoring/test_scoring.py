"""Scores: by branch, never of what failed, and never by a degenerate yardstick."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.domain import Curve, Job, Normaliser, PointWeighting, Response, Simulation, Status
from palpate.errors import ScoringError
from palpate.plugins.score import LEAST_STD_SHARE, Nmse, NmseSettings, ScoringRules
from palpate.scoring.scores import SCHEMA, check_scorable, score


def curve(channel, x, y):
    return Curve(channel=channel, abscissa=x, ordinate=y)


def simulation(set_id=0, status=Status.OK, spot="p1", message="", **curves):
    response = Response(curves={name: curve(name, *xy) for name, xy in curves.items()})
    job = Job(spot=spot, set_id=set_id, materials={}, thetas={}, protocol=None)
    return Simulation(job=job, status=status, response=response, message=message, seconds=2.0)


def scored(simulations, measured, *, coverage=0.9, partial=False, **rules):
    rules = ScoringRules(score=Nmse(NmseSettings(**rules)), minimum_coverage=coverage, rank_partial=partial)
    return score(simulations, measured, rules)


FORCE = ([0.0, 1.0, 2.0], [0.0, 2.0, 4.0])
MEASURED = {"p1": Response(curves={"force": curve("force", *FORCE)})}


def test_the_number_by_hand():
    # Errors 0, 1, 0 over a mean of 2: (1/3)·1/4.
    row = scored([simulation(force=([0.0, 1.0, 2.0], [0.0, 3.0, 4.0]))], MEASURED).row(0, named=True)
    assert row["nmse"] == pytest.approx(1 / 12, rel=1e-15)
    # 1 − 1/Σ(exp − mean)² with Σ = 8.
    assert row["r2"] == pytest.approx(1 - 1 / 8, rel=1e-15)
    assert (row["coverage"], row["status"]) == (1.0, "ok")


def unsure(std):
    return {"p1": Response(curves={"force": replace(curve("force", *FORCE), std=std)})}


def test_a_point_is_weighted_by_its_standard_deviation():
    one = simulation(force=([0.0, 1.0, 2.0], [0.0, 3.0, 4.0]))
    weighed = scored([one], unsure([1.0, 2.0, 1.0]), point_weighting=PointWeighting.STD).row(0, named=True)
    # The error of 1 has weight 1/4 of 9/4, over a mean of 2, which has no weights.
    assert weighed["nmse"] == pytest.approx(1 / 9 / 4, rel=1e-14)
    # Weighted, the curve has mean 2 and variance (4 + 0 + 4)/(9/4).
    assert weighed["r2"] == pytest.approx(1 - (1 / 4) / 8, rel=1e-14)


def test_no_point_counts_beyond_measure():
    by_std = Nmse(NmseSettings(point_weighting=PointWeighting.STD))
    weights = by_std.weights(unsure([0.0, 1.0, 1.0])["p1"]["force"])
    floor = LEAST_STD_SHARE * np.sqrt(2 / 3)
    np.testing.assert_allclose(weights / weights[1], [1 / floor**2, 1.0, 1.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("std", "expected"),
    [
        (None, "spot 'p1', channel 'force': no point has a standard deviation; give repeated presses"),
        (
            [0.0] * 3,
            "spot 'p1', channel 'force': every standard deviation is zero; set scoring.point_weighting",
        ),
    ],
)
def test_weights_need_a_standard_deviation(std, expected):
    check_scorable(unsure(std), ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.RMS))))
    with pytest.raises(ScoringError, match=expected):
        check_scorable(
            unsure(std), ScoringRules(score=Nmse(NmseSettings(point_weighting=PointWeighting.STD)))
        )


def test_other_abscissae_are_interpolated():
    fine = np.linspace(0.0, 2.0, 401)
    assert scored([simulation(force=(fine, 2.0 * fine))], MEASURED)["nmse"][0] < 1e-28


def test_a_twist_is_compared_branch_by_branch():
    x = [0.0, -1.0, 0.0, 1.0, 0.0]
    loop = {"p1": Response(curves={"torque": curve("torque", x, [0.0, -2.0, -0.5, 2.0, 0.5])})}
    same = simulation(0, torque=(x, [0.0, -2.0, -0.5, 2.0, 0.5]))
    mirrored = simulation(1, torque=(x, [0.0, -2.0, 0.5, 2.0, -0.5]))
    nmse = scored([same, mirrored], loop)["nmse"].to_list()
    assert nmse[0] == 0.0
    assert nmse[1] == pytest.approx(2 / 5 / 1.0, rel=1e-12)


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.OK])
def test_what_failed_is_not_ranked_even_with_a_whole_curve(status):
    row = scored([simulation(status=status, message="why", force=FORCE)], MEASURED).row(0, named=True)
    assert row["nmse"] is None
    assert row["r2"] is None
    assert (row["status"], row["message"], row["coverage"]) == (status.value, "why", 1.0)


def test_too_little_coverage_is_not_ranked():
    half = simulation(force=([0.0, 1.0], [0.0, 2.0]))
    rows = [scored([half], MEASURED, coverage=c).row(0, named=True) for c in (2 / 3, 0.7)]
    assert [r["nmse"] for r in rows] == [0.0, None]
    assert rows[1]["message"] == "covers 0.667 of the measured 'force', less than 0.7"


def test_no_response_and_no_channel_are_rows():
    job = simulation().job
    nothing = Simulation(job=job, status=Status.CRASHED, response=None, message="gone")
    other = simulation(1, torque=FORCE)
    rows = scored([nothing, other], MEASURED).rows(named=True)
    assert [(r["status"], r["coverage"]) for r in rows] == [("crashed", 0.0), ("unreadable", 0.0)]
    assert rows[1]["message"] == "the solver gave no curve 'force'"


def test_a_path_that_runs_the_other_way_is_unreadable():
    row = scored([simulation(force=([2.0, 0.0], [4.0, 0.0]))], MEASURED).row(0, named=True)
    assert (row["status"], row["nmse"]) == ("unreadable", None)
    assert "falling" in row["message"]


def test_rows_are_ordered_and_typed():
    measured = {"b": MEASURED["p1"], "a": MEASURED["p1"]}
    made = [simulation(i, spot=s, force=FORCE) for i in (1, 0) for s in ("a", "b")]
    scores = scored(made, measured)
    assert scores.select("spot", "set_id").rows() == [("b", 0), ("b", 1), ("a", 0), ("a", 1)]
    assert dict(scores.schema) == SCHEMA
    assert scored([], measured).schema == scores.schema


def test_the_mean_of_a_twist_is_refused_before_anything_is_simulated():
    x = [0.0, -1.0, 0.0, 1.0, 0.0]
    twist = {"p7": Response(curves={"torque": curve("torque", x, [0.0, -2.0, 0.0, 2.0, 0.0])})}
    with pytest.raises(ScoringError, match=r"spot 'p7', channel 'torque': .*degenerate.*choose another"):
        check_scorable(twist, ScoringRules(score=Nmse(NmseSettings(normaliser=Normaliser.MEAN))))
    check_scorable(twist, ScoringRules())


def test_a_flat_measured_curve_has_no_r2():
    flat = {"p1": Response(curves={"force": curve("force", [0.0, 1.0], [3.0, 3.0])})}
    row = scored([simulation(force=([0.0, 1.0], [3.0, 6.0]))], flat).row(0, named=True)
    assert (row["nmse"], row["r2"]) == (pytest.approx(0.5, rel=1e-14), None)


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.OK])
def test_a_partial_curve_is_ranked_only_on_request_and_marked(status):
    half = simulation(set_id=1, status=status, message="cut short", force=([0.0, 1.0], [0.0, 3.0]))

    def rows(minimum_coverage):
        found = scored([half], MEASURED, coverage=minimum_coverage, partial=True)
        return found.row(0, named=True)

    assert rows(0.9)["nmse"] is None
    row = rows(0.5)
    assert (row["status"], row["message"]) == (status.value, "cut short")
    assert (row["nmse"] is not None) == (status is Status.DIVERGED)
