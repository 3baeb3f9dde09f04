"""The study of skin over soft tissue, pressed and twisted by a sphere, with curves of a known truth."""

from collections.abc import Mapping

from palpate.cli.app import main as palpate

TRUTH = {"skin.E": 0.15, "soft_tissue.c1": 0.009}
"""Moduli [MPa]."""

SPOT = """
[[spot]]
name = "NAME"
measured = "MEASURED"
mesh = "MESH"
"""
STUDY = """
[study]
name = "skin-over-tissue"
description = "skin and soft tissue of a simulated limb"
data = "simulated"
SPOTS
[experiment]
loader = "csv"

[limb]
source = "meshio"

[limb.settings]
regions = { skin = 0, soft_tissue = 1 }

[protocol]
indenter = { shape = "sphere", radius = "RADIUS" }
depth = "DEPTH"
twist = ["-TWIST", "TWIST", "0 deg"]
friction = 1.0

[region.skin]
material = "neo_hookean"

[region.skin.parameters]
E = SKIN_E
nu = 0.45

[region.soft_tissue]
material = "yeoh"

[region.soft_tissue.parameters]
c1 = TISSUE_C1
c2 = "-0.6 kPa"
c3 = "0.06 kPa"
kappa = "0.5 MPa"

[sampling]
n_sets = 0
seed = 1

[selection]
scenarios = ["I", "II", "III"]
generalise_by = "I"

[truth]
skin.E = "0.15 MPa"
soft_tissue.c1 = "9 kPa"
"""


def study(
    files: Mapping[str, tuple[str, str]],
    press: tuple[str, str, str],
    ranges: tuple[str, str],
    tables: str,
) -> str:
    """The study of each spot's curves and mesh.

    ``press`` has the sphere's radius, the depth and the angle of the twist, ``ranges`` those of the skin's E
    and the tissue's c1; ``tables`` are further ones.
    """
    spots = "".join(
        SPOT.replace("NAME", name).replace("MEASURED", measured).replace("MESH", mesh)
        for name, (measured, mesh) in files.items()
    )
    text = STUDY
    keys = ("RADIUS", "DEPTH", "TWIST", "SKIN_E", "TISSUE_C1", "SPOTS")
    for key, value in zip(keys, (*press, *ranges, spots), strict=True):
        text = text.replace(key, value)
    return text + tables


def call(*arguments: str) -> None:
    """Call palpate, or end."""
    if palpate(list(arguments)):
        raise SystemExit(f"palpate {' '.join(arguments)} failed")
