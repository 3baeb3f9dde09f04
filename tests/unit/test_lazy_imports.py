"""Packages whose names are imported when they are used."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from palpate import api
from palpate.lazy_imports import deferred


def test_names_are_the_re_exports_of_the_module():
    get = deferred("palpate.api")
    assert get("Curve").__module__ == "palpate.domain.curves"
    assert {"Curve", "hookimpl", "API_VERSION"} <= set(dir(api))
    with pytest.raises(AttributeError, match=r"module 'palpate\.api' has no attribute 'Curv'"):
        get("Curv")


def test_every_name_of_the_api_is_there():
    assert all(getattr(api, name) is not None for name in api.__all__)


@pytest.mark.parametrize(
    "package",
    [
        "palpate",
        "palpate.api",
        "palpate_materials",
        "palpate_forearm",
        "palpate_indentation",
        "palpate_robot_log",
        "palpate_limb",
        "palpate_febio",
        "palpate_dask",
        "palpate_jax",
    ],
)
def test_finding_a_plugin_imports_none_of_what_it_provides(package):
    code = f"import sys, {package}; print(*{{'numpy', 'pydantic', 'jax', 'polars'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


NATURAL = """
from palpate import Material, Parameter, Solver, hookimpl, mechanics

class {name}(Solver):
    name = "{name}"
    summary = "asks for moduli"

    def simulate(self, job, limb):
        return mechanics.initial_moduli(job.materials["a"], job.thetas["a"])

@hookimpl
def palpate_solvers():
    return [{name}]
"""


def test_plugins_that_name_mechanics_at_their_top_do_not_import_jax(tmp_path):
    files = []
    for name in ("one", "two", "three"):
        (tmp_path / f"{name}.py").write_text(NATURAL.format(name=name))
        files += ["--plugin", str(tmp_path / f"{name}.py")]
    code = (
        f"import sys; from palpate.cli.app import main; main([*{files!r}, '--help'])\n"
        "heavy = {'jax', 'polars', 'scipy', 'matplotlib', 'plotly'}\n"
        "print(*heavy & set(sys.modules), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == ""


def test_what_mechanics_offers_is_there_when_it_is_used():
    from palpate import mechanics

    assert all(getattr(mechanics, name) is not None for name in mechanics.__all__)
    with pytest.raises(AttributeError, match="no attribute 'stres'"):
        _ = mechanics.stres


@pytest.mark.parametrize("before", ["", "import jax.numpy\n"])
@pytest.mark.parametrize(
    "named", ["from palpate import mechanics", "from palpate.api.mechanics import Array"]
)
def test_what_a_plugin_compiles_itself_is_in_double_precision(before, named):
    """Also before mechanics is used, and in a plugin that imports JAX at its top, before palpate."""
    code = f"{before}{named}\nimport jax\nprint(jax.jit(lambda x: 2 * x)(1 / 3).dtype)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "float64"


def test_the_list_of_commands_imports_nothing_heavy():
    code = (
        "import sys; from palpate.cli.app import main; main(['--help'])\n"
        "heavy = {'numpy', 'pydantic', 'jax', 'polars', 'scipy', 'matplotlib', 'plotly', 'dask', 'trimesh'}\n"
        "print(*heavy & set(sys.modules), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize("command", ["init", "plugins", "doctor", "schema"])
def test_lists_of_what_plugins_provide_import_no_numerical_or_plotting_library(command, tmp_path):
    """SciPy's own ``import scipy`` is light; its sub-packages are not."""
    code = (
        f"import sys; from palpate.cli.app import main; main(['{command}'])\n"
        "heavy = {'jax', 'matplotlib', 'plotly', 'jinja2', 'meshio', 'trimesh', 'dask', 'h5py'}\n"
        "heavy |= {'scipy.' + part for part in ('linalg', 'ndimage', 'optimize', 'signal', 'sparse', "
        "'spatial', 'special', 'stats')}\n"
        f"heavy |= {{'polars'}} if '{command}' == 'init' else set()\n"
        "print('heavy:', *heavy & set(sys.modules), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert "heavy:\n" in done.stderr


@pytest.mark.parametrize("file", ["python/palpate/api/__init__.py", "plugins/README.md", "CHANGELOG.md"])
def test_the_version_that_a_text_names_is_the_one_that_exists(file):
    text = (Path(__file__).parents[2] / file).read_text(encoding="utf-8")
    assert set(re.findall(r"palpate_api = \((\d+), (\d+)\)", text)) == {tuple(map(str, api.API_VERSION))}


def test_a_card_and_the_answer_of_a_run_need_no_plotting_library():
    code = (
        "import importlib, pkgutil, sys, palpate_prediction.cards.programs, palpate_report.from_run\n"
        "from palpate.plugins.catalogue import Plugins; Plugins.load()\n"
        "from palpate_report import answer, data, sections\n"
        "for wing in (answer, data, sections):\n"
        "    for module in pkgutil.iter_modules(wing.__path__, wing.__name__ + '.'):\n"
        "        importlib.import_module(module.name)\n"
        "print(*{'matplotlib', 'plotly'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
