"""The table of element topology describes closed elements, in the numbering of VTK."""

from collections import Counter

import numpy as np
import pytest
from meshio._common import num_nodes_per_cell

from palpate.mesh.specimens import block
from palpate.mesh.topology import (
    CELLS,
    HEX_CORNERS,
    barycentric,
    linear_simplex,
    multilinear,
    outer_faces,
    quadratic_simplex,
)

TET_CORNERS = np.vstack([np.zeros(3), np.eye(3)])
CORNERS = {"tet4": TET_CORNERS, "tet10": TET_CORNERS, "hex8": HEX_CORNERS}
VOLUMES = {"tet4": 1.0 / 6.0, "tet10": 1.0 / 6.0, "hex8": 8.0}
EACH_KIND = pytest.mark.parametrize("kind", CELLS)


def enclosed(points, faces):
    """Volume inside faces (n, n_corners) by the divergence theorem: positive where they are outward."""
    fans = [faces[:, [0, k, k + 1]] for k in range(1, faces.shape[1] - 1)]
    a, b, c = np.moveaxis(points[np.concatenate(fans)], 1, 0)
    return np.einsum("ni,ni->", a, np.cross(b, c)) / 6.0


@EACH_KIND
def test_the_faces_of_an_element_enclose_its_volume(kind):
    faces = np.array(CELLS[kind].corner_faces)
    for shift in (0.0, 5.0):
        assert enclosed(CORNERS[kind] + shift, faces) == pytest.approx(VOLUMES[kind])


@EACH_KIND
def test_every_edge_is_run_through_once_in_each_direction(kind):
    """Faces that are outward and leave no gap meet at each edge in opposite directions."""
    cell = CELLS[kind]
    ways = Counter(way for face in cell.corner_faces for way in zip(face, np.roll(face, -1), strict=True))
    assert set(ways.values()) == {1}
    assert {tuple(sorted(way)) for way in ways} == {tuple(sorted(edge)) for edge in cell.edges}
    assert len(ways) == 2 * len(cell.edges)


@EACH_KIND
def test_nodes_after_the_corners_are_in_the_middle_of_edges(kind):
    cell = CELLS[kind]
    points = np.vstack([CORNERS[kind], CORNERS[kind][np.array(cell.edges)].mean(axis=1)])[: cell.n_nodes]
    assert len(points) == cell.n_nodes == num_nodes_per_cell[cell.meshio]
    n = cell.n_face_corners
    for face in np.array(cell.faces):
        corners = points[face[:n]]
        expected = 0.5 * (corners + np.roll(corners, -1, axis=0))[: len(face) - n]
        np.testing.assert_array_equal(points[face[n:]], expected)


@EACH_KIND
@pytest.mark.parametrize("febio", [False, True])
def test_outer_faces_enclose_a_mesh(kind, febio):
    mesh = block(kind, n_across=2, n_down=2, width_mm=4.0, height_mm=3.0).mesh
    faces = outer_faces(kind, mesh.cells[kind], febio=febio)
    n = CELLS[kind].n_face_corners
    assert enclosed(mesh.points_mm, faces[:, :n]) == pytest.approx(48.0)
    middles = mesh.points_mm[faces[:, n:]]
    corners = mesh.points_mm[faces[:, :n]]
    np.testing.assert_allclose(
        middles, (0.5 * (corners + np.roll(corners, -1, axis=1)))[:, : middles.shape[1]]
    )


@EACH_KIND
def test_shape_functions_are_one_at_their_node_and_sum_to_one(kind):
    cell, points = CELLS[kind], CORNERS[kind]
    nodes = np.vstack([points, points[np.array(cell.edges)].mean(axis=1)])[: cell.n_nodes]
    values, slopes = {
        "tet4": lambda p: linear_simplex(barycentric(p)),
        "tet10": lambda p: quadratic_simplex(barycentric(p), cell.edges),
        "hex8": lambda p: multilinear(p, HEX_CORNERS),
    }[kind](nodes)
    np.testing.assert_allclose(values, np.eye(cell.n_nodes), atol=1e-15)
    np.testing.assert_allclose(slopes.sum(axis=1), 0.0, atol=1e-14)
    np.testing.assert_allclose(slopes.transpose(0, 2, 1) @ nodes, [np.eye(3)] * len(nodes), atol=1e-14)
