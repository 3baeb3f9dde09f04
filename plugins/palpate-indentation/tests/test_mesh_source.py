"""Mesh files become meshes with named regions and node sets, or a message with what is missing."""

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from pydantic import ValidationError

from palpate.domain import Mesh, Spot
from palpate.errors import MeshError
from palpate_indentation import MeshioSettings, MeshioSource

pytestmark = pytest.mark.usefixtures("meshes_here")

SPOT = Spot(name="p1")
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [2, 0, 0]], dtype=float)
EDGES = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)]
TETS = np.array([[0, 1, 2, 3], [1, 4, 2, 3]])


def source(**settings: object) -> MeshioSource:
    return MeshioSource(MeshioSettings.model_validate(settings))


def parts() -> dict[str, Any]:
    """Give two tetrahedra of one region each, with both node sets and a face."""
    return {
        "points": CORNERS[:5],
        "cells": [("triangle", np.array([[0, 1, 2]])), ("tetra", TETS)],
        "point_data": {"fixed": np.array([1, 1, 1, 0, 0]), "contact": np.array([0, 0, 0, 1, 1])},
        "cell_data": {"region": [np.array([7]), np.array([0, 1])]},
    }


def write(path: Path, **changes: Any) -> Path:
    content = parts() | changes
    meshio.Mesh(**content).write(path)
    return path


def read(path: Path, **settings: object) -> Mesh:
    return source(regions={"soft_tissue": 0, "skin": 1}, **settings).load(path, SPOT).mesh


# ------------------------------------------------------------------ good files


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_regions_and_node_sets_are_found_by_name(tmp_path: Path, suffix: str) -> None:
    limb = source(regions={"skin": 1, "soft_tissue": 0}).load(write(tmp_path / f"m.{suffix}"), SPOT)
    assert limb.spot is SPOT
    mesh = limb.mesh
    np.testing.assert_array_equal(mesh.points_mm, CORNERS[:5])
    assert list(mesh.cells) == ["tet4"]
    np.testing.assert_array_equal(mesh.cells["tet4"], TETS)
    assert [mesh.regions[i] for i in mesh.cell_regions["tet4"]] == ["soft_tissue", "skin"]
    np.testing.assert_array_equal(mesh.node_sets["fixed"], [0, 1, 2])
    np.testing.assert_array_equal(mesh.node_sets["contact"], [3, 4])


def test_cell_data_of_numbers_and_vectors_are_kept_by_kind(tmp_path: Path) -> None:
    vectors = np.array([[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]])
    data = {
        "region": [np.array([7]), np.array([0, 1])],
        "fibre": [np.full((1, 3), np.nan), vectors],
        "stiffer": [np.array([0]), np.array([1, 2])],
        "tensor": [np.zeros((1, 9)), np.zeros((2, 9))],
    }
    fields = read(write(tmp_path / "m.vtu", cell_data=data)).cell_fields
    assert sorted(fields) == ["fibre", "stiffer"]
    np.testing.assert_array_equal(fields["fibre"]["tet4"], vectors)
    np.testing.assert_array_equal(fields["stiffer"]["tet4"], [1.0, 2.0])


def test_a_tet10_has_the_middles_of_its_edges_in_vtk_order(tmp_path: Path) -> None:
    middles = np.array([(CORNERS[a] + CORNERS[b]) / 2 for a, b in EDGES])
    path = write(
        tmp_path / "m.vtu",
        points=np.vstack([CORNERS[:4], middles]),
        cells=[("tetra10", np.arange(10)[None])],
        point_data={"fixed": np.ones(10), "contact": np.ones(10)},
        cell_data={"region": [np.array([0])]},
    )
    mesh = source().load(path, SPOT).mesh
    (cell,) = mesh.cells["tet10"]
    ends = mesh.points_mm[cell[:4]]
    np.testing.assert_allclose(mesh.points_mm[cell[4:]], [(ends[a] + ends[b]) / 2 for a, b in EDGES])


def test_blocks_of_one_kind_are_joined_and_kinds_kept_apart(tmp_path: Path) -> None:
    hexahedron = np.array([[0, 1, 2, 3, 4, 5, 0, 1]])  # connectivity alone is looked at here
    path = write(
        tmp_path / "m.vtk",
        points=CORNERS,
        cells=[("tetra", TETS[:1]), ("hexahedron", hexahedron), ("tetra", TETS[1:])],
        point_data={"fixed": np.ones(6, dtype=int), "contact": np.ones(6, dtype=int)},
        cell_data={"region": [np.array([1]), np.array([0]), np.array([0])]},
    )
    mesh = read(path)
    np.testing.assert_array_equal(mesh.cells["tet4"], TETS)
    np.testing.assert_array_equal(mesh.cell_regions["tet4"], [1, 0])
    np.testing.assert_array_equal(mesh.cells["hex8"], hexahedron)
    np.testing.assert_array_equal(mesh.cell_regions["hex8"], [0])


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("inch", 25.4)])
def test_coordinates_become_millimetres(tmp_path: Path, unit: str, factor: float) -> None:
    mesh = read(write(tmp_path / "m.vtu"), unit=unit)
    np.testing.assert_allclose(mesh.points_mm, factor * CORNERS[:5])


