"""A mesh file never has files of other folders read, nor entities expanded."""

import tempfile
from functools import cache
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.domain import Spot
from palpate.errors import MeshError, PalpateError
from palpate.limb import check_limb
from palpate_forearm import MeshioSettings, MeshioSource, mesh_files
from palpate_forearm.mesh_files import read_mesh_file

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
    with pytest.raises(MeshError, match="outside of its folder; move it beside"):
        read_mesh_file(tmp_path / name)


@pytest.mark.parametrize("suffix", ["vtu", "xdmf"])
def test_entities_are_refused_before_they_grow(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"m.{suffix}"
    path.write_text('<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaa">]><VTKFile>&a;</VTKFile>')
    with pytest.raises(MeshError, match="XML entities"):
        read_mesh_file(path)


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


@settings(max_examples=120, deadline=None)
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
            limb = MeshioSource(MeshioSettings()).load(path, Spot(name="p1"))
            check_limb(limb, ["soft_tissue"])
        except PalpateError:
            return
    assert np.isfinite(limb.mesh.points_mm).all()
    assert max(int(cells.max()) for cells in limb.mesh.cells.values()) < limb.mesh.n_nodes


def test_a_file_too_large_to_be_a_segment_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "m.inp").write_text(INP)
    monkeypatch.setattr(mesh_files, "MOST_BYTES", 10)
    with pytest.raises(MeshError, match="keep the segment around the spot"):
        read_mesh_file(tmp_path / "m.inp")
