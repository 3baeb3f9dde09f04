"""What ``palpate doctor`` finds, and what it advises."""

import json
from types import SimpleNamespace

import pytest

from palpate.cli import doctor_checks as doctor
from palpate.cli.app import main
from palpate.plugins.catalogue import Plugins

BROKEN = "import palpate\n\n@palpate.hookimpl\ndef palpate_solverz():\n    return []\n"
SOLVERS = """
from pydantic import Field
from palpate import PalpateError, Settings, Solver, hookimpl


class Absent(Solver):
    name = "absent"
    summary = "a program that is not there"

    def version(self):
        raise PalpateError("no program 'absent'; install it")

    def simulate(self, job, limb): ...


class Needy(Absent):
    name = "needy"

    class Settings(Settings):
        file: str = Field(description="A file.")


@hookimpl
def palpate_solvers():
    return [Absent, Needy]
"""


@pytest.fixture
def examined(tmp_path):
    (tmp_path / "misspelt.py").write_text(BROKEN)
    (tmp_path / "programs.py").write_text(SOLVERS)
    plugins = Plugins.load([tmp_path / "misspelt.py", tmp_path / "programs.py"], entry_points=False)
    findings = doctor.examine(plugins, tmp_path / "not" / "yet")
    return {finding.what: finding for finding in findings}


def test_a_broken_plugin_is_listed_with_its_reason(examined):
    found = examined["misspelt"]
    assert found.level == "wrong"
    assert "did you mean 'palpate_solvers'" in found.found
    assert "misspelt.py" in found.advice


def test_a_missing_solver_is_a_note_with_its_remedy(examined):
    assert (examined["absent"].level, examined["absent"].advice) == (
        "note",
        "no program 'absent'; install it",
    )
    assert examined["needy"].found == "needs its settings file"


def test_versions_are_those_that_are_installed(examined):
    import numpy

    assert examined["numpy"].found == numpy.__version__
    assert all(examined[name].level == "fine" for name in doctor.LIBRARIES)


def test_a_missing_library_is_wrong(monkeypatch):
    monkeypatch.setattr(doctor, "LIBRARIES", ("no-such-library",))
    (found,) = [f for f in doctor._versions() if f.level == "wrong"]
    assert found.what == "no-such-library"
    assert "pip install no-such-library" in found.advice


def test_looking_leaves_nothing_behind(examined, tmp_path):
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix != ".csv") in (
        ["misspelt.py", "programs.py"],
        ["__pycache__", "misspelt.py", "programs.py"],
    )


def test_little_room_is_a_note():
    assert doctor._room("free memory", 100.0, "buy some").level == "note"
    assert doctor._room("free memory", 1e6, "buy some").advice == ""


def test_the_command_prints_it(capsys, tmp_path):
    assert main(["doctor", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {"topic", "what", "found", "level", "advice"} == set(found[0])
    assert {f["topic"] for f in found} == {"versions", "plugins", "solvers", "machine"}
    assert main(["doctor", str(tmp_path)]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_the_command_ends_with_1_where_something_is_wrong(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "misspelt.py").write_text(BROKEN)
    assert main(["--plugin", "misspelt.py", "doctor"]) == 1
    assert "1 wrong" in capsys.readouterr().out
    assert main(["--plugin", "misspelt.py", "doctor", "--json"]) == 1
    assert any(each["level"] == "wrong" for each in json.loads(capsys.readouterr().out))
    assert main(["doctor"]) == 0


def test_a_plugin_of_single_components_is_listed_by_its_distribution(monkeypatch):
    point = SimpleNamespace(
        group="palpate.materials",
        name="goh",
        value="goh:GOH",
        dist=SimpleNamespace(name="lab-goh", version="2"),
    )
    monkeypatch.setattr("palpate.cli.doctor_checks.installed_points", lambda: [point])
    found = doctor._plugins(Plugins.load(entry_points=False))
    assert [(each.what, each.found) for each in found] == [("lab-goh", "lab-goh 2")]


def test_a_folder_that_cannot_be_written_is_wrong(tmp_path, monkeypatch):
    monkeypatch.setattr(doctor.os, "access", lambda place, mode: False)
    (found,) = [f for f in doctor._machine(tmp_path / "runs") if f.level == "wrong"]
    assert f"{tmp_path} may not be written to" in found.found
    assert "--out" in found.advice
