"""The skin under the fitted material: one simulation for each spot, with the states of its surface."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Job, Response, Simulation, Status, SurfaceStates
from palpate.errors import SolverError, StudyError
from palpate.fit.fitted import Fitted, inputs_at, job_of
from palpate.run.ledger import Ledger
from palpate.simulation.jobs import check_jobs
from palpate.simulation.sweep import Simulations


def simulate_surfaces(
    simulations: Simulations, found: Fitted, measured: Mapping[str, Response]
) -> pl.DataFrame:
    """Simulate the press at every spot with what was found, unless that is in the ledger already.

    Returns
    -------
    DataFrame
        One row per spot: spot, scenario, source ("fit" or the set), key (of the simulation), status and
        message.

    Raises
    ------
    StudyError
        The solver gives no surface.
    SolverError
        No simulation has ended with an equilibrium state.
    """
    study = simulations.study
    if not study.solver.provides.surface:
        raise StudyError(
            f"{study.file}: solver '{study.solver.name}' does not give the states of the skin; use 'jax'"
        )
    jobs = [job_of(study, s, inputs_at(study, s, found.values, measured), surface=True) for s in found.spots]
    check_jobs(study, jobs, simulations.limbs)
    simulations.progress.begin("surface", len(jobs))
    ended = simulations.of(jobs)
    if all(each.surface is None for each in ended):
        why = next((each.message for each in ended if each.status is not Status.OK), "no equilibrium state")
        raise SolverError(f"{study.file}: no press with the fitted material can be shown: {why}")
    return pl.DataFrame(
        {
            "spot": [each.job.spot for each in ended],
            "scenario": [found.scenario for _ in ended],
            "source": [found.source for _ in ended],
            "key": [simulations.key(job) for job in jobs],
            "status": [each.status.value for each in ended],
            "message": [each.message for each in ended],
        }
    )


def stored_surfaces(folder: Path, table: pl.DataFrame) -> Mapping[str, SurfaceStates]:
    """States of the skin by spot of the simulations that a table names, as far as they are there."""
    found = _stored(folder, table)
    return {spot: each.surface for spot, each in found.items() if each.surface is not None}


def stored_strains(folder: Path, table: pl.DataFrame) -> dict[str, dict[str, Any]]:
    """Strains by spot and region of the simulations that a table names, as their solver reports them."""
    found = _stored(folder, table)
    return {s: each.diagnostics["strain"] for s, each in found.items() if "strain" in each.diagnostics}


def _stored(folder: Path, table: pl.DataFrame) -> dict[str, Simulation]:
    if table.is_empty():
        return {}
    jobs = {row["key"]: Job(spot=row["spot"], set_id=-1) for row in table.iter_rows(named=True)}
    with Ledger(folder) as ledger:
        simulations = ledger.simulations(jobs)
    rows = table.select("spot", "key").iter_rows()
    return {spot: simulations[key] for spot, key in rows if key in simulations}
