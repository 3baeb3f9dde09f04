"""Mesh files in the spellings of other programs are read whole, or refused with what to do."""

import re
from pathlib import Path
from random import Random
from typing import Any

import meshio
import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Limb, Spot
from palpate.errors import MeshError
from palpate.limb.checks import check_limb
from palpate.limb.outer_surface import partly_fixed
from palpate.limb.tidying import tidied
from palpate.mesh.specimens import block
from palpate.mesh.splitting import SOLIDS
from palpate.mesh.topology import outer_faces
from palpate_indentation import MeshioSettings, MeshioSource
from palpate_indentation.mesh_content import MeshFile, numbered_faces
from palpate_indentation.mesh_files import read_here
from palpate_indentation.vtk_files import _groups

pytestmark = pytest.mark.usefixtures("meshes_here")

DATA = Path(__file__).parent / "data" / "meshes_of_others"
GROUPS: dict[str, Any] = {
    "regions": {"skin": "skin", "soft_tissue": "fat"},
    "node_sets": {"contact": "pressed", "fixed": ["bone", "cuts"]},
}
NUMBERS: dict[str, Any] = {"regions": {"soft_tissue": 0, "skin": 1}}
OTHERS: dict[str, dict[str, Any]] = {
    "abaqus_nset_with_set_name": {**GROUPS, "node_sets": {"contact": "pressed", "fixed": "held"}},
    "abaqus_shell_elset_in_two_blocks": {
        **GROUPS,
        "node_sets": {"contact": "pressed", "fixed": ["cuts", "boneface"]},
    },
    "inp_elset_shared": {**GROUPS, "regions": {"tissue": "Tissue"}},
    "labels_of_one_region": {"region_data": "label", "regions": {"skin": 1, "muscle": [12, 13]}},
}
READ = [
    path
    for path in sorted(DATA.iterdir())
    if path.suffix in (".inp", ".vtu", ".vtk") and not path.stem.startswith("plane")
]


def load(path: Path, settings: dict[str, Any]) -> Limb:
    limb = tidied(MeshioSource(MeshioSettings.model_validate(settings)).load(path, Spot(name="p1")))
    check_limb(limb, limb.mesh.regions)
    return limb


@pytest.mark.parametrize("path", READ, ids=lambda path: path.stem)
def test_each_spelling_is_the_whole_block(path: Path) -> None:
    limb = load(path, OTHERS.get(path.stem, GROUPS if path.suffix == ".inp" else NUMBERS))
    x, _, z = limb.mesh.points_mm.T
    np.testing.assert_array_equal(np.sort(limb.mesh.node_sets["contact"]), np.flatnonzero(z == 0.0))
    held = np.flatnonzero((z == -20.0) | (np.abs(x) == 20.0))
    if "tet10" not in limb.mesh.cells:
        np.testing.assert_array_equal(np.sort(limb.mesh.node_sets["fixed"]), held)
    assert set(held.tolist()) <= set(limb.mesh.node_sets["fixed"].tolist())
    assert limb.warnings == ()
    assert not list(partly_fixed(limb.mesh))
    assert len(limb.mesh.used_regions) == (1 if path.stem == "inp_elset_shared" else 2)


def test_what_is_no_limb_is_left_out_with_a_remark() -> None:
    def remarks(stem: str, settings: dict[str, Any]) -> str:
        return " ".join(load(next(DATA.glob(f"{stem}.*")), settings).remarks)

    assert "elements of type MASS are no tissue" in remarks("inp_spring_and_mass", GROUPS)
    assert "elements of type R3D4 are no tissue" in remarks("inp_cae_indenter_after", GROUPS)
    assert "1 nodes belong to no volume element" in remarks("abaqus_reference_point", GROUPS)
    assert "1 nodes belong to no volume element" in remarks("orphan_node", NUMBERS)
    assert "32 elements are numbered the other way round" in remarks("all_inverted", NUMBERS)


