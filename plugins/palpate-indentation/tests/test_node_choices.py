"""Regions and node sets of mesh files by the names of groups, by planes and by nearness to a bone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.domain import Mesh, Spot
from palpate.errors import MeshError
from palpate.limb.checks import check_limb
from palpate_forearm import Phantom, write_phantom
from palpate_forearm.phantom import write_surface
from palpate_indentation import MeshioSettings, MeshioSource

pytestmark = pytest.mark.usefixtures("meshes_here")

DATA = Path(__file__).parent / "data" / "gmsh_two_layers"
SPOT = Spot(name="p1")
BOTTOM = {"normal": [0, 0, 2], "at": "-1.2 cm"}
GROUPS: dict[str, dict[str, Any]] = {
    "two_layers.msh": {
        "regions": {"skin": "skin layer", "soft_tissue": "fat"},
        "node_sets": {"fixed": "base", "contact": "pressed"},
    },
    "two_layers.inp": {
        "regions": {"skin": "skin_layer", "soft_tissue": "fat"},
        "node_sets": {"fixed": "base", "contact": "pressed"},
    },
}


def read(name: str, **changes: Any) -> Mesh:
    settings = MeshioSettings.model_validate(GROUPS[name] | changes)
    return MeshioSource(settings).load(DATA / name, SPOT).mesh


@pytest.mark.parametrize("name", GROUPS)
def test_groups_of_gmsh_and_abaqus_name_regions_and_nodes(name: str) -> None:
    """By the boxes that the file was made from: 30 × 30 mm, skin from −3 to 0 mm, fat from −12 mm."""
    limb = MeshioSource(MeshioSettings.model_validate(GROUPS[name])).load(DATA / name, SPOT)
    check_limb(limb, ["skin", "soft_tissue"])
    mesh = limb.mesh
    depth = -mesh.points_mm[mesh.cells["tet10"][:, :4], 2].mean(axis=1)
    np.testing.assert_array_equal(mesh.cell_regions["tet10"], (depth > 3.0).astype(int))
    np.testing.assert_array_equal(mesh.node_sets["contact"], np.flatnonzero(mesh.points_mm[:, 2] == 0.0))
    np.testing.assert_array_equal(mesh.node_sets["fixed"], np.flatnonzero(mesh.points_mm[:, 2] == -12.0))


def test_both_formats_hold_one_mesh() -> None:
    gmsh, abaqus = (read(name) for name in GROUPS)
    np.testing.assert_allclose(gmsh.points_mm, abaqus.points_mm, atol=1e-9)
    np.testing.assert_array_equal(gmsh.cells["tet10"], abaqus.cells["tet10"])


def test_nodes_are_fixed_by_a_plane_and_by_several_choices_together() -> None:
    mesh = read("two_layers.msh", node_sets={"fixed": BOTTOM, "contact": "pressed"})
    np.testing.assert_array_equal(mesh.node_sets["fixed"], read("two_layers.msh").node_sets["fixed"])
    side = {"normal": [1, 0, 0], "at": "15 mm"}
    both = read("two_layers.msh", node_sets={"fixed": [BOTTOM, side], "contact": "pressed"})
    x, _, z = both.points_mm.T
    np.testing.assert_array_equal(both.node_sets["fixed"], np.flatnonzero((x == 15.0) | (z == -12.0)))


def test_nodes_are_fixed_by_their_distance_to_a_bone(tmp_path: Path) -> None:
    """A round bone right below the block, along it: the base's middle is held and its sides are not."""
    (tmp_path / "m.msh").write_bytes((DATA / "two_layers.msh").read_bytes())
    bone = Phantom().bone_surface("ulna", 3.0)
    # A tube laid under the block: its uppermost line touches the base.
    points = bone.points_mm - bone.points_mm.mean(axis=0)
    low = points - np.array([0.0, 0.0, points[:, 2].max() + 12.0])
    write_surface(tmp_path / "bone.stl", type(bone)(points_mm=low, faces=bone.faces))
    sets = {"fixed": {"surface": "bone.stl", "within": "1.5 mm"}, "contact": "pressed"}
    settings = MeshioSettings.model_validate(GROUPS["two_layers.msh"] | {"node_sets": sets})
    mesh = MeshioSource(settings).load(tmp_path / "m.msh", SPOT).mesh
    held = mesh.points_mm[mesh.node_sets["fixed"]]
    assert 0 < len(held) < np.count_nonzero(mesh.points_mm[:, 2] == -12.0)
    assert held[:, 2].max() < -10.0
    from scipy.spatial import cKDTree

    gaps, _ = cKDTree(low).query(mesh.points_mm)  # points of the bone alone: an upper bound
    assert set(np.flatnonzero(gaps <= 1.5)) <= set(mesh.node_sets["fixed"])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"regions": {"skin": "dermis", "soft_tissue": "fat"}}, "no group of elements 'dermis'.*skin layer"),
        (
            {"regions": {"soft_tissue": "fat"}},
            r"\d+ elements are in none of the groups.*name their groups too",
        ),
        ({"node_sets": {"fixed": "bone", "contact": "pressed"}}, "group of elements 'bone'.*there: .*base"),
        ({"node_sets": {"fixed": {"normal": [0, 0, 0], "at": "1 mm"}}}, "give a vector that is not zero"),
        ({"node_sets": {"fixed": {"normal": [0, 0, 1], "at": "9 mm"}}}, "reach from -12 to 0 mm along it"),
        ({"node_sets": {"fixed": {"surface": "../bone.stl"}}}, "outside of the mesh's folder"),
        ({"node_sets": {"fixed": {"surface": "/bone.stl"}}}, "outside of the mesh's folder"),
        ({"node_sets": {"fixed": {"surface": "bone.stl"}}}, "no such file"),
        ({"unit": "m"}, "3e\\+04 mm long when read in m, longer than any limb"),
    ],
)
def test_a_wrong_choice_is_reported_with_what_is_there(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read("two_layers.msh", **changes)


def test_groups_that_share_an_element_are_refused() -> None:
    with pytest.raises(MeshError, match="belongs to the groups of 'soft_tissue' and of 'all'"):
        read("two_layers.inp", regions={"soft_tissue": "fat", "all": "Volume1"})
    with pytest.raises(ValueError, match="by number and by group"):
        MeshioSettings.model_validate({"regions": {"skin": "skin", "soft_tissue": 0}})


def test_the_distance_of_a_too_distant_bone_surface_is_reported(tmp_path: Path) -> None:
    (tmp_path / "m.msh").write_bytes((DATA / "two_layers.msh").read_bytes())
    write_phantom(tmp_path)
    sets = {"fixed": {"surface": "ulna.stl", "unit": "m"}, "contact": "pressed"}
    settings = MeshioSettings.model_validate(GROUPS["two_layers.msh"] | {"node_sets": sets})
    with pytest.raises(MeshError, match=r"the nearest is .* mm away; check its unit and frame"):
        MeshioSource(settings).load(tmp_path / "m.msh", SPOT)
