"""Packages whose names are imported when they are used."""

import subprocess
import sys

import pytest

from palpate.deferral import deferred


def test_a_name_comes_from_its_home_and_no_other_exists():
    get = deferred("palpate", {"Curve": "domain"})
    assert get("Curve").__module__ == "palpate.curves"
    with pytest.raises(AttributeError, match="module 'palpate' has no attribute 'Curv'"):
        get("Curv")


@pytest.mark.parametrize(
    "package",
    [
        "palpate",
        "palpate_materials",
        "palpate_forearm",
        "palpate_experiments",
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


def test_the_list_of_commands_imports_nothing_heavy():
    code = (
        "import sys; from palpate.cli.app import main; main(['--help'])\n"
        "heavy = {'numpy', 'pydantic', 'jax', 'polars', 'scipy', 'matplotlib', 'plotly', 'dask', 'trimesh'}\n"
        "print(*heavy & set(sys.modules), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == ""
