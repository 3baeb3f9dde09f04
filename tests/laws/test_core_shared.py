"""Laws of batches on a shared path and of PCHIP, against numpy and SciPy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from palpate import _core
from palpate.errors import CurveError, ScoringError

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


def by_numpy(values: Floats, exp: Floats) -> Floats:
    return np.mean((values - exp) ** 2, axis=1) / np.mean(np.abs(exp)) ** 2


@given(batches(), st.sampled_from(["moments", "direct"]))
def test_both_forms_agree_with_numpy(batch, form):
    sim_x, sim, exp_x, exp = batch
    values = np.stack([np.interp(exp_x, sim_x, row) for row in sim])
    nmse, coverage = _core.Measured(exp_x, exp).along(sim_x).score(sim, form)
    # numpy's slope form of the interpolant rounds the curve itself by 1e-16 of its size.
    np.testing.assert_allclose(nmse, by_numpy(values, exp), rtol=1e-12, atol=1e-15 * np.sqrt(nmse.max()))
    assert (coverage == 1.0).all()


@given(batches())
def test_pchip_is_scipys(batch):
    sim_x, sim, exp_x, exp = batch
    values, covered = _core.interpolate(sim_x, sim[0], exp_x, interpolant="pchip")
    expected = np.stack([PchipInterpolator(sim_x, row)(exp_x) for row in sim])
    np.testing.assert_allclose(values, expected[0], rtol=1e-12, atol=1e-12)
    assert covered.all()
    nmse, _ = _core.Measured(exp_x, exp, interpolant="pchip").along(sim_x).score(sim)
    np.testing.assert_allclose(nmse, by_numpy(expected, exp), rtol=1e-12, atol=1e-14 * np.sqrt(nmse.max()))


@given(batches(), st.sampled_from(["linear", "pchip"]), st.integers(0, 4))
def test_layout_and_threads_change_no_bit(batch, interpolant, threads):
    sim_x, sim, exp_x, exp = batch
    sim = np.tile(sim, (20, 1))
    measured = _core.Measured(exp_x, exp, interpolant=interpolant)
    path = measured.along(sim_x)
    expected = path.score(sim)
    for layout in (np.asfortranarray(sim), np.repeat(sim, 2, axis=1)[:, ::2], sim[::-1].copy()[::-1]):
        np.testing.assert_array_equal(path.score(layout, threads=threads), expected)
    starts = np.arange(len(sim) + 1) * sim_x.size
    merged = measured.score_paths(np.tile(sim_x, len(sim)), sim.ravel(), starts, threads=threads)
    np.testing.assert_array_equal(merged, path.score(sim, "direct"))
    assert measured.score(sim_x, sim[0]) == (merged[0][0], merged[1][0])


@given(batches(), st.sampled_from(["linear", "pchip"]))
def test_the_best_scale_has_no_slope_and_the_gradient_says_so(batch, interpolant):
    sim_x, sim, exp_x, exp = batch
    path = _core.Measured(exp_x, exp, interpolant=interpolant).along(sim_x)
    scale, (nmse, _) = path.best_scale(sim)
    (again, _), gradient = path.gradient(scale[:, None] * sim)
    np.testing.assert_allclose(again, nmse, rtol=1e-12, atol=1e-14 * np.sqrt(nmse.max()))
    # d NMSE/d scale = sim · gradient, which vanishes inside the bounds.
    slope, size = np.sum(sim * gradient, axis=1), np.sum(np.abs(sim * gradient), axis=1)
    inside = scale > 0.0
    assert (np.abs(slope[inside]) <= 1e-9 * size[inside] + 1e-13).all()
    clipped, _ = path.best_scale(sim, 2.0, 3.0)
    np.testing.assert_array_equal(clipped, np.clip(path.best_scale(sim, -np.inf, np.inf)[0], 2.0, 3.0))


def test_bad_batches_are_named():
    x = np.array([0.0, 1.0, 2.0])
    measured = _core.Measured(x, x + 1.0)
    path = measured.along(x)
    assert (measured.n_points, path.n_values) == (3, 3)
    with pytest.raises(CurveError, match="1 sets of 3"):
        path.score(np.ones((1, 2)))
    with pytest.raises(CurveError, match=r"sim\[0, 1\] is NaN but later"):
        path.score(np.array([[1.0, np.nan, 1.0]]))
    with pytest.raises(ScoringError, match='form "fast" is unknown'):
        path.score(np.ones((1, 3)), "fast")  # type: ignore[arg-type]
    with pytest.raises(CurveError, match='interpolant "cubic" is unknown'):
        _core.Measured(x, x, interpolant="cubic")  # type: ignore[arg-type]
    with pytest.raises(ScoringError, match="from 2 to 1"):
        path.best_scale(np.ones((1, 3)), 2.0, 1.0)
    with pytest.raises(CurveError, match=r"starts\[1\]"):
        measured.score_paths(x, x, np.array([0, -1]))
    with pytest.raises(CurveError, match=r"simulated path 1: sim_y\[0\] is NaN"):
        measured.score_paths(np.tile(x, 2), np.array([1.0, 1, 1, np.nan, 1, 1]), np.array([0, 3, 6]))
    for wrong in (np.ones(3), np.ones((1, 3), np.float32), [[1.0, 1.0, 1.0]]):
        with pytest.raises(TypeError, match="sim"):
            path.score(wrong)  # type: ignore[arg-type]
