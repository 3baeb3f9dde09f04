"""``palpate new-plugin``: a directory to start a plugin from."""

from collections.abc import Collection
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import AsJson
from palpate.cli.session import Session


def new_plugin(
    context: typer.Context,
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="material, indenter, motion, solver, loader, scenario, limb, executor, sampler, search, "
            "parametrisation, stage, section, filter, channel, command or study.",
        ),
    ],
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="What a study will call it: lower case, an identifier.")
    ],
    into: Annotated[
        Path, typer.Option("--into", metavar="FOLDER", help="Where to make the folder palpate-NAME.")
    ] = Path(),
    as_json: AsJson = False,
) -> None:
    """Make a plugin of KIND that works: code, tests that pass at once, and what to change."""
    from palpate.plugins import scaffold as plugin_kit

    session = Session.of(context)
    folder = plugin_kit.new_plugin(kind, name, into, session.plugins, _commands(session))
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    if as_json:
        session.json({"kind": kind, "name": name, "folder": str(folder), "files": files})
        return
    session.say(f"{folder}")
    for file in files:
        session.say(f"  {file}")
    session.note(f"next: cd {folder} && pytest")


def _commands(session: Session) -> Collection[str]:
    from typer.main import get_group

    app = session.make_app()
    session.plugins.commands(app)
    return get_group(app).commands
