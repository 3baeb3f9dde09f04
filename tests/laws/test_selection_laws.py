"""Laws of selection, over any table of errors."""

import numpy as np
import polars as pl
from hypothesis import given, strategies as st

from palpate.domain import Design, Parameter, Scenario
from palpate.errors import NothingSelectableError
from palpate.scoring.generalisation import generalise
from palpate.scoring.scores import SCHEMA
from palpate.scoring.selection import objectives, select

SCENARIOS = (
    Scenario(name="I", weights={"force": 1.0, "torque": 1.0}),
    Scenario(name="II", weights={"torque": 1.0}),
    Scenario(name="III", weights={"force": 1.0}),
)
PARAMETER = Parameter(name="a.c1", unit="MPa", lower=0.0, upper=1.0, kind="modulus", description="")
error = st.one_of(st.none(), st.floats(0.0, 10.0))
tables = st.integers(1, 4).flatmap(
    lambda n_spots: st.lists(
        st.lists(st.tuples(error, error), min_size=n_spots, max_size=n_spots), min_size=1, max_size=12
    )
)


def scores_of(table):
    """Scores of table[set][spot] = (force, torque)."""
    rows = [
        {"spot": f"p{j}", "set_id": i, "channel": channel, "nmse": nmse, "status": "ok", "message": ""}
        for i, by_spot in enumerate(table)
        for j, pair in enumerate(by_spot)
        for channel, nmse in zip(("force", "torque"), pair, strict=True)
    ]
    return pl.DataFrame(rows, schema=SCHEMA)


def design_of(table):
    values = np.linspace(0.0, 1.0, len(table))[:, None]
    return Design(parameters=(PARAMETER,), values=values, seed=0, n_drawn=len(table))


def selected(table):
    try:
        return select(scores_of(table), SCENARIOS, design_of(table))
    except NothingSelectableError:
        return None


@given(tables)
def test_one_is_never_less_than_two_and_three_together(table):
    """The law that the paper's table 2 obeys: min(F + T) ≥ min F + min T."""
    chosen = selected(table)
    if chosen is None:
        return
    for _, rows in chosen.group_by("spot"):
        least = dict(rows.select("scenario", "fopt").rows())
        if "I" in least:
            assert least["I"] >= least["II"] + least["III"]


@given(tables)
def test_nothing_else_is_better(table):
    chosen = selected(table)
    if chosen is None:
        return
    every = objectives(scores_of(table), SCENARIOS)
    for row in chosen.iter_rows(named=True):
        rivals = every.filter(pl.col("spot") == row["spot"], pl.col("scenario") == row["scenario"])
        better = rivals.filter(
            (pl.col("fopt") < row["fopt"])
            | ((pl.col("fopt") == row["fopt"]) & (pl.col("set_id") < row["set_id"]))
        )
        assert better.is_empty()


@given(tables, st.randoms())
def test_the_order_of_the_scores_decides_nothing(table, random):
    scores = scores_of(table)
    rows = list(range(len(scores)))
    random.shuffle(rows)
    chosen = selected(table)
    if chosen is None:
        return
    shuffled = select(scores[rows], SCENARIOS, design_of(table))
    key = ["spot", "scenario"]
    assert chosen.sort(key).select(*key, "set_id").equals(shuffled.sort(key).select(*key, "set_id"))


@given(tables)
def test_a_row_carries_the_parameters_of_its_set(table):
    chosen = selected(table)
    if chosen is not None:
        values = design_of(table).values[:, 0]
        assert chosen["a.c1"].to_list() == [values[i] for i in chosen["set_id"]]


@given(tables)
def test_the_generalised_mean_bounds_the_mean_of_the_best(table):
    """No set for all spots can beat the best of each spot, and it is one set at all of them."""
    scores = scores_of(table)
    found = generalise(scores, SCENARIOS[0], design_of(table), sorted(scores["spot"].unique()))
    every = objectives(scores, SCENARIOS[:1])
    if found.is_empty():
        return
    assert found["set_id"].n_unique() == 1
    assert len(found) == len(table[0])
    best = every.group_by("spot").agg(pl.col("fopt").min())["fopt"].mean()
    assert found["fopt_mean"][0] >= best - 1e-12
    means = every.group_by("set_id").agg(pl.col("fopt").mean(), pl.len())
    whole = means.filter(pl.col("len") == len(table[0]))
    assert abs(found["fopt_mean"][0] - whole["fopt"].min()) < 1e-12
