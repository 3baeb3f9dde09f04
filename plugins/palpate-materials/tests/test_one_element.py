"""Cauchy stress of FEBio under prescribed deformation, every row to 1e-8."""

import csv
from functools import cache
from pathlib import Path

import jax
import numpy as np
import pytest

from palpate import mechanics
from palpate_materials import NeoHookean, Ogden, Yeoh

FILE = Path(__file__).parent / "data" / "one_element_febio" / "one_element_febio.csv"
COMPONENTS = {"sxx": (0, 0), "syy": (1, 1), "szz": (2, 2), "sxy": (0, 1), "syz": (1, 2), "sxz": (0, 2)}
MATERIALS = {"ogden": Ogden(), "yeoh": Yeoh(), "yeoh_raw": Yeoh(), "neo_hookean": NeoHookean()}
WRITTEN = {
    "ogden": [0.061, 3.1, 1.3],
    "yeoh": [0.0129, -1e-3, 9.2e-5, 0.6],
    "yeoh_raw": [0.0129, -1e-3, 9.2e-5, 0.6],
    "neo_hookean": [0.0735, 0.4434],
}
CAUCHY = jax.jit(mechanics.cauchy_stress, static_argnums=0)
MODES = ["uniaxial_isochoric", "simple_shear", "volumetric", "general"]


def deformation(mode, s):
    e = s - 1.0
    return {
        "uniaxial_isochoric": lambda: np.diag([s, s**-0.5, s**-0.5]),
        "simple_shear": lambda: np.array([[1.0, e, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "volumetric": lambda: (1.0 + 0.1 * e) * np.eye(3),
        "general": lambda: np.array(
            [[s, 0.2 * e, 0.0], [0.1 * e, 1.0 - 0.3 * e, 0.15 * e], [0.0, 0.05 * e, 1.0 - 0.25 * e]]
        ),
    }[mode]()


@cache
def rows(material, mode):
    with FILE.open() as stream:
        return [r for r in csv.DictReader(stream) if (r["material"], r["mode"]) == (material, mode)]


def deviation(material, mode, theta):
    """Largest deviation of each row, relative to its largest stress (at rest: to 1e-6 MPa)."""
    table = rows(material, mode)
    F = np.array([deformation(mode, float(r["stretch"])) for r in table])
    stress = np.asarray(CAUCHY(MATERIALS[material], F, np.asarray(theta)))
    expected = np.array([[float(r[c]) for c in COMPONENTS] for r in table])
    computed = np.array([[s[ij] for ij in COMPONENTS.values()] for s in stress])
    scale = np.maximum(np.abs(expected).max(axis=1), 1e-6)
    return np.abs(computed - expected).max(axis=1) / scale


def test_every_row_is_compared():
    assert sum(len(rows(material, mode)) for material in MATERIALS for mode in MODES) == 220


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("material", MATERIALS)
def test_stress_is_febios(material, mode):
    convention = "febio4" if material == "yeoh_raw" else "textbook"
    theta = MATERIALS[material].to_textbook(np.array(WRITTEN[material]), convention)
    assert deviation(material, mode, theta).max() < 1e-8


@pytest.mark.parametrize("mode", ["uniaxial_isochoric", "simple_shear", "general"])
def test_febios_yeoh_is_not_the_textbooks(mode):
    assert deviation("yeoh_raw", mode, WRITTEN["yeoh_raw"]).max() > 1e-3
