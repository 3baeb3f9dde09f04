"""Archives of Ansys are read as the block that they are, in each of their kinds of solids and of records."""

import contextlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from palpate.domain import Limb, Spot
from palpate.errors import MeshError
from palpate.limb.checks import check_limb
from palpate.limb.outer_surface import partly_fixed
from palpate.limb.tidying import tidied
from palpate.mesh.specimens import block
from palpate.mesh.splitting import SOLIDS, cut
from palpate_indentation import MeshioSettings, MeshioSource
from palpate_indentation.mesh_files import read_here

pytestmark = pytest.mark.usefixtures("meshes_here")

MADE = block("hex8", width_mm=40.0, height_mm=20.0, n_across=4, n_down=2).mesh
HEXES = MADE.cells["hex8"]
TETS = cut(MADE.points_mm, (("hexahedron", HEXES),)).tets
WEDGES = np.concatenate([HEXES[:, [0, 1, 2, 4, 5, 6]], HEXES[:, [0, 2, 3, 4, 6, 7]]])
BRICKS = {"tetra": (0, 1, 2, 2, 3, 3, 3, 3), "wedge": (0, 1, 2, 2, 3, 4, 5, 5), "hexahedron": range(8)}
BRICK_EDGES = SOLIDS["hexahedron20"][0].edges


