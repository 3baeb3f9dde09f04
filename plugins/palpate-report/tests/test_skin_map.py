"""Smoothing of maps of the skin."""

import numpy as np

from palpate_report.figures.skin_map import smoothed

POINTS = np.array([[x, y, 0.0] for y in range(3) for x in range(3)])
CORNERS = [(i, i + 1, i + 4, i + 3) for i in (0, 1, 3, 4)]
TRIANGLES = np.array([t for a, b, c, d in CORNERS for t in ((a, b, c), (a, c, d))])


def test_a_constant_stays_and_a_node_without_triangle_keeps_its_value():
    values = np.append(np.full(9, 7.0), 3.0)
    points = np.vstack([POINTS, [9.0, 9.0, 9.0]])
    np.testing.assert_allclose(smoothed(values, points, TRIANGLES), values)


def test_values_that_alternate_from_node_to_node_are_levelled():
    values = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    found = smoothed(values, POINTS, TRIANGLES)
    assert np.ptp(found) <= 0.5 * np.ptp(values)


def test_a_large_triangle_counts_more():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-3.0, 0.0, 0.0]])
    found = smoothed(np.array([0.0, 3.0, 0.0, 9.0]), points, np.array([[0, 1, 2], [0, 2, 3]]))
    assert found[0] == 0.25 * 1.0 + 0.75 * 3.0
