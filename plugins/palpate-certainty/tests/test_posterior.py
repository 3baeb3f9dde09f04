"""Posteriors, profiles and Sobol indices of a tissue in closed form, against the real solver."""

import numpy as np
import pytest
from scipy.stats import norm

from palpate.domain import Scenario
from palpate_certainty.assessment import Assessment
from palpate_certainty.bounded import least_near
from palpate_certainty.posterior import Draws, draw
from palpate_certainty.posterior_sampling import PRECISE, PosteriorSampling
from palpate_certainty.posterior_tables import posterior_tables, sobol_indices
from palpate_certainty.profiles import RISE, profile, refitted
from palpate_materials.uncoupled import Ogden

SCENARIOS = tuple(
    Scenario(name=name, weights=dict.fromkeys(channels, 1.0))
    for name, channels in (("I", ("force", "torque")), ("III", ("force",)))
)
COVARIANCE = 0.06**2 * np.array([[1.0, 0.8], [0.8, 1.0]])
ROOT = np.linalg.inv(np.linalg.cholesky(COVARIANCE))


def white(points):
    """Residuals of a normal density around the middle of the box."""
    return (points - 0.5) @ ROOT.T


def misfit(points):
    return (white(points) ** 2).sum(axis=1)


def everywhere(points):
    return np.ones(len(points), dtype=bool)


@pytest.mark.slow
def test_draws_of_a_normal_density_have_its_mean_and_covariance():
    pytest.importorskip("emcee")
    start = np.random.default_rng(1).uniform(0.4, 0.6, (50, 2))
    found = draw(misfit, everywhere, start, 1)
    assert found.is_converged
    np.testing.assert_allclose(found.points.mean(axis=0), 0.5, atol=0.003)
    np.testing.assert_allclose(np.cov(found.points, rowvar=False), COVARIANCE, rtol=0.08)
    np.testing.assert_array_equal(found.at_bounds(), 0.0)
    again = draw(misfit, everywhere, start, 1)
    np.testing.assert_array_equal(found.points, again.points)


@pytest.mark.parametrize(
    ("n_steps", "split_r", "is_converged"),
    [(2000, 1.01, True), (1999, 1.0, False), (4000, 1.011, False)],
)
def test_chains_have_converged_when_they_agree_and_are_long(n_steps, split_r, is_converged):
    found = Draws(
        points=np.zeros((1, 2)), split_r=np.array([1.0, split_r]), autocorrelation=np.array([3.0, 40.0]),
        n_steps=n_steps, n_independent=1e6, accepted=1.0,
    )  # fmt: skip
    assert found.is_converged == is_converged


def test_draws_are_within_the_box_and_the_filters():
    pytest.importorskip("emcee")
    start = np.full((1, 2), 0.5)
    found = draw(lambda points: misfit(points - [0.5, 0.0]), lambda p: p[:, 1] < 0.6, start, 1)
    assert found.points.max(axis=0)[0] <= 1.0
    assert found.points.max(axis=0)[1] < 0.6
    assert found.at_bounds()[1, 0] > 0.05
    assert found.accepted < 1.0


@pytest.mark.parametrize("i", [0, 1])
def test_the_profile_of_a_normal_density_ends_where_its_interval_does(i):
    best, least = least_near(white, np.array([0.3, 0.7]), np.ones(2, dtype=bool))
    np.testing.assert_allclose(best, 0.5, atol=1e-6)
    found = profile(white, best, least, i, 0.06)
    half = norm.ppf(0.975) * 0.06
    np.testing.assert_allclose(found.ends[:, i], [0.5 - half, 0.5 + half], atol=1e-4)
    assert found.is_open == (False, False)
    np.testing.assert_allclose(found.rises, ((found.points[:, i] - 0.5) / 0.06) ** 2, atol=1e-3)


def test_a_profile_that_does_not_rise_is_open_at_the_bound():
    found = profile(lambda p: 0.1 * (p - 0.5), np.array([0.5]), 0.0, 0, 0.3)
    assert found.is_open == (True, True)
    np.testing.assert_array_equal(found.ends[:, 0], [0.0, 1.0])


