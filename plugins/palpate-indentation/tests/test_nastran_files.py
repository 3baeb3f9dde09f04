"""Bulk data of Nastran in every field format is the whole block, with what its constraints hold."""

from pathlib import Path

import numpy as np
import pytest

from palpate.errors import MeshError
from palpate.mesh.specimens import block
from palpate.mesh.splitting import SOLIDS
from palpate_indentation.nastran_files import read_nastran

MADE = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2, layers_mm={"skin": 10.0}).mesh
HEXES = MADE.cells["hex8"]
IN_SKIN = MADE.cell_regions["hex8"] == 0
X, _, Z = MADE.points_mm.T
HELD = np.flatnonzero((Z == -20.0) | (np.abs(X) == 20.0))


def small(*cells: object) -> str:
    """Cards of small fields of eight characters, with continuations."""
    name, *data = (f"{cell:<8}" for cell in cells)
    rows = ["".join(data[k : k + 8]) for k in range(0, len(data), 8)]
    return "\n".join([name + rows[0], *("+       " + row for row in rows[1:])])


def free(*cells: object) -> str:
    name, *data = map(str, cells)
    return "\n,".join(",".join(data[k : k + 8]) for k in range(0, len(data), 8)).join([f"{name},", ""])


def large(*cells: object) -> str:
    """Cards of large fields of 16 characters."""
    name, *data = map(str, cells)
    rows = ["".join(f"{cell:<16}" for cell in data[k : k + 4]) for k in range(0, len(data), 4)]
    return "\n".join([f"{name}*".ljust(8) + rows[0], *("*       " + row for row in rows[1:])])


def bulk(write, constraints: str = "", cells: np.ndarray = HEXES, name: str = "CHEXA") -> str:
    lines = [
        "SOL 101",
        "CEND",
        "BEGIN BULK",
        "$ Femap Property 1 : skin",
        '$HMNAME PROP        2"soft tissue" 4',
    ]
    lines += [write("GRID", k, "", *(f"{v:.5g}" for v in p)) for k, p in enumerate(MADE.points_mm, 1)]
    numbers = np.where(IN_SKIN, 1, 2)
    lines += [
        write(name, k, n, *(c + 1).tolist())
        for k, (n, c) in enumerate(zip(numbers[: len(cells)], cells, strict=True), 1)
    ]
    return "\n".join([*lines, constraints, "ENDDATA", "no card"])


CONSTRAINTS = "SPC1,7,123,1,THRU,16\n" + "\n".join(f"SPC,7,{n + 1},123456,0.0" for n in HELD[16:])


@pytest.mark.parametrize("write", [small, free, large])
def test_each_field_format_is_the_whole_block(tmp_path: Path, write) -> None:
    (tmp_path / "m.bdf").write_text(bulk(write, CONSTRAINTS))
    content = read_nastran(tmp_path / "m.bdf")
    np.testing.assert_allclose(content.points, MADE.points_mm, rtol=1e-4)
    ((shape, cells),) = content.blocks
    assert shape == "hexahedron"
    np.testing.assert_array_equal(cells, HEXES)
    assert {name: rows[0].tolist() for name, rows in content.cell_sets.items()} == {
        "skin": np.flatnonzero(IN_SKIN).tolist(),
        "soft tissue": np.flatnonzero(~IN_SKIN).tolist(),
    }
    assert {support.axes for support in content.supports} == {"xyz"}
    held = np.unique(np.concatenate([support.nodes for support in content.supports]))
    np.testing.assert_array_equal(held, HELD)
    assert content.warnings == ()
    assert content.cell_data["nastran:ref"][0].tolist() == np.where(IN_SKIN, 1, 2).tolist()


def test_properties_of_one_name_are_one_group(tmp_path: Path) -> None:
    text = bulk(free).replace('$HMNAME PROP        2"soft tissue" 4', '$HMNAME PROP 2"skin"')
    (tmp_path / "m.bdf").write_text(text)
    ((name, (rows,)),) = read_nastran(tmp_path / "m.bdf").cell_sets.items()
    assert (name, rows.tolist()) == ("skin", list(range(len(HEXES))))


