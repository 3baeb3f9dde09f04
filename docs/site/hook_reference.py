"""The reference for plugins, ``plugins/reference.md``, from hooks, interfaces and values themselves.

``python docs/site/hook_reference.py`` writes it between its two marks.
"""

import dataclasses
import importlib
import inspect
import pkgutil
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import palpate.api
from palpate import api
from palpate.api import experiment, fit
from palpate.cli.session import Session
from palpate.domain.component import Component
from palpate.errors import PluginError
from palpate.plugins import hookspecs
from palpate.plugins.interfaces import ExperimentLoader, Solver
from palpate.plugins.optional import CurveWriter, FileInspector, LoadingDrawer, PressChecker, Verifier
from palpate.plugins.registry import KINDS
from palpate.plugins.scaffold import KITS
from palpate_report.api import ReportData

FILE = Path(__file__).parents[2] / "plugins" / "reference.md"
VALUES: tuple[type[Any], ...] = (
    *(api.Job, api.Indentation, api.HomogeneousTests, api.Limb, api.Spot, api.Mesh, api.Simulation),
    *(api.Response, api.Curve, api.Relaxation, api.Channel, experiment.EquilibriumStates, api.Provides),
    *(fit.SearchSpace, fit.Trial, fit.Evaluation, ReportData),
)
"""Values that plugins receive, in the order of a run."""

BEGIN = "<!-- hooks: written by make hooks -->"
END = "<!-- end of hooks -->"

WIDTH = 132
"""Longest line of running text."""

OPTIONAL: Mapping[type[Component], tuple[type[Any], ...]] = MappingProxyType(
    {ExperimentLoader: (CurveWriter, FileInspector, LoadingDrawer, PressChecker), Solver: (Verifier,)}
)
"""Optional protocols of components."""


def reference() -> str:
    """Describe every hook, in pipeline order: what it returns, what to subclass, what tests it."""
    specs = {name: spec for name, spec in vars(hookspecs).items() if hasattr(spec, "palpate_spec")}
    kinds = {kind.hook: key for key, kind in KINDS.items()}
    hooks = (line for name, spec in specs.items() for line in _hook(name, spec, kinds.get(name)))
    fields = (line for value in VALUES for line in _value(value))
    return "\n".join(["## Hooks", "", *hooks, "## Values", "", *fields, "## Session", "", *_session()])


def written(text: str, where: str) -> str:
    """Put the reference between the marks of a text.

    Raises
    ------
    PluginError
        The marks are not there.
    """
    pattern = re.compile(f"{re.escape(BEGIN)}.*{re.escape(END)}", flags=re.DOTALL)
    if not pattern.search(text):
        raise PluginError(f"{where}: has no lines '{BEGIN}' and '{END}'; put them where the hooks belong")
    return pattern.sub(lambda _: f"{BEGIN}\n\n{reference()}\n{END}", text)


def _hook(name: str, spec: Any, kind: str | None) -> Iterator[str]:  # noqa: ANN401 - a function with marks
    yield f"### `{name}`"
    yield ""
    yield f"`{_signature(spec)}`"
    yield ""
    for paragraph in _plain(inspect.getdoc(spec) or "").split("\n\n"):
        yield from textwrap.wrap(paragraph, WIDTH, break_long_words=False, break_on_hyphens=False)
        yield ""
    if kind is None:
        return
    yield " ".join(_around(kind))
    yield ""
    for base in KINDS[kind].bases:
        yield from _component(base) if issubclass(base, Component) else _fields(base)
        yield ""


def _around(kind: str) -> Iterator[str]:
    """Write how to list, scaffold and test components of a kind."""
    yield f"Listed by `palpate plugins {kind.replace('_', '-')}`."
    words = [word for word, kit in KITS.items() if kit.catalogue == kind and not kit.is_whole]
    if words:
        yield f"Scaffold: `palpate new-plugin {'|'.join(words)} NAME`."
    if contract := KINDS[kind].contract:
        yield f"Tested by `palpate.testing.{contract}`."


def _signature(function: Any) -> str:  # noqa: ANN401
    return f"{function.__name__}{_short(str(inspect.signature(function)))}"


def _component(base: type[Component]) -> Iterator[str]:
    """List what a subclass sets, defines and may override."""
    yield f"Subclass `{_public(base.__name__)}`:"
    yield ""
    yield f"| `{base.__name__}` | | |"
    yield "|---|---|---|"
    classes = [cls for cls in reversed(base.__mro__) if issubclass(cls, Component) and cls is not Component]
    for name, kind in (each for cls in classes for each in inspect.get_annotations(cls).items()):
        shown = kind if isinstance(kind, str) else inspect.formatannotation(kind)
        shown = re.sub(r"(typing\.)?ClassVar\[(.*)\]", r"\2", shown)
        yield f"| {'may set' if hasattr(base, name) else 'set'} | `{name}` | `{_cell(shown)}` |"
    for cls in (*classes, *OPTIONAL.get(base, ())):
        yield from _methods(cls, "may override" if cls in classes else f"may add, as a `{cls.__name__}`")