def test_a_plane_that_misses_nodes_of_its_side_is_a_warning() -> None:
    sides = {"-20 mm": [[0, 0, 1], [1, 0, 0]], "20 mm": [[1, 0, 0]]}
    planes = [{"normal": normal, "at": at} for at, normals in sides.items() for normal in normals]
    wide = [{**plane, "within": "0.3 mm"} for plane in planes]
    path, sets = DATA / "plane_misses_nodes_of_a_cut.vtu", {"contact": "contact"}
    some, every = (load(path, {**NUMBERS, "node_sets": {**sets, "fixed": fixed}}) for fixed in (planes, wide))
    assert len(some.mesh.node_sets["fixed"]) == 21
    assert any("fixed in part: 4 of 9 nodes" in text for text in partly_fixed(some.mesh))
    assert len(every.mesh.node_sets["fixed"]) == 45
    assert not list(partly_fixed(every.mesh))


def test_quadratic_hexahedra_and_wedges_are_cut_and_stay_whole(tmp_path: Path) -> None:
    """The same block of C3D20, C3D15 and C3D6 is fixed and touched alike."""
    made = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2).mesh
    hexes = made.cells["hex8"]
    wedges = np.concatenate([hexes[:, [0, 1, 2, 4, 5, 6]], hexes[:, [0, 2, 3, 4, 6, 7]]])
    kinds = (("C3D20R", hexes, "hexahedron20"), ("C3D15", wedges, "wedge15"), ("C3D6", wedges, "wedge"))
    for kind, cells, shape in kinds:
        edges = np.array(SOLIDS[shape][0].edges)[: (0 if kind == "C3D6" else None)]
        ends = np.sort(cells[:, edges], axis=2).reshape(-1, 2)
        unique, inverse = np.unique(ends, axis=0, return_inverse=True)
        middles = made.points_mm[unique].mean(axis=1) if len(unique) else np.empty((0, 3))
        points = np.vstack([made.points_mm, middles])
        whole = np.hstack([cells, len(made.points_mm) + inverse.reshape(len(cells), -1)]) + 1
        x, _, z = points.T
        text = "*Node\n" + "".join(f"{k}, {a}, {b}, {c}\n" for k, (a, b, c) in enumerate(points, 1))
        rows = (listed([k, *row], 10).strip().replace("\n", ",\n") for k, row in enumerate(whole.tolist(), 1))
        text += f"*Element, type={kind}, elset=fat\n" + "\n".join(rows) + "\n"
        for name, of in (("held", (z == -20.0) | (np.abs(x) == 20.0)), ("top", z == 0.0)):
            text += f"*Nset, nset={name}\n{listed(np.flatnonzero(of) + 1)}"
        (tmp_path / "m.inp").write_text(text + "*Boundary\nheld, 1, 3\n")
        settings = {"regions": {"soft_tissue": "fat"}, "node_sets": {"contact": "top", "fixed": "fixed"}}
        limb = load(tmp_path / "m.inp", settings)
        assert list(limb.mesh.cells) == ["tet10"]
        x, _, z = limb.mesh.points_mm.T
        np.testing.assert_array_equal(np.sort(limb.mesh.node_sets["contact"]), np.flatnonzero(z == 0.0))
        held = np.flatnonzero((z == -20.0) | (np.abs(x) == 20.0))
        assert set(held.tolist()) <= set(limb.mesh.node_sets["fixed"].tolist())
        assert not list(partly_fixed(limb.mesh))
        assert any("are cut into" in remark for remark in limb.remarks)


