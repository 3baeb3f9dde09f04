"""Text files of Gmsh are read as meshio reads them, and also where groups overlap or elements have none."""

import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest

from palpate.domain import Limb, Spot
from palpate.errors import MeshError
from palpate.limb.checks import check_limb
from palpate.limb.tidying import tidied
from palpate.mesh.specimens import block
from palpate.mesh.splitting import SOLIDS, cut
from palpate_indentation import MeshioSettings, MeshioSource
from palpate_indentation.gmsh_files import TYPES, read_gmsh
from palpate_indentation.mesh_files import read_here

pytestmark = pytest.mark.usefixtures("meshes_here")

DATA = Path(__file__).parent / "data"
MADE = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2).mesh
HEXES = MADE.cells["hex8"]
WEDGES = np.concatenate([HEXES[:, [0, 1, 2, 4, 5, 6]], HEXES[:, [0, 2, 3, 4, 6, 7]]])
CELLS = {
    "tetra": cut(MADE.points_mm, (("hexahedron", HEXES),)).tets,
    "hexahedron": HEXES,
    "wedge": WEDGES,
    "pyramid": HEXES[:, [0, 1, 2, 3, 4]],
}
QUADRATIC = {"tetra": "tetra10", "hexahedron": "hexahedron20", "wedge": "wedge15", "pyramid": "pyramid13"}


def load(path: Path, contact: str, fixed: str, regions: dict[str, object]) -> Limb:
    settings = {"regions": regions, "node_sets": {"contact": contact, "fixed": fixed}}
    limb = tidied(MeshioSource(MeshioSettings.model_validate(settings)).load(path, Spot(name="p1")))
    check_limb(limb, limb.mesh.regions)
    return limb


def quadratic(linear: str) -> tuple[np.ndarray, np.ndarray]:
    """Points with the middles of edges, and elements with the nodes there."""
    cells = CELLS[linear]
    ends = np.sort(cells[:, np.array(SOLIDS[QUADRATIC[linear]][0].edges)], axis=2)
    unique, inverse = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    points = np.vstack([MADE.points_mm, MADE.points_mm[unique].mean(axis=1)])
    return points, np.hstack([cells, len(MADE.points_mm) + inverse.reshape(len(cells), -1)])


@pytest.mark.parametrize("version", ["gmsh22", "gmsh"])
@pytest.mark.parametrize("shape", [*CELLS, "tetra10", "hexahedron20"])
def test_nodes_are_in_the_order_of_another_writer(tmp_path: Path, shape: str, version: str) -> None:
    linear = next((name for name, other in QUADRATIC.items() if shape == other), shape)
    points, cells = quadratic(linear) if shape != linear else (MADE.points_mm, CELLS[shape])
    mesh = meshio.Mesh(points, [(shape, cells)])
    if version == "gmsh22":
        mesh.cell_data = {
            "gmsh:physical": [np.full(len(cells), 5)],
            "gmsh:geometrical": [np.ones(len(cells))],
        }
        mesh.cell_data = {k: [v[0].astype(int)] for k, v in mesh.cell_data.items()}
        mesh.field_data = {"limb": np.array([5, 3])}
    meshio.write(tmp_path / "m.msh", mesh, file_format=version, binary=False)
    found = read_gmsh(tmp_path / "m.msh")
    assert found is not None
    np.testing.assert_allclose(found.points, points, atol=1e-13)
    ((kind, read),) = found.blocks
    assert kind == shape
    np.testing.assert_array_equal(read, cells)
    if version == "gmsh22":
        assert found.cell_sets["limb"][0].size == len(cells)


MANUAL = {
    18: ("wedge", "01 02 03 12 14 25 34 35 45"),
    19: ("pyramid", "01 03 04 12 14 23 24 34"),
    17: ("hexahedron", "01 03 04 12 15 23 26 37 45 47 56 67"),
    11: ("tetra", "01 12 20 30 23 31"),
}
"""Edges in whose middles the nodes are, by the node ordering of Gmsh's manual."""


