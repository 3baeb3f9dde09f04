"""A new plugin, as a directory whose tests pass at once: what `palpate new-plugin` writes."""

import importlib.metadata
import importlib.util
import keyword
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import palpate
from palpate.errors import PluginError
from palpate.plugins.catalogue import Plugins
from palpate.plugins.registry import GROUP, KINDS, owner_of, suggestion

_NAME = re.compile(r"[a-z]([a-z0-9_]*[a-z0-9])?")


@dataclass(frozen=True, slots=True)
class Kit:
    """What can be made: its catalogue, its contract test if it has one, and how it is used."""

    catalogue: str
    noun: str
    contract: str
    use: str
    """A sentence, with ``{}`` for the name."""
    needs: tuple[str, ...] = ("palpate",)
    """Distributions that the plugin depends on."""
    files: tuple[str, ...] = ()
    """More files of the package, each with a template."""


def _named(key: str, table: str) -> str:
    return f"A study names it with `{key}` under `[{table}]`."


_FILTER = "A study names it with a table `[sampling.filters.{}]`."
_CHANNEL = 'A study measures it with `measured = {{ {} = "file" }}` under `[[spot]]`.'


KITS: Mapping[str, Kit] = MappingProxyType(
    {
        "material": Kit("materials", "material", "MaterialContract", _named('material = "{}"', "region.…")),
        "indenter": Kit(
            "indenters", "indenter", "IndenterContract", _named('shape = "{}"', "protocol.indenter")
        ),
        "motion": Kit("motions", "motion", "MotionContract", _named('motion = "{}"', "protocol")),
        "solver": Kit("solvers", "solver", "SolverContract", _named('name = "{}"', "solver")),
        "loader": Kit("loaders", "loader", "LoaderContract", _named('loader = "{}"', "experiment")),
        "scenario": Kit(
            "scenarios",
            "scenario",
            "ScenarioContract",
            _named('scenarios = ["{}"]', "selection"),
            needs=("palpate", "palpate-indentation"),  # declares force and torque
        ),
        "limb": Kit("limb_sources", "limb source", "LimbSourceContract", _named('source = "{}"', "limb")),
        "executor": Kit("executors", "executor", "ExecutorContract", _named('name = "{}"', "executor")),
        "sampler": Kit("samplers", "sampler", "SamplerContract", _named('sampler = "{}"', "sampling")),
        "search": Kit("searches", "search", "SearchContract", _named('search = "{}"', "fit")),
        "parametrisation": Kit(
            "parametrisations",
            "parametrisation",
            "ParametrisationContract",
            _named('parametrisation = "{}"', "fit"),
        ),
        "stage": Kit("stages", "stage", "StageContract", "A study's run has it with a table `[stages.{}]`."),
        "section": Kit(
            "sections",
            "section",
            "SectionContract",
            "Every report shows it where it has something.",
            needs=("palpate", "palpate-report"),
        ),
        "filter": Kit("set_filters", "set filter", "SetFilterContract", _FILTER),
        "channel": Kit("channels", "channel", "ChannelContract", _CHANNEL),
        "command": Kit("", "command", "", "Call it with `palpate {} STUDY`."),
        "study": Kit(
            "studies",
            "study",
            "",
            "Copy it with `palpate init --study {}`.",
            needs=("palpate", "palpate-robot-log", "palpate-jax", "palpate-materials"),
            files=("study/study.toml", "study/strip.csv"),
        ),
    }
)
"""Kinds of plugin that can be made, by the word on the command line."""


def new_plugin(kind: str, name: str, into: Path, plugins: Plugins, commands: Collection[str] = ()) -> Path:
    """Write a plugin of one working component, its tests and its README; returns the new directory.

    Parameters
    ----------
    kind : str
        One of ``KITS``.
    name : str
        Name of the component in a study: lower case, an identifier, not taken in ``plugins`` or ``commands``.
    into : Path
        Where the directory ``palpate-<name>`` is made.

    Raises
    ------
    PluginError
        No such kind; the name is no identifier or taken; the directory exists or cannot be written.
    """
    if kind not in KITS:
        known = ", ".join(KITS)
        raise PluginError(f"no plugin of kind '{kind}' can be made{suggestion(kind, KITS)} (known: {known})")
    _check_free(kind, name, plugins, commands)
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


def _shown(kind: str, name: str) -> str:
    """Name that a user writes: those of commands and studies have hyphens."""
    return name.replace("_", "-") if kind in ("command", "study") else name


def _check_free(kind: str, name: str, plugins: Plugins, commands: Collection[str]) -> None:
    """Refuse a name that Python cannot use, or that palpate or an installed plugin has."""
    if not _is_allowed(name):
        raise PluginError(
            f"plugin name '{name}': give a Python identifier in lower case that is no keyword, such as "
            f"{_repaired(name)}"
        )
    catalogue = KITS[kind].catalogue
    if _shown(kind, name) in (plugins.catalogue(catalogue) if catalogue else commands):
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
    return bool(_NAME.fullmatch(name)) and not keyword.iskeyword(name) and not keyword.issoftkeyword(name)


def _repaired(name: str) -> str:
    """Offer an allowed name like the one given."""
    like = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII).strip("_")
    return like if _is_allowed(like) else f"my_{like}".rstrip("_")


def _class(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def _files(kind: str, name: str) -> dict[str, str]:
    """Content of every file, by its path in the directory."""
    try:
        import jinja2
    except ImportError:
        raise PluginError("jinja2 writes a plugin's files; pip install 'palpate[testing]'") from None
    kit, package, shown = KITS[kind], f"palpate_{name}", _shown(kind, name)
    major, minor = map(int, palpate.__version__.split(".")[:2])
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("palpate.plugins", "templates"),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        autoescape=False,  # Python and TOML, and every word in them is checked
    )
    words = {
        "name": name,
        "shown": shown,
        "title": name.replace("_", " ").capitalize(),
        "cls": _class(name),
        "constant": name.upper(),
        "package": package,
        "distribution": _distribution(name),
        "noun": kit.noun,
        "kind_shown": kit.catalogue.replace("_", "-") or "commands",
        "contract": kit.contract,
        "use": kit.use.format(shown),
        "entry": _entry_point(kit, package, name, shown),
        "needs": kit.needs,
        # Versions of palpate, and of what is released with it, that the plugin is written for.
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
    templates |= {f"src/{package}/{file}": f"{kind}/{Path(file).name}" for file in kit.files}
    made = {
        path: environment.get_template(f"{template}.jinja").render(words)
        for path, template in templates.items()
    }
    return {**made, f"src/{package}/py.typed": ""}


def _entry_point(kit: Kit, package: str, name: str, shown: str) -> tuple[str, str, str]:
    """Group, name and object: the one component, so that a list of commands does not import it."""
    if not kit.catalogue:
        return GROUP, name, package
    made = _class(name) if KINDS[kit.catalogue].holds_components else name.upper()
    return f'"{GROUP}.{kit.catalogue}"', shown, f"{package}:{made}"
