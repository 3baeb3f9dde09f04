"""Verification of the selected sets by their solver, such as with halved steps.

It may cost as much as a simulation, so only sets that were selected are verified.
"""

import contextlib
import hashlib
from collections.abc import Mapping
from typing import Any

import polars as pl

from palpate.domain import Design, Limb, Response, Simulation, SimulationId
from palpate.errors import PalpateError, StoppedError, StudyError, typed
from palpate.executors.answers import plain
from palpate.plugins.guard import answering_for
from palpate.plugins.interfaces import Solver
from palpate.plugins.optional import Verifier
from palpate.progress import Progress
from palpate.run.directory import RunDirectory
from palpate.run.keys import job_key
from palpate.simulation.jobs import stored
from palpate.study.reading import Study


def verify(
    study: Study,
    run: RunDirectory,
    design: Design,
    limbs: Mapping[str, Limb],
    measured: Mapping[str, Response],
    progress: Progress,
) -> pl.DataFrame:
    """Let the solver verify every selected set, and the generalised one; none is verified twice.

    Returns
    -------
    DataFrame
        One row per verified spot and set: spot, set_id, passed,
        message, the solver's figures, and ``key``, by which a row is found again.

    Raises
    ------
    StoppedError
        ``progress`` requested a stop; finished verifications are kept.
    """
    if not isinstance(study.solver, Verifier):
        return pl.DataFrame()
    frames = (run.table(name) for name in ("selection", "generalisation"))
    wanted = {SimulationId._make(r) for f in frames if len(f) for r in f.select("spot", "set_id").iter_rows()}
    found = stored(study, design, limbs, measured, run.folder, wanted)
    known = _known(run)
    rows: list[dict[str, Any]] = []
    progress.begin("verify", len(found))
    for simulation in found:
        if not progress.should_continue():
            raise StoppedError(
                f"stopped while verifying the selected sets; `palpate run {typed(run.folder)}` continues"
            )
        key = _key(study, simulation, limb := limbs.get(simulation.job.limb_name))
        row = known.get(key) or _row(study.solver, simulation, limb, key)
        if row is not None:
            if row["key"]:  # jobs that differ only in name have one result
                known[key] = row
            rows.append(row | simulation.id._asdict())
            shown = {each["key"] for each in rows}
            every = _frame([*rows, *(each for k, each in known.items() if k not in shown)])
            run.write_stage("verify", {"verification": every}, {})  # each row costs as much as a simulation
        progress.step("" if row is None or row["passed"] else row["message"])
    return _frame(rows)


def _known(run: RunDirectory) -> dict[str, dict[str, Any]]:
    """Rows of earlier verifications by key; none where the table is corrupt."""
    with contextlib.suppress(StudyError):
        return {row["key"]: row for row in run.table("verification").iter_rows(named=True) if row["key"]}
    return {}


def _key(study: Study, simulation: Simulation, limb: Limb | None) -> str:
    """Inputs of a simulation and all settings, with the settings of the verification."""
    settings = repr(sorted(dict(study.solver.settings).items(), key=str))
    key = job_key(simulation.job, limb, study.solver, study.trusted)
    return hashlib.sha256(f"{key} {settings}".encode()).hexdigest()


def _row(solver: Solver, simulation: Simulation, limb: Limb | None, key: str) -> dict[str, Any] | None:
    about = simulation.id._asdict()
    try:
        with answering_for(solver, f"verifying set {simulation.id.set_id} at spot '{simulation.id.spot}'"):
            figures = plain(
                dict(solver.verify(simulation.job, limb, simulation)) if isinstance(solver, Verifier) else {}
            )
    except PalpateError as error:
        return {**about, "passed": False, "message": str(error), "key": ""}  # no key: tried again
    return {**about, **figures, "key": key} if figures else None


def _frame(rows: list[dict[str, Any]]) -> pl.DataFrame:
    return pl.DataFrame(rows, infer_schema_length=None)
