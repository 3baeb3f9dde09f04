"""Fopt over the planes of the parameters, against the real problem and a bounded linear fit."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import lsq_linear

from palpate.domain import Scenario
from palpate_certainty.assessment import Assessment
from palpate_certainty.emulated_curves import EmulatedCurves, EmulatedProblem, SimulatedCurves
from palpate_certainty.emulator import GaussianProcess
from palpate_certainty.profiles import KNOWN, N_EVEN, fitted, least_fopt, planes_of_fits
from palpate_materials.uncoupled import Ogden

SCENARIOS = tuple(
    Scenario(name=name, weights=dict.fromkeys(channels, 1.0))
    for name, channels in (("I", ("force", "torque")), ("III", ("force",)))
)


@given(st.integers(0, 2**32 - 1), st.sets(st.integers(0, 3), max_size=4))
def test_the_others_are_fitted_within_their_ranges(seed, free):
    rng = np.random.default_rng(seed)
    matrix, target = rng.normal(size=(12, 4)), rng.normal(size=12)
    points = rng.random((3, 4))
    moves = np.isin(np.arange(4), list(free))
    found, least = fitted(lambda at: at @ matrix.T - target, points, moves)
    np.testing.assert_array_equal(found[:, ~moves], points[:, ~moves])
    assert ((found >= 0.0) & (found <= 1.0)).all()
    for start, fopt in zip(points, least, strict=True):
        rest = target - matrix[:, ~moves] @ start[~moves]
        best = 2.0 * lsq_linear(matrix[:, moves], rest, (0.0, 1.0)).cost if moves.any() else rest @ rest
        assert (1.0 - 1e-9) * best - 1e-9 <= fopt <= 1.01 * best + 1e-9


def test_the_variance_of_a_process_is_none_where_it_was_observed_and_of_the_size_of_its_errors():
    rng = np.random.default_rng(2)
    points, elsewhere = rng.uniform(-1.0, 1.0, (25, 2)), rng.uniform(-1.0, 1.0, (300, 2))

    def wave(at):
        return np.sin(2.0 * at[:, :1]) * np.cos(3.0 * at[:, 1:])

    found = GaussianProcess(points, np.zeros(0, dtype=int), wave(points), np.zeros((2, 0, 1)))
    assert found.variance(points).max() < 1e-3 * found.variance(elsewhere).max()
    ratio = np.abs(found(elsewhere) - wave(elsewhere)) / np.sqrt(found.variance(elsewhere))
    assert (ratio < 3.0).mean() > 0.9
    assert ratio.max() > 0.1


def test_given_lengths_are_kept_and_the_points_reproduced():
    points = np.random.default_rng(2).uniform(-1.0, 1.0, (25, 2))
    lengths, values = np.array([0.5, 0.7]), np.sin(2.0 * points[:, :1])
    found = GaussianProcess(points, np.zeros(0, dtype=int), values, np.zeros((2, 0, 1)), lengths)
    np.testing.assert_array_equal(found.lengths, lengths)
    np.testing.assert_allclose(found(points), values, atol=1e-5)


@pytest.fixture(scope="module")
def fit(pressed, stage_of):
    study = pressed.study_of(Ogden(), ("c1", "m1"), scenarios=SCENARIOS)
    measured = {"p1": pressed.measured_at(study, [0.08, 4.0], 0.004, 1)}
    stage = stage_of(study, measured)
    certainty = Assessment(study=study, measured=measured)
    cases = stage.run()
    assessed = certainty.assessed(cases)
    n_simulated = len(stage.simulations.known)
    planes = planes_of_fits(assessed, stage.design, (), main=study.generalise_by)
    assert len(stage.simulations.known) == n_simulated
    return assessed, planes


@pytest.mark.slow
def test_planes_have_the_fopt_of_real_simulations_as_far_as_they_are_known(fit):
    assessed, planes = fit
    for each in assessed:
        rows = planes.filter(scenario=each.case.scenario.name, other="tissue.m1").drop_nulls("fopt")
        assert rows["parameter"].unique().to_list() == ["tissue.c1"]
        assert rows.height > N_EVEN
        at = rows.select("value", "other_value").to_numpy()
        real = np.array([each.end.problem.fopt(row) for row in at])
        np.testing.assert_allclose(rows["fopt"].to_numpy(), real, rtol=4.0 * KNOWN)
        near = real < 3.0 * each.end.best.fopt
        assert near.sum() > 5
        np.testing.assert_allclose(rows["fopt"].to_numpy()[near], real[near], rtol=0.05)


def test_along_a_parameter_the_others_are_fitted_again(fit):
    assessed, planes = fit
    plane = planes.filter(pl.col("scenario") == "I", pl.col("other") == "tissue.m1").drop_nulls("fopt")
    along = planes.filter(
        pl.col("scenario") == "I", pl.col("parameter") == "tissue.c1", pl.col("other").is_null()
    )
    least = plane.group_by("value").agg(pl.col("fopt").min().alias("least"))
    both = along.join(least, on="value").drop_nulls(["fopt", "least"])
    assert both.height > N_EVEN
    assert (both["fopt"] <= 1.01 * both["least"]).mean() > 0.9  # a start may end in another basin
    assert both["fopt"].min() == pytest.approx(assessed[0].end.best.fopt, rel=0.02)


def test_less_is_known_far_from_all_runs_and_nothing_is_claimed_there(fit, monkeypatch):
    assessed, _ = fit
    end = assessed[0].end
    simulated = SimulatedCurves(end.problem, ["force", "torque"])
    near = np.clip(end.best.point + 0.02 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), 0.0, 1.0)
    curves = EmulatedCurves(simulated, simulated.runs(near, slopes=True))
    box = end.problem.box
    density = EmulatedProblem(end.problem, simulated, box.values(end.best.point), emulated=curves)
    points = np.stack([end.best.point, [1.0, 1.0]])
    near, far = density.unknown(box.values(points))
    assert far > 1e3 * near
    monkeypatch.setattr(
        density, "unknown", lambda at: [0.0, 2.0 * KNOWN] * (density.residuals(at) ** 2).sum(axis=1)
    )
    known = np.isfinite(least_fopt(density, points, np.zeros(2, dtype=bool)))
    np.testing.assert_array_equal(known, [True, False])
