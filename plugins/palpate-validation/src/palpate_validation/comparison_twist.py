"""Frictional twist: each solver is compared with itself at halved steps, then with others."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from palpate.api import PRESS_AND_TWIST, Channel, FloatArray, Limb, Material, Simulation, Status
from palpate_validation.comparison import Case, Contender, Row, answer
from palpate_validation.comparison_shared import moved_channels, pair_rows

DEPTH_MM = 2.0
TWIST_DEG = -22.5
STEP_DEG = 4.5
N_HELD = 5
TORQUE_TOLERANCE = 0.02


def _path(step_deg: float, n_held: int) -> FloatArray:
    """Down, twist with a waypoint at each step, hold, and a little back so that the hold is on the curve."""
    n = round(abs(TWIST_DEG) / step_deg)
    down = [(0.0, 0.0), (DEPTH_MM / 2, 0.0), (DEPTH_MM, 0.0)]
    twist = [(DEPTH_MM, TWIST_DEG * (k + 1) / n) for k in range(n)]
    held = [(DEPTH_MM, TWIST_DEG)] * n_held
    return np.array([*down, *twist, *held, (DEPTH_MM, TWIST_DEG + step_deg)])


def twist_rows(
    limb: Limb,
    material: Material,
    theta: FloatArray,
    contenders: Mapping[str, Contender],
    problem: str = "frictional twist",
    references: Collection[str] = (),
    channels: Collection[Channel] = PRESS_AND_TWIST,
) -> Iterator[Row]:
    """Step halving and a hold for every solver, and each against the first that agrees with itself.

    Parameters
    ----------
    limb : Limb
        Every region gets the same material.
    problem : str
        Its name in the rows.
    references : collection of str
        Solvers that others may be compared with; any if it is empty.
    channels : collection of Channel
        Those of them are compared that the path moves and both solvers compute.
    """
    case = Case.of_one_material(problem, limb, material, theta, _path(STEP_DEG, 0))
    case = replace(case, channels=moved_channels(case, channels))
    solvers = {name: make(case.mean_dilatation) for name, make in contenders.items()}
    answers: dict[str, Simulation] = {}
    sound: list[str] = []
    for name, solver in solvers.items():
        answers[name] = case.run(solver)
        fine = replace(case, path=_path(STEP_DEG / 2, N_HELD)).run(solver)
        rows = list(_with_itself(case, name, answers[name], fine))
        yield from rows
        if all(row.verdict == "agrees" for row in rows) and (not references or name in references):
            sound.append(name)
    for name in answers if sound else ():
        if name != sound[0] and answers[name].status is Status.OK:
            yield from pair_rows(case, solvers, answers, name, sound[0])


def _with_itself(case: Case, name: str, coarse: Simulation, fine: Simulation) -> Iterator[Row]:
    """Change by halved steps and by a hold, relative to the torque."""
    before, why = answer(coarse, "torque", [TWIST_DEG])
    after, why_fine = answer(fine, "torque", [TWIST_DEG])
    if before is not None and before[0] == 0.0:
        before, why = None, "its torque is 0 at the end of the twist"
    changes: dict[str, float | None] = {"steps halved": None, "hold": None}
    if before is not None and after is not None and fine.response is not None:
        curve, peak = fine.response["torque"], abs(float(before[0]))
        at_end = curve.ordinate[np.abs(curve.abscissa - TWIST_DEG) < 1e-6]
        changes["steps halved"] = abs(float(after[0] - before[0])) / peak
        changes["hold"] = abs(float(at_end[-1] - at_end[0])) / peak
    for what, change in changes.items():
        yield case.row(
            solver=name,
            quantity=f"torque: {what}",
            against="itself",
            difference=change,
            tolerance=TORQUE_TOLERANCE,
            note=why or why_fine,
            refused="refused" in coarse.diagnostics,
        )
