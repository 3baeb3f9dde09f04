"""The protocol's path as FEBio's time: one unit of it per step, so every output time is a whole number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.api import FloatArray, Indentation, StudyError

if TYPE_CHECKING:
    from palpate.api import Simulation
    from palpate.api.runs import Study


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """Points that FEBio must balance at; row k belongs to time k.

    Parameters
    ----------
    depth_mm, rotation_deg : (n + 1,) array
        Row 0 is rest.
    """

    depth_mm: FloatArray
    rotation_deg: FloatArray

    @property
    def n(self) -> int:
        """Number of steps."""
        return len(self.depth_mm) - 1


def steps_of(protocol: Indentation, depth_steps: int, rotation_step_deg: float) -> Steps:
    """Steps of equal size in each piece of the path; every waypoint is one of the points.

    Parameters
    ----------
    depth_steps : int
        Steps that go from the surface to the greatest depth.
    rotation_step_deg : float
        Largest step of rotation.
    """
    step_mm = max(float(protocol.path[:, 0].max()), 1e-9) / depth_steps
    rows = [protocol.path[:1]]
    for start, end in zip(protocol.path[:-1], protocol.path[1:], strict=True):
        change = np.abs(end - start) / (step_mm, rotation_step_deg)
        n = max(int(np.ceil(change.max() - 1e-9)), 1)
        piece = start + (end - start) * np.arange(1, n + 1)[:, None] / n
        piece[-1] = end
        rows.append(piece)
    points = np.concatenate(rows)
    return Steps(points[:, 0].copy(), points[:, 1].copy())


def up_to_first_turn(steps: Steps) -> Steps:
    """The steps up to where the rotation first turns back; all of them where it never does."""
    change = np.sign(np.diff(steps.rotation_deg))
    moving = np.flatnonzero(change)
    turns = moving[1:][change[moving[1:]] != change[moving[:-1]]]
    end = int(turns[0]) + 1 if turns.size else len(steps.depth_mm)
    return Steps(steps.depth_mm[:end], steps.rotation_deg[:end])


def halved(steps: Steps) -> Steps:
    """Steps in two halves each."""

    def cut(values: FloatArray) -> FloatArray:
        whole = np.empty(2 * len(values) - 1)
        whole[::2] = values
        whole[1::2] = 0.5 * (values[1:] + values[:-1])
        return whole

    return Steps(cut(steps.depth_mm), cut(steps.rotation_deg))


def with_hold(steps: Steps, n_held: int) -> Steps:
    """Steps with the last point held for ``n_held`` more."""
    return Steps(*(np.pad(v, (0, n_held), mode="edge") for v in (steps.depth_mm, steps.rotation_deg)))


def verified_sets(study: Study, folder: Path) -> Iterator[dict[str, Any]]:
    """One row per selected set and spot.

    Yields
    ------
    dict
        ``halving`` and ``hold`` are the results of the checks; ``force`` and ``torque`` the relative
        difference of FEBio from the run at the greatest depth and where the rotation first turns.

    Raises
    ------
    StudyError
        The run has no selection yet, or its protocol has no torque to verify.
    """
    from palpate.api.runs import RunDirectory, job_for, load_limbs, stored
    from palpate_febio.solver import FebioSolver

    run = RunDirectory(folder)
    design, chosen = (
        run.design(),
        run.table("selection", "select").select("spot", "set_id").unique(maintain_order=True),
    )
    measured = run.measured(tuple(spot.spot.name for spot in study.spots))
    limbs = load_limbs(study)
    if not limbs:
        raise StudyError(f"study '{study.name}' has no meshes, so no torque to verify")
    own = study.solver if isinstance(study.solver, FebioSolver) else FebioSolver()
    solver = FebioSolver(own.settings.model_copy(update={"verification": "chosen"}))
    pairs = list(chosen.iter_rows())
    before = stored(study, design, limbs, measured, folder, pairs)
    kept = {(s.job.spot, s.job.set_id): s for s in before}
    for spot, set_id in pairs:
        job = job_for(study, spot, set_id, design.values[set_id], measured)
        solver.check(job, limbs[spot])
        simulation = solver.simulate(job, limbs[spot])
        found = solver.verify(job, limbs[spot], simulation)
        yield {
            "spot": spot,
            "set_id": set_id,
            "verdict": "passed" if found.get("passed") else "failed",
            "halving": found.get("halving"),
            "hold": found.get("hold"),
            **_differences(simulation, kept.get((spot, set_id))),
            "message": found.get("message") or simulation.message or "nothing twists and rubs",
        }


def _differences(found: Simulation, kept: Simulation | None) -> dict[str, float | None]:
    """Differences of FEBio's force and torque from the run's, relative to the run's."""
    differences: dict[str, float | None] = {"force": None, "torque": None}
    if kept is None or kept.response is None or found.response is None:
        return differences
    ours, theirs = found.response.curves, kept.response.curves
    for channel in differences.keys() & ours.keys() & theirs.keys():
        differences[channel] = ours[channel].first_turn / theirs[channel].first_turn - 1.0
    return differences
