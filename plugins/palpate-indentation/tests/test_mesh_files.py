"""A mesh file never has files of other folders read, nor entities expanded."""

import base64
import re
import sys
import tempfile
import zlib
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import meshio
import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from palpate.domain import Spot
from palpate.errors import MeshError, PalpateError
from palpate.limb.checks import check_limb
from palpate_indentation import MeshioSettings, MeshioSource, mesh_files, mesh_source
from palpate_indentation.mesh_files import read_here, read_mesh_file

INP = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n"
XDMF = '<Xdmf Version="3.0"><Domain><Grid><DataItem Format="HDF">{}:/points</DataItem></Grid></Domain></Xdmf>'


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.inp", INP + "*INCLUDE, INPUT=/etc/hostname\n"),
        ("m.inp", INP + "*include , input = ../other.inp\n"),
        ("m.xdmf", XDMF.format("../other.h5")),
        ("m.inp", INP + "INCLUDE, PART=1, FILE=/etc/hostname\n"),
        ("m.inp", INP + "*INCLUDE, INPUT=m.inp\n*INCLUDE, INPUT=inner.txt\n"),
        ("m.xmf", XDMF.format("/data/other.h5")),
        ("m.xdmf", XDMF.format("/data/other.h5").replace(":/", ":")),
        ("m.xdmf", XDMF.format("&#47;data/other.h5")),
        ("m.xdmf", XDMF.format("<![CDATA[/data/other.h5]]>")),
        ("m.xdmf", '<Xdmf><DataItem Format="Binary">/etc/hostname</DataItem></Xdmf>'),
    ],
)
def test_a_file_elsewhere_is_refused_by_name(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    (tmp_path / "inner.txt").write_text("*Include,INPUT=../other.inp\n")
    with pytest.raises(MeshError, match="outside of its folder; move it next to"):
        read_here(tmp_path / name)


def external(file: h5py.File, secret: Path) -> None:
    file["points"] = h5py.ExternalLink(str(secret), "points")


def raw(file: h5py.File, secret: Path) -> None:
    file.create_dataset("points", (4, 3), "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def virtual(file: h5py.File, secret: Path) -> None:
    layout = h5py.VirtualLayout((4, 3), "f8")
    layout[:] = h5py.VirtualSource(str(secret), "points", (4, 3))
    file.create_group("deep").create_virtual_dataset("points", layout)


@pytest.mark.parametrize("points", [external, raw, virtual])
@pytest.mark.parametrize(("name", "user_block"), [("m.xdmf", 0), ("m.h5m", 0), ("m.h5m", 1024)])
def test_hdf5_that_stores_its_arrays_elsewhere_is_refused(
    tmp_path: Path, points: Any, name: str, user_block: int
) -> None:
    secret = tmp_path / "elsewhere" / "secret.h5"
    secret.parent.mkdir()
    with h5py.File(secret, "w") as file:
        file["points"] = np.ones((4, 3))
    (tmp_path / "m.xdmf").write_text(XDMF.format("m.h5"))
    path = tmp_path / ("m.h5" if name == "m.xdmf" else name)
    with h5py.File(path, "w", userblock_size=user_block) as file:
        points(file, secret)
    with pytest.raises(MeshError, match="points' is stored in another file, which is not opened"):
        read_here(tmp_path / name)


def test_a_data_file_that_is_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "m.h5").symlink_to(tmp_path / "other.h5")
    (folder / "m.xdmf").write_text(XDMF.format("m.h5"))
    with pytest.raises(MeshError, match="outside of its folder; move it next to"):
        read_here(folder / "m.xdmf")


@pytest.mark.parametrize("suffix", ["vtu", "xdmf"])
def test_entities_are_refused_before_they_grow(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"m.{suffix}"
    path.write_text('<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaa">]><VTKFile>&a;</VTKFile>')
    with pytest.raises(MeshError, match="XML entities"):
        read_here(path)


def test_a_plain_file_is_read_as_before(tmp_path: Path) -> None:
    (tmp_path / "m.inp").write_text(INP)
    assert [kind for kind, _ in read_mesh_file(tmp_path / "m.inp").blocks] == ["tetra"]


@cache
def sound(suffix: str) -> bytes:
    """Two tetrahedra as a file of each kind."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    marks = {"fixed": np.array([1, 1, 1, 0, 0]), "contact": np.array([0, 0, 0, 1, 1])}
    cells = [("tetra", np.array([[0, 1, 2, 3], [1, 4, 2, 3]]))]
    mesh = meshio.Mesh(points, cells, point_data=marks, cell_data={"region": [np.array([0, 0])]})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"m.{suffix}"
        if suffix == "msh":
            mesh.write(path, file_format="gmsh22", binary=False)
        else:
            mesh.write(path)
        return path.read_bytes()


@given(st.data(), st.sampled_from(["vtu", "vtk", "msh", "inp"]))
def test_damage_to_a_mesh_file_never_escapes_as_anything_but_an_error(
    data: st.DataObject, suffix: str
) -> None:
    content = bytearray(sound(suffix))
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"m.{suffix}"
        path.write_bytes(bytes(content[: data.draw(st.integers(0, len(content)))]))
        try:
            with mock.patch.object(mesh_source, "read_mesh_file", read_here):  # a process for each takes long
                limb = MeshioSource(MeshioSettings()).load(path, Spot(name="p1"))
            check_limb(limb, ["soft_tissue"])
        except PalpateError:
            return
    assert np.isfinite(limb.mesh.points_mm).all()
    assert max(int(cells.max()) for cells in limb.mesh.cells.values()) < limb.mesh.n_nodes


def legacy(words: list[str], kind: bytes) -> bytes:
    """A tetrahedron as VTK 9 writes it, under an array of words and one of numbers."""

    def numbers(given: Any, of: str) -> bytes:
        values = np.asarray(given).ravel()
        return (
            " ".join(map(str, values)).encode() if kind == b"ASCII" else values.astype(of).tobytes()
        ) + b"\n"

    def packed(word: bytes) -> bytes:
        size = len(word)
        return (0xC0 | size).to_bytes(1) + word if size < 64 else (0x8000 | size).to_bytes(2) + word

    words_of = [word.encode() for word in words]
    if kind == b"ASCII":
        text = b"".join(word.replace(b" ", b"%20") + b"\n" for word in words_of)
    else:
        text = b"".join(map(packed, words_of)) + b"\n"
    parts = [
        b"# vtk DataFile Version 5.1\nvtk output\n%b\nDATASET UNSTRUCTURED_GRID\n" % kind,
        b"FIELD FieldData 2\nmade%%20by 1 %d string\n%bMETADATA\nINFORMATION 0\n\n" % (len(words), text),
        b"TIME 1 1 double\n%bMETADATA\nINFORMATION 0\n\n" % numbers([0.5], ">f8"),
        b"POINTS 4 float\n" + numbers(np.eye(4)[:, :3], ">f4"),
        b"CELLS 2 4\nOFFSETS vtktypeint64\n" + numbers([0, 4], ">i8"),
        b"CONNECTIVITY vtktypeint64\n" + numbers(range(4), ">i8"),
        b"CELL_TYPES 1\n" + numbers([10], ">i4"),
        b"CELL_DATA 1\nFIELD FieldData 2\nNULL_ARRAY\nlabel 1 1 int\n" + numbers([7], ">i4"),
    ]
    return b"".join(parts)


@given(st.lists(st.text("ab 1\x8a", max_size=300), max_size=6), st.sampled_from([b"ASCII", b"BINARY"]))
@example(["\n" + "a" * 265, "", "POINTS 3"], b"BINARY")
@example(["", "a", ""], b"ASCII")
def test_words_in_a_legacy_file_are_passed_over(words: list[str], kind: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m.vtk"
        path.write_bytes(legacy(words, kind))
        found = read_here(path)
        np.testing.assert_array_equal(found.points, np.eye(4)[:, :3])
        assert [(name, cells.tolist()) for name, cells in found.blocks] == [("tetra", [[0, 1, 2, 3]])]
        assert {name: values[0].tolist() for name, values in found.cell_data.items()} == {"label": [7]}


def test_an_array_of_another_type_is_named(tmp_path: Path) -> None:
    (tmp_path / "m.vtk").write_bytes(legacy([], b"ASCII").replace(b"label 1 1 int", b"label 1 1 variant"))
    with pytest.raises(MeshError, match=r"'label 1 1 variant' gives no numbers that are read; .* as \.vtu"):
        read_here(tmp_path / "m.vtk")


def test_a_file_too_large_to_be_a_segment_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "m.inp").write_text(INP)
    monkeypatch.setattr(mesh_files, "MOST_BYTES", 10)
    with pytest.raises(MeshError, match="keep only the segment around the spot"):
        read_mesh_file(tmp_path / "m.inp")


def bomb(path: Path, n_megabytes: int) -> Path:
    """A VTU of one tetrahedron whose point data unpack to zeros without end."""
    meshio.Mesh(np.eye(4)[:, :3], [("tetra", [[0, 1, 2, 3]])], point_data={"x": np.zeros(4)}).write(path)
    blocks = [zlib.compress(bytes(1_000_000), 9)] * n_megabytes
    sizes = np.array([len(blocks), 1_000_000, 1_000_000, *map(len, blocks)], dtype="<u4")
    data = base64.b64encode(sizes.tobytes()) + base64.b64encode(b"".join(blocks))
    text, n = re.subn(rb'(Name="x"[^>]*>)[^<]*', lambda found: found.group(1) + data, path.read_bytes())
    assert n == 1
    path.write_bytes(text)
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are kept on Linux")
def test_a_mesh_that_unpacks_to_more_than_its_memory_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mesh_files, "MOST_MEMORY_MB", 600.0)
    with pytest.raises(MeshError, match=r"b\.vtu: reading failed \((too little memory|exit code)"):
        read_mesh_file(bomb(tmp_path / "b.vtu", 700))


def test_a_mesh_read_in_a_subprocess_is_what_meshio_reads(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    content = {"fibre": [np.eye(3)[:1]], "region": [np.array([7])]}
    mesh = meshio.Mesh(np.eye(4)[:, :3], [("tetra", [[0, 1, 2, 3]])], cell_data=content)
    mesh.write(path)
    link = tmp_path / "elsewhere" / "link.vtu"
    link.parent.mkdir()
    link.symlink_to(path)
    here = read_here(path)
    for there in (read_mesh_file(path), read_mesh_file(link)):
        np.testing.assert_array_equal(there.points, here.points)
        assert [kind for kind, _ in there.blocks] == ["tetra"]
        for name, blocks in here.cell_data.items():
            np.testing.assert_array_equal(there.cell_data[name], blocks)


def test_blocks_of_exodus_are_groups(tmp_path: Path) -> None:
    netcdf = pytest.importorskip("netCDF4")
    points = np.vstack([np.eye(4)[:, :3], [[1.0, 1.0, 1.0]]])
    blocks = [("tetra", np.array([[0, 1, 2, 3]])), ("tetra", np.array([[0, 2, 1, 4]]))]
    meshio.Mesh(points, blocks).write(tmp_path / "m.e")
    assert {k: [len(r) for r in v] for k, v in read_here(tmp_path / "m.e").cell_sets.items()} == {
        "block 0": [1, 0],
        "block 1": [0, 1],
    }
    with netcdf.Dataset(tmp_path / "m.e", "a") as file:
        file.createDimension("len_name", 8)
        names = file.createVariable("eb_names", "S1", ("num_el_blk", "len_name"))
        names[:] = netcdf.stringtochar(np.array(["fat", "skin"], dtype="S8"))
    assert [*read_here(tmp_path / "m.e").cell_sets] == ["fat", "skin"]
    with netcdf.Dataset(tmp_path / "m.e", "a") as file:
        file.variables["eb_names"][1] = file.variables["eb_names"][0]
    assert [*read_here(tmp_path / "m.e").cell_sets] == ["fat 0", "fat 1"]


def test_a_version_of_gmsh_that_is_not_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "m.msh").write_text("$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n0 0\n$EndNodes\n")
    with pytest.raises(MeshError, match=r"save it as version 4\.1 or 2\.2"):
        read_here(tmp_path / "m.msh")
