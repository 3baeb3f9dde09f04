"""``palpate plugins``: who provides what."""

import importlib.util
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli import completion
from palpate.cli.options import AsJson
from palpate.cli.session import Session

if TYPE_CHECKING:
    from palpate.plugins.catalogue import Plugins

COMMANDS = "commands"
"""What is listed besides the catalogues."""


def plugins(
    context: typer.Context,
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="KIND",
            help="studies, channels, loaders, materials, solvers, scenarios …",
            autocompletion=completion.kinds,
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", help="One entry of that kind, in full.", autocompletion=completion.components
        ),
    ] = None,
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Show where in its code a broken plugin failed.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show the components of all plugins, and why a plugin is broken; exit 2 if a --plugin FILE is."""
    from palpate.plugins.registry import KINDS

    session = Session.of(context)
    kinds = [kind.replace("-", "_")] if kind else [*KINDS, COMMANDS]
    is_list = name is None and not as_json
    found = {key: _entries(session, key, name, brief=is_list) for key in kinds}
    broken = session.with_broken.broken
    if as_json:
        session.json({**found, "broken": [asdict(each) for each in broken]})
    elif name is not None:
        _show_one(session, found[kinds[0]][0])
    else:
        _show_all(session, found)
    for each in broken if traceback else ():
        session.stderr.print(each.traceback or f"{each}\n", markup=False, end="")
    session.refuse_broken(broken)


def _entries(session: Session, kind: str, name: str | None, *, brief: bool) -> list[dict[str, Any]]:
    """Describe all entries of a kind, or the one of this name; briefly for a list."""
    if kind != COMMANDS:
        loaded, how = session.with_broken, described_briefly if brief else describe
        return [how(loaded, kind, each) for each in ([name] if name else loaded.catalogue(kind))]
    from palpate.plugins.catalogue import UnknownNameError
    from palpate.plugins.registry import suggestion

    commands = session.with_broken.commands(session.make_app())
    if name is not None and name not in commands:
        raise UnknownNameError(f"no plugin adds a command '{name}'{suggestion(name, commands)}")
    return [
        {"name": each, "plugin": plugin, "summary": f"palpate {each} --help"}
        for each, plugin in commands.items()
        if name in (None, each)
    ]


def described_briefly(loaded: "Plugins", kind: str, name: str) -> dict[str, Any]:
    """Name, plugin and summary of one entry."""
    catalogue = loaded.catalogue(kind)
    return {"name": name, "plugin": catalogue.provider(name), "summary": _summary(catalogue[name])}


def describe(loaded: "Plugins", kind: str, name: str) -> dict[str, Any]:
    """Everything there is to know about one entry, in plain values."""
    from palpate.cli.settings import settings_rows
    from palpate.domain.component import Component
    from palpate.domain.material import Material
    from palpate.plugins.interfaces import Solver
    from palpate.plugins.provides import provided_by_default

    entry, found = loaded.catalogue(kind)[name], described_briefly(loaded, kind, name)
    if isinstance(entry, type) and issubclass(entry, Component):
        found["class"] = f"{entry.__module__}.{entry.__qualname__}"
        found["settings"] = settings_rows(entry.Settings)
    if isinstance(entry, type) and issubclass(entry, Material):
        found.update(_material(entry))
    if isinstance(entry, type) and issubclass(entry, Solver):
        provides = provided_by_default(entry)  # None where some of its settings have no default
        found["provides"] = {} if provides is None else asdict(provides)
    for attribute in ("abscissa", "ordinate", "weights", "directory"):
        if hasattr(entry, attribute) and not isinstance(entry, type):
            found[attribute] = getattr(entry, attribute)
    return found


def _summary(entry: Any) -> str:  # noqa: ANN401 -- an entry of any kind
    for attribute in ("summary", "description"):
        if isinstance(text := getattr(entry, attribute, None), str):
            return text
    return f"{entry.ordinate_label} over {entry.abscissa_label}" if hasattr(entry, "ordinate_label") else ""


def _material(material: Any) -> dict[str, Any]:  # noqa: ANN401 -- a material class
    if any(field.is_required() for field in material.Settings.model_fields.values()):
        return {"parameters": [], "conventions": []}  # they follow from settings without default
    built = material()
    keys = ("name", "unit", "lower", "upper", "physical_lower", "physical_upper", "kind", "description")
    parameters = [{key: getattr(p, key) for key in keys} for p in built.parameters]
    return {"parameters": parameters, "conventions": ["textbook", *built.conventions]}


def _show_all(session: Session, found: dict[str, list[dict[str, Any]]]) -> None:
    rows = [
        [kind, entry["name"], entry["plugin"], entry["summary"]]
        for kind, entries in found.items()
        for entry in entries
    ]
    session.table("Provided by plugins", ["kind", "name", "plugin", "summary"], rows)
    broken = [[b.name, b.component or "all of it", b.source, b.reason] for b in session.with_broken.broken]
    if broken:
        session.table("Left out", ["plugin", "what", "source", "reason"], broken)


def _show_one(session: Session, entry: dict[str, Any]) -> None:
    for key, value in entry.items():
        if not isinstance(value, list) and key != "provides":
            session.say(f"{key}: {value}")
    if provided := entry.get("provides"):
        session.table("Provides", ["what", "value"], [[k, _shown(v)] for k, v in provided.items()])
    if "conventions" in entry:
        session.say(f"conventions: {', '.join(entry['conventions'])}")
    for key in ("parameters", "settings"):
        if rows := entry.get(key):
            session.table(key.capitalize(), list(rows[0]), [list(row.values()) for row in rows])


def _shown(value: Any) -> Any:  # noqa: ANN401 -- a field of a declaration
    if isinstance(value, tuple):
        return ", ".join(value) or "none"
    return "any" if value is None else value


def new_plugin(
    context: typer.Context,
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="material, fibres, solver, loader, stage, or generic: a sampler, other hooks in comments.",
            autocompletion=completion.templates,
        ),
    ],
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name in a study: lower case, an identifier.")],
    into: Annotated[
        Path, typer.Option("--into", metavar="FOLDER", help="Where to make the folder palpate-NAME.")
    ] = Path(),
    as_json: AsJson = False,
) -> None:
    """Make a plugin of KIND that works: code, tests that pass at once, and notes on changes."""
    from palpate.plugins import scaffold as plugin_kit

    session = Session.of(context)
    folder = plugin_kit.new_plugin(kind, name, into, session.plugins)
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
    if as_json:
        session.json({"kind": kind, "name": name, "folder": str(folder), "files": files})
        return
    session.say(f"{folder}")
    for file in files:
        session.say(f"  {file}")
    first = "" if importlib.util.find_spec("pytest") else "pip install 'palpate[testing]' && "
    session.note(f"next: {first}cd {folder} && pytest")
