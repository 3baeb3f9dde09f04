"""``palpate predict``, what the fitted limb feels under another tool; ``palpate card``, its materials."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.api import StudyError
from palpate.api.cli import AsJson, RunPath, Session, StageProgress, TrustPlugins, find_run, study_of_run

if TYPE_CHECKING:
    from palpate_prediction.cards.card import CardData
    from palpate_prediction.files import CardOutput, PredictOutput


def predict(
    context: typer.Context,
    tool: Annotated[Path, typer.Option("--tool", metavar="FILE", help="Tool, motion and spots.")],
    run: RunPath = None,
    draws: Annotated[
        int, typer.Option("--draws", min=0, help="Draws of the fitted values to simulate too, for a band.")
    ] = 0,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Predict force, moment, pressure and shear under another tool, with bands."""
    from palpate.api.runs import RunDirectory, read_tool
    from palpate_prediction.files import notes, summary_table, write_prediction
    from palpate_prediction.predict import run_prediction

    folder = find_run(run)
    session, study = study_of_run(Session.of(context), folder, trust=trust_plugins)
    given = read_tool(tool, study, session.plugins)
    with StageProgress(session) as progress:
        found = run_prediction(study, RunDirectory(folder), given, session.plugins, progress, n_solved=draws)
    into = folder / "predictions" / given.name
    files = write_prediction(found, session.plugins.channels, study.notice, into)
    if as_json:
        output: PredictOutput = {
            "source": found.fitted.source,
            "verdict": found.verdict.value,
            "scenario": found.fitted.scenario,
            "n_draws": found.n_draws,
            "notes": notes(found, study.notice),
            "summary": found.summary.to_dicts(),
            "strains": found.strains.to_dicts(),
            "files": [str(path) for path in files],
        }
        session.json(output)
        return
    table = summary_table(found.summary)
    session.table(table.caption, table.columns, table.rows)
    for text in notes(found, study.notice):
        session.say(text)
    session.labelled("Page", files[-1].resolve().as_uri())


def _programs(incomplete: str) -> list[str]:
    from palpate_prediction.cards.programs import PROGRAMS

    return [program for program in PROGRAMS if program.startswith(incomplete)]


def _write_new(file: Path, text: str) -> None:
    from palpate.api.files import write_atomically

    if file.exists():
        raise StudyError(f"{file}: exists and is not overwritten; move it, or name another file")
    write_atomically(file, text.encode())


def _of_region(cards: "Sequence[CardData]", region: str | None) -> "Sequence[CardData]":
    """Cards of one region, or of all; a StudyError where the study has none of this name."""
    wanted = [data for data in cards if region in (None, data.region)]
    if not wanted:
        known = ", ".join(data.region for data in cards)
        raise StudyError(f"--region {region}: not in the study; name one of {known}")
    return wanted


def card(
    context: typer.Context,
    run: RunPath = None,
    program: Annotated[
        str,
        typer.Option(
            "--for", metavar="PROGRAM", help="febio, abaqus, ansys, json, text.", autocompletion=_programs
        ),
    ] = "",
    region: Annotated[
        str | None, typer.Option("--region", help="One region of several.", show_default=False)
    ] = None,
    into: Annotated[
        Path | None, typer.Option("--into", metavar="FILE", help="File to write; default: print it.")
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Write the card of a run without parameters, with a warning.")
    ] = False,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Print the fitted material, or write it for a program: values, formula, moduli, valid range."""
    from palpate.api.runs import RunDirectory, read_run
    from palpate_prediction.cards.programs import PROGRAMS, cards_of, joined

    if (program := program or ("json" if into or as_json else "text")) not in PROGRAMS:
        raise StudyError(f"--for {program}: no such program; choose one of {', '.join(PROGRAMS)}")
    folder = find_run(run)
    session, study = study_of_run(Session.of(context), folder, trust=trust_plugins)
    found = list(cards_of(read_run(study, RunDirectory(folder), session.plugins)))
    wanted = _of_region(found, region)
    if not anyway and (failure := next((data.model.failure for data in wanted if data.model.failure), "")):
        raise StudyError(f"{folder}: {failure} To write its card nevertheless, add --anyway.")
    cards = {data.region: PROGRAMS[program](data) for data in wanted}
    text = joined(program, cards)
    if into is not None:
        _write_new(into, text)
    if as_json:
        output: CardOutput = json.loads(text) if program == "json" else dict(cards)
        session.json(output)
    elif into is None:
        typer.echo(text, nl=False)
    else:
        session.say(f"written to {into}")