def test_exodus_counts_upright_edges_before_the_upper_end(tmp_path: Path) -> None:
    pytest.importorskip("netCDF4")
    made = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2).mesh
    solid, cells = SOLIDS["hexahedron20"][0], made.cells["hex8"]
    edges = [*solid.edges[:4], *solid.edges[8:], *solid.edges[4:8]]
    ends = np.sort(cells[:, np.array(edges)], axis=2).reshape(-1, 2)
    unique, inverse = np.unique(ends, axis=0, return_inverse=True)
    points = np.vstack([made.points_mm, made.points_mm[unique].mean(axis=1)])
    whole = np.hstack([cells, len(made.points_mm) + inverse.reshape(len(cells), -1)])
    meshio.Mesh(points, [("hexahedron20", whole)]).write(tmp_path / "m.e")
    ((_, read),) = read_here(tmp_path / "m.e").blocks
    middles = points[read[:, np.array(solid.edges)]].mean(axis=2)
    np.testing.assert_allclose(points[read[:, solid.n_corners :]], middles, atol=1e-12)


def test_words_of_cells_are_groups(tmp_path: Path) -> None:
    """PyVista writes an array of words as a String: characters that end with 0."""
    words = " ".join(str(b) for word in ["fat"] * 16 + ["skin"] * 16 for b in (*word.encode(), 0))
    text = (DATA / "version_2_2.vtu").read_text()
    array = f'<CellData><DataArray type="String" Name="tissue" format="ascii">{words}</DataArray></CellData>'
    text = re.sub(r"<CellData.*</CellData>", array, text, flags=re.DOTALL)
    (tmp_path / "m.vtu").write_text(text)
    content = read_here(tmp_path / "m.vtu")
    assert {name: rows[0].tolist() for name, rows in content.cell_sets.items()} == {
        "fat": list(range(16)),
        "skin": list(range(16, 32)),
    }
    assert not content.cell_data


def with_words(path: Path, *arrays: tuple[str, list[str], int]) -> dict[str, list[int]]:
    """Groups of a file with these arrays of words and their numbers of components."""
    text = (DATA / "version_2_2.vtu").read_text()
    each = [
        f'<DataArray type="String" Name="{name}" NumberOfComponents="{n}" format="ascii">'
        + " ".join(str(b) for word in words for b in (*word.encode(), 0))
        + "</DataArray>"
        for name, words, n in arrays
    ]
    path.write_text(
        re.sub(r"<CellData.*</CellData>", f"<CellData>{''.join(each)}</CellData>", text, flags=re.DOTALL)
    )
    return {name: rows[0].tolist() for name, rows in read_here(path).cell_sets.items()}


def test_arrays_that_share_a_word_keep_their_groups_apart(tmp_path: Path) -> None:
    tissue, coating = ["fat"] * 16 + ["skin"] * 16, ["skin"] * 8 + [""] * 24
    assert with_words(tmp_path / "m.vtu", ("tissue", tissue, 1), ("coating", coating, 1)) == {
        "fat": list(range(16)),
        "tissue: skin": list(range(16, 32)),
        "coating: skin": list(range(8)),
    }


def test_words_that_are_no_groups_are_passed_over(tmp_path: Path) -> None:
    two, few, none = (["fat", "L"] * 32, 2), (["fat"] * 31, 1), ([], 1)
    for words, n in (two, few, none):
        assert with_words(tmp_path / "m.vtu", ("tissue", words, n)) == {}


def test_numbers_and_words_of_each_cell_are_no_groups() -> None:
    blocks = (("quad", np.zeros((101, 4), dtype=np.int64)),)
    for n, n_groups in ((101, 0), (100, 100)):
        ids = np.arange(101) % n
        content = MeshFile(points=np.zeros((1, 3)), blocks=blocks, cell_data={"id": (ids,)})
        assert len(numbered_faces(content)) == n_groups
        assert len(_groups({"name": ids.astype(str)}, [np.arange(101)])) == n_groups


def test_words_of_a_legacy_file_are_decoded(tmp_path: Path) -> None:
    (tmp_path / "m.vtk").write_text(
        "# vtk DataFile Version 4.2\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        "POINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\n"
        "CELLS 2 10\n4 0 1 2 3\n4 0 1 2 3\nCELL_TYPES 2\n10 10\n"
        "CELL_DATA 2\nFIELD FieldData 1\ntissue 1 2 string\nsoft%20t%C3%AAte\n\n"
    )
    assert list(read_here(tmp_path / "m.vtk").cell_sets) == ["soft tête"]


