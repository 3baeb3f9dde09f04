"""``palpate explain``: the method's terms in a few sentences."""

from dataclasses import asdict
from typing import Annotated

import typer

from palpate.cli.options import AsJson
from palpate.cli.session import Session


def _terms(incomplete: str) -> list[str]:
    from palpate.cli.glossary import Glossary

    return [name for name in Glossary.load() if name.casefold().startswith(incomplete.casefold())]


def explain(
    context: typer.Context,
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="TERM", help="NMSE, scenario, Drucker, twist …", autocompletion=_terms),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Explain a term of the method; without TERM, list them all."""
    from palpate.cli.glossary import Glossary

    session, glossary = Session.of(context), Glossary.load()
    terms = [glossary[" ".join(words)]] if words else list(glossary.values())
    if as_json:
        session.json([asdict(term) for term in terms])
        return
    if not words:
        session.table("Terms", ["term", "also"], [[term.name, ", ".join(term.aliases)] for term in terms])
        session.next("explain TERM")
        return
    for term in terms:
        session.paragraph(f"{term.name}: {term.text}")
        if term.see:
            session.say(f"see: {', '.join(term.see)}")
