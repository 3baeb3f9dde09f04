"""The faceted sphere presses like the round one."""

import numpy as np
import pytest

from palpate_febio.contact_meshes import sphere_mesh
from palpate_febio.settings import FebioSettings

RADIUS_MM = 7.5


@pytest.fixture(scope="module")
def ball():
    return sphere_mesh(RADIUS_MM, FebioSettings().facet_mm)


def test_closed_outward_and_even(ball):
    a, b, c = ball.points_mm[ball.faces].transpose(1, 0, 2)
    edges = np.sort(np.vstack([ball.faces[:, [0, 1]], ball.faces[:, [1, 2]], ball.faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()
    assert (np.einsum("ni,ni->n", a, np.cross(b - a, c - a)) > 0.0).all()
    assert np.linalg.norm(b - a, axis=1).max() <= 1.0
    volume = np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS_MM**3, rel=1e-12)


def test_tetrahedra_are_not_inverted(ball):
    p = ball.points_mm[ball.tets]
    volumes = np.linalg.det(p[:, 1:] - p[:, :1]) / 6.0
    assert (volumes > 0.0).all()
    assert volumes.sum() == pytest.approx(4.0 / 3.0 * np.pi * RADIUS_MM**3, rel=1e-12)


def profile(ball, radius, angle):
    """Depth of the facets below the centre at places in the plane, looked at from below."""
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    corners = ball.points_mm[ball.faces]
    corners = corners[corners[:, :, 2].max(axis=1) < 0.0]
    a, b, c = corners.transpose(1, 0, 2)
    twice = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    found = np.full(x.shape, np.nan)
    for k, (px, py) in enumerate(zip(x, y, strict=True)):
        u = ((px - a[:, 0]) * (c[:, 1] - a[:, 1]) - (py - a[:, 1]) * (c[:, 0] - a[:, 0])) / twice
        v = ((b[:, 0] - a[:, 0]) * (py - a[:, 1]) - (b[:, 1] - a[:, 1]) * (px - a[:, 0])) / twice
        face = np.flatnonzero((u >= -1e-12) & (v >= -1e-12) & (u + v <= 1 + 1e-12))[0]
        found[k] = (a + u[:, None] * (b - a) + v[:, None] * (c - a))[face, 2]
    return -found


@pytest.mark.parametrize("depth_mm", [1.0, 2.0, 4.0])
def test_facets_change_the_force_by_less_than_half_a_percent(ball, depth_mm):
    """To first order dF/F = 1.5 <dz>/d, the mean weighted by a flat punch's pressure 1/sqrt(a² − r²)."""
    a = np.sqrt(RADIUS_MM * depth_mm)
    t = (np.arange(60) + 0.5) / 60.0
    radius = np.repeat(a * np.sqrt(1.0 - t**2), 37)  # equal shares of that weight
    angle = np.tile(2.0 * np.pi * np.arange(37) / 37.0 + 0.1, 60)
    change = profile(ball, radius, angle) - np.sqrt(RADIUS_MM**2 - radius**2)
    assert abs(1.5 * change.mean() / depth_mm) < 0.005
    inscribed = change - 1.0**2 / 8.0 / RADIUS_MM  # what the usual facets would do
    assert abs(change.mean()) < abs(inscribed.mean())


def test_a_coarser_wish_gives_a_coarser_ball():
    assert len(sphere_mesh(RADIUS_MM, 1.2).faces) == 20 * 9**2
    assert len(sphere_mesh(1.0, 0.1).faces) == 20 * 14**2
