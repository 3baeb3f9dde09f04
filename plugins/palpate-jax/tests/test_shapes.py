import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate_jax.shapes import RoundedPunch, SphereShape

SHAPES = [SphereShape(7.5), RoundedPunch(5.0, 1.0), RoundedPunch(3.0, 3.0)]
coordinates = st.tuples(*[st.floats(-9.0, 9.0)] * 2, st.floats(-3.0, 12.0))


@pytest.mark.parametrize("shape", SHAPES)
@given(point=coordinates)
def test_the_distance_is_the_way_to_the_surface(shape, point):
    x = np.array([point])
    n, _ = shape.normals(x)
    d = shape.distance(x)
    if d[0] > -0.5:  # deeper, directions to the surface may cross
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
        assert shape.distance(x - d[:, None] * n)[0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(
    "x", [(1.0, 0.5, 0.2), (2.9, 1.0, 0.2), (4.0, 2.6, 0.3), (5.0, 3.0, -0.5), (4.0, 4.0, 3.5)]
)
def test_normals_and_curvature_are_derivatives_of_the_distance(shape, x):
    x, h = np.array([x]), 1e-5
    n, curvature = shape.normals(x)
    steps = h * np.eye(3)
    slope = np.array([(shape.distance(x + e) - shape.distance(x - e))[0] for e in steps]) / (2 * h)
    bend = np.array([(shape.normals(x + e)[0] - shape.normals(x - e)[0])[0] for e in steps]).T / (2 * h)
    np.testing.assert_allclose(n[0], slope, atol=1e-8)
    np.testing.assert_allclose(curvature[0], bend, atol=1e-8)


@pytest.mark.parametrize("shape", SHAPES)
def test_the_lowest_point_is_the_origin(shape):
    assert shape.distance(np.zeros((1, 3)))[0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(shape.normals(np.array([[0.0, 0.0, -1.0]]))[0], [[0.0, 0.0, -1.0]])


def test_a_rounding_wider_than_the_punch_is_refused():
    with pytest.raises(ValueError, match=r"edge_mm is 4\.0"):
        RoundedPunch(3.0, 4.0)
