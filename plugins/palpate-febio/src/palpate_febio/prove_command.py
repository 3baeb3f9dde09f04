"""``palpate febio-prove``: the gates on the torque of the sets that a run chose."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from palpate.cli.options import AsJson, OutFolder, StudyPath
from palpate.cli.session import Session, run_folder
from palpate.errors import StudyError
from palpate.study import Study
from palpate_febio.solver import FebioSolver


def febio_prove(
    context: typer.Context, study: StudyPath, out: OutFolder = None, as_json: AsJson = False
) -> None:
    """Run the chosen sets by FEBio, each twice: halved steps and a hold must not change the torque."""
    session = Session.of(context)
    checked = session.study(study)
    rows = []
    for row in proofs(checked, run_folder(checked, out)):
        session.note(f"{row['spot']}, set {row['set_id']}: {row['verdict']}")
        rows.append(row)
    if as_json:
        session.json(rows)
    else:
        heads = ["spot", "set_id", "verdict", "halving", "hold", "message"]
        session.table("Torque of the chosen sets", heads, [[str(row[h]) for h in heads] for row in rows])
    if any(row["verdict"] != "proved" for row in rows):
        raise typer.Exit(1)


def proofs(study: Study, folder: Path) -> Iterator[dict[str, Any]]:
    """One row per chosen set and spot.

    Raises
    ------
    StudyError
        The run has no selection yet, or its protocol has nothing to prove.
    """
    from palpate.limb import load_limbs
    from palpate.run_directory import RunDirectory
    from palpate.simulation import job_for

    run = RunDirectory(folder)
    design, chosen = run.design(), run.selection().select("spot", "set_id").unique(maintain_order=True)
    measured = run.measured(tuple(spot.spot.name for spot in study.spots))
    solver = _gated(study)
    limbs = load_limbs(study)
    if not limbs:
        raise StudyError(f"study '{study.name}' has no meshes, so no torque to prove")
    for spot, set_id in chosen.iter_rows():
        job = job_for(study, spot, set_id, design.values[set_id], measured)
        solver.check(job, limbs[spot])
        simulation = solver.simulate(job, limbs[spot])
        gates = simulation.diagnostics.get("gates")
        proved = gates is not None and gates["passed"]
        yield {
            "spot": spot,
            "set_id": set_id,
            "verdict": "proved" if proved else "not proved",
            "halving": None if gates is None else gates["halving"],
            "hold": None if gates is None else gates["hold"],
            "message": simulation.message or ("" if gates else "no twist with friction: nothing to prove"),
        }


def _gated(study: Study) -> FebioSolver:
    """FEBio with the study's settings where it is the study's solver, and its gates on."""
    own = study.solver.settings if isinstance(study.solver, FebioSolver) else FebioSolver().settings
    return FebioSolver(own.model_copy(update={"gates": True}))