def test_groups_of_med_have_their_names(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    made = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2).mesh
    families = np.array([-1] * 16 + [-2] * 16)
    mesh = meshio.Mesh(made.points_mm, [("hexahedron", made.cells["hex8"])])
    mesh.cell_data, mesh.point_data = {"cell_tags": [families]}, {"point_tags": np.repeat([3, 0], [25, 50])}
    mesh.cell_tags, mesh.point_tags = {-1: ["fat", "soft tissue"], -2: ["soft tissue"]}, {3: ["On bone"]}
    mesh.write(tmp_path / "m.med")
    content = read_here(tmp_path / "m.med")
    assert {name: rows[0].tolist() for name, rows in content.cell_sets.items()} == {
        "fat": list(range(16)),
        "soft tissue": list(range(32)),
    }
    assert content.point_sets["On bone"].tolist() == list(range(25))
    assert content.cell_data["cell_tags"][0].tolist() == families.tolist()


# ------------------------------------------------------------------ Abaqus

LIMB = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2, layers_mm={"skin": 10.0})
NODES = "".join(f"{k}, {x:.12g}, {y:.12g}, {z:.12g}\n" for k, (x, y, z) in enumerate(LIMB.mesh.points_mm, 1))
ROWS = (LIMB.mesh.cells["hex8"] + 1).tolist()
CELLS = [f"{k}, {', '.join(map(str, cell))}" for k, cell in enumerate(ROWS, 1)]
IN_SKIN = LIMB.mesh.cell_regions["hex8"] == 0
X, _, Z = LIMB.mesh.points_mm.T
BONE, CUTS, TOP = (np.flatnonzero(of) + 1 for of in (Z == -20.0, np.abs(X) == 20.0, Z == 0.0))
HELD = np.union1d(BONE, CUTS)


def listed(numbers: Any, width: int = 16) -> str:
    rows = [list(map(str, numbers[k : k + width])) for k in range(0, len(numbers), width)]
    return "".join(f"{', '.join(row)}\n" for row in rows)


def part(elements: str = "", sets: str = "") -> str:
    skin = "\n".join(cell for cell, is_skin in zip(CELLS, IN_SKIN, strict=True) if is_skin)
    fat = "\n".join(cell for cell, is_skin in zip(CELLS, IN_SKIN, strict=True) if not is_skin)
    solids = f"*Element, type=C3D8R, elset=Fat\n{fat}\n*ELEMENT,\n ELSET=skin,\n TYPE=c3d8h\n{skin}\n"
    own = f"*NSET, NSET=Bone\n{listed(BONE)}*NSET, NSET=cuts\n{listed(CUTS)}*nset, nset=TOP\n{listed(TOP)}"
    return f"*NODE, NSET=ALL\n{NODES}{solids}{elements}{own}{sets}"


def settings_of(fixed: Any = "fixed") -> dict[str, Any]:
    regions = {"skin": "Skin", "soft_tissue": "FAT"}
    return {"regions": regions, "node_sets": {"contact": "Top", "fixed": fixed}}


def counts(tmp_path: Path, text: str, fixed: Any = "fixed") -> tuple[Limb, int]:
    (tmp_path / "m.inp").write_text(text)
    limb = load(tmp_path / "m.inp", settings_of(fixed))
    return limb, len(limb.mesh.node_sets["fixed"])


