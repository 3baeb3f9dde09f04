"""Recorded curves of FEBio on a block: a glued sphere, and one that presses without friction."""

import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np

from palpate.api import FloatArray, Limb, Material
from palpate.specimens import block
from palpate_validation.comparison import COUPLED, Case, Contender, Row, compared

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
    """Every solver against the recorded curves of one material, or of ``layered``."""
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


def _text(name: str) -> str:
    return files("palpate_validation").joinpath(f"data/{name}").read_text()


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
