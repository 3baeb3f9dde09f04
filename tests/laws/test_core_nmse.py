"""Laws of scores, against the NMSE written out in numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from palpate import _core
from palpate.errors import CurveError, ScoringError

Floats = NDArray[np.float64]

BY_NUMPY = {
    "mean_abs": lambda exp: np.abs(exp).mean(),
    "mean": lambda exp: abs(exp.mean()),
    "rms": lambda exp: np.sqrt((exp**2).mean()),
    "range": np.ptp,
    "std": np.std,
}
NORMALISERS = st.sampled_from(sorted(BY_NUMPY))


@st.composite
def batches(draw: st.DrawFn, *, gaps: bool = False) -> tuple[Floats, Floats, Floats]:
    """Simulated (n_sets, n) and measured (n,) values and weights (n,)."""
    n_sets, n = draw(st.integers(1, 5)), draw(st.integers(2, 30))
    sim = draw(arrays(float, (n_sets, n), elements=st.floats(-50, 50)))
    # Rising by at least 0.1 a point, so that no normaliser is degenerate.
    exp = np.cumsum(draw(arrays(float, n, elements=st.floats(0.1, 5))))
    weights = draw(arrays(float, n, elements=st.floats(0.01, 10)))
    if gaps:
        sim[draw(arrays(bool, (n_sets, n)))] = np.nan
    return sim, exp, weights


@given(batches(gaps=True), NORMALISERS)
def test_scores_and_coverage_agree_with_numpy(batch, normaliser):
    sim, exp, weights = batch
    scores, coverage = _core.nmse_batch(sim, exp, normaliser, weights)
    reached = np.where(np.isnan(sim), 0.0, weights)
    np.testing.assert_allclose(coverage, reached.sum(1) / weights.sum(), rtol=1e-12)
    with np.errstate(invalid="ignore"):
        mse = np.nansum(weights * (sim - exp) ** 2, axis=1) / reached.sum(1)
    np.testing.assert_allclose(scores, mse / BY_NUMPY[normaliser](exp) ** 2, rtol=1e-12)


@given(batches(), NORMALISERS)
def test_a_batch_is_a_loop_in_any_memory_layout(batch, normaliser):
    sim, exp, weights = batch
    loop = [_core.nmse(row, exp, normaliser, weights) for row in sim]
    for layout in (sim, np.asfortranarray(sim), np.repeat(sim, 2, axis=1)[:, ::2], sim[::-1].copy()[::-1]):
        scores, coverage = _core.nmse_batch(layout, exp, normaliser, weights)
        np.testing.assert_array_equal(scores, loop)
        assert (coverage == 1.0).all()


@given(batches(), NORMALISERS, st.floats(1e-3, 1e3))
def test_one_factor_on_both_curves_changes_nothing(batch, normaliser, factor):
    (row, *_), exp, _ = batch
    before = _core.nmse(row, exp, normaliser)
    assert _core.nmse(factor * row, factor * exp, normaliser) == pytest.approx(before, rel=1e-12)


@given(batches(), NORMALISERS)
def test_only_equal_curves_score_zero(batch, normaliser):
    (row, *_), exp, _ = batch
    assert _core.nmse(exp, exp, normaliser) == 0.0
    assert (_core.nmse(row, exp, normaliser) > 0.0) == (row != exp).any()


@given(batches(), st.floats(-0.9, 0.9))
def test_a_uniform_error_scores_its_square_with_rms(batch, error):
    _, exp, _ = batch
    rounding = 8 * np.finfo(float).eps * abs(error)  # of (1 + error) and of its products
    score = _core.nmse((1 + error) * exp, exp, "rms")
    assert score == pytest.approx(error**2, rel=1e-9, abs=rounding + 1e-30)


@given(batches(), NORMALISERS, st.integers(2, 20))
def test_a_score_is_interpolation_then_nmse(batch, normaliser, n_sim):
    sim, exp, weights = batch
    exp_x = np.linspace(0, 10, exp.size)
    sim_x = np.linspace(0, 7, n_sim)
    sim_y = np.resize(sim, n_sim)
    values, _ = _core.interpolate(sim_x, sim_y, exp_x)
    (nmse,), (coverage,) = _core.nmse_batch(values[None], exp, normaliser, weights)
    assert _core.score(sim_x, sim_y, exp_x, exp, normaliser, 0.0, weights) == (nmse, coverage)
    assert coverage < 1.0


@given(st.floats(0.1, 100), st.floats(-0.09, 0.09))
def test_the_mean_of_a_nearly_symmetric_twist_is_degenerate(peak, offset):
    loop = np.sin(np.linspace(0, 2 * np.pi, 400, endpoint=False))
    torque = peak * (loop + offset * np.sqrt(0.5))
    with pytest.raises(ScoringError, match=r'"mean" is degenerate.*choose another'):
        _core.nmse(1.1 * torque, torque, "mean")
    assert _core.nmse(1.1 * torque, torque) == pytest.approx(0.0124, rel=0.05)


def test_bad_scoring_inputs_are_named():
    pair = np.array([1.0, 2.0])
    for weights, message in [
        ([1.0], "weights has 1"),
        ([1.0, -1.0], r"weights\[1\]"),
        ([0, 0], "every weight"),
    ]:
        with pytest.raises(ScoringError, match=message):
            _core.nmse(pair, pair, weights=np.array(weights, dtype=float))
    with pytest.raises(ScoringError, match='"median" is unknown'):
        _core.nmse(pair, pair, "median")  # type: ignore[arg-type]
    with pytest.raises(CurveError, match="sim has 3 values but exp has 2"):
        _core.nmse(np.ones(3), pair)
    with pytest.raises(CurveError, match=r"sim\[0\] is NaN"):
        _core.nmse(np.array([np.nan, 1.0]), pair)
    with pytest.raises(CurveError, match=r"sim\[1, 0\] is inf"):
        _core.nmse_batch(np.array([[1.0, 1.0], [np.inf, 1.0]]), pair)
    with pytest.raises(CurveError, match="2 sets of 2"):
        _core.nmse_batch(np.ones((2, 3)), pair)
    with pytest.raises(TypeError, match="sim"):
        _core.nmse_batch(pair, pair)
