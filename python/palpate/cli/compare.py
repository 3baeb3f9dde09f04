"""``palpate compare``: materials or limbs side by side."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, TrustPlugins
from palpate.cli.progress import StageProgress
from palpate.cli.runs import find_run, study_of_run
from palpate.cli.session import Session
from palpate.errors import StudyError


def compare(
    context: typer.Context,
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN RUN…", help="Run directories, or studies for their newest runs."),
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Where the page, tables and figure go.")
    ] = Path("comparison"),
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Compare materials or limbs: parameters, intervals, curves, information criteria."""
    from palpate.stages import pipeline
    from palpate_report import comparison

    session = Session.of(context)
    folders = list(dict.fromkeys(find_run(run) for run in runs))
    if len(folders) < 2:
        raise StudyError("one run is nothing to compare; name two or more: palpate compare RUN RUN")
    found = {}
    with StageProgress(session) as progress:
        for folder in folders:
            own, study = study_of_run(session, folder, trust=trust_plugins)
            found[folder] = pipeline.read_results(study, folder, own.plugins, progress)
    made = comparison.write_comparison(comparison.named(found), out)
    if as_json:
        tables = {name: table.to_dicts() for name, table in made["tables"].items()}
        session.json({**made, "tables": tables})
        return
    for name, table in made["tables"].items():
        session.frame(name.capitalize(), table)
    for note in made["notes"]:
        session.paragraph(note)
    session.say(f"Page: {(out / 'index.html').resolve().as_uri()}")
