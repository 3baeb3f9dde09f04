"""``palpate run``: from measured curves to identified parameters, and on where a run stopped."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.options import (
    AsJson,
    ForkTo,
    GoOn,
    NumberOfSets,
    OutFolder,
    StudyOrRun,
    Tables,
    Trust,
    TrustPlugins,
)
from palpate.cli.progress import StageProgress
from palpate.cli.results import run_values, show_summary
from palpate.cli.runs import original_study
from palpate.cli.session import Session, run_folder
from palpate.errors import StudyError, typed

if TYPE_CHECKING:
    from palpate.run.manifest import Changed
    from palpate.study.reading import Study


def run(
    context: typer.Context,
    study: StudyOrRun,
    out: OutFolder = None,
    moved: Annotated[
        Path | None, typer.Option("--study", help="Study file of a run, if it has moved.", show_default=False)
    ] = None,
    n_sets: NumberOfSets = None,
    go_on: GoOn = False,
    fork: ForkTo = None,
    trust: Trust = None,
    trust_plugins: TrustPlugins = False,
    tables: Tables = False,
    quick: Annotated[bool, typer.Option("--quick", help="Stop after the first answer.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run every stage of a study, or continue a run; finished simulations are reused.

    A run that was stopped and continued has the same tables as an uninterrupted one.
    """
    from palpate.run.ownership import is_run

    session = Session.of(context)
    if is_run(study) and out is None:
        folder = study
        session, checked = _continued(session, folder, moved, n_sets, trust_plugins=trust_plugins)
    elif moved is not None:
        raise StudyError(f"--study {moved}: {study} is no run directory whose study could have moved")
    else:
        checked = replace(session.study(study), n_total=n_sets or 0)
        folder = run_folder(checked, out)
    run_and_show(
        session,
        checked,
        folder,
        go_on=go_on,
        fork=fork,
        trust=trust or (),
        tables=tables,
        as_json=as_json,
        adopt=moved is not None,
        is_quick=quick,
    )


def _continued(
    session: Session, folder: Path, moved: Path | None, n_sets: int | None, *, trust_plugins: bool
) -> "tuple[Session, Study]":
    """Session with the plugin files of a run, and its study with as many sets as the run has, or more."""
    from palpate.run.directory import RunDirectory

    session, file = original_study(session, folder, trust=trust_plugins, moved=moved)
    study, n_before = session.study(file), RunDirectory(folder).manifest()["n_total"]
    if not n_before and n_sets is not None and n_sets <= study.n_sets:
        return session, study
    return session, replace(study, n_total=max(n_sets or 0, n_before))


def run_and_show(
    session: Session,
    study: "Study",
    folder: Path,
    *,
    go_on: bool,
    fork: Path | None,
    trust: Sequence[str],
    tables: bool,
    as_json: bool,
    adopt: bool = False,
    fit_start: Mapping[str, float] | None = None,
    is_quick: bool = False,
) -> None:
    """Run a study in a folder, or in a copy of it, and show what it found.

    With ``adopt`` the folder may hold the run of another study file. The fit starts at ``fit_start``, if
    given, before its other starts. With ``is_quick`` it ends with the first answer.
    """
    from palpate.stages import pipeline

    where = folder if fork is None else fork
    if is_quick and study.search.name == "sweep":
        raise StudyError("--quick needs a fit, and fit.search is 'sweep'. Leave out --quick.")
    with StageProgress(session) as progress:
        result = pipeline.run_study(
            study,
            where,
            session.plugins,
            progress,
            forked_from=None if fork is None else folder,
            trust=trust,
            adopt=adopt,
            fit_start=fit_start,
            is_quick=is_quick,
            confirm=lambda changed: _confirm(session, changed, folder, sure=go_on or fork is not None),
        )
    values = run_values(study, result) if as_json else None
    show_summary(session, result.summary, progress, tables=tables, values=values)
    if result.is_first_answer and not as_json:
        session.next("run {folder}", folder=where)


def _confirm(session: Session, changed: "Changed", folder: Path, *, sure: bool) -> None:
    """Show how a study has changed, and ask where finished simulations are not valid any more."""
    if not changed.changes:
        return
    shown = [f"  {change}" for change in changed.changes[:20]]
    more = len(changed.changes) - len(shown)
    lines = [f"the study has changed since {folder} was written:", *shown]
    lines += [f"  … and {more} more"] if more else []
    if changed.n_finished:
        lines.append(f"  {changed.n_valid} of {changed.n_finished} finished simulations are still valid")
    if changed.loses and not sure:
        trust = " ".join(f"--trust {name}" for name in changed.trustable)
        or_trust = f"; if the new code gives the same results, {trust} keeps them" if trust else ""
        session.confirm(
            "\n".join(lines),
            f"go on in this folder? (no finished simulation is removed{or_trust})",
            f"`palpate run STUDY --out {typed(folder)} --go-on` reuses all valid results; add "
            f"--fork FOLDER to go on in a copy and keep this run{or_trust}",
        )
        return
    session.stderr.print("\n".join(lines), markup=False)
