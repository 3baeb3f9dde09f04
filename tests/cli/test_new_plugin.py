"""A new plugin of each kind passes its own tests at once; a name that cannot be is refused."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import palpate
from palpate import testing
from palpate.errors import PluginError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import HOOKS, KINDS
from palpate.plugins.scaffold import FIBRES, KITS, new_plugin

from .conftest import Call

NOTHING = Plugins.load(entry_points=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One plugin of each kind, side by side."""
    into = tmp_path_factory.mktemp("new plugins")
    return {kind: new_plugin(kind, f"my_{kind}", into, NOTHING) for kind in KITS}


def _run(arguments: list[str], folder: Path, paths: list[Path]) -> subprocess.CompletedProcess[str]:
    own = Path(palpate.__file__).parents[1]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (own, *paths)))}
    return subprocess.run(
        [sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_the_help_names_every_kind(call: Call) -> None:
    words = re.findall(r"\w+", call("new-plugin", "--help").out)
    assert set(KITS) <= set(words)


@pytest.mark.slow
def test_their_tests_pass_at_once(made: dict[str, Path]) -> None:
    folder = made["material"].parent
    sources, tests = zip(*((path / "src", path / "tests") for path in made.values()), strict=True)
    done = _run(
        ["-m", "pytest", "-q", "-rs", "-W", "error", "-p", "no:cacheprovider", *map(str, tests)],
        folder,
        [*sources, *(Path(path) for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path)],
    )
    assert done.returncode == 0, done.stdout + done.stderr
    skipped = [line for line in done.stdout.splitlines() if line.startswith("SKIPPED")]
    # What a component need not do.
    choices = (
        ": draws nothing",
        ": takes no cell fields",
        ": an anisotropic energy takes one deformation gradient",
        ": an anisotropic energy has no such symmetry",
        ": an anisotropic energy is called by JAX only",
        ": the solver declares no slopes",
        ": the solver declares no surface, or has no force",
    )
    assert all(line.endswith(choices) for line in skipped), skipped
    for kind in KITS:
        assert f"my_{kind}" in "".join(path.name for path in made[kind].glob("tests/*.py"))

        # Each runs a study: the scaffold of a solver once fitted none. The bench has no solver for fibres.
        if kind != FIBRES:
            assert (
                "def test_a_study_runs_with_it(" in (made[kind] / "tests" / f"test_my_{kind}.py").read_text()
            )


def test_the_generic_one_shows_every_hook_with_its_contract(made: dict[str, Path]) -> None:
    text = (made["generic"] / "src" / "palpate_my_generic" / "__init__.py").read_text()
    assert set(re.findall(r"^# (palpate_\w+)\(", text, flags=re.MULTILINE)) == HOOKS
    comments = " ".join(re.sub(r"\n#\s*", " ", text).split())
    assert "Returns classes of Score (from palpate.api.scores), tested by ScoreContract." in comments
    assert "Returns classes of Search (from palpate.api.fit), tested by SearchContract." in comments
    for kind in KINDS.values():
        assert not kind.contract or hasattr(testing, kind.contract)


@pytest.mark.slow
def test_their_code_is_typed(made: dict[str, Path]) -> None:
    root = Path(__file__).parents[2]
    packages = [str(path / "src") for path in made.values()]
    options = ["--strict", "--config-file", str(root / "pyproject.toml")]
    done = _run(["-m", "mypy", *options, "--cache-dir", str(root / ".mypy_cache"), *packages], root, [])
    assert done.returncode == 0, done.stdout
    assert all(list(path.glob("src/*/py.typed")) for path in made.values())


def test_they_are_licensed_and_bounded(made: dict[str, Path]) -> None:
    for folder in made.values():
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        assert project["license"] == "MIT"
        assert "Permission is hereby granted" in (folder / "LICENSE").read_text()
        assert "palpate>=0.1,<0.2" in project["dependencies"]
        assert all(needed.endswith(">=0.1,<0.2") for needed in project["dependencies"])


def test_their_code_is_clean(made: dict[str, Path]) -> None:
    """By their own settings, from within each folder as its author would."""
    for folder in made.values():
        done = _run(["-m", "ruff", "check", "."], folder, [])
        assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("kind", KITS)
def test_an_installer_finds_the_entry_point(made: dict[str, Path], kind: str) -> None:
    project = tomllib.loads((made[kind] / "pyproject.toml").read_text())["project"]
    assert project["name"] == f"palpate-my-{kind}"
    ((group, points),) = project["entry-points"].items()
    ((name, value),) = points.items()
    package, _, made_of = value.partition(":")
    assert package == f"palpate_my_{kind}"
    if kind == "generic":
        assert (group, name, made_of) == ("palpate", "my_generic", "")
        return
    assert group == f"palpate.{KITS[kind].catalogue}"
    assert (name, made_of) == (f"my_{kind}", f"My{kind.title()}")
    assert (made[kind] / "src" / f"palpate_my_{kind}" / "__init__.py").is_file()


def test_a_material_takes_thirty_lines(made: dict[str, Path]) -> None:
    code = (made["material"] / "src" / "palpate_my_material" / "__init__.py").read_text()
    assert len([line for line in code.splitlines() if line.strip()]) <= 30


def test_the_command_reports_what_it_wrote_and_what_to_do_next(call: Call, tmp_path: Path) -> None:
    outcome = call("new-plugin", "stage", "my_view", "--into", tmp_path / "here")
    assert outcome.code == 0, outcome.err
    assert "tests/test_my_view.py" in outcome.out
    assert "next: cd" in outcome.err
    reported = call("new-plugin", "stage", "other", "--into", tmp_path, "--json").json
    assert reported["folder"] == str(tmp_path / "palpate-other")
    assert (tmp_path / "palpate-other" / "src" / "palpate_other" / "__init__.py").is_file()


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("materail", "x", "no plugin of kind 'materail' can be made; did you mean 'material'"),
        ("material", "My Tissue", "in lower case that is no keyword, such as my_tissue"),
        ("material", "2nd", "such as my_2nd"),
        ("material", "class", "such as my_class"),
        ("material", "match", "such as my_match"),
        ("material", "tissue_", "such as tissue"),
        ("loader", "curve", "hide palpate's own Curve; choose another name, such as my_curve"),
        ("material", "../x", "such as x"),
        ("material", "yeoh", "material 'yeoh' is already provided; choose another"),
        (
            "scenario",
            "x",
            "(known: material, fibres, solver, loader, stage, generic; generic has every other hook)",
        ),
        ("stage", "fit", "stage 'fit' is already provided; choose another"),
        ("stage", "materials", "plugin name 'materials' is taken by distribution palpate-materials"),
        ("stage", "palpate", "choose another name"),
    ],
)
def test_a_name_that_cannot_be_is_refused(call: Call, kind: str, name: str, message: str) -> None:
    outcome = call("new-plugin", kind, name, plugin=None)
    assert outcome.code == 2
    assert message in outcome.err
    assert not list(Path.cwd().iterdir())


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "palpate-mine").mkdir()
    with pytest.raises(PluginError, match="palpate-mine: exists; choose another name"):
        new_plugin("stage", "mine", tmp_path, NOTHING)
    assert not list((tmp_path / "palpate-mine").iterdir())


def test_a_folder_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(PluginError, match="cannot be written"):
        new_plugin("stage", "mine", tmp_path / "file", NOTHING)


def test_its_development_group_has_what_its_contract_needs(made: dict[str, Path]) -> None:
    for folder in made.values():
        groups = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]
        assert any(each.startswith("palpate[testing]") for each in groups["dev"])