def test_other_names_in_the_file(tmp_path: Path) -> None:
    path = write(
        tmp_path / "m.vtu",
        point_data={"bone": np.array([1.0, 0, 0, 0, 0]), "skin": np.array([0, 0, 0, 0, 1])},
        cell_data={"part": [np.array([0]), np.array([4.0, 3.0])]},
    )
    mesh = (
        source(region_data="part", regions={"a": 3, "b": 4}, node_sets={"fixed": "bone", "contact": "skin"})
        .load(path, SPOT)
        .mesh
    )
    np.testing.assert_array_equal(mesh.cell_regions["tet4"], [1, 0])
    np.testing.assert_array_equal(mesh.node_sets["fixed"], [0])
    np.testing.assert_array_equal(mesh.node_sets["contact"], [4])


def test_node_sets_of_an_abaqus_file(tmp_path: Path) -> None:
    sets = {"fixed": np.array([0, 2]), "contact": np.array([3])}
    path = write(tmp_path / "m.inp", point_data={}, cell_data={}, point_sets=sets)
    mesh = source(region_data="").load(path, SPOT).mesh
    assert mesh.regions == ("soft_tissue",)
    np.testing.assert_array_equal(mesh.node_sets["fixed"], [0, 2])
    np.testing.assert_array_equal(mesh.cell_regions["tet4"], [0, 0])


# ------------------------------------------------------------------- bad files


def _nan() -> np.ndarray:
    points = CORNERS[:5].copy()
    points[3, 1] = np.nan
    return points


BAD = {
    "nan coordinate": ({"points": _nan()}, r"node 3 is at \[0\.0, nan, 1\.0\]; every coordinate must be"),
    "no regions": ({"cell_data": {}}, r"no cell data 'region' \(there: none\)"),
    "other regions": (
        {"cell_data": {"part": [np.array([0]), np.array([0, 1])]}},
        r"no cell data 'region' \(there: part\); set region_data",
    ),
    "unknown region": (
        {"cell_data": {"region": [np.array([0]), np.array([0, 5])]}},
        r"cell data 'region' holds 5 \(first in element 1\), which regions does not name",
    ),
    "fraction of a region": (
        {"cell_data": {"region": [np.array([0.0]), np.array([0.0, 0.5])]}},
        r"cell data 'region'\[1\] is 0\.5; give whole numbers",
    ),
    "nan region": (
        {"cell_data": {"region": [np.array([0.0]), np.array([0.0, np.nan])]}},
        r"cell data 'region'\[1\] is nan",
    ),
    "region vectors": (
        {"cell_data": {"region": [np.zeros((1, 3)), np.zeros((2, 3))]}},
        r"cell data 'region' has shape \(2, 3\)",
    ),
    "no fixed": (
        {"point_data": {"contact": np.ones(5)}},
        r"no point data, point set or group of elements 'fixed' \(there: contact, region 7\); add it to ",
    ),
    "nan in a node set": (
        {"point_data": {"fixed": np.array([1, 0, np.nan, 0, 0]), "contact": np.ones(5)}},
        r"point data 'fixed'\[2\] is nan",
    ),
    "surface only": (
        {"cells": [("triangle", TETS[:, :3])], "cell_data": {"region": [np.array([0, 0])]}},
        r"no volume elements \(found: triangle\); export the volume mesh",
    ),
    "quadratic wedges of 18 nodes": (
        {
            "points": np.arange(54.0).reshape(18, 3),
            "cells": [("wedge18", np.arange(18)[None])],
            "point_data": {},
            "cell_data": {"region": [np.array([0])]},
        },
        r"cells of VTK's type 32 .* are not understood; mesh the limb with tetrahedra or hexahedra",
    ),
}


@pytest.mark.parametrize(("changes", "message"), BAD.values(), ids=BAD.keys())
def test_a_bad_mesh_is_reported_with_what_is_there(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = write(tmp_path / "m.vtu", **changes)
    with pytest.raises(MeshError, match=message) as caught:
        read(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("empty.vtu", ""),
        ("text.vtu", "this is no mesh"),
        ("other.vtu", '<?xml version="1.0"?><VTKFile type="PolyData"></VTKFile>'),
        ("empty.vtk", ""),
        ("text.msh", "$MeshFormat\nnonsense\n"),
        ("unknown.xyz123", "1 2 3"),
        ("cut.inp", "*NODE\n1, 0, 0\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 9\n"),
        ("matrix.mesh", "MeshVersionFormatted 9\nDimension three\n"),
    ],
)
def test_a_broken_file_ends_in_a_message(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, text: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(MeshError, match=r"be read|and no Unstr|no legacy file|not there|is no format"):
        read(path)
    assert capfd.readouterr() == ("", "")


def test_a_cut_off_file_is_reported(tmp_path: Path) -> None:
    path = write(tmp_path / "m.vtu")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(MeshError, match=r"m\.vtu: no XML that can be read .*; write the mesh again"):
        read(path)


def test_an_exit_of_meshio_does_not_end_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def leave(_: Path) -> None:
        raise SystemExit(1)

    path = tmp_path / "m.msh"
    path.write_text("$MeshFormat\n")
    monkeypatch.setattr(meshio, "read", leave)
    with pytest.raises(MeshError, match=r"m\.msh: cannot be read as \.msh; .*export it again"):
        read(path)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"gone\.vtu: no such file"):
        read(tmp_path / "gone.vtu")


def test_one_region_is_required_without_regions_in_the_file(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r'region_data = "" makes the mesh one region, but regions names 2'):
        read(write(tmp_path / "m.vtu"), region_data="")


@pytest.mark.parametrize(
    "settings",
    [{"unit": "parsec"}, {"regions": {}}, {"regions": {"a": 0, "b": 0}}, {"node_sets": {}}, {"mesh": "x"}],
)
def test_wrong_settings_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        source(**settings)
