"""A third party's plugin: installed from its own folder, used in a study, removed, and gone."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import palpate

from .conftest import Call

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "palpate-fibre"
STUDY = """\
import json, sys
from dataclasses import replace
import palpate
plugins = palpate.Plugins.load()
study = replace(palpate.read_study(sys.argv[1], plugins), n_sets=32)
result = palpate.run_study(study, sys.argv[2], plugins, without=["report"])
chosen = result.selected.selection
print(json.dumps([plugins.materials.provider("reinforced"), *chosen.to_dicts()]))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder that the example is installed to, as into any environment, but this one."""
    folder = tmp_path_factory.mktemp("environment")
    copy = folder / "source"
    shutil.copytree(EXAMPLE, copy)  # building leaves files behind
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    target = folder / "site-packages"
    command = [sys.executable, "-m", "pip", "install", *options, "--target", str(target), str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


def run(site: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a program where ``site`` is one of the environment's folders."""
    own = [str(Path(palpate.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site), *filter(None, own)])}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_it_is_used_in_a_study_and_leaves_with_its_folder(
    installed: Path, call: Call, tmp_path: Path
) -> None:
    done = run(installed, STUDY, str(EXAMPLE / "study"), str(tmp_path / "run"))
    assert done.returncode == 0, done.stderr
    provider, both, strip_only = json.loads(done.stdout)
    assert provider == "fibre"
    assert (both["scenario"], strip_only["scenario"]) == ("both", "strip only")
    assert both["fopt"] < 0.1
    assert strip_only["fopt"] == strip_only["nmse_uniaxial"] <= both["nmse_uniaxial"]

    shutil.rmtree(installed)
    refused = call("check", EXAMPLE / "study", plugin=None)
    assert refused.code == 2
    assert "no experiment loader 'strip'" in refused.err
    assert "no material 'reinforced'" in refused.err


@pytest.mark.slow
def test_its_tests_pass() -> None:
    path = os.pathsep.join([str(EXAMPLE / "src"), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider"],
        cwd=EXAMPLE,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
