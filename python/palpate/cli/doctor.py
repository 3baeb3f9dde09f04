"""``palpate doctor``: what this machine has, and what is missing."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson
from palpate.cli.session import Session


def doctor(
    context: typer.Context,
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Where runs are kept; its disk is looked at.")
    ] = Path("runs"),
    as_json: AsJson = False,
) -> None:
    """Show versions, solvers, broken plugins, memory and disk; exit 1 where one is wrong."""
    from palpate.cli.doctor_checks import LABELS, examine

    session = Session.of(context)
    findings = examine(session.with_broken, folder)
    n_wrong = sum(finding.level == "wrong" for finding in findings)
    if as_json:
        session.json([asdict(finding) for finding in findings])
        raise typer.Exit(min(n_wrong, 1))
    rows = [[f.topic, f.what, f.found, LABELS[f.level]] for f in findings]
    session.table("palpate doctor", ["topic", "what", "found", ""], rows)
    for finding in findings:
        if finding.advice:
            session.paragraph(f"{finding.what}: {finding.advice}")
    session.say("nothing is wrong" if n_wrong == 0 else f"{n_wrong} wrong")
    raise typer.Exit(min(n_wrong, 1))
