"""The command line with plugins: files, installed ones, and what they provide."""

import json
import re
from pathlib import Path

import pytest

from palpate.cli.app import COMMANDS, STAGES, split_option
from palpate.cli.options import name_of

from .conftest import PLUGIN, Call


def test_help_lists_every_command_and_those_of_plugins(call: Call) -> None:
    outcome = call("--help")
    assert outcome.code == 0
    for command in (*COMMANDS, *STAGES):
        assert f"  {name_of(command)} " in outcome.out
    assert "toy-hello" in outcome.out


def test_a_command_of_a_plugin_runs(call: Call) -> None:
    assert call("toy-hello").out == "hello from a plugin\n"


def test_a_command_whose_plugin_is_not_there_is_refused_with_where_it_is_from(call: Call) -> None:
    outcome = call("--no-plugin", "prediction", "predict", plugin=None)
    assert outcome.code == 2
    assert "no command 'predict'" in outcome.err
    assert "pip install 'palpate[standard]'" in outcome.err


@pytest.mark.parametrize(
    ("given", "rest", "files"),
    [
        (["--plugin", "a.py", "run", "s"], ["run", "s"], ["a.py"]),
        (["run", "s", "--plugin=a.py", "--plugin", "b.py"], ["run", "s"], ["a.py", "b.py"]),
        (["run", "--", "--plugin", "a.py"], ["run", "--", "--plugin", "a.py"], []),
        (["run", "--plugin"], ["run", "--plugin"], []),
    ],
)
def test_plugin_files_may_be_given_anywhere(given: list[str], rest: list[str], files: list[str]) -> None:
    assert split_option("--plugin", given) == (rest, files)


def test_a_missing_plugin_file_is_a_mistake(call: Call) -> None:
    outcome = call("plugins", plugin="nowhere.py")
    assert outcome.code == 2
    assert "nowhere.py: no such file" in outcome.err


def test_plugins_as_json_holds_everything(call: Call) -> None:
    found = call("plugins", "--json").json
    (spring,) = [entry for entry in found["materials"] if entry["name"] == "spring"]
    assert spring["plugin"] == "toy_plugin"
    assert spring["conventions"] == ["textbook", "doubled"]
    assert spring["parameters"][0] == {
        "name": "k",
        "unit": "MPa",
        "lower": 0.5,
        "upper": 4.0,
        "physical_lower": 0.0,
        "physical_upper": None,
        "kind": "modulus",
        "description": "stiffness",
    }
    (lines,) = [entry for entry in found["loaders"] if entry["name"] == "lines"]
    assert lines["settings"] == [
        {
            "name": "skip",
            "type": "integer",
            "default": 0,
            "required": False,
            "description": "Rows to skip at the top.",
        }
    ]


def test_plugins_by_kind_and_by_name(call: Call) -> None:
    kind = call("plugins", "set-filters").out
    assert "stiff" in kind
    assert "spring" not in kind
    one = call("plugins", "materials", "spring").out
    assert "stiffening" in one
    assert "conventions: textbook, doubled" in one
    (solver,) = call("plugins", "solvers", "closed_form", "--json").json["solvers"]
    assert solver["provides"]["body"] == "specimen"
    assert solver["provides"]["channels"] == ["pull", "push"]
    shown = call("plugins", "solvers", "on_mesh").out
    assert re.search(r"motions\W+depth, rotation\W", shown)
    assert re.search(r"max_regions\W+any\W", shown)
    assert call("plugins", "channels", "pull", "--json").json["channels"][0]["abscissa"] == "stretch"


SWITCHED = """
from pydantic import Field

from palpate import Settings, Solver, hookimpl
from palpate.api import Provides

class Switch(Settings):
    on_mesh: bool = Field({default}, description="Whether it takes a mesh.")

class Switched(Solver[Switch]):
    name, summary = "switched", "its settings decide what it provides"

    @property
    def provides(self):
        return Provides(body="mesh" if self.settings.on_mesh else "layers", max_regions=3)

    def simulate(self, job, limb):
        raise NotImplementedError

@hookimpl
def palpate_solvers():
    return [Switched]
"""


