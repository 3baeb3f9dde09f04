"""Laws of the mean of repeated presses."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Curve
from palpate.errors import CurveError
from palpate.experiment.repeats import POOLED_SHARE, average, described

TURNS = st.lists(st.floats(0.5, 10.0), min_size=1, max_size=4)
SHIFTS = st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=5)


def path(swings, n_points):
    """Abscissae that go up, down, up … by these amounts."""
    ways = np.cumsum([0.0, *(s * (-1) ** k for k, s in enumerate(swings))])
    legs = [np.linspace(a, b, n_points) for a, b in itertools.pairwise(ways)]
    return np.concatenate([legs[0], *(leg[1:] for leg in legs[1:])])


def press(swings, n_points, ordinate=np.sin, std=None):
    x = path(swings, n_points)
    return Curve(channel="torque", abscissa=x, ordinate=ordinate(x), std=std)


@given(TURNS, st.integers(2, 30), st.integers(2, 4))
def test_equal_presses_have_themselves_as_mean(swings, n_points, n_presses):
    one = press(swings, n_points)
    mean = average({str(i): one for i in range(n_presses)})
    np.testing.assert_array_equal(mean.abscissa, one.abscissa)
    np.testing.assert_allclose(mean.ordinate, one.ordinate, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(mean.std, 0.0, atol=1e-14)


@given(TURNS, st.integers(2, 30), SHIFTS)
def test_presses_that_differ_by_constants_have_their_spread(swings, n_points, shifts):
    one = press(swings, n_points)
    presses = {str(i): replace(one, ordinate=one.ordinate + s) for i, s in enumerate(shifts)}
    mean = average(presses)
    np.testing.assert_allclose(mean.ordinate, one.ordinate + np.mean(shifts), atol=1e-12)
    np.testing.assert_allclose(mean.std, np.std(shifts, ddof=1), atol=1e-12)


@given(TURNS, st.integers(2, 30), SHIFTS)
def test_the_mean_has_the_mean_times_of_presses_that_all_have_them(swings, n_points, shifts):
    one = press(swings, n_points)
    time_s = np.linspace(0.0, 2.0, one.abscissa.size)
    presses = {str(i): replace(one, time_s=time_s + s) for i, s in enumerate(shifts)}
    np.testing.assert_allclose(average(presses).time_s, time_s + np.mean(shifts), atol=1e-12)
    assert average(presses | {"no clock": one}).time_s is None


@given(TURNS, SHIFTS, st.randoms(use_true_random=False))
def test_the_order_of_the_presses_changes_nothing(swings, shifts, random):
    presses = [press(swings, 9, lambda x, s=s: np.cos(x + s)) for s in shifts]
    shuffled = random.sample(presses, len(presses))
    one = average(dict(enumerate(presses)))
    other = average(dict(enumerate(shuffled)))
    np.testing.assert_allclose(other.ordinate, one.ordinate, atol=1e-13)
    np.testing.assert_allclose(other.std, one.std, atol=1e-7)


@given(
    st.integers(1, 4),
    st.lists(st.tuples(st.floats(0.99, 1.01), st.integers(2, 20)), min_size=2, max_size=4),
    st.floats(-2, 2),
    st.floats(-2, 2),
)
def test_a_line_pressed_to_other_depths_at_other_points_is_that_line(n_swings, presses, slope, offset):
    swings = [10.0 * 3.0**-k for k in range(n_swings)]
    curves = {
        str(i): press([swings[0] * scale, *swings[1:]], n, lambda x: slope * x + offset)
        for i, (scale, n) in enumerate(presses)
    }
    mean = average(curves)
    np.testing.assert_allclose(mean.ordinate, slope * mean.abscissa + offset, atol=1e-11)
    np.testing.assert_allclose(mean.std, 0.0, atol=1e-6)
    for curve in curves.values():
        assert len(mean.branches) == len(curve.branches)
    assert mean.abscissa.max() == min(curve.abscissa.max() for curve in curves.values())


def test_a_single_press_is_left_as_it_is():
    one = press([1.0, 2.0], 5)
    assert average({"a": one}) is one


def test_the_band_is_no_narrower_than_the_std_of_the_presses():
    one = press([1.0], 50)
    unsure = replace(one, std=np.full(50, 0.3))
    sure = replace(one, std=np.full(50, 0.4))
    np.testing.assert_allclose(average({"a": unsure, "b": sure}).std, np.sqrt((0.09 + 0.16) / 2))
    # Without a std of a press, that between the presses counts.
    np.testing.assert_allclose(average({"a": unsure, "b": one}).std, 0.0, atol=1e-15)


def test_presses_that_cross_are_not_taken_to_agree_there():
    x = np.linspace(0.0, 10.0, 201)
    up, down = (Curve(channel="force", abscissa=x, ordinate=s * (x - 5.0)) for s in (1.0, -1.0))
    mean = average({"a": up, "b": down})
    np.testing.assert_allclose(mean.ordinate, 0.0, atol=1e-12)
    # The mean of 2t² over |t| ≤ half the pooled stretch w is w²/6.
    width = POOLED_SHARE * 10.0
    assert mean.std[100] == pytest.approx(np.sqrt(width**2 / 6.0), rel=0.06)
    assert mean.std[0] == pytest.approx(np.sqrt(2.0) * 5.0, rel=0.06)


def test_what_is_reported_of_an_average():
    one = press([1.0], 11)
    presses = {"a": one, "b": replace(one, ordinate=one.ordinate + 0.2)}
    reported = described(average(presses), presses)
    assert reported["n_presses"] == 2
    assert reported["largest_std"] == pytest.approx(0.2 / np.sqrt(2.0))
    scale = np.abs(one.ordinate + 0.1).mean()
    assert reported["nmse_from_mean"] == pytest.approx({"a": (0.1 / scale) ** 2, "b": (0.1 / scale) ** 2})


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            press([1.0], 5),
            r"b\.csv: channel 'torque' turns 0 times and starts upwards, where .*a\.csv turns 1",
        ),
        (
            press([-1.0, -2.0], 5),
            r"b\.csv: .*starts downwards, .*starts upwards; .*list the other as a separate spot",
        ),
        (
            Curve(channel="torque", abscissa=[8.0, 9.0, 7.0], ordinate=[0.0, 1.0, 2.0]),
            "no abscissa in common on branch 1; leave out the one that stops early",
        ),
    ],
)
def test_presses_along_different_paths_have_no_mean(other, message):
    with pytest.raises(CurveError, match=message):
        average({"a.csv": press([1.0, 2.0], 5), "b.csv": other})
