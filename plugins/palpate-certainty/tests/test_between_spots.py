"""Spots whose tissues differ manifold: the mean and the spread are of each spot's own value."""

from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from scipy.stats import t as student

from palpate.api.fit import ALL_SPOTS
from palpate_certainty.assessment import Assessment
from palpate_certainty.between_spots import coordinates_of, differences
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
    # The errors of the own values are taken off.
    assert row["sd"] / row["value"] == pytest.approx(logs.std(ddof=1), rel=0.03)
    assert row["lower"] < row["sd"] < row["upper"]
    assert joint.verdict.value == "describes"
    # The largest difference is one of the own fits, within their noise.
    assert max(misfit.share for misfit in joint.misfits.values()) < 0.05
    drawn = tables["spot_draws"][parameter.name]
    assert drawn.is_between(parameter.lower, parameter.upper).all()
    assert drawn.min() < min(OWN) < max(OWN) < drawn.max()
    assert held_out(joint)["inside"].all()


@pytest.mark.parametrize("sd", [0.1, 0.7])
def test_spots_that_differ_manifold_with_errors_in_proportion(sd):
    """Curves in proportion to a modulus of 1 to 100, with an error of all, of each, and of each point."""
    n_spots, n, log, width = 6, 10, np.log(100.0), 99.0
    spot = np.repeat(np.arange(n_spots), n)
    rows = SimpleNamespace(spot=spot, channel=np.zeros(spot.size, dtype=int), curve=spot)
    shape, logs, rng = np.tile(np.linspace(0.1, 1.0, n), n_spots), np.array([log]), np.random.default_rng(3)
    held, spread = [], []
    for _ in range(60):
        true = 10.0 * np.exp(sd * rng.normal(size=n_spots))
        seen = true * (1.0 + 0.1 * rng.normal() + 0.05 * rng.normal(size=n_spots))
        curves = shape * (seen[spot] + 0.02 * true[spot] * rng.normal(size=spot.size))
        # As Fopt weighs them: each over its own largest ordinate.
        scale = 1.0 / true[spot]
        jacobian = (width * shape * scale)[:, None]
        joint = float(jacobian[:, 0] @ (curves * scale) / (jacobian[:, 0] ** 2).sum())
        fitted = jacobian[:, 0] * joint
        causes = {
            "gain": 0.1 * fitted[:, None],
            "place": 0.05 * fitted[:, None] * (spot[:, None] == np.arange(n_spots)),
            "noise": np.diag(0.02 * shape),
        }
        point = np.array([joint - 1.0 / width])
        residuals = fitted - curves * scale
        found = differences(residuals, jacobian, causes, rows, point, logs, by_size=("noise",))
        most = student.ppf(0.975, n_spots - 1)
        away = found.mean[0] - np.log(10.0) / log
        held.append(abs(away) < most * np.sqrt(found.covariance[0, 0]))
        low, high = found.ends[0] * log
        spread.append(low <= sd <= high)
        own = coordinates_of(point + found.own[:, 0], logs)
        np.testing.assert_allclose(np.exp(log * own), seen, rtol=0.08)
    assert np.mean(held) >= 0.9
    assert np.mean(spread) >= 0.9


@pytest.mark.parametrize("log", [0.0, np.log(100.0)])
@pytest.mark.parametrize("has_prior", [True, False])
def test_a_prior_holds_the_mean_and_spots_without_a_parameter_tell_nothing_of_its_spread(log, has_prior):
    n, own = 10, np.array([0.3, 0.4, 0.5])
    spot = np.array([*np.repeat(np.arange(5), n), *([-1] * has_prior)])
    rows = SimpleNamespace(spot=spot, channel=np.where(spot < 0, -1, 0), curve=spot)
    slopes = np.where((spot >= 0) & (spot < 3), np.tile(np.linspace(0.1, 1.0, n), 6)[: spot.size], 0.0)
    slopes[spot < 0] = 1.0
    joint = 0.4
    residuals = slopes * (joint - np.append(own, [0.0, 0.0, 0.2])[spot])
    causes = {
        "noise": np.diag(np.where(spot < 0, 0.0, 0.01)),
        "priors": np.diag(np.where(spot < 0, 1e-4, 0.0)),
    }
    made = differences(residuals, slopes[:, None], causes, rows, np.array([joint]), np.array([log]))
    value = np.expm1(log * made.mean[0]) / np.expm1(log) if log else made.mean[0]
    middle = np.expm1(np.log1p(np.expm1(log) * own).mean()) / np.expm1(log) if log else 0.4
    assert value == pytest.approx(0.2 if has_prior else middle, abs=1e-3)
    assert made.seen.sum() == 3
    assert made.freedom == 2.0
    of_three = spot < 3
    alone = SimpleNamespace(spot=spot[of_three], channel=rows.channel[of_three], curve=spot[of_three])
    if not has_prior:
        few = {"noise": causes["noise"][np.ix_(of_three, of_three)]}
        same = differences(
            residuals[of_three], slopes[of_three, None], few, alone, np.array([joint]), np.array([log])
        )
        np.testing.assert_allclose(made.ends, same.ends, rtol=1e-6)
