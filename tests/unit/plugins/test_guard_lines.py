"""A plugin's exception is reported with the line of its own file, and with a remedy that fits it."""

from pathlib import Path

import pytest

from palpate.errors import PluginError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for

from .conftest import Write

MATERIAL = """
from palpate import IsotropicMaterial, Parameter, hookimpl

def helper():
    raise RuntimeError("my table is missing")

class M(IsotropicMaterial):
    name, summary = "m", "a material"
    parameters = (
        Parameter(name="mu", unit="MPa", lower=0.1, upper=1.0, kind="modulus", description="shear modulus"),
    )

    def energy(self, stretches, theta):
        return helper()

    def other(self):
        return 0.0

@hookimpl
def palpate_materials():
    return [M]
"""


@pytest.fixture
def lab(write: Write, tmp_path: Path):
    path = write("lab", f"{MATERIAL}# {tmp_path}")  # a module is imported once per content
    return path, Plugins.load([path], entry_points=False).materials["m"]()


def test_the_line_is_in_the_plugin_though_another_package_called_it(lab) -> None:
    path, material = lab
    with pytest.raises(PluginError) as raised, answering_for(material, "energy at the ends"):
        material.energy(0.0, 0.0)  # from this module, whose lines are not the plugin's
    assert f"raised RuntimeError: my table is missing (line 5 of {path})" in str(raised.value)


def test_a_call_with_wrong_arguments_names_the_class(lab) -> None:
    path, material = lab
    with pytest.raises(PluginError) as raised, answering_for(material, "energy at the ends"):
        material.other(1)
    assert f"(class at line 7 of {path}); correct the plugin, or tell its author" in str(raised.value)


def test_a_missing_name_has_the_broken_plugin_before_the_known_names(write: Write) -> None:
    plugins = Plugins.load([write("lab", "def broken(:\n")], entry_points=False)
    with pytest.raises(
        PluginError, match=r"^no sampler 'my_lhs' .*SyntaxError.* did you mean 'lhs'.* \(known"
    ):
        plugins.samplers["my_lhs"]
