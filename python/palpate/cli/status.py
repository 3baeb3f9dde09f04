"""``palpate status``: how far a run is, from another terminal or after the fact."""

import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, cast

import typer

from palpate.cli.options import AsJson, RunPath
from palpate.cli.runs import find_run
from palpate.cli.session import Session
from palpate.errors import StudyError, typed
from palpate.progress import about

if TYPE_CHECKING:
    from palpate.cli.output import FitStateOutput, StatusOutput
    from palpate.stages.status import RunStatus


def status(
    context: typer.Context,
    run: RunPath = None,
    watch: Annotated[
        bool, typer.Option("--watch", help="Look again every two seconds until the run ends.")
    ] = False,
    cost: Annotated[
        bool, typer.Option("--cost", help="Show where the processor time of the run went.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show the progress of a run and the reasons of failures; of a finished run, its result."""
    from palpate.stages.status import status as read

    session = Session.of(context)
    seen = read(find_run(run))
    if watch and seen.runner is not None:
        seen = _watched(session, seen)
    if as_json:
        session.json(_as_json(seen))
        return
    _show(session, seen)
    if cost:
        _show_cost(session, seen)


def _show_cost(session: Session, seen: "RunStatus") -> None:
    from palpate.simulation.processor_time import COST_HEADS, cost_rows

    if seen.cost.is_empty():
        raise StudyError(
            f"{seen.folder}: no processor time is recorded. An earlier palpate has made the run. "
            f"Run `palpate run {typed(seen.folder)}` again."
        )
    session.table("Processor time", COST_HEADS, cost_rows(seen.cost))


def _watched(session: Session, seen: "RunStatus") -> "RunStatus":
    """Show a run until it ends: one line that changes for people, a line for each change in a log."""
    from rich.live import Live

    from palpate.stages.status import status as read

    line = _line(seen)
    if not session.stderr.is_terminal:
        session.stderr.print(line, markup=False)
    with Live(line, console=session.stderr, transient=True, auto_refresh=False) as live:
        while seen.runner is not None:
            time.sleep(2.0)
            seen = read(seen.folder)
            if session.stderr.is_terminal:
                live.update(_line(seen), refresh=True)
            elif _counts(seen) not in line:
                line = _line(seen)
                session.stderr.print(line, markup=False)
    return seen


def _show(session: Session, seen: "RunStatus") -> None:
    session.say(_line(seen))
    if not seen.failures.is_empty():
        session.frame("Failures", seen.failures)
    for label, text in seen.result.items():
        session.labelled(label, text)
    if seen.is_unfinished:
        session.next("run {folder}", folder=seen.folder)


def _line(seen: "RunStatus") -> str:
    line = f"{seen.folder}: {_counts(seen)}"
    if seen.seconds_left is not None:  # before the runner: a narrow terminal cuts the end
        line += f"; {about(seen.seconds_left)} left"
    if seen.runner is not None:
        line += f"; running: {seen.runner}"
    elif seen.is_unfinished:
        line += "; not running"
    elif seen.result:
        line += "; finished"
    return line


def _counts(seen: "RunStatus") -> str:
    states = ", ".join(f"{n} {state}" for state, n in seen.states.items()) or "none finished"
    total = "" if seen.n_finished == seen.n_simulations else f" of {seen.n_simulations}"
    done = f"{seen.n_finished}{total} simulations ({states})"
    return done if seen.fit is None else f"{done}; fit: {seen.fit}"


def _as_json(seen: "RunStatus") -> "StatusOutput":
    runner = seen.runner
    return {
        "folder": str(seen.folder),
        "running": None
        if runner is None
        else {"host": runner.host, "pid": runner.pid, "since": runner.since},
        "n_simulations": seen.n_simulations,
        "n_finished": seen.n_finished,
        "states": dict(seen.states),
        "seconds_left": seen.seconds_left,
        "failures": seen.failures.to_dicts(),
        "is_first_answer": seen.is_first_answer,
        "result": dict(seen.result),
        "cost": seen.cost.to_dicts(),
        "intervals": [dict(row) for row in seen.intervals],
        "fit": cast("FitStateOutput | None", seen.fit and asdict(seen.fit)),
    }
