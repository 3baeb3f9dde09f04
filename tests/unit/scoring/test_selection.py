"""Selection: least Fopt, the lower set on a tie, and a reason when there is nothing."""

import numpy as np
import polars as pl
import pytest

from palpate.domain import Design, Parameter, Scenario, Status
from palpate.errors import NothingSelectableError, ScoringError
from palpate.scoring.scores import SCHEMA
from palpate.scoring.selection import by_reason, failures, objectives, select, unranked

BOTH = Scenario(name="I", weights={"force": 1.0, "torque": 1.0})
TORQUE = Scenario(name="II", weights={"torque": 1.0, "force": 0.0})
FORCE = Scenario(name="III", weights={"force": 1.0})


def design(n_sets):
    parameter = Parameter(
        name="soft_tissue.c1", unit="MPa", lower=0.0, upper=9.0, kind="modulus", description="stiffness"
    )
    return Design(
        parameters=(parameter,), values=np.arange(n_sets, dtype=float)[:, None] / 10, seed=0, n_drawn=n_sets
    )


def scores(table, status=None):
    """Scores of {spot: [(force, torque) by set]}; None is not ranked."""
    rows = [
        {
            "spot": spot,
            "set_id": set_id,
            "channel": channel,
            "nmse": nmse,
            "r2": None if nmse is None else 1.0 - nmse,
            "coverage": 1.0,
            "status": status or ("ok" if nmse is not None else "diverged"),
            "seconds": 1.0,
            "message": "" if nmse is not None else "too far",
        }
        for spot, sets in table.items()
        for set_id, pair in enumerate(sets)
        for channel, nmse in zip(("force", "torque"), pair, strict=True)
    ]
    return pl.DataFrame(rows, schema=SCHEMA)


TABLE = {"p2": [(0.1, 0.9), (0.5, 0.2), (0.3, 0.3)], "p1": [(0.4, 0.4), (0.9, 0.1), (0.2, 0.8)]}


def test_each_scenario_selects_its_least():
    chosen = select(scores(TABLE), [BOTH, TORQUE, FORCE], design(3))
    assert chosen.select("spot", "scenario", "set_id").rows() == [
        ("p2", "I", 2), ("p2", "II", 1), ("p2", "III", 0),
        ("p1", "I", 0), ("p1", "II", 1), ("p1", "III", 2),
    ]  # fmt: skip
    first = chosen.row(0, named=True)
    assert first["fopt"] == pytest.approx(0.6)
    assert (first["nmse_force"], first["nmse_torque"], first["r2_force"]) == (0.3, 0.3, 0.7)
    assert first["soft_tissue.c1"] == 0.2


def test_the_channel_that_was_not_fitted_is_reported_too():
    row = select(scores(TABLE), [FORCE], design(3)).row(0, named=True)
    assert (row["nmse_force"], row["nmse_torque"]) == (0.1, 0.9)


def test_weights_count():
    heavy = Scenario(name="heavy", weights={"force": 10.0, "torque": 1.0})
    row = select(scores(TABLE), [heavy], design(3)).row(0, named=True)
    assert (row["set_id"], row["fopt"]) == (0, pytest.approx(1.9))


def test_a_tie_goes_to_the_lower_set():
    tied = {"p1": [(0.5, 0.5), (0.2, 0.2), (0.2, 0.2), (0.2, 0.2)]}
    backwards = scores(tied).sort("set_id", descending=True)
    assert select(backwards, [BOTH], design(4))["set_id"].to_list() == [1]


def test_a_set_without_nmse_in_a_weighted_channel_is_no_candidate():
    table = {"p1": [(0.0, None), (0.5, 0.5)]}
    chosen = select(scores(table), [BOTH, FORCE], design(2))
    assert chosen["set_id"].to_list() == [1, 0]


def test_a_spot_where_all_failed_has_no_row():
    table = {"p1": [(None, None)], "p2": [(0.1, 0.1)]}
    assert select(scores(table), [BOTH], design(1))["spot"].to_list() == ["p2"]


def test_nothing_to_select_reports_the_most_frequent_reason_and_a_remedy():
    lines = scores({"p1": [(None, None)] * 3}).with_columns(
        pl.when(pl.col("set_id") == 0).then(pl.lit("crashed")).otherwise(pl.lit("timed_out")).alias("status"),
        pl.lit("stopped").alias("message"),
    )
    with pytest.raises(NothingSelectableError) as caught:
        select(lines, [BOTH], design(3))
    text = str(caught.value)
    assert "none of 3 simulations" in text
    assert "(2, first p1/1): timed_out: stopped" in text
    assert Status.TIMED_OUT.remedy in text


def test_a_scenario_of_an_unknown_channel_is_refused():
    with pytest.raises(ScoringError, match=r"'slip' weights channel 'shear'"):
        objectives(scores(TABLE), [Scenario(name="slip", weights={"shear": 1.0})])


def test_failures_are_counted_by_simulation_and_reason():
    found = failures(unranked(scores({"p1": [(None, None), (0.1, 0.1), (None, None)]})))
    assert found.select("status", "message", "n", "example").rows() == [("diverged", "too far", 2, "p1/0")]
    assert found["remedy"].to_list() == [Status.DIVERGED.remedy]


def test_a_reason_has_its_numbers_where_there_is_one_message():
    failed = {"spot": "p1", "set_id": range(4), "status": "crashed"}
    messages = ["exit code 137", "exit code 137", "nan in row 3", "nan in row 5"]
    reasons = by_reason(failures(pl.DataFrame(failed | {"message": messages})))
    assert reasons.select("reason", "n").rows() == [("exit code 137", 2), ("nan in row …", 2)]


def test_too_little_coverage_has_a_remedy():
    rows = scores({"p1": [(None, None)]}, status="ok")
    assert "simulated path" in failures(unranked(rows))["remedy"][0]


def test_a_spot_without_a_channel_is_ranked_by_those_that_it_has():
    found = scores({"p1": [(0.4, 0.1), (0.2, None)], "p2": [(0.3, 0.0), (0.1, 0.0)]})
    lacking = found.filter(~((pl.col("spot") == "p2") & (pl.col("channel") == "torque")))
    rows = objectives(lacking, [BOTH, TORQUE]).select("spot", "scenario", "set_id", "fopt").rows()
    # Where it is measured and has no NMSE, a set is left out.
    assert rows == [("p1", "I", 0, 0.5), ("p1", "II", 0, 0.1), ("p2", "I", 0, 0.3), ("p2", "I", 1, 0.1)]
