"""Laws of intervals: as wide as the errors make them, cause by cause, and right as often as they say."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.linalg import null_space
from scipy.stats import binom, chi2, norm, t as student

from palpate.api import Parameter
from palpate.api.fit import THRESHOLDS, Box
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.between_spots import SPOTS, by_spot, differences, freedom_of, probability_of_alike
from palpate_certainty.laplace import Laplace, laplace, scores_of
from palpate_certainty.noise_model import (
    error_scale,
    estimate,
    grouped,
    groups_of,
)
from palpate_certainty.tables import parameter_combinations

from .pressed_residuals import EXPECTED, drawn, errors_of, fitted, press

seeds = st.integers(0, 2**32 - 1)


def linear(seed, n=30, p=3):
    """A linear model, its fit, and errors of two causes besides the noise."""
    rng = np.random.default_rng(seed)
    jacobian = rng.normal(size=(n, p)) * 10.0 ** rng.uniform(-1, 1, p)
    noise, causes = np.diag(rng.uniform(0.5, 2.0, n)), rng.normal(size=(2, n, 1))
    return rng, jacobian, {"noise": noise, "a": causes[0], "b": causes[1]}


def density(jacobian, causes, curves=None, point=None, residuals=None, **changes):
    """As of one curve, if none are numbered, and of a fit without residuals in the middle of the box."""
    n, p = jacobian.shape
    scores = scores_of(jacobian, np.zeros(n, dtype=int) if curves is None else curves)
    point = np.full(p, 0.5) if point is None else point
    residuals = np.zeros(n) if residuals is None else residuals
    return laplace(point, residuals, jacobian, causes, scores, **changes)


@given(seeds)
def test_the_covariance_is_that_of_the_fit_of_a_linear_model(seed):
    _, jacobian, causes = linear(seed)
    fitted = np.linalg.pinv(jacobian)
    errors = np.concatenate(list(causes.values()), axis=1)
    expected = fitted @ errors @ errors.T @ fitted.T
    np.testing.assert_allclose(density(jacobian, causes, range_sd=np.inf).covariance, expected, rtol=1e-6)


@given(seeds)
def test_curves_of_one_point_each_are_weighed_as_aitken_does(seed):
    rng, jacobian, causes = linear(seed)
    errors = np.concatenate(list(causes.values()), axis=1)
    weights = np.linalg.inv(errors @ errors.T)
    residuals = rng.normal(size=len(jacobian))
    each = np.arange(len(jacobian))
    found = density(jacobian, causes, each, np.zeros(3), residuals, range_sd=np.inf)
    expected = np.linalg.inv(jacobian.T @ weights @ jacobian)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-6)
    np.testing.assert_allclose(found.centre, -expected @ jacobian.T @ weights @ residuals, rtol=1e-5)
    np.testing.assert_allclose(sum(found.shares.values()), 1.0, rtol=1e-9)


@given(seeds, st.integers(2, 5))
def test_no_further_curve_and_no_weights_of_curves_widen_an_interval(seed, n_curves):
    """A curve may be a channel, a spot or a press; errors that several share are among the causes."""
    rng, jacobian, causes = linear(seed)
    curves = rng.integers(n_curves, size=len(jacobian))
    causes["c"] = rng.normal(size=(len(jacobian), 1)) * 10.0 ** rng.uniform(-2, 2, n_curves)[curves][:, None]
    of_all = density(jacobian, causes, curves, range_sd=10.0)
    fewer = curves != curves[0]
    part = {name: factor[fewer] for name, factor in causes.items()}
    of_some = density(jacobian[fewer], part, curves[fewer], range_sd=10.0)
    weight = 10.0 ** rng.uniform(-2, 2, n_curves)[curves][:, None]
    weighed = density(weight * jacobian, {name: weight * of for name, of in causes.items()}, range_sd=10.0)
    for other in (of_some, weighed):
        assert (of_all.sd <= other.sd * (1.0 + 1e-6)).all()
        assert np.linalg.eigvalsh(other.covariance - of_all.covariance).min() > -1e-6 * other.sd.max() ** 2


@pytest.mark.parametrize("n", [32, 64, 200, 256])
def test_draws_are_as_wide_as_their_density(n):
    covariance = 1e-4 * np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 4.0]])
    centre = np.array([0.4, 0.5, 0.6])
    found = Laplace(centre=centre, covariance=covariance, parts={"noise": covariance}).within().draws(n)
    np.testing.assert_allclose(found.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.3)
    np.testing.assert_allclose(found.mean(axis=0), centre, atol=0.02)


@given(seeds, st.floats(0.01, 10.0))
def test_white_noise_gives_the_textbook_covariance(seed, sigma):
    _, jacobian, _ = linear(seed)
    found = density(jacobian, {"noise": sigma * np.eye(len(jacobian))}, range_sd=np.inf)
    np.testing.assert_allclose(found.covariance, sigma**2 * np.linalg.inv(jacobian.T @ jacobian), rtol=1e-6)


@given(seeds)
def test_shares_sum_to_one(seed):
    _, jacobian, causes = linear(seed)
    shares = density(jacobian, causes).shares
    assert set(shares) == {"noise", "a", "b", "range"}
    np.testing.assert_allclose(sum(shares.values()), 1.0, rtol=1e-9)
    assert all((share >= -1e-12).all() for share in shares.values())


@given(seeds)
def test_a_cause_of_no_size_changes_nothing(seed):
    _, jacobian, causes = linear(seed)
    without = {name: part for name, part in causes.items() if name != "b"}
    zero = density(jacobian, {**without, "b": np.zeros_like(causes["b"])})
    np.testing.assert_allclose(zero.covariance, density(jacobian, without).covariance, rtol=1e-12)
    np.testing.assert_array_equal(zero.shares["b"], 0.0)


@given(seeds, st.floats(0.0, 3.0))
def test_no_cause_narrows_an_interval(seed, size):
    _, jacobian, causes = linear(seed)
    more = {**causes, "c": size * np.random.default_rng(seed).normal(size=(len(jacobian), 2))}
    assert (density(jacobian, more).sd >= density(jacobian, causes).sd * (1.0 - 1e-9)).all()


@given(seeds)
def test_a_parameter_that_no_curve_shows_has_its_whole_range(seed):
    _, jacobian, causes = linear(seed)
    jacobian[:, 1] = 0.0
    found = density(jacobian, causes)
    lower, upper = found.within().interval(np.full(3, 0.5))
    assert upper[1] - lower[1] > 0.93
    assert found.shares["range"][1] == pytest.approx(1.0)


@given(seeds)
def test_intervals_are_within_the_ranges_and_have_the_fit(seed):
    rng, jacobian, causes = linear(seed)
    point = rng.choice([0.0, 0.3, 1.0], 3)
    residuals = 5.0 * rng.normal(size=len(jacobian))
    lower, upper = density(jacobian, causes, None, point, residuals).within().interval(point)
    assert ((lower >= 0.0) & (lower <= point) & (point <= upper) & (upper <= 1.0)).all()


@given(seeds)
def test_draws_are_within_the_ranges_and_their_quantiles_are_the_intervals(seed):
    _, jacobian, causes = linear(seed)
    found = density(jacobian, causes).within()
    draws = found.draws(400)
    assert ((draws >= 0.0) & (draws <= 1.0)).all()
    ends = np.quantile(draws, (0.025, 0.975), axis=0)
    lower, upper = found.interval(np.median(draws, axis=0))
    np.testing.assert_allclose(ends, [lower, upper], atol=0.2 * (upper - lower).max())


def test_intervals_of_a_linear_model_hold_the_truth_as_often_as_they_say():
    rng, n = np.random.default_rng(1), 400
    _, jacobian, causes = linear(2)
    jacobian, held = 100.0 * jacobian, np.zeros((n, 4))
    found, truth = density(jacobian, causes), np.full(3, 0.5)
    errors = np.concatenate(list(causes.values()), axis=1)
    fitted = truth + (np.linalg.pinv(jacobian) @ errors @ rng.normal(size=(errors.shape[1], n))).T
    for i, point in enumerate(fitted):
        at = density(jacobian, causes, None, point).within()
        lower, upper = at.interval(point)
        held[i] = *((lower <= truth) & (truth <= upper)), at.holds(truth)
    least, most = binom.ppf([1e-4, 1.0 - 1e-4], n, 0.95)
    assert ((held.sum(axis=0) >= least) & (held.sum(axis=0) <= most)).all()
    assert found.sd.max() < 0.2


# -------------------------------------------------------------- noise and discrepancy


@given(st.floats(0.0, 6.0), st.floats(0.1, 0.9))
def test_a_centre_outside_of_a_range_is_as_unlikely_as_it_is_far(far, other):
    covariance = np.diag([0.1**2, 0.05**2])
    found = Laplace(centre=np.array([1.0 + 0.1 * far, other]), covariance=covariance, parts={})
    assert found.in_ranges == pytest.approx(chi2.sf(far**2, 2), rel=1e-3, abs=1e-9)
    inside = Laplace(centre=np.array([0.5, other]), covariance=covariance, parts={})
    assert inside.in_ranges == pytest.approx(1.0)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_the_scale_of_errors_is_between_the_stated_one_and_the_seen_one(times):
    rows, jacobian = press()
    rng, rest, found = np.random.default_rng(7), errors_of(rows, 0.002, 0.0), []
    known = 0.05 * np.stack([rows.path ** (k + 0.5) * (rows.channel == k % 2) for k in range(6)], axis=1)
    for _ in range(200):
        residuals = fitted(drawn(rng, rest) + times * known @ rng.normal(size=6), jacobian)
        found.append(error_scale(residuals, null_space(jacobian.T), known, rest))
    n_seen = found[0].freedom - ASSUMED.scale_freedom
    assert n_seen >= 2
    expected = (ASSUMED.scale_freedom + n_seen * times**2) / (ASSUMED.scale_freedom + n_seen)
    assert np.mean([each.factor**2 for each in found]) == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize(
    ("n_seen", "least_at_once", "least_at_twice"), [(2, 96, 80), (4, 96, 83), (6, 95, 85)]
)
def test_a_region_of_uncertain_scale_holds_the_truth_at_twice_the_errors(
    n_seen, least_at_once, least_at_twice
):
    """Worlds of three parameters whose errors have one unknown scale, which ``n_seen`` directions show."""
    rng, n, held = np.random.default_rng(0), 600, []
    for times in (1.0, 2.0):
        inside = 0
        for _ in range(n):
            chi2_seen = float(np.sum((times * rng.normal(size=n_seen)) ** 2))
            freedom = ASSUMED.scale_freedom + n_seen
            scale = (ASSUMED.scale_freedom + chi2_seen) / freedom
            covariance = scale * 1e-4 * np.eye(3)
            at = Laplace(
                centre=0.5 + 0.01 * times * rng.normal(size=3),
                covariance=covariance,
                parts={},
                freedom=freedom,
            )
            inside += at.within().holds(np.full(3, 0.5))
        held.append(100.0 * inside / n)
    assert held[0] >= least_at_once
    assert held[1] >= least_at_twice


@given(st.floats(3.0, 30.0))
def test_intervals_of_an_uncertain_scale_are_students(freedom):
    found = Laplace(centre=np.array([0.5]), covariance=np.array([[1e-4]]), parts={}, freedom=freedom).within()
    lower, upper = found.interval(np.array([0.5]))
    expected = 2.0 * 0.01 * student.ppf(0.975, freedom)
    assert upper[0] - lower[0] == pytest.approx(expected, rel=0.06)


@given(st.floats(2.5, 30.0))
def test_a_standard_deviation_has_the_interval_of_the_draws(freedom):
    parts = {"noise": np.array([[4e-6]]), "mesh": np.array([[6e-6]])}
    found = Laplace(centre=np.array([0.5]), covariance=np.array([[1e-5]]), parts=parts, freedom=freedom)
    upper = student.ppf(0.975, freedom, scale=np.sqrt(1e-5))
    assert found.sd[0] * norm.ppf(0.975) == pytest.approx(upper)


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "discrepancy"), [(0.01, 0.0), (0.002, 0.01), (0.0005, 0.002)])
def test_noise_and_discrepancy_are_found_in_residuals(noise, discrepancy):
    rows, jacobian = press()
    rng, found = np.random.default_rng(3), []
    for _ in range(10):
        residuals = fitted(drawn(rng, errors_of(rows, noise, discrepancy)), jacobian)
        known, free = np.zeros((len(residuals), 1)), null_space(jacobian.T)
        found.append(estimate(residuals, free, known, rows, expected=EXPECTED))
    for channel in (0, 1):
        assert np.median([each.noise[channel] for each in found]) == pytest.approx(noise, rel=0.2)
        size = np.median([each.discrepancy[channel] for each in found])
        assert size == pytest.approx(discrepancy, rel=0.6, abs=0.008)


def test_the_discrepancy_is_no_less_than_expected():
    """Parameters absorb what is alike along the path, so that small residuals do not speak against it."""
    rows, jacobian = press()
    residuals = fitted(drawn(np.random.default_rng(3), errors_of(rows, 1e-4, 0.0)), jacobian)
    known, free = np.zeros((len(residuals), 1)), null_space(jacobian.T)
    expected = {0: 0.005, 1: 0.02}
    found = estimate(residuals, free, known, rows, expected=expected)
    for channel, size in expected.items():
        assert found.discrepancy[channel] == pytest.approx(size)
        variances, inside = np.diag(found.covariances(rows)[1]), rows.channel == channel
        np.testing.assert_allclose(variances[inside], (size * rows.envelope[inside]) ** 2)


def test_spots_of_different_tissue_are_seen():
    rows, jacobian = press(n_spots=2, n=12)
    rng = np.random.default_rng(6)
    errors = drawn(rng, errors_of(rows, 0.003, 0.002))
    errors += jacobian @ [0.15, 0.0, 0.0] * np.where(rows.spot == 0, 1.0, -1.0)
    residuals = fitted(errors, jacobian)
    found = estimate(
        residuals, null_space(jacobian.T), np.zeros((len(residuals), 1)), rows, expected=EXPECTED
    )
    assert probability_of_alike(residuals, jacobian, sum(found.covariances(rows)), rows) < THRESHOLDS.spots


@pytest.mark.parametrize(("n_spots", "worlds"), [(5, 40)])
def test_the_mean_and_the_spread_of_spots_that_differ_are_in_their_intervals(n_spots, worlds):
    """Worlds with known errors, in which parameters differ by 10 % of their ranges."""
    rows, jacobian = press(n_spots=n_spots, n=12)
    rng, sd, covariance = np.random.default_rng(7), 0.1, errors_of(rows, 0.003, 0.005)
    slopes, errors = by_spot(jacobian, rows), {"errors": np.linalg.cholesky(covariance)}
    ranges = [Parameter(name=n, unit="1", lower=-9.0, upper=9.0, kind="shape", description="") for n in "abc"]
    box, width = Box(ranges), 18.0
    scores, none = scores_of(slopes, rows.curve), np.empty((0, 3))
    held, spread = [], []
    for _ in range(worlds):
        own = sd * rng.normal(size=(n_spots, 3))
        residuals = drawn(rng, covariance) + (jacobian * own[rows.spot]).sum(axis=1)
        own = laplace(np.zeros(3 * n_spots), residuals, width * slopes, errors, scores)
        prior = none[:, 0], none, np.empty((0, 0)), np.full(3, 0.5)
        found = differences(own, jacobian, rows, np.full((n_spots, 3), 0.5), box, prior)
        most = student.ppf(0.975, freedom_of(found.mean.shares[SPOTS], found.freedom, 1e9))
        held += (np.abs(found.point - 0.5) < most * np.sqrt(np.diag(found.mean.covariance))).tolist()
        spread += ((found.ends[:, 0] <= sd / width) & (sd / width <= found.ends[:, 1])).tolist()
        assert ((found.ends[:, 0] <= found.sd) & (found.sd <= found.ends[:, 1])).all()
    assert 0.88 < np.mean(held) <= 1.0
    assert 0.88 < np.mean(spread) <= 1.0


def test_averaged_neighbours_keep_size_and_place():
    rows, jacobian = press(n=100)
    groups = groups_of(rows)
    np.testing.assert_allclose(groups @ groups.T, np.eye(len(groups)), atol=1e-12)
    fewer = grouped(rows, groups)
    assert np.bincount(fewer.channel).max() <= 64
    assert (np.diff(fewer.path[fewer.channel == 0]) > 0.0).all()
    smooth = groups.T @ (groups @ jacobian)
    np.testing.assert_allclose(smooth.T @ smooth, jacobian.T @ jacobian, rtol=0.01)


# ------------------------------------------------------------------------- directions


def test_the_best_known_direction_is_the_product_that_the_curves_show():
    # Curves that depend on a·b^0.5 alone: relative changes d(log a) + d(log b)/2.
    values, rates = np.array([2.0, 8.0]), np.array([1.0, 1.0])
    seen = np.array([1.0 / values[0], 0.5 / values[1]])
    covariance = np.linalg.inv(1e6 * np.outer(seen, seen) + np.eye(2))
    best, worst = parameter_combinations(("a", "b"), values, rates, covariance)
    assert best[0] in ("a · b^0.5", "a^2 · b")
    assert best[1] < 0.01 < worst[1]


@given(seeds)
def test_directions_come_by_how_well_they_are_known(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T + 1e-6 * np.eye(3)
    widths = [
        width for _, width in parameter_combinations(("a", "b", "c"), np.ones(3), np.ones(3), covariance)
    ]
    assert len(widths) == 3
    assert widths[0] <= widths[-1] * 3.0


@pytest.mark.slow
@pytest.mark.parametrize(("share", "low", "high"), [(0.0, 0.0, 0.3), (1.0, 0.7, 1.0)])
def test_what_the_discrepancies_of_sites_have_in_common_is_found(share, low, high):
    rows, jacobian = press(n_spots=5, n=12)
    rng, found = np.random.default_rng(5), []
    covariance = sum(1e-6 * rows.noise(c, 0.0) + 1e-4 * rows.discrepancy(c, 0.35, share) for c in (0, 1))
    for _ in range(6):
        residuals = fitted(drawn(rng, covariance), jacobian)
        known, free = np.zeros((len(residuals), 1)), null_space(jacobian.T)
        found.append(estimate(residuals, free, known, rows, expected=EXPECTED))
    assert low <= np.median([each.common for each in found]) <= high


def test_two_sites_do_not_tell_what_they_have_in_common():
    rows, jacobian = press(n_spots=2, n=12)
    residuals = fitted(np.random.default_rng(6).normal(size=len(rows.spot)), jacobian)
    known, free = np.zeros((len(residuals), 1)), null_space(jacobian.T)
    assert estimate(residuals, free, known, rows, expected=EXPECTED).common == ASSUMED.common


@given(seed=st.integers(0, 10_000), small=st.integers(0, 26), is_inside=st.booleans())
def test_most_likely_values_inside_of_the_ranges_are_the_centre(seed, small, is_inside):
    """A coefficient over many powers of ten has a share, and an error, of nearly nothing."""
    rng, n = np.random.default_rng(seed), 6
    sd = np.append(10.0**-small, 10.0 ** rng.uniform(-4.0, 0.0, n - 1))
    root = sd[:, None] * (rng.normal(size=(n, n)) + 2.0 * np.eye(n))
    centre = np.append(sd[0], rng.uniform(0.05, 0.95, n - 1))
    centre[-1] += 0.0 if is_inside else 1.0
    found = Laplace(centre=centre, covariance=root @ root.T, parts={}).most_likely
    assert ((found >= 0.0) & (found <= 1.0)).all()
    if is_inside:
        np.testing.assert_allclose(found, centre, rtol=1e-9)
    else:
        assert found[-1] == 1.0
