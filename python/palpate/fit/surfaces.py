"""The skin under the fitted material: one simulation for each spot, with the states of its surface."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Response, SimulationId, Status, SurfaceStates
from palpate.errors import SolverError, StudyError
from palpate.fit.fitted import Fitted, inputs_at, job_of
from palpate.run.ledger import Ledger
from palpate.run.result_files import read_surface, surface_path
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
    """States of the skin by spot that a table names, as far as their files are there."""
    found = {}
    for spot, key in table.select("spot", "key").iter_rows() if not table.is_empty() else ():
        if (states := read_surface(surface_path(folder, key))) is not None:
            found[spot] = states
    return found


def stored_strains(folder: Path, table: pl.DataFrame) -> dict[str, dict[str, Any]]:
    """Strains by spot and region of the simulations that a table names, as their solver reports them."""
    if table.is_empty():
        return {}
    ids = {row["key"]: SimulationId(row["spot"], -1) for row in table.iter_rows(named=True)}
    with Ledger(folder) as ledger:
        recorded = ledger.recorded(ids)
    return {
        spot: recorded[key].diagnostics["strain"]
        for spot, key in table.select("spot", "key").iter_rows()
        if key in recorded and "strain" in recorded[key].diagnostics
    }
