"""A new plugin, as a directory whose tests pass at once: what `palpate new-plugin` writes."""

import importlib.metadata
import importlib.util
import inspect
import keyword
import pkgutil
import re
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import palpate
from palpate.errors import PluginError
from palpate.plugins import hookspecs
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import GROUP, KINDS, owner_of, suggestion


@dataclass(frozen=True, slots=True)
class Kit:
    """Kind of plugin to make: the catalogue of its component, its noun, and how a study uses it."""

    catalogue: str
    noun: str
    use: str
    """A sentence, with ``{}`` for the name."""
    is_whole: bool = False
    """Whether the entry point names the module, with all its hooks, and not the one component."""


def _named(key: str, table: str) -> str:
    return f"A study names it with `{key}` under `[{table}]`."


FIBRES, GENERIC = "fibres", "generic"

KITS: Mapping[str, Kit] = MappingProxyType(
    {
        "material": Kit("materials", "material", _named('material = "{}"', "region.…")),
        FIBRES: Kit("materials", "material with fibres", _named('material = "{}"', "region.…")),
        "solver": Kit("solvers", "solver", _named('name = "{}"', "solver")),
        "loader": Kit("loaders", "loader", _named('loader = "{}"', "experiment")),
        "stage": Kit("stages", "stage", "A study's run has it with a table `[stages.{}]`."),
        GENERIC: Kit("samplers", "sampler", _named('sampler = "{}"', "sampling"), is_whole=True),
    }
)
"""Kinds of plugin that can be made, by the word on the command line; ``generic`` shows every other hook."""


def new_plugin(kind: str, name: str, into: Path, plugins: Plugins) -> Path:
    """Write a plugin of one working component, its tests and its README; returns the new directory.

    ``kind`` is one of ``KITS``, ``name`` the component's in a study, and ``into`` where the directory
    ``palpate-<name>`` is made. A PluginError where there is no such kind, the name is no identifier in lower
    case or is taken, or the directory exists or cannot be written.
    """
    if kind not in KITS:
        known = ", ".join(KITS)
        raise PluginError(
            f"no plugin of kind '{kind}' can be made{suggestion(kind, KITS)} (known: {known}; {GENERIC} has "
            "every other hook)"
        )
    _check_free(kind, name, plugins)
    folder = into / _distribution(name)
    if folder.exists():
        raise PluginError(f"{folder}: exists; choose another name, or another folder with --into")
    files = _files(kind, name)
    try:
        for path, text in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise PluginError(f"{folder}: cannot be written ({error.strerror}); name another folder") from error
    return folder


def _distribution(name: str) -> str:
    return f"palpate-{name.replace('_', '-')}"


def _check_free(kind: str, name: str, plugins: Plugins) -> None:
    """Refuse a name that Python cannot use, or that palpate or an installed plugin has."""
    if not _is_allowed(name):
        like = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII).strip("_")
        like = like if _is_allowed(like) else f"my_{like}".rstrip("_")
        raise PluginError(
            f"plugin name '{name}': give a Python identifier in lower case that is no keyword, such as {like}"
        )
    if name in plugins.catalogue(KITS[kind].catalogue):
        raise PluginError(f"{KITS[kind].noun} '{name}' is already provided; choose another name")
    for point in importlib.metadata.entry_points(group=GROUP, name=name):
        raise PluginError(
            f"plugin name '{name}' is taken by distribution {owner_of(point)}; choose another name"
        )
    if _class(name) in dir(palpate):
        raise PluginError(
            f"plugin name '{name}': its class would hide palpate's own {_class(name)}; choose another name, "
            f"such as my_{name}"
        )
    if name == GROUP or importlib.util.find_spec(f"palpate_{name}") is not None:
        raise PluginError(f"the module palpate_{name} is installed already; choose another name")


def _is_allowed(name: str) -> bool:
    is_word = re.fullmatch(r"[a-z]([a-z0-9_]*[a-z0-9])?", name) is not None
    return is_word and not keyword.iskeyword(name) and not keyword.issoftkeyword(name)


def _class(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def _files(kind: str, name: str) -> dict[str, str]:
    """Content of every file, by its path in the directory."""
    try:
        import jinja2
    except ImportError:
        raise PluginError("jinja2 writes a plugin's files; pip install 'palpate[testing]'") from None
    kit, package = KITS[kind], f"palpate_{name}"
    major, minor = map(int, palpate.__version__.split(".")[:2])
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("palpate.plugins", "templates"),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,  # Python and TOML, and every word in them is checked
    )
    words = {
        "name": name,
        "title": name.replace("_", " ").capitalize(),
        "cls": _class(name),
        "package": package,
        "distribution": _distribution(name),
        "noun": kit.noun,
        "catalogue": kit.catalogue,
        "contract": KINDS[kit.catalogue].contract,
        "use": kit.use.format(name),
        "entry": (GROUP, name, package)
        if kit.is_whole
        else (f'"{GROUP}.{kit.catalogue}"', name, f"{package}:{_class(name)}"),
        "hooks": _hooks() if kind == GENERIC else [],
        # Versions of palpate that the plugin is written for.
        "bounds": f">={major}.{minor},<{major}.{minor + 1}",
    }
    templates = {
        "pyproject.toml": "pyproject.toml",
        "README.md": "README.md",
        "LICENSE": "LICENSE",
        "tests/conftest.py": "conftest.py",
        f"src/{package}/__init__.py": f"{kind}/module.py",
        f"tests/test_{name}.py": f"{kind}/test.py",
    }
    made = {
        path: environment.get_template(f"{template}.jinja").render(words)
        for path, template in templates.items()
    }
    return {**made, f"src/{package}/py.typed": ""}


def _hooks() -> list[str]:
    """Comment on every hook: its signature, what it returns, what to import for that, and its contract."""
    rooms = importlib.import_module("palpate.api")
    names = ["palpate.api", *(f"palpate.api.{room.name}" for room in pkgutil.iter_modules(rooms.__path__))]
    kinds, lines = {kind.hook: kind for kind in KINDS.values()}, []
    for hook, spec in vars(hookspecs).items():
        if not hasattr(spec, "palpate_spec"):
            continue
        meaning = " ".join((spec.__doc__ or "").split("\n\n")[0].split())
        line = f"{hook}({', '.join(inspect.signature(spec).parameters)}): {meaning}"
        if hook in kinds:
            kind = kinds[hook]
            first = kind.base.split(" or ")[0]
            home = next(name for name in names if first in dir(importlib.import_module(name)))
            tested = f", tested by {kind.contract}" if kind.contract else ""
            what = "classes" if kind.holds_components else "values"
            line += f" Returns {what} of {kind.base} (from {home}){tested}."
        lines += ["#", *textwrap.wrap(line, 106, initial_indent="# ", subsequent_indent="#     ")]
    return lines
