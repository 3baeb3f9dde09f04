"""Laws of optimised and extended designs and scrambled nets, against SciPy and by themselves."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.distance import pdist
from scipy.stats import qmc

from palpate import _core
from palpate.errors import SamplingError

SEEDS = st.integers(0, 2**64 - 1)
CRITERIA = st.sampled_from(["cd", "maximin", "correlation"])
CUBE = st.integers(2, 60).flatmap(
    lambda n: st.builds(
        lambda d, seed: np.random.default_rng(seed).random((n, d)), st.integers(2, 6), st.integers(0, 2**32)
    )
)


def quality(criterion: str, points: np.ndarray) -> float:
    """What is to become less, from SciPy and numpy."""
    if criterion == "cd":
        return float(qmc.discrepancy(points, method="CD"))
    if criterion == "maximin":
        return -float(pdist(points).min())
    r = np.corrcoef(points.T)
    return float(np.sum(np.triu(r, 1) ** 2))


def strata(points: np.ndarray) -> np.ndarray:
    return np.sort(np.floor(points * len(points)), axis=0)


@given(CUBE)
def test_memory_layout_changes_nothing(points):
    spaced = np.repeat(np.asfortranarray(points), 2, axis=0)[::2]
    np.testing.assert_array_equal(
        _core.optimise_design(spaced, "cd", 1, n_swaps=50), _core.optimise_design(points, "cd", 1, n_swaps=50)
    )


@given(CUBE, CRITERIA, SEEDS, st.integers(0, 300))
def test_optimising_never_worsens_and_keeps_each_column_s_values(points, criterion, seed, n_swaps):
    better = _core.optimise_design(points, criterion, seed, n_swaps=n_swaps)
    np.testing.assert_array_equal(np.sort(better, axis=0), np.sort(points, axis=0))
    assert quality(criterion, better) <= quality(criterion, points) + 1e-13
    np.testing.assert_array_equal(better, _core.optimise_design(points, criterion, seed, n_swaps=n_swaps))


@given(st.integers(1, 40), st.integers(1, 5), SEEDS, st.integers(2, 5), st.booleans())
def test_an_extension_is_a_latin_hypercube_around_the_old_points(n, d, seed, factor, centred):
    points = _core.latin_hypercube(n, d, seed, centred=centred)
    extended = _core.extend_latin_hypercube(points, factor * n, seed, centred=centred)
    np.testing.assert_array_equal(extended[:n], points)
    if not centred:  # centres of the old strata may be on borders of the new ones
        np.testing.assert_array_equal(strata(extended), np.repeat(np.arange(factor * n)[:, None], d, axis=1))
    arranged = _core.optimise_design(extended, "cd", seed, n_fixed=n, n_swaps=100)
    np.testing.assert_array_equal(arranged[:n], points)
    np.testing.assert_array_equal(np.sort(arranged, axis=0), np.sort(extended, axis=0))


@given(st.integers(0, 7), st.integers(1, 6), SEEDS)
def test_a_scrambled_net_is_a_net(levels, d, seed):
    net = qmc.Sobol(d, scramble=False, bits=32).random_base2(levels)
    scrambled = _core.owen_scramble(net, seed)
    np.testing.assert_array_equal(strata(scrambled), np.repeat(np.arange(2**levels)[:, None], d, axis=1))
    # Any two equal leading parts stay equal, any two different ones different.
    for digits in (1, 3, 9):
        before, after = (np.floor(p * 2**digits) for p in (net, scrambled))
        for k in range(d):
            assert len(np.unique(np.stack([before[:, k], after[:, k]]), axis=1).T) == len(
                np.unique(before[:, k])
            )


def test_a_scrambled_point_is_uniform_and_its_columns_independent():
    corner = np.zeros((1, 2))
    drawn = np.concatenate([_core.owen_scramble(corner, seed) for seed in range(4000)])
    assert np.abs(drawn.mean(axis=0) - 0.5).max() < 5 / np.sqrt(12 * 4000)
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 5 / np.sqrt(4000)


def test_scrambling_makes_the_error_of_an_integral_smaller_than_chance():
    net = qmc.Sobol(3, scramble=False, bits=32).random_base2(8)
    errors = [np.prod(_core.owen_scramble(net, seed) * 2, axis=1).mean() - 1 for seed in range(50)]
    by_chance = np.sqrt((4 / 3) ** 3 - 1) / 16
    assert np.std(errors) < by_chance / 10
    assert abs(np.mean(errors)) < 5 * np.std(errors) / np.sqrt(50)


@given(st.floats(1e-9, 1e9), st.floats(1.0 + 1e-9, 1e9), SEEDS)
def test_a_logarithmic_range_spreads_the_logarithm(lower, factor, seed):
    shares = _core.latin_hypercube(20, 1, seed)[:, 0]
    values = _core.geometric(shares, lower, lower * factor)
    assert (values >= lower).all()
    assert (values <= lower * factor).all()
    np.testing.assert_allclose(values, lower * factor**shares, rtol=1e-14)


TWO = np.array([[0.1, 0.2], [0.3, 0.4]])


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: _core.optimise_design(TWO, "phi", 1), SamplingError, '"phi" is unknown'),
        (lambda: _core.optimise_design(TWO, "cd", -1), SamplingError, "seed is -1"),
        (lambda: _core.optimise_design(TWO, "cd", 1, n_swaps=-2), SamplingError, "n_swaps is -2"),
        (lambda: _core.optimise_design(TWO, "cd", 1, n_swaps=0.5), TypeError, r"n_swaps is 0\.5"),
        (lambda: _core.optimise_design(TWO, "cd", 1, n_fixed=3), SamplingError, "n_fixed is 3"),
        (lambda: _core.optimise_design(TWO + 1, "cd", 1), SamplingError, r"points\[0, 0\] is 1\.1"),
        (lambda: _core.optimise_design(TWO[0], "cd", 1), TypeError, "points"),
        (lambda: _core.optimise_design(TWO.astype(np.float32), "cd", 1), TypeError, "points"),
        (lambda: _core.optimise_design(np.empty((0, 3)), "cd", 1), SamplingError, "0 values"),
        (lambda: _core.optimise_design(TWO * np.nan, "cd", 1), SamplingError, "is NaN"),
        (lambda: _core.extend_latin_hypercube(TWO, 2, 1), SamplingError, "n_total is 2"),
        (lambda: _core.extend_latin_hypercube(TWO, 3, 1), SamplingError, "share one of n_total = 3"),
        (lambda: _core.extend_latin_hypercube(TWO, 2**60, 1), SamplingError, "exceeds"),
        (lambda: _core.owen_scramble(TWO - 1, 1), SamplingError, "unit cube"),
        (lambda: _core.geometric(TWO[0], 0.0, 1.0), SamplingError, "0 to 1 has no logarithmic scale"),
    ],
)
def test_an_impossible_request_names_argument_and_value(call, error, message):
    with pytest.raises(error, match=message):
        call()
