"""Spots whose tissues differ manifold: the mean and the spread are of each spot's own value."""

import numpy as np
import polars as pl
import pytest

from palpate.api.fit import ALL_SPOTS
from palpate_certainty.assessment import Assessment
from palpate_certainty.held_out import held_out
from palpate_certainty.tables import certainty_tables
from palpate_materials import Ogden

OWN = (0.035, 0.07, 0.19)


@pytest.mark.slow
def test_the_mean_and_the_spread_are_those_of_the_own_values(pressed, stage_of):
    spots = ("p1", "p2", "p3")
    study = pressed.study_of(Ogden(), ("c1",), spots=spots)
    (parameter,) = study.space.parameters
    of_each = zip(spots, OWN, (1, 2, 3), strict=True)
    measured = {s: pressed.measured_at(study, np.array([c1]), 0.004, seed) for s, c1, seed in of_each}
    assessed = Assessment(study=study, measured=measured).assessed(stage_of(study, measured).run())
    joint, tables = assessed[0], certainty_tables(assessed, study)
    own = tables["intervals"].filter(pl.col("fit") != ALL_SPOTS)
    assert own["value"].to_list() == pytest.approx(list(OWN), rel=0.05)
    (mean,) = tables["intervals"].filter(fit=ALL_SPOTS).to_dicts()
    logs = np.log(own["value"].to_numpy())
    assert mean["value"] == pytest.approx(np.exp(logs.mean()), rel=0.01)
    assert mean["lower"] < min(OWN) * 2.0
    (row,) = tables["between_spots"].to_dicts()
    assert row["value"] == mean["value"]
    # Of a lognormal spread, with the errors of the own values taken off.
    assert row["sd"] / row["value"] == pytest.approx(np.sqrt(np.expm1(logs.var(ddof=1))), rel=0.03)
    assert row["lower"] < row["sd"] < row["upper"]
    assert joint.verdict.value == "describes"
    # The largest difference is one of the own fits, within their noise.
    assert max(misfit.share for misfit in joint.misfits.values()) < 0.05
    drawn = tables["spot_draws"][parameter.name]
    assert drawn.is_between(parameter.lower, parameter.upper).all()
    assert drawn.min() < min(OWN) < max(OWN) < drawn.max()
    assert held_out(joint)["inside"].all()