def test_an_end_is_fitted_again_with_the_real_residuals():
    moved = np.array([0.0, 0.01])  # the real solver's least is elsewhere along what is free
    start = np.array([[0.55, 0.54]])
    (least,) = refitted(white, lambda points: white(points - moved), start, [0])
    expected = least_near(lambda points: white(points - moved), start[0], np.arange(start[0].size) > 0)[1]
    assert least == pytest.approx(expected, rel=1e-6)


def test_sobol_indices_of_a_sum_are_its_shares_of_the_variance():
    weights = np.array([3.0, 2.0, 0.0])
    first, total = sobol_indices(lambda p: np.stack([p @ weights, 0.0 * p[:, 0]], axis=1), 3, 1)
    expected = weights**2 / (weights**2).sum()
    np.testing.assert_allclose(first[:, 0], expected, atol=0.02)
    np.testing.assert_allclose(total[:, 0], expected, atol=0.02)
    np.testing.assert_array_equal(total[:, 1], 0.0)


@pytest.fixture(scope="module")
def sampled(pressed, stage_of):
    """The posteriors of an Ogden tissue of two parameters, and the study."""
    pytest.importorskip("emcee")
    study = pressed.study_of(Ogden(), ("c1", "m1"), scenarios=SCENARIOS)
    measured = {"p1": pressed.measured_at(study, [0.08, 4.0], 0.004, 1)}
    stage = stage_of(study, measured)
    cases = stage.run()
    assessed = Assessment(study=study, measured=measured).assessed(cases)
    return study, PosteriorSampling(study=study, design=stage.design, swept=()).run(cases, assessed)


@pytest.mark.slow
def test_the_posterior_is_that_of_a_grid_of_real_simulations(sampled):
    _, found = sampled
    main = found.posteriors[0]
    points, box = main.draws.points, main.density.problem.box
    width = points.std(axis=0)
    axes = [
        np.linspace(m - 5.0 * s, m + 5.0 * s, 45) for m, s in zip(points.mean(axis=0), width, strict=True)
    ]
    grid = np.clip(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2), 0.0, 1.0)
    runs = found.curves.simulated.runs(grid, slopes=False)
    logs = -0.5 * main.density.misfit(runs.values, runs.ordinates)
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    mean = weights @ runs.values
    sd = np.sqrt(weights @ (runs.values - mean) ** 2)
    np.testing.assert_allclose(main.values.mean(axis=0), mean, rtol=0.02)
    # Three standard deviations of that of so many draws, which are independent.
    assert main.draws.n_independent > len(points) > 1900
    np.testing.assert_allclose(main.values.std(axis=0), sd, rtol=3.0 / np.sqrt(2.0 * len(points)))
    assert box.names == ("tissue.c1", "tissue.m1")


@pytest.mark.slow
def test_what_is_printed_was_solved_again(sampled):
    study, found = sampled
    tables = posterior_tables(found, study.seed)
    row = tables["posterior"].filter(scenario="I", parameter="tissue.m1").row(0, named=True)
    assert row["lower"] < row["mean"] < row["upper"]
    assert row["mean_solved"] == pytest.approx(row["mean"], abs=0.1 * row["sd"])
    assert tables["profile_ends"]["value_solved"].to_list() == pytest.approx(
        tables["profile_ends"]["value"].to_list(), rel=1e-3
    )
    assert tables["profiles"].filter(parameter="tissue.m1")["rise"].min() == 0.0
    assert tables["profiles"]["rise"].max() > RISE
    assert set(tables["sobol_indices"]["channel"]) == {"force", "torque"}
    assert tables["sobol_indices"].height == 2 * (20 + 41)
    assert tables["volumes"]["ratio"].to_list()[0] == 1.0
    assert tables["volumes"]["ratio"].to_list()[1] > 1.0
    assert tables["emulator"]["error"].max() <= PRECISE
