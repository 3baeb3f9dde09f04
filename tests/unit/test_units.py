"""Units at the door."""

import math

import pytest
from hypothesis import given, strategies as st

from palpate.units import convert


@pytest.mark.parametrize(
    ("given", "unit", "value"),
    [
        ("15 mm", "mm", 15.0),
        ("1.5 cm", "mm", 15.0),
        ("20 kPa", "MPa", 0.02),
        ("1 N/mm^2", "MPa", 1.0),
        ("-22.5 deg", "deg", -22.5),
        ("22.5°", "deg", 22.5),
        (f"{math.pi} rad", "deg", 180.0),
        ("3 N·mm", "N·mm", 3.0),
        ("0.003 N·m", "N·mm", 3.0),
        ("10 min", "s", 600.0),
        ("4 GB", "MB", 4000.0),
        ("512 MiB", "MB", 536.870912),
        (".5 mm", "mm", 0.5),
        ("2e-3 MPa", "MPa", 2e-3),
        (0.4, "1", 0.4),
        (3, "", 3.0),
        ("0.4", "1", 0.4),
        ("40 %", "1", 0.4),
    ],
)
def test_a_quantity_is_in_the_unit_of_the_surface(given: object, unit: str, value: float) -> None:
    assert convert(given, unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "unit", "message"),
    [
        ("10 apples", "mm", "unknown unit 'apples'; use e.g. \"10 mm\""),
        ("10 s", "mm", "is not of the kind of mm"),
        ("10 rad", "MB", "is not of the kind of MB"),
        ("10 MB", "1", "is not a plain ratio"),
        ("10 MPa", "mm", "is not of the kind of mm"),
        ("0.3 Mpa", "MPa", "'0.3 Mpa': unknown unit 'Mpa'; did you mean 'MPa'?"),
        ("3 S", "s", "'3 S' is not of the kind of s; did you mean 's'?"),
        ("0,3 MPa", "MPa", "'0,3 MPa' has a decimal comma; write \"0.3 MPa\""),
        ("-,5", "1", "'-,5' has a decimal comma; write \"-.5\""),
        (10, "mm", 'has no unit; write "10 mm"'),
        ("10", "mm", 'has no unit; write "10 mm"'),
        ("ten mm", "mm", "is not a number with a unit"),
        ("", "mm", "is not a number with a unit"),
        ("10 mm mm", "mm", "is not of the kind of mm"),
        ("10 ((", "mm", "unknown unit '(('"),
        ("nan mm", "mm", "is not a number with a unit"),
        ("1e999 mm", "mm", "is not finite"),
        (float("inf"), "1", "is not finite"),
        (True, "1", "is not a quantity"),
        (["1 mm"], "mm", "is not a quantity"),
        # SI calls these dimensionless; reading one as another would be wrong by 180/π.
        ("0.4", "deg", 'has no unit; write "0.4 deg"'),
        ("5 mm/m", "deg", "is not of the kind of deg"),
        ("5 %", "deg", "is not of the kind of deg"),
        ("5 deg", "1", "is not a plain ratio"),
    ],
)
def test_anything_else_is_refused_with_what_to_write(given: object, unit: str, message: str) -> None:
    with pytest.raises(ValueError) as caught:
        convert(given, unit)
    assert message in str(caught.value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_in_the_same_unit_keeps_its_bits(number: float) -> None:
    assert convert(f"{number!r} mm", "mm") == number
