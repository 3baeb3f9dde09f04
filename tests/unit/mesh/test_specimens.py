"""Specimens are watertight, upright and of the size that was asked for."""

import numpy as np
import pytest

from palpate.errors import MeshError
from palpate.mesh.specimens import block, cylinder, half_space, layer, spacing
from palpate.mesh.topology import CELLS

KINDS = ("hex8", "tet10")
SIX = np.array([[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]])

SPECIMENS = {
    "block": lambda kind: block(kind, grading=1.4),
    "half_space": lambda kind: half_space(kind, 0.5, n_radius=4, n_core=4),
    "fine": lambda kind: half_space(kind, 0.5, n_radius=6, n_core=6, crowding=1.8, growth=1.4),
    "layer": lambda kind: layer(kind, 2.0, 1.0, n_radius=4, n_core=4, crowding=1.3),
    "cylinder": lambda kind: cylinder(kind, np.arange(5.0), np.array([0.0, 1.0, 3.0]), n_core=6),
}


@pytest.fixture(params=[(name, kind) for name in SPECIMENS for kind in KINDS], ids="-".join)
def meshed(request):
    name, kind = request.param
    return kind, SPECIMENS[name](kind).mesh


def tetrahedra(mesh, kind):
    corners = mesh.cells[kind][:, : CELLS[kind].n_corners]
    return corners[:, SIX].reshape(-1, 4) if kind == "hex8" else corners


def volumes(mesh, kind):
    a, b, c, d = np.moveaxis(mesh.points_mm[tetrahedra(mesh, kind)], 1, 0)
    return np.einsum("ei,ei->e", b - a, np.cross(c - a, d - a)) / 6.0


def surface(mesh, kind):
    """Corner nodes of the faces that belong to one cell only, and the largest number of sharers."""
    faces = np.concatenate([mesh.cells[kind][:, list(f)] for f in CELLS[kind].corner_faces])
    found, counts = np.unique(np.sort(faces, axis=1), axis=0, return_counts=True)
    return found[counts == 1], counts.max()


def test_every_cell_is_upright(meshed):
    kind, mesh = meshed
    assert volumes(mesh, kind).min() > 0.0


def test_cells_match_their_neighbours(meshed):
    """A face of one cell only is on the upper face or between fixed nodes."""
    kind, mesh = meshed
    faces, most = surface(mesh, kind)
    assert most == 2
    top = (mesh.points_mm[faces][..., 2] == 0.0).all(axis=1)
    held = np.isin(faces, mesh.node_sets["fixed"]).all(axis=1)
    walls = np.ptp(np.abs(mesh.points_mm[faces][..., :2]).max(axis=2), axis=1) == 0.0
    assert (top | held | walls).all()


def test_nodes_are_used_once(meshed):
    kind, mesh = meshed
    assert np.array_equal(np.unique(mesh.cells[kind]), np.arange(mesh.n_nodes))
    assert len(np.unique(mesh.points_mm.round(9), axis=0)) == mesh.n_nodes


def test_contact_is_the_upper_face(meshed):
    _, mesh = meshed
    np.testing.assert_array_equal(mesh.node_sets["contact"], np.flatnonzero(mesh.points_mm[:, 2] == 0.0))


@pytest.mark.parametrize("kind", KINDS)
def test_a_half_space_fills_its_hemisphere_and_is_held_there(kind):
    mesh = half_space(kind, 0.5, n_radius=6, n_core=6, extent=50.0, growth=1.5).mesh
    held = mesh.points_mm[mesh.node_sets["fixed"]]
    np.testing.assert_allclose(np.linalg.norm(held[:1], axis=1), 25.0)
    assert np.linalg.norm(held, axis=1).min() > 0.95 * 25.0
    assert volumes(mesh, kind).sum() == pytest.approx(2.0 / 3.0 * np.pi * 25.0**3, rel=0.05)


@pytest.mark.parametrize("kind", KINDS)
def test_a_layer_has_its_thickness_and_a_ring_at_the_contact(kind):
    mesh = layer(kind, 2.0, 1.0, n_radius=4, n_core=4, extent=5.0).mesh
    x, y, z = mesh.points_mm.T
    assert (z.min(), z.max()) == (-2.0, 0.0)
    radii = np.hypot(x, y)
    assert radii.max() == pytest.approx(11.0)
    assert np.isclose(radii[mesh.node_sets["contact"]], 1.0).sum() >= 16
    assert np.isin(np.flatnonzero(z == -2.0), mesh.node_sets["fixed"]).all()


def test_spacing_crowds_towards_the_edge_and_grows_beyond_it():
    x = spacing(1.0, 4, 20.0, growth=1.5, crowding=1.3)
    cells = np.diff(x)
    assert x[4] == 1.0
    assert x[-1] == pytest.approx(20.0)
    np.testing.assert_allclose(cells[:3] / cells[1:4], 1.3)
    np.testing.assert_allclose(cells[5:] / cells[4:-1], 1.5)


@pytest.mark.parametrize(
    "make",
    [
        lambda: spacing(1.0, 4, 0.5, growth=2.0),
        lambda: spacing(1.0, 4, 5.0, growth=0.5),
        lambda: cylinder("hex8", np.arange(5.0), np.arange(3.0), n_core=3),
        lambda: cylinder("hex8", np.arange(3.0), np.arange(3.0), n_core=6),
        lambda: cylinder("hex8", np.array([0.0, 1.0, 1.0, 2.0]), np.arange(3.0), n_core=2),
    ],
)
def test_what_cannot_be_meshed_is_refused(make):
    with pytest.raises(MeshError, match="specimen"):
        make()
