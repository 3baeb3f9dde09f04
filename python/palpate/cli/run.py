"""``palpate run``: from measured curves to identified parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from palpate.cli.options import AsJson, ForkTo, GoOn, NumberOfSets, OutFolder, StudyPath, Tables, Trust
from palpate.cli.progress import StageProgress
from palpate.cli.results import show_run
from palpate.cli.session import Session, run_folder

if TYPE_CHECKING:
    from palpate.run.study_diff import Changed
    from palpate.study.reading import Study

MAX_CHANGES = 20
"""Most changes of a study that are listed."""


def run(
    context: typer.Context,
    study: StudyPath,
    out: OutFolder = None,
    n_sets: NumberOfSets = None,
    go_on: GoOn = False,
    fork: ForkTo = None,
    trust: Trust = None,
    tables: Tables = False,
    as_json: AsJson = False,
) -> None:
    """Run every stage of a study; what is already simulated is not simulated again."""
    session = Session.of(context)
    checked = replace(session.study(study), n_total=n_sets or 0)
    folder = run_folder(checked, out)
    go(session, checked, folder, go_on=go_on, fork=fork, trust=trust or (), tables=tables, as_json=as_json)


def go(
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
) -> None:
    """Run a study in a folder, or in a copy of it, and show what it found.

    With ``adopt`` the folder may hold the run of another study file. The fit starts at ``fit_start``, if
    given, before its other starts.
    """
    from palpate import pipeline

    where = folder if fork is None else fork
    with StageProgress(session, where) as progress:
        result = pipeline.run_study(
            study,
            where,
            session.plugins,
            progress,
            forked_from=None if fork is None else folder,
            trust=trust,
            adopt=adopt,
            fit_start=fit_start,
            confirm=lambda changed: _confirm(session, changed, folder, sure=go_on or fork is not None),
        )
    show_run(session, study, result, progress, tables=tables, as_json=as_json)


def _confirm(session: Session, changed: "Changed", folder: Path, *, sure: bool) -> None:
    """Show how a study has changed, and ask where finished simulations are not valid any more."""
    if not changed.changes:
        return
    shown = [f"  {change}" for change in changed.changes[:MAX_CHANGES]]
    more = len(changed.changes) - len(shown)
    lines = [f"the study has changed since {folder} was written:", *shown]
    lines += [f"  … and {more} more"] if more else []
    lines.append(f"  {changed.n_valid} of {changed.n_finished} finished simulations are still valid")
    if changed.loses and not sure:
        trust = " ".join(f"--trust {name}" for name in changed.trustable)
        or_trust = f"; if the new code gives the same results, {trust} keeps them" if trust else ""
        session.confirm(
            "\n".join(lines),
            f"go on in this folder? (no finished simulation is removed{or_trust})",
            "use --fork FOLDER to leave the run as it is and go on in a copy, "
            f"or --go-on to go on in it{or_trust}",
        )
        return
    session.stderr.print("\n".join(lines), markup=False)
