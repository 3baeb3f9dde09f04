"""``palpate card``: the fitted material for another program."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson, RunPath, TrustPlugins
from palpate.cli.runs import find_run, study_of_run
from palpate.cli.session import Session
from palpate.errors import StudyError


def card(
    context: typer.Context,
    run: RunPath = None,
    program: Annotated[
        str, typer.Option("--for", metavar="PROGRAM", help="febio, abaqus, ansys, ls-dyna or json.")
    ] = "json",
    region: Annotated[
        str | None, typer.Option("--region", help="One region of several.", show_default=False)
    ] = None,
    into: Annotated[
        Path | None, typer.Option("--into", metavar="FILE", help="File to write; default: print it.")
    ] = None,
    trust_plugins: TrustPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Write the fitted material for another program: values, formula of the stress, moduli, valid range."""
    from palpate.run.atomic_files import write_atomically
    from palpate.run.directory import RunDirectory
    from palpate.stages.stage import read_run
    from palpate_prediction.cards import PROGRAMS, cards_of, joined

    if program not in PROGRAMS:
        raise StudyError(f"--for {program}: no such program; choose one of {', '.join(PROGRAMS)}")
    folder = find_run(run)
    session, study = study_of_run(Session.of(context), folder, trust=trust_plugins)
    found = list(cards_of(read_run(study, RunDirectory(folder), session.plugins), session.plugins))
    wanted = [data for data in found if region in (None, data.region)]
    if not wanted:
        known = ", ".join(data.region for data in found)
        raise StudyError(f"--region {region}: not in the study; name one of {known}")
    cards = {data.region: PROGRAMS[program](data) for data in wanted}
    text = joined(program, cards)
    if into is not None:
        if into.exists():
            raise StudyError(f"{into}: exists and is not overwritten; move it, or name another file")
        write_atomically(into, text.encode())
    if as_json:
        session.json(cards)
    elif into is None:
        typer.echo(text, nl=False)
    else:
        session.say(f"written to {into}")