def test_a_second_body_is_named_and_can_be_left_out(tmp_path: Path) -> None:
    nodes = "".join(f"{k + 500}, {x + 99}, {y}, {z}\n" for k, (x, y, z) in enumerate(LIMB.mesh.points_mm, 1))
    cells = "".join(f"{k + 500}, {', '.join(str(n + 500) for n in row)}\n" for k, row in enumerate(ROWS, 1))
    text = part(f"*Node\n{nodes}*Element, type=C3D8, elset=Gel\n{cells}") + "*Boundary\nbone, 1, 3\n"
    (tmp_path / "m.inp").write_text(text)
    settings = settings_of()
    settings["regions"]["gel"] = "Gel"
    advice = "merge their nodes, or remove it, as leave_out under [limb.settings] does"
    with pytest.raises(MeshError, match=rf"\(region gel\) .* {re.escape(advice)}"):
        load(tmp_path / "m.inp", settings)
    assert advice in " ".join(MeshioSource.inspect(tmp_path / "m.inp").findings)
    limb = load(tmp_path / "m.inp", {**settings_of(), "leave_out": ["gel"]})
    assert len(limb.mesh.node_sets["fixed"]) == len(BONE)
    assert limb.mesh.n_nodes == len(X)
    assert limb.absent == ()
    (tmp_path / "m.inp").write_text(part() + "*Boundary\nbone, 1, 3\n")
    for word in ("gel", 7):
        limb = load(tmp_path / "m.inp", {**settings_of(), "leave_out": [word]})
        assert (limb.absent, limb.mesh.n_nodes) == ((str(word),), len(X))


def test_new_conditions_before_any_others_remove_nothing(tmp_path: Path) -> None:
    step = "*Step\n*Static\n*Boundary, op=New\n*Boundary\nBone, 1, 3\n{}*End Step\n"
    assert not counts(tmp_path, part() + step.format(""))[0].warnings
    again = counts(tmp_path, part() + step.format("*Boundary, op=New\ncuts, 1, 3\n"))[0]
    assert "op=NEW in line" in again.warnings[0]


def test_nodes_in_a_file_of_their_own_are_read(tmp_path: Path) -> None:
    (tmp_path / "nodes.inc").write_text(f"** exported\n{NODES}")
    text = part().replace(f"*NODE, NSET=ALL\n{NODES}", '*Node, nset=ALL, input="nodes.inc"\n')
    limb, n_fixed = counts(tmp_path, text, ["bone", "cuts"])
    same, n_same = counts(tmp_path, part(), ["bone", "cuts"])
    np.testing.assert_array_equal(limb.mesh.points_mm, same.mesh.points_mm)
    assert n_fixed == n_same


def test_what_gmsh_writes_twice_is_proposed_once(tmp_path: Path) -> None:
    """Its volumes are there by number and by name, as elements and as nodes; faces are of plane stress."""
    faces = outer_faces("hex8", LIMB.mesh.cells["hex8"]) + 1
    rows = "".join(
        f"{900 + k}, {', '.join(map(str, face))}\n"
        for k, face in enumerate(faces[np.isin(faces, TOP).all(axis=1)].tolist())
    )
    numbers = {"SKIN": np.flatnonzero(IN_SKIN) + 1, "FAT": np.flatnonzero(~IN_SKIN) + 1}
    sets = "".join(f"*Elset, elset=Volume{k}\n{listed(of)}" for k, of in enumerate(numbers.values(), 1))
    nodes = np.unique(LIMB.mesh.cells["hex8"][IN_SKIN]) + 1
    for name, of in {"SKIN": nodes, "OUTER_SIDE": TOP, "ENDS": CUTS}.items():
        sets += f"*Nset, nset={name}\n{listed(of)}"
    text = part(f"*Element, type=CPS4, elset=Surface1\n{rows}", sets).replace("nset=TOP", "nset=t")
    (tmp_path / "m.inp").write_text(text.replace("NSET=Bone", "NSET=b").replace("NSET=cuts", "NSET=c"))
    inspection = MeshioSource(MeshioSettings()).inspect(tmp_path / "m.inp")
    settings = inspection.record["settings"]
    assert set(settings["regions"].values()) == {"Fat", "skin"}
    assert settings["node_sets"] == {"contact": "OUTER_SIDE", "fixed": "ENDS"}
    assert "Surface1" not in " ".join(inspection.findings)
    (tmp_path / "m.inp").write_text(text[: text.index("*NSET")] + sets[: sets.index("*Nset")])
    inspection = MeshioSource(MeshioSettings()).inspect(tmp_path / "m.inp")
    assert "node_sets" not in inspection.record["settings"]
    assert "no set of nodes has the name of a skin; name the pressed surface" in " ".join(inspection.findings)