@pytest.mark.parametrize(("kind", "linear", "edges"), [(k, *v) for k, v in MANUAL.items()])
def test_nodes_are_in_the_order_of_the_manual(tmp_path: Path, kind: int, linear: str, edges: str) -> None:
    cells = CELLS[linear][:1]
    ends = [[cells[0, int(a)], cells[0, int(b)]] for a, b in edges.split()]
    points = np.vstack([MADE.points_mm, MADE.points_mm[ends].mean(axis=1)])
    nodes = [*cells[0].tolist(), *range(len(MADE.points_mm), len(points))]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(points))]
    lines += [f"{k} {x!r} {y!r} {z!r}" for k, (x, y, z) in enumerate(points.tolist(), 1)]
    lines += ["$EndNodes", "$Elements", "1", f"7 {kind} 2 4 1 {' '.join(str(n + 1) for n in nodes)}"]
    lines += ["$EndElements", "$ElementData", "1", '"fibre"', "1", "0.0", "3", "0", "3", "1", "7 1.5 0 -2"]
    (tmp_path / "m.msh").write_text("\n".join([*lines, "$EndElementData", ""]))
    found = read_gmsh(tmp_path / "m.msh")
    assert found is not None
    ((shape, read),) = found.blocks
    middles = found.points[read[0][SOLIDS[shape][0].n_corners :]]
    own = found.points[read[0][np.array(SOLIDS[shape][0].edges)]].mean(axis=1)
    np.testing.assert_allclose(middles, own, atol=1e-12)
    np.testing.assert_array_equal(found.cell_data["fibre"][0], [[1.5, 0.0, -2.0]])


def text_2(groups: dict[int, np.ndarray]) -> str:
    """Version 2.2, which writes an element once for each of its groups; the group 0 is none."""
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "3"]
    lines += ['3 1 "tissue"', '3 2 "upper half"', '2 3 "skin"', "$EndPhysicalNames"]
    lines += ["$Nodes", str(len(MADE.points_mm))]
    lines += [f"{k} {x!r} {y!r} {z!r}" for k, (x, y, z) in enumerate(MADE.points_mm.tolist(), 1)]
    rows = [(5, group, cell + 1) for group, of in groups.items() for cell in HEXES[of]]
    top = np.flatnonzero(MADE.points_mm[:, 2] == 0.0)
    for cell in HEXES:
        faces = (cell[list(face)] for face in SOLIDS["hexahedron"][0].faces)
        rows += [(3, 3, face + 1) for face in faces if np.isin(face, top).all()]
    lines += ["$EndNodes", "$Elements", str(len(rows))]
    lines += [f"{k} {t} 2 {g} 1 {' '.join(map(str, c))}" for k, (t, g, c) in enumerate(rows, 1)]
    return "\n".join([*lines, "$EndElements", ""])


def test_an_element_of_two_groups_is_there_once(tmp_path: Path) -> None:
    """Twice it would be twice as stiff."""
    upper = np.flatnonzero(MADE.points_mm[HEXES].mean(axis=1)[:, 2] > -10.0)
    (tmp_path / "m.msh").write_text(text_2({1: np.arange(len(HEXES)), 2: upper}))
    found = read_gmsh(tmp_path / "m.msh")
    assert found is not None
    assert [(kind, len(cells)) for kind, cells in found.blocks] == [("hexahedron", 32), ("quad", 16)]
    assert [sum(map(len, found.cell_sets[name])) for name in ("tissue", "upper half", "skin")] == [32, 16, 16]
    limb = load(tmp_path / "m.msh", "skin", "upper half", {"soft_tissue": "tissue"})
    np.testing.assert_array_equal(
        np.sort(limb.mesh.node_sets["contact"]), np.flatnonzero(MADE.points_mm[:, 2] == 0.0)
    )


def test_a_volume_and_its_surface_may_have_one_name(tmp_path: Path) -> None:
    upper = np.flatnonzero(MADE.points_mm[HEXES].mean(axis=1)[:, 2] > -10.0)
    rest = np.setdiff1d(np.arange(len(HEXES)), upper)
    (tmp_path / "m.msh").write_text(text_2({1: rest, 2: upper}).replace("upper half", "skin"))
    found = read_gmsh(tmp_path / "m.msh")
    assert found is not None
    members = {name: [len(rows) for rows in blocks] for name, blocks in found.cell_sets.items()}
    assert members == {"tissue": [16, 0], "skin": [16, 0], "skin of dimension 2": [0, 16]}
    sets = tomllib.loads(MeshioSource.inspect(tmp_path / "m.msh").study_text)["limb"]["settings"]["node_sets"]
    assert sets["contact"] == "skin of dimension 2"


def test_elements_without_a_group_are_named(tmp_path: Path) -> None:
    upper = np.flatnonzero(MADE.points_mm[HEXES].mean(axis=1)[:, 2] > -10.0)
    rest = np.setdiff1d(np.arange(len(HEXES)), upper)
    (tmp_path / "m.msh").write_text(text_2({2: upper, 0: rest}))
    with pytest.raises(MeshError, match="16 elements are in none of the groups of regions"):
        load(tmp_path / "m.msh", "skin", "skin", {"soft_tissue": "upper half"})


