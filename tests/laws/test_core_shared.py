"""Laws of batches on a shared path, against numpy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from palpate import _core
from palpate.errors import CurveError

Floats = NDArray[np.float64]
Batch = tuple[Floats, Floats, Floats, Floats]


@st.composite
def batches(draw: st.DrawFn) -> Batch:
    """Simulated x (n,) and ordinates (n_sets, n), measured x and ordinates (N,), one rising branch."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n, n_points, n_sets = draw(st.integers(2, 30)), draw(st.integers(2, 80)), draw(st.integers(1, 9))
    sim_x, exp_x = (np.cumsum(rng.uniform(0.05, 1.0, size)) for size in (n, n_points))
    sim_x, exp_x = ((x - x[0]) / (x[-1] - x[0]) * 10.0 for x in (sim_x, exp_x))
    noise = 10.0 ** draw(st.integers(-6, 1))
    exp = 1.0 + exp_x**2
    return sim_x, 1.0 + sim_x**2 + noise * rng.normal(size=(n_sets, n)), exp_x, exp


@given(batches())
def test_a_batch_agrees_with_numpy(batch):
    sim_x, sim, exp_x, exp = batch
    values = np.stack([np.interp(exp_x, sim_x, row) for row in sim])
    nmse, coverage = _core.Measured(exp_x, exp).along(sim_x).score(sim)
    expected = np.mean((values - exp) ** 2, axis=1) / np.mean(np.abs(exp)) ** 2
    # numpy's slope form of the interpolant rounds the curve itself by 1e-16 of its size.
    np.testing.assert_allclose(nmse, expected, rtol=1e-12, atol=1e-15 * np.sqrt(nmse.max()))
    assert (coverage == 1.0).all()


@given(batches(), st.floats(0.0, 1.0))
def test_weights_and_coverage_agree_with_numpy(batch, share):
    sim_x, sim, exp_x, exp = batch
    weights = 0.01 + np.cos(exp_x) ** 2
    reached = round(share * sim_x.size)
    sim[:, reached:] = np.nan
    nmse, coverage = _core.Measured(exp_x, exp, "rms", weights=weights).along(sim_x).score(sim)
    if reached < 2:
        assert np.isnan(nmse).all()
        assert not coverage.any()
        return
    covered = exp_x <= sim_x[reached - 1] + 1e-9 * 10.0
    values = np.stack([np.interp(exp_x[covered], sim_x[:reached], row[:reached]) for row in sim])
    error = np.average((values - exp[covered]) ** 2, axis=1, weights=weights[covered])
    np.testing.assert_allclose(nmse, error / np.mean(exp**2), rtol=1e-12, atol=1e-15 * np.sqrt(nmse.max()))
    np.testing.assert_allclose(coverage, weights[covered].sum() / weights.sum(), rtol=1e-12)


@given(batches())
def test_memory_layout_changes_no_bit(batch):
    sim_x, sim, exp_x, exp = batch
    path = _core.Measured(exp_x, exp).along(sim_x)
    expected = path.score(sim)
    for layout in (np.asfortranarray(sim), np.repeat(sim, 2, axis=1)[:, ::2], sim[::-1].copy()[::-1]):
        np.testing.assert_array_equal(path.score(layout), expected)


@given(batches())
def test_the_gradient_is_zero_at_the_best_scale(batch):
    sim_x, sim, exp_x, exp = batch
    path = _core.Measured(exp_x, exp).along(sim_x)
    values = np.stack([np.interp(exp_x, sim_x, row) for row in sim])
    scale = values @ exp / np.sum(values**2, axis=1)
    _, gradient = path.gradient(scale[:, None] * sim)
    # d NMSE/d scale = sim · gradient.
    slope, size = np.sum(sim * gradient, axis=1), np.sum(np.abs(sim * gradient), axis=1)
    assert (np.abs(slope) <= 1e-9 * size + 1e-13).all()


def test_bad_batches_are_named():
    x = np.array([0.0, 1.0, 2.0])
    path = _core.Measured(x, x + 1.0).along(x)
    with pytest.raises(CurveError, match="1 sets of 3"):
        path.score(np.ones((1, 2)))
    with pytest.raises(CurveError, match=r"sim\[0, 1\] is NaN but later"):
        path.score(np.array([[1.0, np.nan, 1.0]]))
    with pytest.raises(CurveError, match=r"sim\[0, 2\] is inf"):
        path.score(np.array([[1.0, 1.0, np.inf]]))
    for wrong in (np.ones(3), np.ones((1, 3), np.float32), [[1.0, 1.0, 1.0]]):
        with pytest.raises(TypeError, match="sim"):
            path.score(wrong)  # type: ignore[arg-type]
