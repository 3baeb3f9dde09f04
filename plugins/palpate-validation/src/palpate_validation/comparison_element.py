"""One element under prescribed deformation: the stress of palpate's energies against FEBio's."""

import csv
from collections.abc import Iterator, Mapping
from functools import cache, partial
from importlib.resources import files

import numpy as np

from palpate import mechanics
from palpate.api import FloatArray, Material, PalpateError
from palpate_febio.probe import COMPONENTS, TOLERANCE
from palpate_febio.solver import FebioSolver
from palpate_validation.comparison import ENERGIES, RECORDED, Row

RECORDED_VALUES: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "ogden": ("ogden", (0.061, 3.1, 1.3)),
    "yeoh": ("yeoh_raw", (0.0129, -1e-3, 9.2e-5, 0.6)),
    "neo_hookean": ("neo_hookean", (0.0735, 0.4434)),
}
"""Recorded rows by material, and the coefficients of the deck."""

COLUMNS = ("sxx", "syy", "szz", "sxy", "syz", "sxz")


def deformation(mode: str, s: float) -> FloatArray:
    """F (3, 3) of a recorded mode at its parameter ``s``; rest at 1."""
    e = s - 1.0
    if mode == "uniaxial_isochoric":
        return np.diag([s, s**-0.5, s**-0.5])
    if mode == "simple_shear":
        return np.eye(3) + e * np.outer([1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    if mode == "volumetric":
        return (1.0 + 0.1 * e) * np.eye(3)
    return np.array([[s, 0.2 * e, 0.0], [0.1 * e, 1.0 - 0.3 * e, 0.15 * e], [0.0, 0.05 * e, 1.0 - 0.25 * e]])


@cache
def _table() -> tuple[dict[str, str], ...]:
    text = files("palpate_validation").joinpath("data/one_element.csv").read_text()
    return tuple(csv.DictReader(text.splitlines()))


def recorded_deviation(material: Material, rows_of: str, theta: FloatArray) -> float:
    """Largest deviation of the stress from the recorded one, relative to each row's largest component."""
    rows = [row for row in _table() if row["material"] == rows_of and float(row["stretch"]) != 1.0]
    F = np.array([deformation(row["mode"], float(row["stretch"])) for row in rows])
    stress = np.asarray(mechanics.cauchy_stress(material, F, theta))
    computed = np.stack([stress[:, i, j] for i, j in COMPONENTS], axis=1)
    expected = np.array([[float(row[c]) for c in COLUMNS] for row in rows])
    return float((np.abs(computed - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


def one_element(material: Material, febio: FebioSolver | None) -> Iterator[Row]:
    """Palpate's stress against the record, and against an installed FEBio."""
    stress = partial(Row, problem="one element", material=material.name, quantity="stress", solver=ENERGIES)
    if material.name in RECORDED_VALUES:
        rows_of, sent = RECORDED_VALUES[material.name]
        numbers = np.array(sent)
        fits = {
            c: recorded_deviation(material, rows_of, material.to_textbook(numbers, c))
            for c in ("textbook", *material.conventions)
        }
        best = min(fits, key=lambda name: fits[name])
        note = f"convention {best}: " + ", ".join(f"{name} {value:.1e}" for name, value in fits.items())
        yield stress(against=RECORDED, difference=fits[best], tolerance=TOLERANCE, note=note)
    if febio is not None:
        difference, note, refused = None, "", False
        try:
            found = febio.convention(material)
            difference, note = found.deviations[found.convention], f"convention {found.convention}"
        except PalpateError as error:
            note, refused = str(error), True
        against = febio.version()
        yield stress(against=against, difference=difference, tolerance=TOLERANCE, note=note, refused=refused)
