"""``palpate schema``: what ``--json`` prints, for those who write scripts."""

from typing import Annotated

import typer

from palpate.cli.session import Session
from palpate.errors import StudyError


def schema(
    context: typer.Context,
    command: Annotated[str | None, typer.Argument(metavar="COMMAND", help="Name of a command.")] = None,
) -> None:
    """Print the JSON schema of a command's --json output; without COMMAND, list the commands."""
    from palpate.cli.output import OUTPUTS, VERSION, schema
    from palpate.plugins.registry import suggestion

    session = Session.of(context)
    plugins = session.only("stages")
    stages, others = plugins.stages, plugins.outputs()
    known = list(dict.fromkeys([*OUTPUTS, *stages, *others]))
    if command is None:
        session.table("Commands with a schema", ["command", "version"], [[name, VERSION] for name in known])
        session.next(f"schema {known[0]}")
        return
    if command not in known:
        raise StudyError(
            f"no schema of '{command}'{suggestion(command, known)}; `palpate schema` lists the commands"
        )
    output = {command: others[command]()} if command in others else {}
    session.json(schema(command, stages, output))