def whole(linear: str, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points with the middles of edges, and the nodes (n, 20) of bricks that are these elements."""
    bricks = cells[:, list(BRICKS[linear])]
    ends = np.sort(bricks[:, np.array(BRICK_EDGES)], axis=2)
    unique, inverse = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    is_edge = unique[:, 0] != unique[:, 1]
    number = np.where(is_edge, len(MADE.points_mm) + np.cumsum(is_edge) - 1, unique[:, 0])
    points = np.vstack([MADE.points_mm, MADE.points_mm[unique[is_edge]].mean(axis=1)])
    return points, np.hstack([bricks, number[inverse].reshape(len(bricks), -1)])


def ranges(nodes: Sequence[int]) -> list[int]:
    """Numbers of a component, in which the end of a range is negative."""
    found: list[int] = []
    for node in nodes:
        if len(found) > 1 and found[-1] < 0 and node == 1 - found[-1]:
            found[-1] = -node
        elif found and found[-1] > 0 and node == found[-1] + 1:
            found.append(-node)
        else:
            found.append(node)
    return found


def lines(numbers: Sequence[int], n: int, width: int) -> str:
    return "".join(
        "".join(f"{x:{width}d}" for x in numbers[k : k + n]) + "\n" for k in range(0, len(numbers), n)
    )


def archive(points: np.ndarray, cells: np.ndarray, kind: int, *, et: str = "ET,1,{}", width: int = 9) -> str:
    x, _, z = points.T
    top, held = (np.flatnonzero(of) + 1 for of in (z == 0.0, (z == -20.0) | (np.abs(x) == 20.0)))
    text = f"/PREP7\n{et.format(kind)}\nNBLOCK,6,SOLID,{len(points)},{len(points)}\n(3i{width},6e21.13e3)\n"
    for number, point in enumerate(points, 1):
        # Zeros at the end of a line are left out, as Ansys does.
        row = "".join(f"{value:21.13E}" for value in point).rstrip()
        while row.endswith(f"{0.0:21.13E}"):
            row = row[:-21]
        text += f"{number:{width}d}{0:{width}d}{0:{width}d}{row}\n"
    text += f"N,R5.3,LOC,       -1,\nEBLOCK,19,SOLID,{len(cells)},{len(cells)}\n(19i{width})\n"
    for number, nodes in enumerate((cells + 1).tolist(), 1):
        head = [7, 1, 1, 1, 0, 0, 0, 0, len(nodes), 0, number]
        text += lines([*head, *nodes[:8]], 19, width) + (lines(nodes[8:], 19, width) if nodes[8:] else "")
    text += f"{-1:{width}d}\n"
    for name, of in (("TOP", top), ("HELD", held)):
        numbers = ranges(of.tolist())
        text += f"CMBLOCK,{name:8},NODE,{len(numbers):8d}  ! nodes\n(8i10)\n{lines(numbers, 8, 10)}"
    return text + "CMSEL,S,HELD\nD,ALL,UX,0\nD,ALL,UY,0.0\nD,ALL,UZ\nALLSEL,ALL\nFINISH\n"


def load(path: Path, **more: object) -> Limb:
    chosen = {"regions": {"soft_tissue": 7}, "region_data": "material", "node_sets": {"contact": "top"}}
    limb = tidied(MeshioSource(MeshioSettings.model_validate(chosen | more)).load(path, Spot(name="p1")))
    check_limb(limb, limb.mesh.regions)
    return limb


KINDS = {
    "185, bricks": (185, "hexahedron", HEXES, 8),
    "45, tetrahedra": (45, "tetra", TETS, 8),
    "185, prisms": (185, "wedge", WEDGES, 8),
    "186, bricks": (186, "hexahedron", HEXES, 20),
    "95, prisms": (95, "wedge", WEDGES, 20),
    "186, tetrahedra": (186, "tetra", TETS, 20),
    "187": (187, "tetra", TETS, 10),
    "285": (285, "tetra", TETS, 4),
}
OF_TEN = (0, 1, 2, 4, 8, 9, 11, 16, 17, 18)


@pytest.mark.parametrize(("kind", "linear", "cells", "n"), KINDS.values(), ids=KINDS)
def test_each_kind_is_the_whole_block(
    tmp_path: Path, kind: int, linear: str, cells: np.ndarray, n: int
) -> None:
    points, bricks = whole(linear, cells)
    nodes = bricks[:, list(OF_TEN)][:, :n] if n in (4, 10) else bricks[:, :n]
    points = points if n > 8 else MADE.points_mm
    (tmp_path / "m.cdb").write_text(archive(points, nodes, kind))
    limb = load(tmp_path / "m.cdb")
    x, _, z = limb.mesh.points_mm.T
    assert {float(t) for t in limb.mesh.points_mm.min(axis=0)} == {-20.0}
    np.testing.assert_array_equal(np.sort(limb.mesh.node_sets["contact"]), np.flatnonzero(z == 0.0))
    assert set(np.flatnonzero((z == -20.0) | (np.abs(x) == 20.0))) <= set(limb.mesh.node_sets["fixed"])
    assert not list(partly_fixed(limb.mesh))
    assert limb.warnings == ()


def test_spellings_of_the_formats_change_nothing(tmp_path: Path) -> None:
    plain = archive(MADE.points_mm, HEXES, 185)
    etblock = "ETBLOCK,        1,        1\n(2i9,19a9)\n        1      {}        0\n       -1"
    spelt = {
        "plain": plain,
        "wide": archive(MADE.points_mm, HEXES, 185, width=10),
        "et": plain.replace("ET,1,185", "et, 1, SOLID185"),
        "etblock": archive(MADE.points_mm, HEXES, 185, et=etblock),
        "mixed": plain.replace("(3i9,6e21.13e3)", "(1i9,2i9,6E21.13)"),
        "crlf": plain.replace("\n", "\r\n"),
        "elements of no tissue": plain.replace("ET,1,185\n", "ET,1,185\nET,2,170\n"),
    }
    for name, text in spelt.items():
        (tmp_path / f"{name}.cdb").write_text(text)
        found = load(tmp_path / f"{name}.cdb").mesh
        np.testing.assert_array_equal(found.points_mm, MADE.points_mm)
        np.testing.assert_array_equal(found.cells["hex8"], HEXES)


def test_midside_nodes_that_are_left_out_are_in_the_middle(tmp_path: Path) -> None:
    points, bricks = whole("hexahedron", HEXES)
    bricks[:, 12:] = -1
    (tmp_path / "m.cdb").write_text(archive(points[: bricks.max() + 1], bricks, 186))
    limb = load(tmp_path / "m.cdb")
    assert limb.mesh.points_mm.shape[0] > len(points)
    assert not list(partly_fixed(limb.mesh))


def test_what_moves_and_what_is_no_tissue_is_named(tmp_path: Path) -> None:
    text = archive(MADE.points_mm, HEXES, 185).replace(
        "ALLSEL,ALL",
        "D,HELD,UX,2.5\nD,ABSENT,ALL\nD,1,TEMP,5\nD,HELD,ALL,DISP\nD,HELD,UZ,%TAB%\nD,HELD,UX,-.0E+00",
    )
    text = text.replace("ET,1,185", "ET,1,185\nET,3,154").replace(
        f"{-1:9d}\n", lines([7, 3, 1, 1, 0, 0, 0, 0, 4, 0, 999, 1, 2, 3, 4], 19, 9) + f"{-1:9d}\n", 1
    )
    (tmp_path / "m.cdb").write_text(text)
    limb = load(tmp_path / "m.cdb")
    assert "1 elements of Ansys' 154 are no tissue and are left out" in limb.remarks
    assert [w.split(" in line")[0] for w in limb.warnings] == [
        "D,HELD,UX",
        "D,ABSENT,ALL",
        "D,HELD,ALL",
        "D,HELD,UZ",
    ]
    assert all("moves 45 nodes and is not used" in limb.warnings[k] for k in (0, 2, 3))


IN_PARTS = "CMSEL,S,HELD\nCMSEL,U,TOP\nD,ALL,UX,0,,,,UY,UZ\nCMSEL,S,HELD\nCMSEL,R,TOP\nD,ALL,ALL\n"


@pytest.mark.parametrize(
    ("commands", "n_fixed"),
    [
        ("CMSEL,S,HELD\nCMSEL,A,TOP\nD,ALL,ALL\n", 60),
        ("D,1,ALL,0,,25,1\n", 25),
        ("D,1,ALL,0,,25,0\n", 25),
        (IN_PARTS, 45),
        ("D,HELD,UX,0,,,,UY,UZ\n", 45),
        ("D,HELD,ALL\nNSEL,S,LOC,Y,-20\nD,ALL,ALL\n", 45),
    ],
    ids=[
        "a selection of two",
        "a range",
        "a range of no step",
        "without and among",
        "three axes",
        "a selection by place",
    ],
)
def test_every_node_that_a_command_holds_is_fixed_or_named(
    tmp_path: Path, commands: str, n_fixed: int
) -> None:
    text = archive(MADE.points_mm, HEXES, 185)
    start = text.index("CMSEL,S,HELD")
    (tmp_path / "m.cdb").write_text(text[:start] + commands)
    limb = load(tmp_path / "m.cdb")
    assert len(limb.mesh.node_sets["fixed"]) == n_fixed
    assert any("a selection that is not read" in w for w in limb.warnings) == ("LOC" in commands)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("(3i9,6e21.13e3)", ""), "line 4: no Fortran format"),
        (lambda t: t[: t.index("EBLOCK") + 300], "of fewer than 11 fields|has too few nodes"),
        (
            lambda t: "/PREP7\nN,1,0.0,0.0,0.0\nEN,1,1,2\n",
            "nodes by single commands; write the archive in",
        ),
        (lambda t: t.replace("ET,1,185", "ET,1,181"), "no volume elements"),
    ],
)
def test_what_is_not_understood_is_named(tmp_path: Path, change, message: str) -> None:
    (tmp_path / "m.cdb").write_text(change(archive(MADE.points_mm, HEXES, 185)))
    with pytest.raises(MeshError, match=message):
        load(tmp_path / "m.cdb")


@settings(max_examples=60)
@given(at=st.floats(0.0, 1.0), length=st.integers(0, 40), mark=st.sampled_from(["", "x", "-1", "\n", "9"]))
def test_damaged_text_is_a_mesh_or_an_error(
    tmp_path_factory: pytest.TempPathFactory, at: float, length: int, mark: str
) -> None:
    text = archive(MADE.points_mm, HEXES, 185)
    start = int(at * len(text))
    path = tmp_path_factory.mktemp("cdb") / "m.cdb"
    path.write_text(text[:start] + mark + text[start + length :])
    with contextlib.suppress(MeshError):
        assert read_here(path).points.shape[1] == 3
