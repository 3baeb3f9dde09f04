"""More points of a curve between its own, on cubics along each branch."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from hypothesis.extra.numpy import arrays

from palpate import Curve

LOOP = np.concatenate([np.linspace(0.0, 10.0, 6), np.linspace(8.0, 0.0, 5)])
ordinates = arrays(np.float64, LOOP.size, elements=st.floats(-10.0, 10.0))


def curve(y, **slopes):
    return Curve(channel="force", abscissa=LOOP, ordinate=y, slopes=slopes)


@given(ordinates, st.integers(0, 4))
def test_the_own_points_stay(y, n):
    found = curve(y).densified(n)
    assert found.abscissa.size == (LOOP.size - 1) * (n + 1) + 1
    np.testing.assert_array_equal(found.abscissa[:: n + 1], LOOP)
    np.testing.assert_allclose(found.ordinate[:: n + 1], y, atol=1e-12)


@given(st.integers(0, 2**32 - 1))
def test_slopes_are_derivatives_of_the_new_ordinates(seed):
    y, z = np.random.default_rng(seed).normal(size=(2, LOOP.size))
    found = curve(y, a=z).densified(3)
    moved = [curve(y + step * z).densified(3).ordinate for step in (-1e-7, 1e-7)]
    np.testing.assert_allclose((moved[1] - moved[0]) / 2e-7, found.slopes["a"], atol=1e-5)


@given(arrays(np.float64, 6, elements=st.floats(0.0, 10.0)), st.sampled_from([-1.0, 1.0]))
@example(np.array([0.0, 0.0, 0.0, 0.1, 3.0, 9.0]), 1.0)
def test_ordinates_that_only_rise_or_fall_still_do(steps, sign):
    x, y = np.arange(6.0), sign * np.cumsum(steps)
    found = Curve(channel="force", abscissa=x, ordinate=y).densified(7).ordinate
    assert (sign * np.diff(found) >= -1e-9).all()


def test_each_branch_has_its_own_parabola():
    loads = np.arange(LOOP.size) < 6
    found = curve(np.where(loads, LOOP**2, 12.0 * LOOP - 20.0)).densified(4)
    x, y = found.abscissa, found.ordinate
    np.testing.assert_allclose(y[:26], x[:26] ** 2, atol=1e-9)
    np.testing.assert_allclose(y[26:], 12.0 * x[26:] - 20.0, atol=1e-9)


def test_a_force_of_hertz_is_nearer_than_straight_lines_are():
    x, between = np.arange(11.0), np.linspace(0.0, 10.0, 81)
    found = Curve(channel="force", abscissa=x, ordinate=x**1.5).densified(7)
    straight = np.interp(between, x, x**1.5)
    assert np.abs(found.ordinate - between**1.5).max() < 0.35 * np.abs(straight - between**1.5).max()


def test_a_rest_gets_no_points_and_times_and_spread_follow():
    rests = Curve(
        channel="force",
        abscissa=np.array([0.0, 1.0, 2.0, 2.0, 2.0]),
        ordinate=np.array([0.0, 1.0, 4.0, 3.5, 3.2]),
        std=np.array([0.0, 0.2, 0.4, 0.3, 0.1]),
        time_s=np.array([0.0, 1.0, 2.0, 5.0, 9.0]),
    ).densified(1)
    assert rests.abscissa.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.0, 2.0]
    assert rests.time_s.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 5.0, 9.0]
    assert rests.std == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.3, 0.1])
    assert rests.ordinate[-3:] == pytest.approx([4.0, 3.5, 3.2])
