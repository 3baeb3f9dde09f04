"""``palpate report`` and ``palpate compare``: tables and figures of one run, or of several."""

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.api import StudyError
from palpate.api.cli import (
    AsJson,
    OutFolder,
    RunPath,
    RunPaths,
    Session,
    StageProgress,
    Tables,
    TrustPlugins,
    find_run,
    newest_run,
    run_folder,
    show_summary,
    study_of_run,
)


def report(
    context: typer.Context,
    run: RunPath = None,
    out: OutFolder = None,
    trust_plugins: TrustPlugins = False,
    tables: Tables = False,
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
    as_json: AsJson = False,
) -> None:
    """Lay the results out as tables and figures under report/, also while the run goes on.

    A run directory needs nothing besides it. A study is compared with the run: its files must be there.
    """
    from palpate.api.runs import is_run
    from palpate_report import from_run
    from palpate_report.stage import ReportOutput, summary_of

    session = Session.of(context)
    if as_run := run is None or (is_run(run) and out in (None, run)):
        folder = find_run(run if run is not None else out)
        session, checked = study_of_run(session, folder, trust=trust_plugins)
    else:
        checked = session.study(run)
        folder = out or newest_run(run) or run_folder(checked, out)
    with StageProgress(session) as progress:
        made = from_run.report(checked, folder, session.plugins, progress, as_run=as_run)
    if open_page:
        typer.launch(next(file for file in made.files if file.suffix == ".html").resolve().as_uri())
    summary = summary_of(checked, made)
    values = {name: summary.values[name] for name in ReportOutput.__annotations__} if as_json else None
    show_summary(session, summary, progress, tables=tables, values=values)


def compare(
    context: typer.Context,
    runs: RunPaths,
    into: Annotated[
        Path, typer.Option("--into", metavar="FOLDER", help="Where the page, tables and figure go.")
    ] = Path("comparison"),
    materials: Annotated[
        str | None,
        typer.Option(
            "--materials",
            metavar="all|LAW,…",
            help="Fit these laws to the curves of one study, such as yeoh,gent,ogden-2.",
        ),
    ] = None,
    region: Annotated[
        str | None, typer.Option("--region", help="Region whose law is compared, where there are several.")
    ] = None,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Compare materials or limbs: parameters, intervals, curves, information criteria.

    With --materials the laws are fitted first, each by a study next to the given one, and ranked by AICc and
    by the error of held-out curves.
    """
    from palpate_report.data.tables import TITLES

    session = Session.of(context)
    if materials is not None:
        made = _laws_compared(session, runs, materials, region, into)
    else:
        made = _compared(session, runs, into, trust_plugins=trust_plugins)
    if as_json:
        tables = {name: table.to_dicts() for name, table in made["tables"].items()}
        session.json({**made, "tables": tables})
        return
    for name, table in made["tables"].items():
        session.frame(TITLES[name], table)
    # The first note on laws concludes, and so comes last.
    notes = made["notes"] if materials is None else [*made["notes"][1:], *made["notes"][:1]]
    for note in notes:
        session.paragraph(note)
    session.say(f"Page: {(into / 'index.html').resolve().as_uri()}")


def _laws_compared(
    session: Session, studies: list[Path], laws: str, region: str | None, into: Path
) -> dict[str, Any]:
    """Comparison of the fits of several laws to the curves of one study."""
    from palpate_report.law_comparison import compare_laws

    if len(studies) != 1:
        raise StudyError("--materials compares laws of one study; name one")
    with StageProgress(session) as progress:
        return compare_laws(session, studies[0], laws, region, into, progress)


def _compared(session: Session, runs: list[Path], into: Path, *, trust_plugins: bool) -> dict[str, Any]:
    """Comparison of finished runs."""
    from palpate_report import comparison, from_run

    folders = list(dict.fromkeys(find_run(run) for run in runs))
    if len(folders) < 2:
        raise StudyError("one run is nothing to compare; name two or more: palpate compare RUN RUN")
    found = {}
    with StageProgress(session) as progress:
        for folder in folders:
            own, study = study_of_run(session, folder, trust=trust_plugins)
            found[folder] = from_run.read_results(study, folder, own.plugins, progress)
    return comparison.write_comparison(comparison.named(found), into)
