"""Other elements are cut into tetrahedra that fill them, meet and keep their curved shape."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Mesh
from palpate.limb.checks import check_limb
from palpate.mesh.specimens import block
from palpate.mesh.splitting import SOLIDS, curved, cut
from palpate.mesh.topology import outer_faces

CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
SHAPES = {
    "hexahedron": (CUBE, 1.0, 6),
    "wedge": (CUBE[[0, 1, 3, 4, 5, 7]], 0.5, 3),
    "pyramid": (np.vstack([CUBE[:4], [[0.5, 0.5, 1.0]]]), 1 / 3, 2),
    "tetra": (CUBE[[0, 1, 3, 4]], 1 / 6, 1),
}


def volumes(points, tets):
    return np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]]) / 6.0


@given(st.sampled_from(sorted(SHAPES)), st.randoms(use_true_random=False))
def test_an_element_is_filled_whatever_its_numbers(kind, random):
    points, volume, n_tets = SHAPES[kind]
    numbers = np.array(random.sample(range(len(points)), len(points)))
    place = np.empty_like(points)
    place[numbers] = points
    found = cut(place, ((kind, numbers[None]),))
    assert len(found.tets) == n_tets
    assert (volumes(place, found.tets) > 0.0).all()
    assert volumes(place, found.tets).sum() == pytest.approx(volume)


@given(st.randoms(use_true_random=False))
def test_neighbours_cut_their_face_alike(random):
    """The outer faces of the cut block are twice the squares of its surface: none is left inside."""
    mesh = block("hex8", n_across=2, n_down=2).mesh
    numbers = np.array(random.sample(range(mesh.n_nodes), mesh.n_nodes))
    points = np.empty_like(mesh.points_mm)
    points[numbers] = mesh.points_mm
    found = cut(points, (("hexahedron", numbers[mesh.cells["hex8"]]),))
    assert len(outer_faces("tet4", found.tets)) == 2 * len(outer_faces("hex8", mesh.cells["hex8"]))


def with_middles(points, cells, edges, bend):
    """Elements with nodes in the middle of their edges, all points bent."""
    pairs = np.sort(cells[:, np.array(edges)], axis=2)
    ends, inverse = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    whole = np.vstack([points, points[ends].mean(axis=1)])
    return bend(whole), np.hstack([cells, len(points) + inverse.reshape(len(cells), -1)])


@pytest.mark.parametrize("kind", ["hexahedron20", "wedge15"])
def test_a_curved_mesh_keeps_its_shape_and_sets(kind):
    limb = block("hex8", width_mm=40.0, height_mm=10.0, n_across=4, n_down=2)
    cells = limb.mesh.cells["hex8"]
    if kind == "wedge15":
        cells = np.concatenate([cells[:, [0, 1, 2, 4, 5, 6]], cells[:, [0, 2, 3, 4, 6, 7]]])

    def bend(points):
        return points + [0.0, 0.0, 0.01] * (points[:, :1] ** 2)

    points, cells = with_middles(limb.mesh.points_mm, cells, SOLIDS[kind][0].edges, bend)
    found = cut(points, ((kind, cells),))
    corners = np.arange(limb.mesh.n_nodes)
    mesh = Mesh(
        points_mm=points[corners],
        cells={"tet4": found.tets},
        cell_regions={"tet4": np.zeros(len(found.tets))},
        regions=("soft_tissue",),
        node_sets=limb.mesh.node_sets,
    )
    made = curved(mesh, found.ends, found.middles)
    check_limb(type(limb)(spot=limb.spot, mesh=made), ["soft_tissue"])
    x, _, z = made.points_mm.T
    for name, level in (("fixed", -10.0), ("contact", 0.0)):
        nodes = made.node_sets[name]
        np.testing.assert_allclose(z[nodes], level + 0.01 * x[nodes] ** 2, atol=1e-9)
        assert len(nodes) == 81
