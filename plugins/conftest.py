"""A stand-in for FEBio on the search path, for every plugin that runs it."""

import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent / "palpate-febio" / "tests" / "data" / "fake" / "fake_febio.py"


@pytest.fixture
def install_febio():
    """Install the stand-in as a program in a folder; it behaves as the variable FAKE_FEBIO says."""

    def install(folder, name="febio4"):
        folder.mkdir(parents=True, exist_ok=True)
        program = folder / name
        program.write_text(f"#!{sys.executable}\n{SOURCE.read_text()}")
        program.chmod(0o755)
        return program

    return install


@pytest.fixture
def fake_febio(tmp_path, monkeypatch, install_febio):
    """The stand-in as the first program of the search path, with an empty cache; counts its runs."""
    program = install_febio(tmp_path / "bin")
    monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("FAKE_FEBIO", "")
    monkeypatch.setenv("FAKE_FEBIO_COUNT", str(tmp_path / "count"))
    return program
