"""The sets that a run selected with another solver, verified with FEBio."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.api import StudyError

if TYPE_CHECKING:
    from palpate.api import Simulation
    from palpate.api.runs import Study


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
