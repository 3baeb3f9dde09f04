"""Cells of tables as people read them."""

import sys

import pytest

from palpate.plugins.sections import shown


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (True, "yes"),
        (False, "no"),
        (1.0, "1"),
        (0.99994, "0.9999"),
        (0.99996, "0.9999"),
        (-0.99996, "-1"),
        (sys.float_info.min, "> 0"),
        (23.43412, "23.43"),
        (12345, "12345"),
        ("p1", "p1"),
    ],
)
def test_a_cell_has_a_word_for_what_is_no_number_and_four_digits(value, text):
    assert shown(value) == text
