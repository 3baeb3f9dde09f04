"""Solvers compared with each other along a frictional twist, in every channel that two of them provide.

Each solver is compared with itself at halved steps, then with the others. What two do not share is named.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.api import (
    PRESS_AND_TWIST,
    Channel,
    FloatArray,
    Limb,
    Material,
    Provides,
    Simulation,
    Solver,
    Status,
)
from solver_comparison.comparison import Case, Contender, Row, answer

DEPTH_MM = 2.0
TWIST_DEG = -22.5
STEP_DEG = 4.5
N_HELD = 5
TORQUE_TOLERANCE = 0.02

TOLERANCES = {"force": 0.01}
TOLERANCE = 0.05
"""Between two solvers with different contact, one with a faceted sphere."""


def _path(step_deg: float, n_held: int) -> FloatArray:
    """Path (n, 2) down, a waypoint at each step of the twist, a hold, and a little back to end the hold."""
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
    """Rows of step halving and a hold of every solver, and of each against the first that agrees with itself.

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


def moved_channels(case: Case, channels: Collection[Channel]) -> tuple[Channel, ...]:
    """Channels whose abscissa a case moves."""
    columns = case.protocol.columns
    return tuple(c for c in channels if c.abscissa in columns and np.ptp(columns[c.abscissa]) > 0.0)


def pair_rows(
    case: Case, solvers: Mapping[str, Solver], answers: Mapping[str, Simulation], name: str, other: str
) -> Iterator[Row]:
    """Rows of the channels that two solvers compute, where the abscissa is farthest from rest."""
    both = [solvers[each].provides for each in (name, other)]
    for channel in case.channels:
        if not all(provides.computes(channel) for provides in both):
            continue
        path = case.protocol.columns[channel.abscissa]
        place = float(path[np.argmax(np.abs(path))])
        (found, why), (expected, why_other) = (
            answer(answers[each], channel.name, [place]) for each in (name, other)
        )
        difference, note = None, ""
        if found is None or expected is None:
            note = f"{name}: {why}" if found is None else f"{other}: {why_other}"
        elif found[0] == expected[0]:
            difference = 0.0
        elif peak := _peak(answers[other], channel.name):
            difference = abs(float(found[0] - expected[0])) / peak
        else:
            note = f"{other}: its {channel.name} is zero all along"
        yield case.row(
            solver=name,
            quantity=channel.name,
            against=other,
            difference=difference,
            tolerance=TOLERANCES.get(channel.name, TOLERANCE),
            note=note,
        )


def _peak(simulation: Simulation, channel: str) -> float:
    assert simulation.response is not None
    return float(np.nanmax(np.abs(simulation.response[channel].ordinate)))


def not_shared(solvers: Mapping[str, Provides], channels: Sequence[Channel]) -> list[str]:
    """Sentences that name what one of two solvers provides alone, which is not compared."""
    names, found = list(solvers), []
    for k, name in enumerate(names):
        for other in names[k + 1 :]:
            for one, two in ((name, other), (other, name)):
                if alone := ", ".join(_alone(solvers[one], solvers[two], channels)):
                    found.append(f"not compared, '{one}' alone and not '{two}': {alone}")
    return found


def _alone(one: Provides, two: Provides, channels: Sequence[Channel]) -> Iterator[str]:
    names = [c.name for c in channels if one.computes(c) and not two.computes(c)]
    if names:
        yield f"channels {', '.join(names)}"
    if motions := [part for part in one.motions if part not in two.motions]:
        yield f"motions with {', '.join(motions)}"
    if two.indenters is not None and one.indenters is None:
        yield f"indenters other than {', '.join(two.indenters)}"
    elif indenters := [name for name in one.indenters or () if not two.simulates(name)]:
        yield f"indenters {', '.join(indenters)}"
    if two.max_regions is not None and (one.max_regions is None or one.max_regions > two.max_regions):
        yield f"more than {two.max_regions} region{'s' * (two.max_regions > 1)}"
    for what in ("anisotropic", "fields", "slopes", "surface"):
        if getattr(one, what) and not getattr(two, what):
            yield {"anisotropic": "anisotropic materials", "fields": "cell fields"}.get(what, what)
