"""Orphan nodes, mirrored elements and four-node tetrahedra are changed, with a remark."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.limb.checks import check_limb
from palpate.limb.tidying import MIRRORED, tidied
from palpate.mesh.specimens import block


def mesh_of(limb, **changes):
    return replace(limb, mesh=replace(limb.mesh, **changes))


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
def test_a_sound_limb_stays_the_same_object(kind):
    limb = block(kind, n_across=2, n_down=2)
    assert tidied(limb) == limb


@pytest.mark.parametrize("kind", MIRRORED)
def test_mirrored_elements_are_turned(kind):
    limb = block(kind, n_across=2, n_down=2, layers_mm={"skin": 9.0})
    cells = limb.mesh.cells[kind][:, MIRRORED[kind]]
    made = tidied(mesh_of(limb, cells={kind: cells}), linear=True)
    np.testing.assert_array_equal(made.mesh.cells[kind], limb.mesh.cells[kind])
    assert f"{len(cells)} elements are numbered the other way round" in made.remarks[0]


def test_one_mirrored_element_among_sound_ones_is_a_fault():
    limb = block("hex8", n_across=2, n_down=2)
    cells = limb.mesh.cells["hex8"].copy()
    cells[1] = cells[1, list(MIRRORED["hex8"])]
    made = tidied(mesh_of(limb, cells={"hex8": cells}))
    assert made.remarks == ()
    np.testing.assert_array_equal(made.mesh.cells["hex8"], cells)


def test_nodes_without_element_are_left_out_of_the_sets_too():
    limb = block("hex8", n_across=2, n_down=2)
    points = np.insert(limb.mesh.points_mm, 5, [100.0, 0.0, 0.0], axis=0)
    moved = {name: nodes + (nodes >= 5) for name, nodes in limb.mesh.node_sets.items()}
    moved["fixed"] = np.append(moved["fixed"], 5)
    cells = {"hex8": limb.mesh.cells["hex8"] + (limb.mesh.cells["hex8"] >= 5)}
    made = tidied(mesh_of(limb, points_mm=points, cells=cells, node_sets=moved))
    np.testing.assert_array_equal(made.mesh.points_mm, limb.mesh.points_mm)
    np.testing.assert_array_equal(made.mesh.cells["hex8"], limb.mesh.cells["hex8"])
    for name, nodes in limb.mesh.node_sets.items():
        np.testing.assert_array_equal(made.mesh.node_sets[name], nodes)
    assert made.remarks == ("1 nodes belong to no volume element and are left out",)


@pytest.mark.parametrize("kind", ["hex8", "tet4", "tet10"])
def test_a_rigid_region_is_fixed_and_has_no_elements(kind):
    """A block on bone is the block alone whose lower face is fixed."""
    limb = block(kind, n_across=2, n_down=3, layers_mm={"skin": 6.0, "fat": 6.0})
    whole = mesh_of(limb, regions=("skin", "bone", "muscle"))
    made = tidied(whole, rigid=["bone", "muscle"], linear=True)
    check_limb(made, ["skin"])
    assert made.mesh.regions == ("skin",)
    (count,) = np.bincount(made.mesh.cell_regions[kind])
    assert count == np.count_nonzero(limb.mesh.cell_regions[kind] == 0)
    lowest = made.mesh.points_mm[:, 2] < -6.0 + 1e-9
    assert lowest.any()
    assert np.isin(np.flatnonzero(lowest), made.mesh.node_sets["fixed"]).all()
    below = limb.mesh.points_mm[:, 2] < -6.0 - 1e-9
    assert made.mesh.n_nodes == limb.mesh.n_nodes - np.count_nonzero(below)
    assert made.remarks[0] == "bone, muscle rigid: their nodes are fixed, and their elements left out"
    free = {name: nodes for name, nodes in whole.mesh.node_sets.items() if name != "fixed"}
    loose = replace(whole, mesh=replace(whole.mesh, node_sets=free))
    alone = tidied(loose, rigid=["bone", "muscle"], linear=True)
    assert set(alone.mesh.node_sets["fixed"]) <= set(made.mesh.node_sets["fixed"])
    assert tidied(whole, rigid=["bones"], linear=True).mesh is whole.mesh


def test_four_node_tetrahedra_become_the_quadratic_block():
    straight, curved = (block(k, n_across=4, n_down=2, layers_mm={"skin": 9.0}) for k in ("tet4", "tet10"))
    made = tidied(straight)
    check_limb(made, ["skin", "soft_tissue"])
    np.testing.assert_allclose(made.mesh.points_mm, curved.mesh.points_mm)
    np.testing.assert_array_equal(made.mesh.cells["tet10"], curved.mesh.cells["tet10"])
    np.testing.assert_array_equal(made.mesh.cell_regions["tet10"], straight.mesh.cell_regions["tet4"])
    for name, nodes in curved.mesh.node_sets.items():
        np.testing.assert_array_equal(np.sort(made.mesh.node_sets[name]), np.sort(nodes))
    assert "got a node in the middle of each edge" in made.remarks[0]


def test_four_node_tetrahedra_stay_where_a_study_wants_them_with_a_warning():
    limb = block("tet4", n_across=2, n_down=2)
    made = tidied(limb, linear=True)
    assert made.mesh is limb.mesh
    assert "linear = true" in made.warnings[0]
    assert "too low" in made.warnings[0]
