"""Every distribution declares the libraries that it imports, and no others."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PLUGINS = sorted(path.parent for path in ROOT.glob("plugins/*/pyproject.toml"))
FOLDERS = (ROOT, *PLUGINS, ROOT / "examples" / "palpate-multis")
PARTS = {"dask": "distributed", "markupsafe": "jinja2", "pydantic-core": "pydantic"}
"""Libraries that come with the one that is declared."""
LOADED_BY_NAME = {"embreex": "by trimesh", "pytetwild": "in a process of its own", "rtree": "by trimesh"}


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", name)[0]).lower()


def modules(folder: Path) -> Iterator[str]:
    """Top-level modules that the sources of a distribution import."""
    for path in (folder / ("python" if folder == ROOT else "src")).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or ""]
            yield from (name.split(".")[0] for name in names)


@pytest.fixture(scope="module")
def homes() -> Mapping[str, list[str]]:
    """Distributions by the modules that they bring: all of the environment is read for it."""
    return packages_distributions()


@pytest.mark.slow
@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_it_declares_what_it_imports(folder: Path, homes: Mapping[str, list[str]]) -> None:
    project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = set(map(plain, project["dependencies"]))
    optional = {plain(name) for names in project.get("optional-dependencies", {}).values() for name in names}
    used = {plain(homes.get(name, [name])[0]) for name in set(modules(folder)) - sys.stdlib_module_names}
    used = {PARTS.get(name, name) for name in used} - {project["name"]}
    assert not used - needed - optional, "declare these in pyproject.toml"
    libraries = {name for name in needed if not name.startswith("palpate")}
    assert not libraries - used - LOADED_BY_NAME.keys(), "remove these from pyproject.toml"


ALONE = """
import importlib, pkgutil, sys


class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {missing!r}:
            raise ModuleNotFoundError(f"{{name}} is not installed")


sys.meta_path.insert(0, Missing())
import palpate

for module in pkgutil.walk_packages(palpate.__path__, "palpate."):
    if module.name != "palpate.__main__":
        importlib.import_module(module.name)
names = [palpate.api, *(importlib.import_module(f"palpate.api.{{each.name}}")
                        for each in pkgutil.iter_modules(palpate.api.__path__))]
for room in names:
    for name in dir(room):
        getattr(room, name)
print(*palpate.Plugins.load(entry_points=False).broken)
"""


@pytest.mark.slow
def test_the_core_works_without_its_plugins_and_their_libraries() -> None:
    made_of_a_fit = {"palpate_certainty", "palpate_planning", "palpate_prediction", "palpate_report"}
    missing = made_of_a_fit | {"PIL", "jinja2", "matplotlib", "plotly"}
    code = ALONE.format(missing=missing)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr
