"""Values have the digits that their intervals say something of."""

import math

import pytest
from hypothesis import given, strategies as st

from palpate_report.data.marks import rounded


@pytest.mark.parametrize(
    ("value", "lower", "upper", "expected"),
    [
        (13.7312, 13.2204, 14.5611, "13.7"),
        (-0.93424, -1.5724, -0.58501, "-0.93"),
        (0.066923, 0.031142, 0.22141, "0.07"),
        (27461.0, 26402.0, 29113.0, "27500"),
        (-0.001, -0.6, 0.6, "0.0"),
        (1.23456e-9, 1.2e-9, 1.3e-9, "1.23e-09"),
        (13.7312, None, None, "13.7"),
        (5.0, 5.0, 5.0, "5"),
        (math.nan, 1.0, 2.0, "nan"),
    ],
)
def test_two_digits_of_the_width_are_shown(value, lower, upper, expected):
    assert rounded(value, lower, upper) == expected


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e9))
def test_what_is_shown_is_within_a_twentieth_of_the_width(widths, width):
    value = widths * width
    shown = float(rounded(value, value - 0.5 * width, value + 0.5 * width))
    assert abs(shown - value) <= 0.051 * width
