"""Regions and sets without a telling name are proposed by their shape, with a question."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.domain import Spot
from palpate.limb.inspection import skin_of
from palpate.mesh.layers import outer_layer
from palpate.mesh.specimens import block
from palpate.mesh.topology import outer_faces
from palpate_indentation import MeshioSettings, MeshioSource
from palpate_indentation.mesh_content import MeshFile
from palpate_indentation.mesh_inspection import _regions

pytestmark = pytest.mark.usefixtures("meshes_here")

BLOCK = block("hex8", width_mm=60.0, height_mm=18.0, n_across=10, n_down=6, layers_mm={"skin": 3.0}).mesh
X, Y, Z = BLOCK.points_mm.T
BENT = np.stack([(40.0 + Z) * np.sin(X / 40.0), Y, (40.0 + Z) * np.cos(X / 40.0) - 40.0], axis=1)
"""The block around a bone of 22 mm radius, so that its upper face curves outwards."""
SIDES = {"top": Z == 0.0, "bone": Z == -18.0, "ends": (np.abs(X) == 30.0) | (np.abs(Y) == 30.0)}


def with_faces(points: np.ndarray, numbers: dict[str, int]) -> meshio.Mesh:
    """Mesh with numbers alone: 7 is the skin, 9 the tissue, and each side has the number of its faces."""
    cells, faces = BLOCK.cells["hex8"], outer_faces("hex8", BLOCK.cells["hex8"])
    sides = {side: faces[of[faces].all(axis=1)] for side, of in SIDES.items()}
    blocks = [("hexahedron", cells), *(("quad", sides[side]) for side in numbers)]
    labels = [np.where(BLOCK.cell_regions["hex8"] == 0, 7, 9)]
    labels += [np.full(len(sides[side]), number) for side, number in numbers.items()]
    return meshio.Mesh(points, blocks, cell_data={"gmsh:physical": labels})


def test_numbers_alone_are_named_by_the_shape_of_what_they_number(tmp_path: Path) -> None:
    file = tmp_path / "m.vtu"
    with_faces(BENT, {"bone": 3, "top": 4, "ends": 5}).write(file)
    inspection = MeshioSource(MeshioSettings()).inspect(file)
    settings = inspection.record["settings"]
    assert settings["regions"] == {"skin": 7, "soft_tissue": 9}
    assert settings["node_sets"] == {
        "contact": "gmsh:physical 4",
        "fixed": ["gmsh:physical 3", "gmsh:physical 5"],
    }
    for asked in (inspection.study_text, " ".join(inspection.findings)):
        assert "answer first: did the tool press 'gmsh:physical 4'" in asked
        assert "answer first: is region 7 skin?" in asked
        assert "3 mm thick" in asked
    limb = MeshioSource(MeshioSettings.model_validate(settings)).load(file, Spot(name="m"))
    assert limb.mesh.node_sets["contact"].tolist() == np.flatnonzero(SIDES["top"]).tolist()
    assert limb.mesh.node_sets["fixed"].tolist() == np.flatnonzero(SIDES["bone"] | SIDES["ends"]).tolist()


def test_faces_of_a_number_are_read_next_to_named_groups_too(tmp_path: Path) -> None:
    """One mesh of Gmsh has names, and another spot's has numbers alone: one table reads both."""
    faces = with_faces(BENT, {"bone": 3, "top": 4, "ends": 5})
    faces.field_data = {
        name: np.array([k, 2]) for name, k in {"Knochen": 3, "Seite": 4, "Schnitt": 5}.items()
    }
    faces.cell_data["gmsh:geometrical"] = faces.cell_data["gmsh:physical"]
    faces.write(tmp_path / "m.msh", file_format="gmsh22", binary=False)
    chosen = {"contact": "gmsh:physical 4", "fixed": ["Knochen", "gmsh:physical 5"]}
    settings = {"region_data": "gmsh:physical", "regions": {"skin": 7, "soft_tissue": 9}, "node_sets": chosen}
    limb = MeshioSource(MeshioSettings.model_validate(settings)).load(tmp_path / "m.msh", Spot(name="m"))
    assert len(limb.mesh.node_sets["contact"]) == np.count_nonzero(SIDES["top"])
    assert len(limb.mesh.node_sets["fixed"]) == np.count_nonzero(SIDES["bone"] | SIDES["ends"])


def test_the_pressed_side_is_asked_for_where_no_side_curves(tmp_path: Path) -> None:
    file = tmp_path / "m.vtu"
    with_faces(BLOCK.points_mm, {"bone": 3, "top": 4, "ends": 5}).write(file)
    inspection = MeshioSource(MeshioSettings()).inspect(file)
    assert "node_sets" not in inspection.record["settings"]
    assert any("name the pressed surface as `contact`" in text for text in inspection.findings)


def test_a_side_without_a_telling_name_is_pressed_next_to_named_supports(tmp_path: Path) -> None:
    cells, numbers = BLOCK.cells["hex8"], BLOCK.cell_regions["hex8"]
    regions = {"upper": [np.flatnonzero(numbers == 0)], "inner": [np.flatnonzero(numbers == 1)]}
    sides = dict(zip(("zone", "bone", "cuts"), map(np.flatnonzero, SIDES.values()), strict=True))
    mesh = meshio.Mesh(BENT, [("hexahedron", cells)], point_sets=sides, cell_sets=regions)
    mesh.write(tmp_path / "m.inp")
    inspection = MeshioSource(MeshioSettings()).inspect(tmp_path / "m.inp")
    assert inspection.record["settings"]["node_sets"] == {"contact": "zone", "fixed": ["bone", "cuts"]}
    asked = " ".join(inspection.findings)
    assert "did the tool press 'zone'? " in asked
    assert "not used: zone" not in asked
    assert "answer first: is region 'upper' skin?" in inspection.study_text


@pytest.mark.parametrize(
    ("names", "regions"),
    [
        (("property 7", "property 9"), {"region_7": "property 7", "region_9": "property 9"}),
        (("Physical 1", "Volume1"), {"region_1_1": "Physical 1", "region_1_2": "Volume1"}),
        (("a b", "a_b"), {"a_b_1": "a b", "a_b_2": "a_b"}),
    ],
)
def test_each_group_is_a_region_whatever_its_number(names, regions) -> None:
    numbers = np.arange(BLOCK.n_cells) < BLOCK.n_cells // 2 - 1
    content = MeshFile(
        points=BLOCK.points_mm,
        blocks=(("hexahedron", BLOCK.cells["hex8"]),),
        cell_sets={n: (np.flatnonzero(of),) for n, of in zip(names, (numbers, ~numbers), strict=True)},
    )
    assert _regions(content) == {"regions": regions}


def test_fat_of_a_centimetre_is_no_skin() -> None:
    assert outer_layer(BLOCK) == ("skin", pytest.approx(3.0))
    thick = block("hex8", width_mm=60.0, height_mm=18.0, n_across=10, n_down=6, layers_mm={"a": 9.0})
    assert outer_layer(thick.mesh) == ("a", pytest.approx(9.0))
    assert skin_of(thick) is None