@pytest.mark.parametrize("conditions", ["", "*Boundary\nFixed, 1, 3\n"])
def test_nodes_and_elements_of_a_face_in_cae_have_one_name(tmp_path: Path, conditions: str) -> None:
    sets = ""
    for name, of in (("Pressed_skin", TOP), ("Fixed", HELD)):
        touched = [k for k, row in enumerate(ROWS, 1) if np.isin(row, of).any()]
        sets += f"*Nset, nset={name}\n{listed(of)}*Elset, elset={name}\n{listed(touched)}"
    text = part(sets=sets).replace("nset=TOP", "nset=t").replace("NSET=Bone", "NSET=b")
    (tmp_path / "m.inp").write_text(text.replace("NSET=cuts", "NSET=c") + conditions)
    settings = MeshioSource(MeshioSettings()).inspect(tmp_path / "m.inp").record["settings"]
    assert settings["node_sets"] == {"contact": "Pressed_skin"} | ({} if conditions else {"fixed": "Fixed"})
    sets_of = load(tmp_path / "m.inp", settings).mesh.node_sets
    assert {name: of.size for name, of in sets_of.items()} == {"contact": TOP.size, "fixed": HELD.size}


def test_a_second_mesh_of_one_part_is_refused(tmp_path: Path) -> None:
    two = "".join(f"*Instance, name=L-{k}, part=L\n{part()}*End Instance\n" for k in "12")
    text = f"*Part, name=L\n*End Part\n*Assembly, name=A\n{two}*End Assembly\n"
    with pytest.raises(MeshError, match="another instance of 'L' has nodes; write a part for each instance"):
        counts(tmp_path, text)


SUPPORTS = {
    "encastre": "*Boundary\nbone, ENCASTRE\ncuts, PINNED\n",
    "ranges of directions": "*BOUNDARY\nbone, 1, 3\ncuts, 1, 3, 0.\n",
    "one direction at a time": "*Boundary\nBone, 1, 1\nBone, 2\nBone, 3, 3, 0.0\ncuts, 1, 6\n",
    "in a step": "*Boundary\ncuts, encastre\n*Step, nlgeom=YES\n*Static\n0.1, 1.\n"
    "*Boundary\nBONE, 1, 3\n*End Step\n",
    "symmetries together": "*Boundary\nbone, XSYMM\nbone, YSYMM\nbone, zsymm\ncuts, 1, 3\n",
    "nodes by number": "*Boundary\n" + "".join(f"{n}, 1, 3\n" for n in BONE) + "cuts, 1, 3\n",
    "a rigid bone": "*Node\n900, 0., 0., -30.\n*Rigid Body, ref node=900, tie nset=bone\n"
    "*Boundary\n900, 1, 6\ncuts, 1, 3\n",
    "a coupling": "*Node, nset=RP\n900, 0., 0., -30.\n*Surface, type=NODE, name=bone_face\nbone,\n"
    "*Coupling, constraint name=c, ref node=RP, surface=bone_face\n*Kinematic\n"
    "*Boundary\nRP, 1, 6\ncuts, 1, 3\n",
}


@pytest.mark.parametrize("conditions", SUPPORTS.values(), ids=SUPPORTS)
def test_the_files_own_supports_are_used(tmp_path: Path, conditions: str) -> None:
    limb, n_fixed = counts(tmp_path, part() + conditions)
    assert n_fixed == HELD.size
    assert limb.warnings == ()
    assert any(f"fixes {HELD.size} nodes of the limb" in remark for remark in limb.remarks)


