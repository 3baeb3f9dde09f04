"""Values and the unit box: one goes to the other and back, within the bounds."""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from palpate.domain import Parameter
from palpate.fit.box import Box


def parameter(name, lower, upper, **more):
    kind = more.pop("kind", "modulus")
    return Parameter(
        name=name, unit="MPa", lower=lower, upper=upper, kind=kind, description="of a test", **more
    )


BOX = Box(
    [
        parameter("c1", 1e-3, 0.2),
        parameter("c2", -2e-3, -4e-5),
        parameter("m", 1.0, 8.0, kind="shape"),
        parameter("f", 0.1, 10.0, kind="shape", scale="log"),
    ]
)
points = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4).map(np.array)


def test_moduli_above_zero_and_what_is_spread_in_logarithms_are_logarithmic():
    assert BOX.log.tolist() == [True, False, False, True]
    np.testing.assert_allclose(BOX.values(np.full(4, 0.5)), [np.sqrt(2e-4), -1.02e-3, 4.5, 1.0])


@example(np.array([1.0 - 2.0**-53, 0.0, 0.0, 0.0]))  # next below a power of two
@example(np.array([0.5 - 2.0**-54, 0.0, 0.0, 0.0]))
@given(points)
def test_there_and_back(point):
    values = BOX.values(point)
    assert ((values >= BOX.lower) & (values <= BOX.upper)).all()
    np.testing.assert_allclose(BOX.point(values), point, atol=1e-12)
    np.testing.assert_array_equal(BOX.values(BOX.exact_point(values)), values)


def test_bounds_are_exact_and_what_is_outside_is_at_its_bound():
    assert np.array_equal(BOX.values(np.zeros(4)), BOX.lower)
    assert np.array_equal(BOX.values(np.ones(4)), BOX.upper)
    assert np.array_equal(BOX.point(np.array([-1.0, -1.0, 0.0, 0.0])), np.zeros(4))
    assert np.array_equal(BOX.point(np.array([1.0, 1.0, 9.0, 99.0])), np.ones(4))


@given(points.map(lambda point: np.clip(point, 1e-4, 1.0 - 1e-4)))
def test_rates_are_derivatives(point):
    step = 1e-6
    for i in range(4):
        moved = np.array([point, point])
        moved[:, i] += (step, -step)
        ahead, behind = (BOX.values(each)[i] for each in moved)
        assert BOX.rates(point)[i] == pytest.approx((ahead - behind) / (2.0 * step), rel=1e-6)
