"""Ranges of parameters."""

from hypothesis import given, strategies as st

from palpate.domain import Parameter

ENDS = st.lists(st.floats(-100.0, 100.0).map(lambda x: round(x, 3)), min_size=2, max_size=2, unique=True)


@given(
    ends=ENDS,
    below=st.booleans(),
    kind=st.sampled_from(["modulus", "shape"]),
    limit=st.one_of(st.just(0.0), st.floats(1e-3, 300.0)),
)
def test_a_wider_range_goes_on_beyond_one_end_as_far_as_physics_lets_it(ends, below, kind, limit):
    lower, upper = sorted(ends)
    limits = {"physical_lower": lower - limit, "physical_upper": upper + limit}
    parameter = Parameter(name="p", unit="MPa", lower=lower, upper=upper, kind=kind, description="", **limits)
    wider = parameter.wider(below=below)
    if below:
        assert wider.upper == upper
        assert lower - limit <= wider.lower <= lower
        assert wider.lower < lower or limit == 0.0
    else:
        assert wider.lower == lower
        assert upper <= wider.upper <= upper + limit
        assert wider.upper > upper or limit == 0.0
    assert wider.in_logarithms == parameter.in_logarithms
