import numpy as np
import pytest

from palpate.domain.indenter import Sphere
from palpate.domain.level_set import level_set_surface


def volume(points, triangles):
    a, b, c = points[triangles].transpose(1, 0, 2)
    return np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0


@pytest.mark.parametrize("n_across", [7, 20])
def test_a_sphere_is_closed_and_turned_outwards(n_across):
    ball = Sphere(radius_mm=3.0)
    points, triangles = level_set_surface(ball.distance, ball.bounds_mm, n_across)
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    assert (counts == 2).all()
    assert len(np.unique(sides, axis=0)) == len(sides)  # each side once in each direction
    assert volume(points, triangles) == pytest.approx(4.0 / 3.0 * np.pi * 27.0, rel=4.0 / n_across**2)
    assert np.abs(ball.distance(points)).max() < 2.0 * (6.0 / n_across) ** 2 / 3.0


def test_the_triangles_of_the_sphere_s_own_surface_are_turned_outwards():
    points, triangles = Sphere(radius_mm=3.0).surface()
    assert volume(points, triangles) == pytest.approx(4.0 / 3.0 * np.pi * 27.0, rel=0.02)


def test_no_surface_is_no_triangle():
    points, triangles = level_set_surface(lambda x: np.ones(len(x)), np.array([[0.0] * 3, [1.0] * 3]), 4)
    assert points.shape == (0, 3)
    assert triangles.shape == (0, 3)
