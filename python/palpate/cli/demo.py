"""``palpate demo``: the whole method on a study that palpate carries."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, NumberOfSets, OutFolder, Tables
from palpate.cli.progress import StageProgress
from palpate.cli.results import data_notice, show_run
from palpate.cli.session import Session, run_folder

DEMO = "forearm-demo"


def demo(
    context: typer.Context,
    study: Annotated[str, typer.Option("--study", help="Name of a ready study; see palpate init.")] = DEMO,
    out: OutFolder = None,
    n_sets: NumberOfSets = None,
    tables: Tables = False,
    as_json: AsJson = False,
) -> None:
    """Identify the material of a ready study, end to end."""
    from palpate import pipeline

    session = Session.of(context)
    template = Path(session.plugins.studies[study].directory) / "study.toml"
    checked = replace(session.study(template), n_total=n_sets or 0)
    folder = run_folder(checked, out)
    session.note(f"{study}: {checked.description}\nNote: {data_notice(checked)}.")
    with StageProgress(session, folder) as progress:
        result = pipeline.run_study(checked, folder, session.plugins, progress)
    show_run(session, checked, result, progress, tables=tables, as_json=as_json)
    if not as_json:
        session.next(f"init --study {study} my-{study}", "to make the study your own, ")
