"""Values have the digits that their intervals say something of."""

import math

import polars as pl
import pytest
from hypothesis import given, strategies as st

from palpate.plugins.sections import Table, rounded, rounded_rows
from palpate_report.data.table_files import latex, markdown


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


def test_rows_of_a_frame_have_the_digits_of_their_intervals():
    frame = pl.DataFrame(
        {
            "parameter": ["c1", "c2", "c3"],
            "value": [14.0, 2.0, 0.12345],
            "lower": [13.54, None, 0.1],
            "upper": [14.46, None, math.inf],
            "loss_tangent": [0.1, 0.2, 0.3],
            "loss_lower": [0.091, 0.1, 0.2],
            "loss_upper": [0.109, 0.3, 0.4],
        }
    )
    assert rounded_rows(frame) == [
        ("c1", "14.00", "13.54", "14.46", "0.100", "0.091", "0.109"),
        ("c2", 2.0, None, None, "0.20", "0.10", "0.30"),
        ("c3", 0.12345, 0.1, math.inf, "0.30", "0.20", "0.40"),
    ]


def test_a_posterior_has_the_digits_of_its_interval_and_its_probabilities_at_the_ends_keep_theirs():
    row = {
        "mean": 1.2349, "sd": 0.1251, "lower": 1.0012, "upper": 1.4998,
        "mean_solved": 1.2412, "at_lower": 0.0031, "at_upper": 0.9,
    }  # fmt: skip
    assert rounded_rows(pl.DataFrame([row])) == [("1.23", 0.1251, "1.00", "1.50", "1.24", 0.0031, 0.9)]


def test_rounded_texts_are_numbers_of_a_table_and_of_latex():
    frame = pl.DataFrame({"parameter": ["c1"], "value": [-14.0], "lower": [-14.46], "upper": [-13.54]})
    assert Table.of("Values", frame).is_number == (False, True, True, True)
    assert "$-14.00$" in latex("parameters", frame)
    assert "| -14.00 |" in markdown("parameters", frame)