def _public(name: str) -> str:
    """Where a plugin imports a name from."""
    modules = [module.name for module in pkgutil.iter_modules(palpate.api.__path__, "palpate.api.")]
    places = ("palpate.api", *modules)
    return next(f"{place}.{name}" for place in places if name in dir(importlib.import_module(place)))


def _methods(base: type[Any], else_called: str) -> Iterator[str]:
    for name, member in vars(base).items():
        if name.startswith("_") or not callable(getattr(base, name)) or inspect.isclass(member):
            continue
        needed = "define" if name in getattr(base, "__abstractmethods__", ()) else else_called
        arguments = ", ".join(p for p in inspect.signature(getattr(base, name)).parameters if p != "self")
        summary = _plain((inspect.getdoc(getattr(base, name)) or "").split("\n")[0])
        yield f"| {needed} | `{name}({arguments})` | {summary} |"


def _fields(base: type) -> Iterator[str]:
    """List the fields of a value."""
    yield f"Values of `{_public(base.__name__)}`:"
    yield ""
    yield f"| `{base.__name__}` | |"
    yield "|---|---|"
    for field in dataclasses.fields(base):
        kind = field.type if isinstance(field.type, str) else inspect.formatannotation(field.type)
        needed = "" if field.default is dataclasses.MISSING else ", optional"
        yield f"| `{field.name}` | `{_cell(kind)}`{needed} |"


def _value(base: type[Any]) -> Iterator[str]:
    """List the fields of a value with their meaning."""
    described = _described(base)
    yield f"### `{base.__name__}`"
    yield ""
    yield from textwrap.wrap(_plain(inspect.getdoc(base) or "").split("\n\n")[0], WIDTH)
    yield ""
    yield f"| `{base.__name__}` | |"
    yield "|---|---|"
    for field in dataclasses.fields(base):
        kind = field.type if isinstance(field.type, str) else inspect.formatannotation(field.type)
        meaning = described.get(field.name, "")
        yield f"| `{field.name}` | `{_cell(kind)}`{': ' if meaning else ''}{meaning} |"
    yield ""


def _described(base: type[Any]) -> dict[str, str]:
    """Meaning of the parameters that a NumPy docstring lists."""
    section = re.search(r"Parameters\n-+\n(.*?)(?:\n\n|\Z)", inspect.getdoc(base) or "", flags=re.DOTALL)
    entries = re.findall(
        r"^(\w[\w, ]*) : [^\n]*\n((?: +[^\n]*\n?)+)", section[1] if section else "", flags=re.MULTILINE
    )
    return {name: _plain(" ".join(text.split())) for names, text in entries for name in names.split(", ")}


def _session() -> Iterator[str]:
    """List the methods of a session of a command."""
    yield "| `Session` | |"
    yield "|---|---|"
    for name, member in vars(Session).items():
        if not name.startswith("_") and (inspect.isfunction(member) or isinstance(member, property)):
            yield f"| `{name}` | {_plain((inspect.getdoc(member) or '').split(chr(10))[0])} |"
    yield ""


def _cell(kind: str) -> str:
    """Type as a cell of a table has it."""
    return _short(kind).replace("|", "\\|")


def _array(match: re.Match[str]) -> str:
    return f"{match[1].capitalize()}Array"


def _short(text: str) -> str:
    """Leave the modules out of the names of types."""
    text = re.sub(r"numpy\.ndarray\[.*?numpy\.dtype\[numpy\.(?:\w*?)(float|int|bool)\w*\]\]", _array, text)
    return re.sub(r"\b(?:palpate|collections|numpy|typer)(?:\.\w+)*\.(?=[A-Z])", "", text).replace("'", "")


def _plain(docstring: str) -> str:
    """Write a docstring as Markdown: no roles, single backticks, each paragraph on one line."""
    text = re.sub(r":\w+:`~?([^`]*)`", r"`\1`", docstring).replace("``", "`").replace("|", "\\|")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def main(arguments: list[str]) -> None:
    """Write the reference into each of the files, or into its own."""
    for path in map(Path, arguments or [str(FILE)]):
        path.write_text(written(path.read_text(encoding="utf-8"), str(path)), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