def test_conditions_of_an_assembly_name_sets_of_instances(tmp_path: Path) -> None:
    text = (
        f"*Part, name=Limb\n{part()}*End Part\n*Assembly, name=A\n"
        "*Instance, name=Limb-1, part=limb\n0., 0., 0.\n"
        "*End Instance\n*Nset, nset=held, instance=Limb-1\n"
        + listed(BONE)
        + "*Nset, nset=held\nLimb-1.cuts,\n"
        "*Elset, elset=_low, internal, instance=Limb-1, generate\n1, 16, 1\n*End Assembly\n"
        "*Boundary\nheld, 1, 3\n"
    )
    assert counts(tmp_path, text)[1] == HELD.size
    assert counts(tmp_path, text, ["Limb-1.bone", "CUTS"])[1] == HELD.size


def test_a_tool_whose_node_is_in_its_instance_is_left_out(tmp_path: Path) -> None:
    tool = "*Instance, name=Tool-1, part=Tool\n*Node\n1, 0., 0., 90.\n*Surface, type=CYLINDER, name=Face\n"
    text = (
        f"*Part, name=Limb\n{part()}*End Part\n*Part, name=Tool\n*End Part\n*Assembly, name=A\n"
        f"*Instance, name=Limb-1, part=Limb\n*End Instance\n{tool}START, 5., 10.\n"
        "*Rigid Body, ref node=1, analytical surface=Face\n*End Instance\n"
        "*End Assembly\n*Boundary\nLimb-1.bone, 1, 3\nLimb-1.cuts, 1, 3\nTool-1.1, 3, 3, -5.\n"
    )
    limb, n_fixed = counts(tmp_path, text)
    assert (len(limb.mesh.points_mm), n_fixed) == (len(LIMB.mesh.points_mm), HELD.size)


def test_an_instance_that_is_moved_is_moved(tmp_path: Path) -> None:
    moved = (
        f"*Part, name=Limb\n{part()}*End Part\n*Assembly, name=A\n*Instance, name=L, part=Limb\n1., 2., 0.\n"
        "0., 0., 0., 0., 0., 1., 90.\n*End Instance\n*End Assembly\n*Boundary\nbone, 1, 3\n"
    )
    limb, _ = counts(tmp_path, moved)
    x, y, z = LIMB.mesh.points_mm.T
    np.testing.assert_allclose(limb.mesh.points_mm, np.stack([-(y + 2.0), x + 1.0, z], axis=1), atol=1e-9)


@pytest.mark.parametrize(
    ("surface", "n"),
    [
        ("*Elset, elset=low, generate\n{first}, {last}\n*Surface, type=ELEMENT, name=held\nlow, S1\n", 25),
        ("*Surface, type=NODE, name=held\nbone, 1.\n", 25),
        ("*Surface, name=held\n1, S1\n2, S1\n", 6),
    ],
)
def test_surfaces_are_sets_of_nodes(tmp_path: Path, surface: str, n: int) -> None:
    numbers = np.array([int(cell.split(",")[0]) for cell in CELLS])
    low = numbers[np.isin(LIMB.mesh.cells["hex8"] + 1, BONE).any(axis=1)]
    text = part(sets=surface.format(first=low.min(), last=low.max()))
    (tmp_path / "m.inp").write_text(text)
    found = MeshioSource(MeshioSettings.model_validate(settings_of("HELD"))).load(
        tmp_path / "m.inp", Spot(name="p1")
    )
    assert found.mesh.node_sets["fixed"].size >= n


@pytest.mark.parametrize("kind", ["REVOLUTION", "CYLINDER", "SEGMENTS"])
def test_the_analytical_surface_of_a_tool_is_passed_over(tmp_path: Path, kind: str) -> None:
    tool = f"*Surface, type={kind}, name=Punch\nSTART, 5., 10.\nLINE, 5., 0.\n"
    assert counts(tmp_path, part() + tool + "*Boundary\nbone, 1, 3\ncuts, 1, 3\n")[1] == HELD.size


