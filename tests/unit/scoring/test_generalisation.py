"""Generalisation: least mean over all spots, of sets that succeeded at all of them."""

import numpy as np
import polars as pl
import pytest

from palpate.domain import Design, Parameter, Scenario
from palpate.scoring.generalisation import generalise
from palpate.scoring.scores import SCHEMA

BOTH = Scenario(name="I", weights={"force": 1.0})
PARAMETER = Parameter(name="a.c1", unit="MPa", lower=0.0, upper=1.0, kind="modulus", description="")


def generalised(table, spots=None):
    rows = [
        {"spot": spot, "set_id": i, "channel": "force", "nmse": nmse, "status": "ok"}
        for spot, sets in table.items()
        for i, nmse in enumerate(sets)
    ]
    n_sets = len(next(iter(table.values())))
    values = np.linspace(0.1, 0.9, n_sets)[:, None]
    design = Design(parameters=(PARAMETER,), values=values, seed=0, n_drawn=n_sets)
    return generalise(pl.DataFrame(rows, schema=SCHEMA), BOTH, design, spots or list(table))


def test_the_mean_over_the_spots_decides():
    found = generalised({"p1": [0.0, 0.2, 0.9], "p2": [0.8, 0.3, 0.1]})
    assert found["set_id"].to_list() == [1, 1]
    assert found["spot"].to_list() == ["p1", "p2"]
    assert found["fopt"].to_list() == [0.2, 0.3]
    assert found["fopt_mean"][0] == pytest.approx(0.25)
    assert found["fopt_sd"][0] == pytest.approx(0.05 * np.sqrt(2.0))  # the sample's, n − 1
    assert found["a.c1"].to_list() == [0.5, 0.5]


def test_a_set_that_failed_anywhere_is_out():
    found = generalised({"p1": [0.0, 0.2], "p2": [None, 0.3]})
    assert found["set_id"].to_list() == [1, 1]


def test_none_at_every_spot_is_empty():
    assert generalised({"p1": [0.0, None], "p2": [None, 0.3]}).is_empty()


def test_a_spot_of_the_study_without_scores_leaves_no_set_for_all():
    table = {"p1": [0.0, 0.2], "p2": [0.1, 0.3]}
    assert generalised(table, ["p1", "p2", "p3"]).is_empty()
    assert generalised(table, ["p2"])["fopt"].to_list() == [0.1]


def test_ties_go_to_the_lower_set():
    assert generalised({"p1": [0.9, 0.2, 0.3], "p2": [0.9, 0.3, 0.2]})["set_id"].to_list() == [1, 1]


def test_one_spot_has_a_mean_and_no_spread():
    found = generalised({"p1": [0.4, 0.2]})
    assert found.select("set_id", "fopt_mean", "fopt_sd").rows() == [(1, 0.2, None)]


def test_a_spot_that_measures_nothing_of_the_scenario_does_not_count():
    rows = [
        {"spot": spot, "set_id": i, "channel": channel, "nmse": nmse, "status": "ok"}
        for spot, channel, sets in [("p1", "force", [0.3, 0.1]), ("p2", "torque", [0.0, 0.9])]
        for i, nmse in enumerate(sets)
    ]
    design = Design(parameters=(PARAMETER,), values=np.array([[0.1], [0.9]]), seed=0, n_drawn=2)
    found = generalise(pl.DataFrame(rows, schema=SCHEMA), BOTH, design, ["p1", "p2"])
    assert found.select("spot", "set_id", "fopt_mean").rows() == [("p1", 1, 0.1)]
