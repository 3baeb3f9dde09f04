"""Recorded results of FEBio: the stress of one element, and the curves of a sphere on a block.

An element under prescribed deformation compares palpate's energies. A sphere that is glued to a block, and
one that presses it without friction, compare whole solvers.
"""

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from importlib.resources import files
from typing import Any

import numpy as np

from palpate.api import FloatArray, Limb, Material, PalpateError, mechanics
from palpate.api.mesh import block
from palpate_febio.api import COMPONENTS, TOLERANCE, FebioSolver
from solver_comparison.comparison import COUPLED, ENERGIES, RECORDED, Case, Contender, Row, compared


def _text(name: str) -> str:
    return files("solver_comparison").joinpath(f"data/{name}").read_text()


# ----------------------------------------------------------------- one element

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
    return tuple(csv.DictReader(_text("one_element.csv").splitlines()))


def recorded_deviation(material: Material, rows_of: str, theta: FloatArray) -> float:
    """Largest deviation of the stress from the recorded one, relative to each row's largest component."""
    rows = [row for row in _table() if row["material"] == rows_of and float(row["stretch"]) != 1.0]
    F = np.array([deformation(row["mode"], float(row["stretch"])) for row in rows])
    stress = np.asarray(mechanics.cauchy_stress(material, F, theta))
    computed = np.stack([stress[:, i, j] for i, j in COMPONENTS], axis=1)
    expected = np.array([[float(row[c]) for c in COLUMNS] for row in rows])
    return float((np.abs(computed - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


def one_element(material: Material, febio: FebioSolver | None) -> Iterator[Row]:
    """Rows of palpate's stress, against the record and an installed FEBio."""
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


# --------------------------------------------------------------------- a block

BONDED_RADIUS_MM = 5.0
BONDED_TIMES = (0.6, 1.0, 2.0, 4.0)
"""Half depth, full depth, and both ends of the twist."""

FRICTIONLESS_TIMES = (0.5, 1.0)
BONDED_TOLERANCE = 1e-3
FRICTIONLESS_TOLERANCE = 1e-2
FEBIO_NAMES: Mapping[str, str] = {"kappa": "k", "nu": "v"}
NAMES = ("ogden", "yeoh", "neo_hookean", "layered")
SKIN_MM = 2.0
"""Between the first and second layer of elements, as in the recorded skin."""


def block_rows(
    name: str, materials: Mapping[str, type[Material]], contenders: Mapping[str, Contender]
) -> Iterator[Row]:
    """Rows of every solver, against the recorded curves of one material or of ``layered``."""
    for kind in ("bonded", "frictionless"):
        about = json.loads(_text(f"{kind}_{name}.json"))
        case, rows = _case(kind, name, about, materials)
        press = rows[rows[:, 1] == 0.0]
        references = {"force": (press[:, 0].tolist(), press[:, 2], float(about["peak_force"]))}
        note = "the facets of FEBio's sphere change the force by up to 0.5 %"
        tolerance = FRICTIONLESS_TOLERANCE
        if kind == "bonded":
            twist = rows[rows[:, 1] != 0.0]
            peak = float(np.abs(about["torque"]).max())
            references["torque"] = (twist[:, 1].tolist(), twist[:, 3], peak)
            note, tolerance = "", BONDED_TOLERANCE
        yield from compared(case, contenders, references, tolerance, note)


def _case(
    kind: str, name: str, about: Mapping[str, Any], materials: Mapping[str, type[Material]]
) -> tuple[Case, FloatArray]:
    """The case and FEBio's rows (depth, rotation, force, torque) to compare at."""
    times = BONDED_TIMES if kind == "bonded" else FRICTIONLESS_TIMES
    table = csv.DictReader(_text(f"{kind}_{name}.csv").splitlines())
    columns = ("depth_mm", "angle_deg", "force_N", "torque_Nmm")
    rows = np.array([[float(r[c]) for c in columns] for r in table if float(r["time"]) in times])
    given = {region: materials[kind_of]() for region, (kind_of, _) in about["materials"].items()}
    thetas = {
        region: np.array([numbers[FEBIO_NAMES.get(p.name, p.name)] for p in given[region].parameters])
        for region, (_, numbers) in about["materials"].items()
    }
    case = Case(
        problem={"bonded": "bonded punch", "frictionless": "frictionless press"}[kind],
        name=name,
        limb=_limb(name, bonded=kind == "bonded"),
        materials=given,
        thetas=thetas,
        path=np.vstack([np.zeros((1, 2)), rows[:, :2]]),
        friction=0.0,
        mean_dilatation=tuple(r for r, m in given.items() if m.name not in COUPLED),
    )
    return case, rows


def _limb(name: str, *, bonded: bool) -> Limb:
    layers = {"skin": SKIN_MM} if name == "layered" else {}
    limb = block(n_across=18, n_down=9, grading=1.3, layers_mm=layers)
    if not bonded:
        return limb
    points = limb.mesh.points_mm
    glued = (np.hypot(points[:, 0], points[:, 1]) <= BONDED_RADIUS_MM + 1e-9) & (points[:, 2] == 0.0)
    sets = {**limb.mesh.node_sets, "bonded": np.flatnonzero(glued)}
    return replace(limb, mesh=replace(limb.mesh, node_sets=sets))
