"""FEBio is found, and asked for its version; other programs are refused."""

import os
from pathlib import Path

import pytest

from palpate.errors import PluginError
from palpate_febio.binary import examine, find_binary


def test_found_by_setting_then_on_the_path(tmp_path, monkeypatch, install_febio):
    on_path, named = install_febio(tmp_path / "bin"), install_febio(tmp_path / "other", "mine")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert find_binary() == on_path
    assert find_binary(str(named)) == named


def test_found_in_the_usual_places(tmp_path, monkeypatch, install_febio):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    there = install_febio(tmp_path / "FEBioStudio2" / "bin")
    assert find_binary() == there


def test_missing_names_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(PluginError, match=r"febio\.org"):
        find_binary()
    with pytest.raises(PluginError, match="setting executable"):
        find_binary("no_such_febio")


def test_version_and_remark(tmp_path, monkeypatch, install_febio):
    program = install_febio(tmp_path)
    monkeypatch.setenv("FAKE_FEBIO", "")
    binary = examine(program)
    assert binary.version == "4.11.0.65622b536"
    assert binary.remark == ""
    monkeypatch.setenv("FAKE_FEBIO", "version=4.20.1")
    assert "was not measured" in examine(program).remark


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("version=3.9.0", "FEBio 3.9.0.*4.0 deck"),
        ("version=5.0", "FEBio 5.0"),
        ("say_nothing", "does not say"),
    ],
)
def test_other_programs_are_refused(tmp_path, monkeypatch, words, message, install_febio):
    monkeypatch.setenv("FAKE_FEBIO", words)
    program = Path("/bin/true") if words == "say_nothing" else install_febio(tmp_path)
    with pytest.raises(PluginError, match=message):
        examine(program)


def test_the_digest_covers_the_libraries(tmp_path, monkeypatch, install_febio):
    monkeypatch.setenv("FAKE_FEBIO", "")
    program = install_febio(tmp_path / "bin")
    before = examine(program).digest
    assert examine(program).digest == before
    (tmp_path / "lib").mkdir()
    library = tmp_path / "lib" / "libfebiomech.so"
    library.write_bytes(b"one")
    with_library = examine(program).digest
    library.write_bytes(b"two")
    assert len({before, with_library, examine(program).digest}) == 3
    assert os.access(program, os.X_OK)