def test_what_is_not_used_is_named(tmp_path: Path) -> None:
    conditions = (
        "*Boundary\ncuts, 1, 3\nbone, 3\ntop, 3, 3, -2.\n*MPC\nBEAM, bone, 1\n"
        "*Node\n900, 0., 0., -30.\n*Rigid Body, ref node=900, tie nset=bone\n"
    )
    limb, n_fixed = counts(tmp_path, part() + conditions)
    text = "\n".join(limb.warnings)
    assert n_fixed == CUTS.size
    assert "held in z alone by *Boundary of 'bone'" in text
    assert "*Boundary of 'top' moves 25 nodes" in text
    assert "*MPC in line" in text
    assert "reference node that the file does not hold" in text
    limb, n_fixed = counts(
        tmp_path, part() + "*Boundary\ncuts, 1, 3\n*Boundary, submodel, step=1\nbone, 1, 3\n"
    )
    assert n_fixed == CUTS.size
    assert "*Boundary, submodel in line" in limb.warnings[0]
    limb, _ = counts(tmp_path, part() + "*Boundary\ncuts, 1, 3\nbone, 1, 3\n", "cuts")
    assert "the file holds 15 more nodes by *Boundary of 'bone'" in limb.warnings[0]


def test_a_solid_rigid_body_is_no_limb(tmp_path: Path) -> None:
    box = [(x, y, z) for z in (3, 4) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    nodes = "".join(f"{800 + k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(box))
    ball = f"*Node\n{nodes}*Element, type=C3D8, elset=ball\n900, {', '.join(map(str, range(800, 808)))}\n"
    text = part() + ball + "*Rigid Body, ref node=800, elset=BALL\n*Boundary\nbone, 1, 3\ncuts, 1, 3\n"
    limb, n_fixed = counts(tmp_path, text)
    assert limb.mesh.n_cells == len(CELLS)
    assert n_fixed == HELD.size
    assert "1 elements of type 'ball' (rigid body) are no tissue and are left out" in limb.remarks


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (part("*Element, type=C3D8X9Z\n1, 2\n"), r"line \d+: elements of type C3D8X9Z are not understood"),
        (
            part("*Element, type=CAX4\n1, 2\n"),
            r"elements of type CAX4 are not understood; mesh the limb with",
        ),
        (part("*NGEN, nset=x\n1, 2\n"), r"\*NGEN in line \d+: it makes nodes or elements; write all of them"),
        (part("*Node, system=C\n1, 2, 3, 4\n"), "cylindrical or spherical; write x, y and z"),
        ("*Node, input=nodes.inc\n", r"\*NODE in line 1: no such file 'nodes.inc'; put it next to it"),
        ("*Include, input=nodes.inc\n", r"\*INCLUDE in line 1: no such file 'nodes.inc'; put it next to it"),
        (part("*Element, type=C3D8\n1, 2, 3\n"), "C3D8 wants 8 nodes in each element"),
        (
            part("*Element, type=C3D4\n901, 1, 2, 3, 5000\n"),
            "element 901 names node 5000, which is",
        ),
        (part(sets="*Nset, nset=x\nnone\n"), r"\*NSET in line \d+: no set 'none'; define it first"),
        (part() + "*Boundary\nbones, 1, 3\n", r"\*BOUNDARY in line \d+: no node set 'bones'"),
        (part() + "*Boundary\nbone, up\n", "'up' is no number"),
        (part(), "no point data, point set or group of elements 'fixed'"),
    ],
)
def test_what_is_not_understood_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        counts(tmp_path, text)


@given(st.integers(0, 2**32))
def test_case_blanks_and_line_ends_do_not_matter(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    random = Random(seed)
    text = part() + SUPPORTS["one direction at a time"]
    spelled = "".join(random.choice((c.upper(), c.lower(), c)) for c in text)
    for sign in ",=":
        spelled = spelled.replace(sign, random.choice((sign, f" {sign}", f" {sign} ")))
    folder = tmp_path_factory.mktemp("inp")
    (folder / "m.inp").write_bytes(spelled.replace("\n", random.choice(("\n", "\r\n"))).encode())
    assert load(folder / "m.inp", settings_of()).mesh.node_sets["fixed"].size == HELD.size
