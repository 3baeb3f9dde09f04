"""Laws of scores, against the NMSE written out in numpy."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
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
def pairs(draw: st.DrawFn) -> tuple[Floats, Floats, Floats]:
    """Simulated and measured values and weights, (n,) each."""
    n = draw(st.integers(2, 30))
    sim = draw(arrays(float, n, elements=st.floats(-50, 50)))
    # Rising by at least 0.1 a point, so that no normaliser is degenerate.
    exp = np.cumsum(draw(arrays(float, n, elements=st.floats(0.1, 5))))
    return sim, exp, draw(arrays(float, n, elements=st.floats(0.01, 10)))


@given(pairs(), NORMALISERS)
def test_a_score_agrees_with_numpy(pair, normaliser):
    sim, exp, weights = pair
    expected = np.average((sim - exp) ** 2, weights=weights) / BY_NUMPY[normaliser](exp) ** 2
    assert _core.nmse(sim, exp, normaliser, weights) == pytest.approx(expected, rel=1e-12)
    assert _core.normaliser(exp, normaliser) == pytest.approx(BY_NUMPY[normaliser](exp), rel=1e-12)


@given(pairs(), NORMALISERS)
def test_memory_layout_changes_no_bit(pair, normaliser):
    sim, exp, weights = pair
    expected = _core.nmse(sim, exp, normaliser, weights)
    spaced = (np.repeat(values, 2)[::2] for values in pair)
    assert _core.nmse(*list(spaced)[:2], normaliser, weights[::-1].copy()[::-1]) == expected


@given(pairs(), NORMALISERS, st.floats(1e-3, 1e3))
def test_one_factor_on_both_curves_changes_nothing(pair, normaliser, factor):
    row, exp, _ = pair
    before = _core.nmse(row, exp, normaliser)
    assert _core.nmse(factor * row, factor * exp, normaliser) == pytest.approx(before, rel=1e-12)


@given(pairs(), NORMALISERS)
def test_only_equal_curves_score_zero(pair, normaliser):
    row, exp, _ = pair
    assert _core.nmse(exp, exp, normaliser) == 0.0
    assert (_core.nmse(row, exp, normaliser) > 0.0) == (row != exp).any()


@given(pairs(), st.floats(-0.9, 0.9))
def test_a_uniform_error_scores_its_square_with_rms(pair, error):
    _, exp, _ = pair
    rounding = 8 * np.finfo(float).eps * abs(error)  # of (1 + error) and of its products
    score = _core.nmse((1 + error) * exp, exp, "rms")
    assert score == pytest.approx(error**2, rel=1e-9, abs=rounding + 1e-30)


@given(st.floats(0.1, 100), st.floats(-0.09, 0.09))
def test_the_mean_of_a_nearly_symmetric_twist_is_degenerate(peak, offset):
    loop = np.sin(np.linspace(0, 2 * np.pi, 400, endpoint=False))
    torque = peak * (loop + offset * np.sqrt(0.5))
    with pytest.raises(ScoringError, match=r'"mean" is degenerate.*choose another'):
        _core.nmse(1.1 * torque, torque, "mean")
    assert _core.nmse(1.1 * torque, torque) == pytest.approx(0.0124, rel=0.05)


def test_no_normaliser_helps_a_curve_of_zeros():
    for name in ("mean_abs", "rms", "std"):
        with pytest.raises(ScoringError, match=r"all its ordinates are 0: check its column"):
            _core.nmse(np.ones(3), np.zeros(3), name)


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
    with pytest.raises(TypeError, match="sim"):
        _core.nmse(pair[None], pair)