@pytest.mark.parametrize(
    ("case", "nodes", "warning"),
    [
        ("SPC = 1", [0, 1], "SPC 2, 4: not used"),
        ("SUBCASE 1\n  spc=3", [0, 1, 2], "SPC 4: not used"),
        ("$ SPC = 1", [0, 1, 2, 3], "selects no set of constraints, so sets 1, 2, 4 hold"),
        ("SPC = 1\nSUBCASE 2\nSPC = 2", [0, 1, 2], "selects several sets of constraints, so sets 1, 2"),
    ],
)
def test_the_case_control_selects_the_supports(tmp_path: Path, case: str, nodes, warning: str) -> None:
    cards = "SPC1,1,123,1,2\nSPC1,2,123,3\nSPCADD,3,1,2\nSPC,4,4,123,0.0\n"
    (tmp_path / "m.bdf").write_text(bulk(free, cards).replace("CEND", f"CEND\n{case}"))
    content = read_nastran(tmp_path / "m.bdf")
    assert np.concatenate([support.nodes for support in content.supports]).tolist() == nodes
    assert warning in " | ".join(content.warnings)


def test_what_moves_what_is_absent_and_what_links_is_named(tmp_path: Path) -> None:
    cards = "SPC,7,1,3,-0.5\nSPC1,7,2,400,2\nRBE2,9,1,123,2,3\nGRID,900,,0.,0.,0.,,13"
    (tmp_path / "m.nas").write_text(bulk(free, cards))
    content = read_nastran(tmp_path / "m.nas")
    assert [(s.name, s.axes, s.nodes.tolist()) for s in content.supports] == [
        ("SPC1 7", "y", [1]),
        ("GRID", "xz", [75]),
    ]
    said = " | ".join(content.warnings)
    assert "SPC 7 moves nodes" in said
    assert "SPC1 7 names 1 nodes that are not there" in said
    assert "not used: 1 RBE2" in said


def test_a_node_held_in_all_axes_may_have_a_system_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "m.bdf").write_text("GRDSET\nGRID,1,,0.,0.,0.,5,3\nGRID,2,,1.,0.,0.,5\nSPC1,1,12,1\n")
    assert {support.axes for support in read_nastran(tmp_path / "m.bdf").supports} == {"xy", "z"}


@pytest.mark.parametrize(("name", "shape"), [("CHEXA", "hexahedron20"), ("CPENTA", "wedge15")])
def test_upright_edges_come_before_upper_ones(tmp_path: Path, name: str, shape: str) -> None:
    solid, n = SOLIDS[shape][0], SOLIDS[shape][0].n_corners
    n_ring = n // 2
    edges = [*solid.edges[:n_ring], *solid.edges[2 * n_ring :], *solid.edges[n_ring : 2 * n_ring]]
    corners = np.random.default_rng(0).normal(size=(n, 3)).round(3)
    points = np.vstack([corners, [corners[list(edge)].mean(axis=0) for edge in edges]])
    cards = [free("GRID", k, "", *(f"{v:.5f}" for v in p)) for k, p in enumerate(points, 1)]
    cards.append(free(name, 1, 1, *range(1, len(points) + 1)))
    (tmp_path / "m.fem").write_text("\n".join(cards))
    content = read_nastran(tmp_path / "m.fem")
    ((kind, cells),) = content.blocks
    assert kind == shape
    middles = content.points[cells[0][np.array(solid.edges)]].mean(axis=1)
    np.testing.assert_allclose(content.points[cells[0][n:]], middles, atol=1e-4)


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("GRID,1,5,0.,0.,0.", "node 1 is in coordinate system 5; export the nodes in the basic system"),
        ("CTETRA,1,1,1,2,3,4,5", "CTETRA 1 lacks nodes; write all nodes in the middle of its edges, or none"),
        ("GRID,1,,x,0.,0.", "GRID cannot be read; write the file again"),
        (
            "GRID,1,,0.,0.,0.,5\nSPC1,1,3,1",
            "node 1 is held in some axes of coordinate system 5; hold it in 123",
        ),
        ("GRID,1,,0.,0.,0.,5,12", "node 1 is held in some axes of coordinate system 5; hold it in 123"),
        ("GRDSET,,5", "GRDSET has defaults of nodes; write systems and constraints into each GRID"),
        ("GRDSET,,,,,,,456", "GRDSET has defaults of nodes; write systems and constraints into each GRID"),
        ("INCLUDE 'more.bdf'", "INCLUDE takes in another file; write the bulk data as one file"),
    ],
)
def test_what_is_not_understood_is_named_with_its_line(tmp_path: Path, card: str, message: str) -> None:
    (tmp_path / "m.bdf").write_text(f"$ comment\n{card}\n")
    with pytest.raises(MeshError, match=f"line 2: {message}"):
        read_nastran(tmp_path / "m.bdf")


def test_numbers_may_have_no_letter_before_their_exponent(tmp_path: Path) -> None:
    (tmp_path / "m.bdf").write_text("GRID           1         1.5-3   -2.+1  3.D+00\n")
    assert read_nastran(tmp_path / "m.bdf").points.tolist() == [[0.0015, -20.0, 3.0]]
