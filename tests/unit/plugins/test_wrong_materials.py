"""A material that declares wrong parameters is refused where it is registered, by the plugin's name."""

import pytest

from palpate.plugins.catalogue import Plugins

from .conftest import Write

MATERIAL = """
from palpate import IsotropicMaterial, Parameter, hookimpl

class M(IsotropicMaterial):
    name, summary = "m", "a material"
    parameters = (
        Parameter(name="mu", unit="MPa", lower=0.1, upper=1.0, kind="modulus", description="shear modulus"),
        Parameter(name="kappa", unit="kPa", lower=0.1, upper=1.0, kind="modulus", description="bulk modulus"),
    )

    def energy(self, stretches, theta):
        return 0.0

@hookimpl
def palpate_materials():
    return [M]
"""


@pytest.mark.parametrize(
    ("old", "new", "reason", "remedy"),
    [
        ("MPa", "Mpa", "parameter 'mu': a modulus in unit 'Mpa'", 'use unit="MPa"'),
        ("MPa", "mm", "parameter 'mu': a modulus in unit 'mm'", 'use unit="MPa"'),
        ("MPa", "", "parameter 'mu': a modulus in unit ''", 'use unit="MPa"'),
        ('"modulus"', '"stiffness"', "unknown kind 'stiffness'", "choose one of: modulus, shape"),
        ('"kappa"', '"mu"', "material 'm' has two parameters 'mu'", "rename one"),
        ('"kappa"', '"a b"', "parameter name 'a b' of material 'm' is no identifier", "use letters, digits"),
        ("    )\n\n", '    "nu")\n\n', "entry 3 of the parameters of material 'm' is 'nu'", "give a palpate"),
        ("parameters =", "other =", "material 'm' has no parameters", "give it a tuple"),
        ('"m"', '"my m"', "name 'my m' of class M is no identifier", "use letters, digits"),
    ],
)
def test_a_wrong_material_is_refused(write: Write, old: str, new: str, reason: str, remedy: str) -> None:
    assert old in MATERIAL
    plugins = Plugins.load([write("lab", MATERIAL.replace(old, new))], entry_points=False)
    (broken,) = plugins.broken
    assert broken.name == "lab"
    assert reason in broken.reason
    assert remedy in broken.reason
    assert not plugins.materials


def test_a_modulus_may_be_in_any_unit_of_pressure(write: Write) -> None:
    assert Plugins.load([write("lab", MATERIAL)], entry_points=False).broken == ()