def test_all_entities_that_gmsh_saves_are_read() -> None:
    limb = load(DATA / "meshes_of_others" / "gmsh_save_all.msh", "pressed", "bone", {"a": "skin", "b": "fat"})
    z = limb.mesh.points_mm[:, 2]
    np.testing.assert_array_equal(np.sort(limb.mesh.node_sets["contact"]), np.flatnonzero(np.abs(z) < 1e-9))
    assert limb.warnings == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("$EndElements", ""), r"no section \$Elements, or it does not end"),
        (lambda t: t.replace(" 5 2 1 1 ", " 92 2 1 1 ", 1), "elements of Gmsh's type 92; mesh the limb in"),
        (lambda t: t.replace(" 5 2 1 1 ", " 5 2 1 1 999 ", 1), "has 9 nodes, not 8; save it again"),
    ],
)
def test_what_is_not_understood_is_named(tmp_path: Path, change, message: str) -> None:
    (tmp_path / "m.msh").write_text(change(text_2({1: np.arange(len(HEXES))})))
    with pytest.raises(MeshError, match=message):
        load(tmp_path / "m.msh", "skin", "skin", {"soft_tissue": "tissue"})


FULL = {12: "hexahedron20", 13: "wedge15", 14: "pyramid13"}


@pytest.mark.parametrize("kind", FULL)
def test_nodes_in_the_middles_of_faces_are_left_out(tmp_path: Path, kind: int) -> None:
    """Gmsh adds them at order 2, after the nodes in the middles of the edges."""
    n_nodes, n_used = TYPES[kind][1], SOLIDS[FULL[kind]][1]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(n_nodes)]
    lines += [f"{k} {k} 0 0" for k in range(1, n_nodes + 1)]
    lines += ["$EndNodes", "$Elements", "1", f"1 {kind} 2 1 1 {' '.join(map(str, range(1, n_nodes + 1)))}"]
    (tmp_path / "m.msh").write_text("\n".join([*lines, "$EndElements", ""]))
    found = read_gmsh(tmp_path / "m.msh")
    assert found is not None
    ((shape, read),) = found.blocks
    assert shape == FULL[kind]
    assert sorted(read[0].tolist()) == list(range(n_used))


def test_an_element_of_two_groups_is_there_once_in_a_binary_file(tmp_path: Path) -> None:
    twice, numbers = np.concatenate([HEXES, HEXES[16:]]), np.repeat([1, 2], [32, 16])
    mesh = meshio.Mesh(MADE.points_mm, [("hexahedron", twice)], cell_data={"gmsh:physical": [numbers]})
    mesh.cell_data["gmsh:geometrical"] = [numbers]
    mesh.field_data = {"tissue": np.array([1, 3]), "upper half": np.array([2, 3])}
    meshio.write(tmp_path / "m.msh", mesh, file_format="gmsh22", binary=True)
    found = read_here(tmp_path / "m.msh")
    np.testing.assert_array_equal(found.blocks[0][1], HEXES)
    np.testing.assert_array_equal(found.cell_sets["tissue"][0], np.arange(32))
    np.testing.assert_array_equal(found.cell_sets["upper half"][0], np.arange(16, 32))


def test_binary_files_are_left_to_meshio(tmp_path: Path) -> None:
    mesh = meshio.Mesh(MADE.points_mm, [("hexahedron", HEXES)])
    meshio.write(tmp_path / "m.msh", mesh, file_format="gmsh22", binary=True)
    assert read_gmsh(tmp_path / "m.msh") is None


def test_volumes_of_one_name_have_their_numbers(tmp_path: Path) -> None:
    thirds = np.array_split(np.arange(len(HEXES)), 3)
    text = text_2({1: thirds[0], 2: thirds[1], 3: thirds[2]}).replace("upper half", "tissue")
    names = text.partition("$PhysicalNames\n")[2].partition("$EndPhysicalNames")[0]
    count = int(names.split()[0])
    more = names.replace(f"{count}\n", f"{count + 1}\n", 1) + '3 3 "tissue"\n'
    (tmp_path / "m.msh").write_text(text.replace(names, more))
    found = read_gmsh(tmp_path / "m.msh")
    assert found is not None
    members = {name: sum(map(len, blocks)) for name, blocks in found.cell_sets.items()}
    assert {name: n for name, n in members.items() if "tissue" in name} == {
        f"tissue {k + 1}": len(third) for k, third in enumerate(thirds)
    }


def test_a_binary_file_with_two_groups_of_one_name_is_refused(tmp_path: Path) -> None:
    names = b'$PhysicalNames\n2\n3 1 "skin"\n2 2 "skin"\n$EndPhysicalNames\n'
    (tmp_path / "m.msh").write_bytes(b"$MeshFormat\n2.2 1 8\n\x01\x00\x00\x00\n$EndMeshFormat\n" + names)
    with pytest.raises(MeshError, match="two groups have the name 'skin'; save the mesh as text"):
        read_here(tmp_path / "m.msh")
