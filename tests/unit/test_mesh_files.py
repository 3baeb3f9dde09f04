"""A mesh file never has files of other folders read, nor entities expanded."""

from pathlib import Path

import pytest

from palpate.errors import MeshError
from palpate_forearm.mesh_files import read_mesh_file

INP = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n"
XDMF = '<Xdmf Version="3.0"><Domain><Grid><DataItem Format="HDF">{}:/points</DataItem></Grid></Domain></Xdmf>'


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("m.inp", INP + "*INCLUDE, INPUT=/etc/hostname\n"),
        ("m.inp", INP + "*include , input = ../other.inp\n"),
        ("m.xdmf", XDMF.format("../other.h5")),
        ("m.xmf", XDMF.format("/data/other.h5")),
    ],
)
def test_a_file_elsewhere_is_refused_by_name(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
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
