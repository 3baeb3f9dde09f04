"""Doubt of the answers that a run rests on: each chosen set is put to its solver's own proof.

A sweep believes each simulation as it comes. What a solver can prove about one, such as that its
steps do not matter, may cost as much as the simulation did, so only the sets that were chosen
are put to it.
"""

import contextlib
import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from palpate.domain import Design, Limb, Response, Simulation
from palpate.errors import PalpateError, StoppedError, StudyError
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import Solver
from palpate.progress import Progress
from palpate.run.directory import RunDirectory
from palpate.run.result_files import plain
from palpate.stages.keys import job_key
from palpate.stages.simulation import stored
from palpate.study.reading import Study


def proves(solver: Solver) -> bool:
    """Whether a solver has a proof of its answers."""
    return type(solver).prove is not Solver.prove


def prove(
    study: Study,
    run: RunDirectory,
    design: Design,
    limbs: Mapping[str, Limb],
    measured: Mapping[str, Response],
    progress: Progress,
) -> pl.DataFrame:
    """Put every selected set, and the generalised one, to the solver's proof; none is proved twice.

    Returns
    -------
    DataFrame
        One row per spot and set that there was something to prove of: spot, set_id, passed,
        message, the solver's own figures, and ``key``, by which a row is known again.

    Raises
    ------
    StoppedError
        ``progress`` said to stop; what is proved is kept.
    """
    if not proves(study.solver):
        run.write_proofs(pl.DataFrame())
        return pl.DataFrame()
    chosen = set(_chosen(run))
    found = stored(study, design, limbs, measured, run.folder, chosen)
    known: dict[str, dict[str, Any]] = {}
    with contextlib.suppress(StudyError):  # damaged: all are verified again
        known = {row["key"]: row for row in run.proofs().iter_rows(named=True) if row["key"]}
    rows: list[dict[str, Any]] = []
    progress.begin("prove", len(found))
    for simulation in found:
        if not progress.should_continue():
            raise StoppedError(
                f"stopped while proving the chosen sets; `palpate resume {run.folder}` goes on from there"
            )
        limb = limbs.get(simulation.job.spot)
        key = _key(study, simulation, limb)
        row = known.get(key) or _row(study.solver, simulation, limb, key)
        if row is not None:
            if row["key"]:  # jobs that differ by name alone have one answer, and one proof
                known[key] = row
            rows.append(row | {"spot": simulation.job.spot, "set_id": simulation.job.set_id})
            told = {each["key"] for each in rows}
            run.write_proofs(_frame([*rows, *(each for k, each in known.items() if k not in told)]))
        progress.step("" if row is None or row["passed"] else row["message"])
    run.write_proofs(_frame(rows))
    return _frame(rows)


def _chosen(run: RunDirectory) -> Iterator[tuple[str, int]]:
    for frame in (run.selection(), run.generalisation()):
        if not frame.is_empty():
            yield from frame.select("spot", "set_id").iter_rows()


def _key(study: Study, simulation: Simulation, limb: Limb | None) -> str:
    """What decides a simulation, and every setting, also those that decide nothing but the proof."""
    settings = repr(sorted(dict(study.solver.settings).items(), key=str))
    key = job_key(simulation.job, limb, study.solver, study.trusted)
    return hashlib.sha256(f"{key} {settings}".encode()).hexdigest()


def _row(solver: Solver, simulation: Simulation, limb: Limb | None, key: str) -> dict[str, Any] | None:
    job = simulation.job
    about = {"spot": job.spot, "set_id": job.set_id}
    try:
        with answering_for(solver, f"proving set {job.set_id} at spot '{job.spot}'"):
            figures = plain(dict(solver.prove(job, limb, simulation)))
    except PalpateError as error:
        return {**about, "passed": False, "message": str(error), "key": ""}  # no key: tried again
    return {**about, **figures, "key": key} if figures else None


def _frame(rows: list[dict[str, Any]]) -> pl.DataFrame:
    return pl.from_dicts(rows, infer_schema_length=None) if rows else pl.DataFrame()
