"""Refined meshes: the same limb with the same sets, conforming, and no element too flat."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.domain import Indentation, Limb, Mesh, Spot
from palpate.domain.indenter import Sphere
from palpate.errors import MeshError
from palpate.limb.checks import check_depth, check_limb
from palpate.mesh import refinement
from palpate.mesh.refinement import refined
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import contact_edge_mm
from palpate.mesh.topology import CELLS, linear_simplex, outer_faces, quadratic_simplex, with_midpoints
from palpate_limb.quality import scaled_jacobians

HEIGHT = 12.0
# Exact for polynomials of degree three, as the determinant of a quadratic map is.
_RULE = np.vstack([np.full(4, 0.25), np.full((4, 4), 1.0 / 6.0) + np.eye(4) / 3.0])
_WEIGHTS = np.array([-0.8, 0.45, 0.45, 0.45, 0.45]) / 6.0


def curved(limb: Limb, bend: float) -> Limb:
    """Bend a block so that its edges are parabolas."""
    x, y, z = np.array(limb.mesh.points_mm).T
    moved = np.stack([x + bend * z**2, y - bend * x * z, z - bend * (x**2 + x * y)], axis=1)
    return replace(limb, mesh=replace(limb.mesh, points_mm=moved))


def volumes(limb: Limb) -> np.ndarray:
    ((kind, cells),) = limb.mesh.cells.items()
    slopes = linear_simplex(_RULE)[1] if kind == "tet4" else quadratic_simplex(_RULE, CELLS[kind].edges)[1]
    each = np.linalg.det(np.einsum("qak,cai->cqik", slopes, limb.mesh.points_mm[cells])) @ _WEIGHTS
    return np.bincount(limb.mesh.cell_regions[kind], weights=each)


def flux(limb: Limb, nodes: np.ndarray) -> np.ndarray:
    """Vector area of the outer faces that have all their nodes in a set: exact for curved ones too."""
    ((kind, cells),) = limb.mesh.cells.items()
    faces = outer_faces(kind, cells)
    corners = limb.mesh.points_mm[faces[np.isin(faces, nodes).all(axis=1)]]
    loop = corners if kind == "tet4" else corners[:, [0, 3, 1, 4, 2, 5]]
    if kind == "tet4":
        return sum(0.5 * np.cross(a, b) for a, b in pairwise([*np.moveaxis(loop, 1, 0), loop[:, 0]])).sum(0)
    a, m, b = (np.concatenate([loop[:, (k + i) % 6] for k in (0, 2, 4)]) for i in range(3))
    # ½ ∮ x × dx of the parabola through a, m and b.
    return ((2.0 * np.cross(a, m) + 2.0 * np.cross(m, b)) / 3.0 - np.cross(a, b) / 6.0).sum(axis=0)


@st.composite
def limbs(draw):
    kind = draw(st.sampled_from(["tet4", "tet10"]))
    layers = draw(st.sampled_from([{}, {"skin": 3.0}]))
    limb = block(kind, n_across=4, n_down=4, width_mm=24.0, height_mm=HEIGHT, layers_mm=layers)
    numbers = np.random.default_rng(draw(st.integers(0, 99)))
    ((kind, cells),) = limb.mesh.cells.items()
    field = numbers.random((len(cells), 3))
    limb = replace(limb, mesh=replace(limb.mesh, cell_fields={"fibres": {kind: field}}))
    limb = curved(limb, draw(st.sampled_from([0.0, 0.01]))) if kind == "tet10" else limb
    x, y = draw(st.floats(-9.0, 9.0)), draw(st.floats(-9.0, 9.0))
    skin = limb.mesh.points_mm[limb.mesh.node_sets["contact"]]
    spot = skin[np.linalg.norm(skin[:, :2] - [x, y], axis=1).argmin()]
    return replace(limb, spot=Spot(name="p1", position_mm=spot))


asked = st.tuples(st.floats(1.0, 6.0), st.floats(2.0, 5.0))


@pytest.mark.slow
@settings(max_examples=15)
@given(limbs(), asked)
def test_a_refined_mesh_is_the_same_limb(limb, sizes):
    fine = refined(limb, *sizes)
    check_limb(fine, fine.mesh.regions)  # no crack, no hanging middle, no inverted element
    assert volumes(fine) == pytest.approx(volumes(limb), rel=1e-12)
    assert fine.mesh.regions == limb.mesh.regions
    for name, nodes in limb.mesh.node_sets.items():
        assert flux(fine, fine.mesh.node_sets[name]) == pytest.approx(flux(limb, nodes), abs=1e-9)
    assert np.array_equal(fine.mesh.points_mm[: limb.mesh.n_nodes], limb.mesh.points_mm)


@pytest.mark.slow
@settings(max_examples=15)
@given(limbs(), asked)
def test_a_refined_mesh_conforms(limb, sizes):
    fine = refined(limb, *sizes)
    ((kind, cells),) = fine.mesh.cells.items()
    faces = np.sort(cells[:, np.array(CELLS[kind].corner_faces)].reshape(-1, 3), axis=1)
    assert np.unique(faces, axis=0, return_counts=True)[1].max() == 2
    # A node that hangs leaves faces of one element inside of the limb.
    ((_, coarse),) = limb.mesh.cells.items()
    outside = np.zeros(fine.mesh.n_nodes, dtype=bool)
    outside[outer_faces(kind, cells)] = True
    inner = np.setdiff1d(np.arange(limb.mesh.n_nodes), outer_faces(kind, coarse))
    assert not outside[inner].any()
    assert len(np.unique(outer_faces(kind, cells)[:, :3])) - 2 == len(outer_faces(kind, cells)) / 2  # Euler


@pytest.mark.slow
@settings(max_examples=15)
@given(limbs(), asked)
def test_no_edge_near_the_spot_is_too_long_and_no_element_too_flat(limb, sizes):
    near, longest = sizes
    fine = refined(limb, near, longest)
    ((kind, cells),) = fine.mesh.cells.items()
    points = fine.mesh.points_mm
    least = scaled_jacobians(limb.mesh.points_mm, limb.mesh.cells[kind]).min()
    assert scaled_jacobians(points, cells).min() > 0.4 * least
    ends = points[cells[:, np.array(CELLS[kind].edges)].reshape(-1, 2)]
    away = np.linalg.norm(ends.mean(axis=1) - limb.spot.position_mm, axis=1)
    skin = points[fine.mesh.node_sets["contact"]]
    for (a, b), distance in zip(ends, away, strict=True):
        if distance <= near:
            depth = min(np.linalg.norm(skin - end, axis=1).min() for end in (a, b))
            assert np.linalg.norm(b - a) <= longest + depth + 1e-9
    again = refined(fine, near, longest)
    assert again.mesh.n_cells == fine.mesh.n_cells


@pytest.mark.parametrize("kind", ["tet4", "tet10"])
def test_node_sets_grow_with_their_surfaces_alone(kind):
    limb = block(kind, n_across=4, n_down=1, height_mm=6.0)
    ((_, cells),) = limb.mesh.cells.items()
    field = np.arange(len(cells), dtype=float)
    limb = replace(limb, mesh=replace(limb.mesh, cell_fields={"number": {kind: field}}))
    fine = refined(limb, 12.0, 2.0)
    depth = fine.mesh.points_mm[:, 2]
    assert np.array_equal(fine.mesh.node_sets["contact"], np.flatnonzero(depth == 0.0))
    assert np.array_equal(fine.mesh.node_sets["fixed"], np.flatnonzero(depth == -6.0))
    assert len(fine.mesh.node_sets["contact"]) > 4 * len(limb.mesh.node_sets["contact"])
    # Each element has the field of the one it is a part of: the volume of each number is kept.
    numbers = fine.mesh.cell_fields["number"][kind].astype(int)
    whole, parts = (
        volumes(replace(each, mesh=replace(each.mesh, cell_regions={kind: ids})))
        for each, ids in ((limb, field.astype(int)), (fine, numbers))
    )
    assert parts == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("kind", ["tet4", "tet10"])
@pytest.mark.parametrize("tets", ["around a diagonal", "around a tetrahedron"])
def test_no_node_inside_of_the_limb_joins_its_surface(kind, tets):
    """All nodes of the inner edge of one cube, and of the inner faces of the other, are on the surface."""
    corners = 10.0 * np.array(list(np.ndindex(2, 2, 2)))
    cells = {
        "around a diagonal": [[0, *side, 7] for side in ([4, 6], [6, 2], [2, 3], [3, 1], [1, 5], [5, 4])],
        "around a tetrahedron": [[0, 4, 2, 1], [6, 2, 4, 7], [5, 4, 1, 7], [3, 1, 2, 7], [1, 2, 4, 7]],
    }[tets]
    volume = np.linalg.det(corners[cells][:, 1:] - corners[cells][:, :1])[:, None]
    cells = np.where(volume < 0, np.array(cells)[:, [0, 2, 1, 3]], cells)
    points, ten, _ = with_midpoints(corners, cells)
    points, cells = (corners, cells) if kind == "tet4" else (points, ten)

    def skin(points):
        return np.flatnonzero(((points == 0.0) | (points == 10.0)).any(axis=1))

    mesh = Mesh(
        points_mm=points,
        cells={kind: cells},
        cell_regions={kind: np.zeros(len(cells), dtype=int)},
        regions=("soft_tissue",),
        node_sets={"fixed": np.flatnonzero(points[:, 2] == 0.0), "contact": skin(points)},
    )
    fine = refined(Limb(spot=Spot(name="p1", position_mm=[5.0, 5.0, 10.0]), mesh=mesh), 30.0, 4.0).mesh
    assert np.array_equal(fine.node_sets["contact"], skin(fine.points_mm))
    assert np.array_equal(fine.node_sets["fixed"], np.flatnonzero(fine.points_mm[:, 2] == 0.0))


def test_a_set_inside_of_the_limb_gains_inner_nodes():
    limb = block("tet10", n_across=4, n_down=4, height_mm=HEIGHT)
    points = limb.mesh.points_mm
    below = np.flatnonzero(points[:, 2] <= -3.0)
    limb = replace(limb, mesh=replace(limb.mesh, node_sets={**limb.mesh.node_sets, "deep": below}))
    fine = refined(limb, 6.0, 2.0).mesh
    assert np.array_equal(fine.node_sets["deep"], np.flatnonzero(fine.points_mm[:, 2] <= -3.0))


def test_edges_under_the_indenter_alone_get_shorter():
    limb = block("tet10", n_across=6, n_down=4, width_mm=60.0, height_mm=20.0)
    fine = refined(limb, 5.0, 3.0)
    assert contact_edge_mm(fine, 5.0) < 3.0 < 0.5 * contact_edge_mm(limb, 5.0)
    away = replace(fine, spot=Spot(name="p1", position_mm=[28.0, 28.0, 0.0]))
    assert contact_edge_mm(away, 5.0) > 0.5 * contact_edge_mm(replace(limb, spot=away.spot), 5.0)
    check_depth(fine, Indentation(indenter=Sphere(radius_mm=5.0), path=[(0, 0), (4.0, 0)], friction=0.0))


def test_an_annulus_is_refined_and_its_middle_is_not():
    limb = block("tet10", n_across=6, n_down=4, width_mm=60.0, height_mm=20.0)
    disc, ring = refined(limb, 12.0, 3.0), refined(limb, 12.0, 3.0, 9.0)
    n_middle = [np.count_nonzero(np.hypot(*each.mesh.points_mm[:, :2].T) < 5.0) for each in (disc, ring)]
    assert n_middle[1] < 0.5 * n_middle[0]
    edges = ring.mesh.cells["tet10"][:, np.array(CELLS["tet10"].edges)].reshape(-1, 2)
    ends = ring.mesh.points_mm[edges[np.isin(edges, ring.mesh.node_sets["contact"]).all(axis=1)]]
    away = np.linalg.norm(ends, axis=2)
    there = (away.min(axis=1) <= 12.0) & (away.max(axis=1) >= 9.0)
    assert there.any()
    assert np.linalg.norm(np.diff(ends[there], axis=1), axis=2).max() <= 3.0


def test_other_elements_are_refused():
    with pytest.raises(MeshError, match="elements of kind hex8 cannot be refined, only tet4 or only tet10"):
        refined(block("hex8"), 5.0, 1.0)


def test_an_edge_that_needs_too_many_elements_is_refused(monkeypatch):
    monkeypatch.setattr(refinement, "MOST_CELLS", 2000)
    with pytest.raises(MeshError, match=r"within 5 mm of spot 'block' need more than 2000 elements"):
        refined(block("tet10"), 5.0, 0.3)


def test_a_contact_without_a_face_has_no_size():
    limb = block("tet10")
    sets = {**limb.mesh.node_sets, "contact": limb.mesh.node_sets["contact"][:2]}
    with pytest.raises(MeshError, match="'contact' holds no face of the surface; mark all nodes of the skin"):
        contact_edge_mm(replace(limb, mesh=replace(limb.mesh, node_sets=sets)), 5.0)
