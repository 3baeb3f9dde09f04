"""The skin under the fitted material: one simulation for each spot, with the states of its surface."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from palpate.domain import Job, Response, Simulation, Status, SurfaceStates
from palpate.errors import SolverError, StudyError
from palpate.fit.fitted import Fitted, inputs_at, job_of, relaxing_space, relaxing_thetas
from palpate.run.ledger import Ledger
from palpate.simulation.jobs import check_jobs
from palpate.simulation.sweep import Simulations
from palpate.study.reading import Study


def simulate_surfaces(
    simulations: Simulations, found: Fitted, measured: Mapping[str, Response]
) -> pl.DataFrame:
    """Simulate the press at every spot with what was found, unless that is in the ledger already.

    What relaxes by shares of all moduli relaxes in the solver, where that can; else the skin is that at once.

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
    jobs = [
        replace(_job(study, spot, found, measured), channels=study.observed(measured[spot]))
        for spot in found.spots
    ]
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


def _job(study: Study, spot: str, found: Fitted, measured: Mapping[str, Response]) -> Job:
    inputs = inputs_at(study, spot, found.values, measured)
    if study.parametrisation.times_s and study.solver.provides.relaxation:
        inputs = replace(inputs, thetas=relaxing_thetas(study, inputs.thetas, found.values))
        study = replace(study, space=relaxing_space(study))
    return job_of(study, spot, inputs, surface=True)


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