@pytest.mark.parametrize(("default", "body"), [("False", "layers"), ("True", "mesh"), ("...", None)])
def test_what_a_solver_provides_by_its_settings_is_that_of_their_defaults(
    call: Call, tmp_path: Path, default: str, body: str | None
) -> None:
    file = tmp_path / "switched.py"
    file.write_text(SWITCHED.format(default=default))
    (solver,) = call("plugins", "solvers", "switched", "--json", "--plugin", file).json["solvers"]
    assert solver["provides"].get("body") == body
    assert solver["provides"].get("max_regions") == (3 if body else None)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["material"], "did you mean 'materials'"), (["materials", "sprig"], "did you mean 'spring'")],
)
def test_plugins_that_do_not_exist(call: Call, arguments: list[str], message: str) -> None:
    outcome = call("plugins", *arguments)
    assert outcome.code == 2
    assert message in outcome.err


def test_a_broken_plugin_file_is_refused_with_its_line(call: Call, tmp_path: Path) -> None:
    bad = tmp_path / "bad.py"
    bad.write_text("def work():\n    import nowhere_at_all\n\nwork()\n")
    outcome = call("plugins", "--plugin", bad)
    assert outcome.code == 2
    reason = f"No module named 'nowhere_at_all' (line 2 of {bad})"
    assert "No module named 'nowhere_at_all'" in outcome.out
    assert f"plugin file {bad}: ModuleNotFoundError: {reason}" in outcome.err
    assert "spring" in outcome.out
    assert "in work" not in outcome.err
    assert "in work\n" in call("plugins", "--traceback", "--plugin", bad).err
    for command in (["check", "toy"], ["toy-hello"]):
        refused = call(*command, "--plugin", bad)
        assert (refused.code, reason in refused.err) == (2, True)
    found = call("plugins", "--json", "--plugin", bad).json
    assert [(b["name"], b["source"]) for b in found["broken"] if b["name"] == "bad"] == [("bad", str(bad))]


def test_a_study_names_plugin_files(call: Call, study: Path) -> None:
    file = study / "study.toml"
    text = file.read_text()
    (study / "springs.py").write_bytes(Path(PLUGIN).read_bytes())
    missing = call("check", study, plugin=None)
    assert missing.code == 2
    assert "if a file of yours provides it, give it as --plugin FILE or as [study] plugins" in missing.err
    file.write_text(text.replace('name = "toy"', 'name = "toy"\nplugins = ["springs.py"]', 1))
    assert call("experiment", study, "--out", "run", plugin=None).code == 0
    manifest = json.loads(Path("run/manifest.json").read_text())
    assert manifest["plugin_files"] == ["../study/springs.py"]
    assert "study/springs.py" in manifest["inputs"] or "springs.py" in manifest["inputs"]
    file.write_text(text.replace('name = "toy"', 'name = "toy"\nplugins = ["sprigs.py"]', 1))
    wrong = call("check", study, plugin=None)
    assert wrong.code == 2
    assert "[study] plugins" in wrong.err
    assert "sprigs.py: no such file" in wrong.err


def test_plugins_shows_commands(call: Call) -> None:
    assert "limb scan" in call("plugins", "commands").out
    assert "plugin: planning" in call("plugins", "commands", "next").out
    assert "did you mean 'extend'" in call("plugins", "commands", "extand").err


def test_an_installed_plugin_can_be_left_out(call: Call) -> None:
    found = call("--no-plugin", "palpate-materials", "plugins", "--json").json
    assert "yeoh" not in [m["name"] for m in found["materials"]]
    commands = {each["name"]: each["plugin"] for each in found["commands"]}
    assert commands["predict"] == "prediction"
    assert commands["limb scan"] == "limb"
    wrong = call("plugins", "--no-plugin=materails")
    assert wrong.code == 2
    assert "no plugin 'materails' is installed; did you mean 'materials'" in wrong.err
