"""Shares of the outer surface are areas; a side that is fixed in part is a warning, a whole one is none."""

from dataclasses import replace

import numpy as np
import pytest

from palpate.limb.outer_surface import partly_fixed, surface_shares
from palpate.limb.tidying import tidied
from palpate.mesh.specimens import block

KINDS = ("hex8", "tet4", "tet10")


def with_fixed(limb, nodes):
    return replace(limb.mesh, node_sets={**limb.mesh.node_sets, "fixed": nodes})


@pytest.mark.parametrize("kind", KINDS)
def test_shares_are_those_of_the_block(kind):
    mesh = block(kind, width_mm=40.0, height_mm=10.0, n_across=4, n_down=2).mesh
    whole = 2 * 40.0 * 40.0 + 4 * 40.0 * 10.0
    found = surface_shares(mesh)
    assert found.fixed == pytest.approx(1600.0 / whole)
    assert found.contact == pytest.approx(1600.0 / whole)
    assert found.free == pytest.approx(1600.0 / whole)
    assert str(found) == "33 %, 33 %, 33 %"


@pytest.mark.parametrize("kind", KINDS)
def test_whole_sides_and_shared_edges_are_no_warning(kind):
    limb = block(kind, n_across=4, n_down=3)
    x = limb.mesh.points_mm[:, 0]
    sides = np.union1d(limb.mesh.node_sets["fixed"], np.flatnonzero(np.abs(x) == x.max()))
    assert not list(partly_fixed(with_fixed(limb, sides)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("lost", [0.1, 0.5, 0.9])
def test_a_base_that_lost_nodes_is_a_warning(kind, lost):
    limb = block(kind, n_across=6, n_down=2)
    base = limb.mesh.node_sets["fixed"]
    inside = base[(np.abs(limb.mesh.points_mm[base, :2]) < 17.0).all(axis=1)]
    gone = np.random.default_rng(1).permutation(inside)[: max(1, int(lost * inside.size))]
    (warning,) = partly_fixed(with_fixed(limb, np.setdiff1d(base, gone)))
    assert f"{inside.size - gone.size} of {inside.size} nodes" in warning
    assert "[0.0, 0.0, -18.0] mm" in warning


def test_midside_nodes_that_are_free_are_a_warning():
    """A support by the corners of the faces alone, as of shells of three nodes."""
    limb = block("tet10", n_across=4, n_down=2)
    corners = np.unique(limb.mesh.cells["tet10"][:, :4])
    base = np.intersect1d(limb.mesh.node_sets["fixed"], corners)
    (warning,) = partly_fixed(with_fixed(limb, base))
    assert "fixed in part" in warning


def test_single_fixed_nodes_on_the_skin_are_a_warning_and_a_fixed_part_is_none():
    limb = block("hex8", n_across=6, n_down=2)
    contact = limb.mesh.node_sets["contact"]
    strip = contact[limb.mesh.points_mm[contact, 0] < -5.0]
    assert not list(partly_fixed(with_fixed(limb, np.union1d(limb.mesh.node_sets["fixed"], strip))))
    inside = contact[(np.abs(limb.mesh.points_mm[contact, :2]) < 17.0).all(axis=1)]
    single = np.union1d(limb.mesh.node_sets["fixed"], inside[:1])
    (warning,) = partly_fixed(with_fixed(limb, single))
    assert warning.startswith("1 fixed nodes on the skin")


def test_a_corner_between_two_fixed_sides_is_no_warning():
    """The midside node across the corner is fixed by both ends of its edge, on a side that is free."""
    limb = tidied(with_sides(block("tet4", n_across=4, n_down=2)))
    assert not list(partly_fixed(limb.mesh))


def with_sides(limb):
    x = limb.mesh.points_mm[:, 0]
    sides = np.flatnonzero(np.abs(x) == x.max())
    return replace(limb, mesh=with_fixed(limb, np.union1d(limb.mesh.node_sets["fixed"], sides)))
