"""Nouns refuse what has no meaning, and say so for people."""

import sys

import pytest
from hypothesis import assume, given, strategies as st

from palpate.domain import Indentation, Parameter, ParameterName
from palpate.domain.indenter import Sphere
from palpate.errors import MaterialError, StudyError


@pytest.mark.parametrize(
    ("lower", "upper", "message"),
    [
        (sys.float_info.min, float("inf"), r"physical range \(> 0 MPa\); give a value inside it"),
        (0.5, 3.0, r"physical range \[0.5, 3.0\] MPa; give"),
    ],
)
def test_a_physical_range_is_reported_in_plain_numbers(lower, upper, message):
    parameter = Parameter(
        name="c1", unit="MPa", lower=1.0, upper=2.0, kind="modulus", description="",
        physical_lower=lower, physical_upper=upper,
    )  # fmt: skip
    parameter.check(1.5)
    with pytest.raises(MaterialError, match=message):
        parameter.check(0.0)


@pytest.mark.parametrize("friction", [-0.1, float("nan"), float("inf")])
def test_a_friction_that_is_none_is_refused(friction):
    with pytest.raises(StudyError, match="give a coefficient >= 0"):
        Indentation(indenter=Sphere(radius_mm=7.5), path=[(0.0, 0.0), (1.0, 0.0)], friction=friction)


@given(
    region=st.from_regex(r"[\w-]*", fullmatch=True),
    name=st.from_regex(r"[\w-]+(\.[\w-]+)?", fullmatch=True),
    spot=st.text(),
)
def test_the_name_of_a_parameter_is_read_as_it_is_written(region: str, name: str, spot: str) -> None:
    assume(region or "." not in name)
    written = ParameterName(region, name, spot)
    assert ParameterName.parse(str(written)) == written
    assert ParameterName.parse(written.shared) == written.at("")
    assert written.counts_at(spot)
    assert written.counts_at(f"{spot}+") == (not spot)
