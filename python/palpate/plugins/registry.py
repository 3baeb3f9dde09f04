"""Registry of plugins, which imports them and asks for what they provide, each behind a guard.

One plugin's mistake must not stop another: whatever a plugin does wrong while
it is imported or asked becomes a :class:`BrokenPlugin` with the reason.
"""

import difflib
import functools
import importlib.metadata
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any

import pluggy

from palpate.errors import PluginError
from palpate.fingerprints import CONTENT_HASH, content_hash
from palpate.plugins import hookspecs
from palpate.plugins.commands import new_names
from palpate.plugins.guard import BrokenPlugin, guarded
from palpate.plugins.versions import API_VERSION, FIRST_PARTY, THIS_VERSION

if TYPE_CHECKING:
    import typer

    from palpate.domain.component import Component
    from palpate.domain.material import Material
    from palpate.plugins.commands import Command

DOMAIN, INTERFACES = "palpate.domain", "palpate.plugins.interfaces"

GROUP = "palpate"
"""Entry-point group of plugins with hooks, and the name of the core's own plugin.

``palpate.materials`` and so on, one group for each of ``KINDS``, hold single components.
"""

MORE = "pip install 'palpate[standard]' brings palpate's own plugins"
"""Where commands and components that are missing may come from."""


@dataclass(frozen=True, slots=True)
class Kind:
    """One catalogue: the hook that fills it, and what the hook must return: one class, or A or B."""

    hook: str
    noun: str
    home: str
    base: str

    @property
    def contract(self) -> str:
        """Class of :mod:`palpate.testing` that tests what is provided; empty where it has none."""
        words = self.noun.removeprefix("experiment ").title().replace(" ", "")
        return "" if words in ("Study", "Section") else f"{words}Contract"

    @property
    def bases(self) -> tuple[type[Any], ...]:
        """Classes of what the hook returns, or of its instances; imported when they are asked for."""
        return tuple(getattr(importlib.import_module(self.home), name) for name in self.base.split(" or "))

    @property
    def holds_components(self) -> bool:
        """Whether the hook returns classes, and not values."""
        from palpate.domain.component import Component

        return issubclass(self.bases[0], Component)


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "studies": Kind("palpate_studies", "study", DOMAIN, "StudyTemplate"),
        "channels": Kind("palpate_channels", "channel", DOMAIN, "Channel"),
        "loaders": Kind("palpate_experiment_loaders", "experiment loader", INTERFACES, "ExperimentLoader"),
        "limb_sources": Kind("palpate_limb_sources", "limb source", INTERFACES, "LimbSource"),
        "indenters": Kind("palpate_indenters", "indenter", "palpate.domain.indenter", "Indenter"),
        "motions": Kind("palpate_motions", "motion", "palpate.plugins.motion", "Motion"),
        "materials": Kind(
            "palpate_materials",
            "material",
            "palpate.domain.material",
            "IsotropicMaterial or AnisotropicMaterial",
        ),
        "samplers": Kind("palpate_samplers", "sampler", INTERFACES, "Sampler"),
        "set_filters": Kind("palpate_set_filters", "set filter", INTERFACES, "SetFilter"),
        "solvers": Kind("palpate_solvers", "solver", INTERFACES, "Solver"),
        "scores": Kind("palpate_scores", "score", "palpate.plugins.score", "Score"),
        "executors": Kind("palpate_executors", "executor", "palpate.plugins.execution", "Executor"),
        "parametrisations": Kind(
            "palpate_parametrisations",
            "parametrisation",
            "palpate.plugins.parametrisation",
            "Parametrisation",
        ),
        "searches": Kind("palpate_searches", "search", "palpate.plugins.search", "Search"),
        "scenarios": Kind("palpate_scenarios", "scenario", DOMAIN, "Scenario"),
        "stages": Kind("palpate_stages", "stage", "palpate.stages.stage", "Stage"),
        "sections": Kind("palpate_sections", "section", "palpate.plugins.sections", "Section"),
    }
)
"""The catalogues in pipeline order, by the name of their attribute in :class:`Plugins`."""

HOOKS = frozenset({*(kind.hook for kind in KINDS.values()), "palpate_commands"})


def suggestion(name: str, known: Iterable[str]) -> str:
    """Text that offers the close matches of ``name`` among ``known``, or is empty."""
    close = difflib.get_close_matches(name, list(known), n=3, cutoff=0.5)
    return f"; did you mean {' or '.join(repr(match) for match in close)}?" if close else ""


class Registry:
    """Plugins by name, and their entries by kind, as they are being collected."""

    def __init__(self) -> None:
        self.manager = pluggy.PluginManager(GROUP)
        self.manager.add_hookspecs(hookspecs)
        self.entries: dict[str, dict[str, tuple[Any, str]]] = {}
        self.sources: dict[str, str] = {}
        self.broken: list[BrokenPlugin] = []
        self.commands: dict[str, str] = {}
        self.installed: Collection[str] = ()
        """Names of the core's plugin and of distributions, whose components keep a name before a file's."""
        self.points: list[tuple[str, importlib.metadata.EntryPoint]] = []
        """Entry points of single components by kind, imported when the catalogues are filled."""

    def register(self, name: str, source: str, load: Callable[[], object]) -> None:
        """Import one plugin and register its hooks, or list it as broken."""
        try:
            if name in self.sources:
                raise PluginError(f"the plugin name '{name}' is taken by {self.sources[name]}; rename one")
            with guarded():
                plugin = load()
                _check_version(plugin)
            self._register(name, plugin)
        except PluginError as error:
            self._leave_out(name, source, error)
            return
        self.sources[name] = source

    def _leave_out(self, name: str, source: str, error: PluginError, component: str = "") -> None:
        self.broken.append(BrokenPlugin.of(error, name, source, component))

    def collect(self, kinds: Collection[str]) -> None:
        """Ask every plugin for what it provides of some kinds; one that fails is listed as broken."""
        self.entries = {kind: {} for kind in kinds}
        given = self.sources.keys() - self.installed
        self._collect_hooks(kinds, self.installed)
        for kind, point in ((kind, point) for kind, point in self.points if kind in kinds):
            owner, source = owner_of(point), _source(point)
            try:
                self._add(kind, _single(kind, point), owner, source)
            except PluginError as error:
                self._leave_out(owner, source, error, f"{KINDS[kind].noun} '{point.name}'")
        self._collect_hooks(kinds, given)

    def _collect_hooks(self, kinds: Collection[str], names: Collection[str]) -> None:
        for name, source in [each for each in self.sources.items() if each[0] in names]:
            try:
                provided = {kind: self._provided(name, kind) for kind in kinds}
            except PluginError as error:
                del self.sources[name]
                self._leave_out(name, source, error)
                continue
            for kind, items in provided.items():
                for item in items:
                    self._add(kind, item, name, source)

    def _add(self, kind: str, item: Any, owner: str, source: str) -> None:  # noqa: ANN401 -- any entry
        """Enter one item; of two with one name the first keeps it."""
        noun, name = KINDS[kind].noun, item.name
        held, holder = self.entries[kind].setdefault(name, (item, owner))
        if held is item or (not isinstance(item, type) and held == item):
            return
        reason = (
            f"{noun} '{name}' of plugin '{owner}' is already provided by plugin '{holder}'; rename one, or "
            "leave a plugin out (--no-plugin)"
        )
        self._leave_out(owner, source, PluginError(reason), f"{noun} '{name}'")

    def _register(self, name: str, plugin: object) -> None:
        _check_hooks(plugin)
        try:
            with guarded():
                self.manager.register(plugin, name)
        except PluginError:
            # Older releases of pluggy keep what they had registered before they failed.
            if self.manager.is_registered(plugin):
                self.manager.unregister(plugin)
            raise

    def _provided(self, name: str, kind: str) -> list[Any]:
        hook = KINDS[kind].hook
        with guarded():
            call = self._call(name, hook)
            results = call()
            if len(results) < len(call.get_hookimpls()):
                raise PluginError(f"{hook} returned None; return a list")
            items = [item for result in results for item in _as_items(result, hook)]
            for item in items:
                _check_item(item, KINDS[kind], hook)
        return items

    def _call(self, name: str, hook: str) -> pluggy.HookCaller:
        others = [plugin for key, plugin in self.manager.list_name_plugin() if key != name]
        return self.manager.subset_hook_caller(hook, others)

    def add_commands(
        self, app: "typer.Typer", add_stage: "Callable[[type[Component]], None] | None" = None
    ) -> tuple[BrokenPlugin, ...]:
        """Let every plugin add its commands, all of them or none; ``add_stage`` adds a stage's command.

        A plugin with commands of its own lists its stages' commands too, so that none is imported here.
        """
        broken = []
        for name, source in self.sources.items():
            try:
                with guarded():
                    added = self._own_commands(name)
                    is_for_stages = add_stage and all(command.stage for command in added)
                    stages = self._stages(name) if is_for_stages else []
                    names = new_names(app, added, [stage.name for stage in stages])
            except PluginError as error:
                broken.append(BrokenPlugin.of(error, name, source))
                continue
            self.commands |= dict.fromkeys(names, name)
            for command in added:
                command.add_to(app)
            for stage in stages:
                add_stage(stage)  # type: ignore[misc]
        return tuple(broken)

    def outputs(self) -> dict[str, Callable[[], Any]]:
        """Functions that import the types of the JSON of plugins' commands, by the command's name."""
        found: dict[str, Callable[[], Any]] = {}
        for name in self.sources:
            with guarded():
                commands = [each for each in self._own_commands(name) if each.output]
            found |= {each.name: functools.partial(pkgutil.resolve_name, each.output) for each in commands}
        return found

    def _own_commands(self, plugin: str) -> "list[Command]":
        results = self._call(plugin, "palpate_commands")()
        return [command for result in results for command in _as_items(result, "palpate_commands")]

    def _stages(self, plugin: str) -> "list[type[Component]]":
        """Stages of a plugin besides the core: through its hook, and as single components."""
        if plugin == GROUP:
            return [_single(kind, point) for kind, point in self.points if kind == "stages"]
        return self._provided(plugin, "stages")


def registered(
    files: Sequence[Path], *, entry_points: bool, without: Sequence[str] = (), modules: Sequence[object] = ()
) -> Registry:
    """Import the core's plugin, those released with it, other installed ones by name, modules, and files.

    Entry points and distributions named in ``without`` are left out. A PluginError where a file does not
    exist, or nothing of such a name is installed.
    """
    for path in files:
        if not path.is_file():
            raise PluginError(f"plugin file {path}: no such file; give the path of a Python file")
    registry = Registry()
    # The core's own plugin, imported by name like any other.
    registry.register(GROUP, "the core", lambda: importlib.import_module("palpate.builtins"))
    points = installed_points() if entry_points else []
    known = sorted({name for point in points for name in (point.name, owner_of(point))})
    if unknown := [name for name in without if name not in known]:
        close = suggestion(unknown[0], known)
        raise PluginError(f"no plugin '{unknown[0]}' is installed{close}; see `palpate plugins`")
    for point in points:
        if {point.name, owner_of(point)} & set(without):
            continue
        if point.group == GROUP:
            registry.register(point.name, _source(point), point.load)
        else:
            registry.points.append((point.group.removeprefix(f"{GROUP}."), point))
    registry.installed = frozenset(registry.sources)
    for module in modules:
        name = getattr(module, "__name__", type(module).__name__)
        registry.register(name, "given as itself", lambda module=module: module)  # type: ignore[misc]
    for path in dict.fromkeys(path.resolve() for path in files):
        registry.register(path.stem, str(path), functools.partial(load_file, path))
    return registry


_SOURCES: dict[Path, bytes] = {}
"""Content of each plugin file as this process has imported it last."""


def plugin_source(path: Path) -> bytes:
    """Content of a plugin file as this process has imported it, whatever the file has become since."""
    return _SOURCES.get(path.resolve()) or path.read_bytes()


def load_file(path: Path, source: bytes | None = None) -> ModuleType:
    """Import a one-file plugin, once per process and content: by itself the content of the file.

    The module's name in ``sys.modules`` follows from the file's name and content alone, so that a
    worker process that loads the same content can unpickle instances of its classes.
    """
    _SOURCES[path.resolve()] = source = path.read_bytes() if source is None else source
    digest = content_hash(source)
    name = f"palpate_plugin_{path.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError(f"plugin file {path}: not a Python file; its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    setattr(module, CONTENT_HASH, digest)
    sys.modules[name] = module
    try:
        exec(compile(source, path, "exec", dont_inherit=True), vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    return module


def add_commands(
    app: "typer.Typer",
    files: Sequence[Path] = (),
    without: Sequence[str] = (),
    add_stage: "Callable[[type[Component]], None] | None" = None,
) -> tuple[BrokenPlugin, ...]:
    """Let plugins add their commands, without the time that it takes to import what else they provide."""
    registry = registered(files, entry_points=True, without=without)
    return (*registry.broken, *registry.add_commands(app, add_stage))


def installed_points() -> list[importlib.metadata.EntryPoint]:
    """Entry points of all groups of palpate: the distributions released with the core come first."""
    installed = importlib.metadata.entry_points()
    # A distribution that two folders of sys.path describe is still one plugin.
    found = {
        (owner_of(point) not in FIRST_PARTY, point.name, point.value, owner_of(point), point.group): point
        for group in (GROUP, *(f"{GROUP}.{kind}" for kind in KINDS))
        for point in installed.select(group=group)
    }
    return [found[key] for key in sorted(found)]


def owner_of(point: importlib.metadata.EntryPoint) -> str:
    """Name of the distribution of an entry point."""
    return point.dist.name if point.dist else point.value


def _source(point: importlib.metadata.EntryPoint) -> str:
    return f"distribution {owner_of(point)}"


def _single(kind: str, point: importlib.metadata.EntryPoint) -> Any:  # noqa: ANN401 -- any entry
    """Import the one component, or value, of an entry point."""
    group = f"{GROUP}.{kind}"
    with guarded():
        item = point.load()
        _check_version(item)
        _check_item(item, KINDS[kind], group)
    if item.name != point.name:
        raise PluginError(f"{group}: '{point.name}' provides '{item.name}'; give both one name")
    return item


def _check_version(plugin: object) -> None:
    """Refuse a plugin that needs names or meanings which this version of :mod:`palpate.api` lacks.

    The plugin's own ``palpate_api`` counts, else its module's, else the packages' around it.
    """
    parts = str(getattr(plugin, "__module__", None) or getattr(plugin, "__name__", "")).split(".")
    around = (sys.modules.get(".".join(parts[:n])) for n in range(len(parts), 0, -1))
    stated = (getattr(place, "palpate_api", None) for place in (plugin, *around))
    # A module of that name is no version.
    needed = next((each for each in stated if not isinstance(each, ModuleType | None)), API_VERSION)
    try:
        major, minor = map(int, needed)
    except (TypeError, ValueError):
        raise PluginError(f"palpate_api = {needed!r}; give major and minor version, as in (1, 0)") from None
    if major != API_VERSION[0] or minor > API_VERSION[1]:
        raise PluginError(f"needs version {major}.{minor} of palpate.api; {THIS_VERSION}")


def _check_hooks(plugin: object) -> None:
    """Refuse hooks that would be passed over in silence: misspelt, not marked, or none at all."""
    found = False
    for name in dir(plugin):
        member = getattr(plugin, name, None)
        if not inspect.isroutine(member) or hasattr(member, "palpate_spec"):
            continue
        marked = hasattr(member, "palpate_impl")
        found |= marked
        if (marked or name.startswith("palpate_")) and name not in HOOKS:
            raise PluginError(f"unknown hook '{name}'{suggestion(name, HOOKS)}")
        if name in HOOKS and not marked:
            raise PluginError(f"hook '{name}' is not marked; put @palpate.hookimpl above it")
    if not found:
        raise PluginError(
            "provides nothing: no function is marked @palpate.hookimpl; add one, such as palpate_materials()"
        )


def _as_items(result: object, hook: str) -> list[Any]:
    if isinstance(result, str) or not isinstance(result, Iterable):
        raise PluginError(f"{hook} returned {result!r}; return a list")
    return list(result)


def _check_item(item: object, kind: Kind, hook: str) -> None:
    if kind.holds_components:
        if not (isinstance(item, type) and issubclass(item, kind.bases)):
            raise PluginError(f"{hook} returned {item!r}; return subclasses of {kind.base}")
        _check_component(item, hook)
    elif not isinstance(item, kind.bases):
        raise PluginError(f"{hook} returned {item!r}; return {kind.base} values")
    else:
        _check_text(item, "name", hook)


def _check_component(component: "type[Component]", hook: str) -> None:
    from palpate.domain.material import Material
    from palpate.plugins.sections import Section

    if inspect.isabstract(component):
        missing = ", ".join(sorted(component.__abstractmethods__))
        raise PluginError(f"{hook}: class {component.__name__} does not define {missing}")
    _check_text(component, "name", hook)
    _check_text(component, "summary", hook)
    _check_name(component.name, f"{hook}: name {component.name!r} of class {component.__name__}")
    if issubclass(component, Material):
        _check_parameters(component, hook)
    if issubclass(component, Section):
        _check_text(component, "title", hook)
    for name, info in component.Settings.model_fields.items():
        if not info.description:
            raise PluginError(
                f"{hook}: setting '{name}' of '{component.name}' has no description; "
                "give it one with pydantic.Field(description=...)"
            )


def _check_parameters(material: "type[Material]", hook: str) -> None:
    from palpate.domain import Parameter

    if any(field.is_required() for field in material.Settings.model_fields.values()):
        return  # they follow from settings that only a study gives
    given = getattr(material(), "parameters", None)
    found, name = list(given) if isinstance(given, Iterable) else [], material.name
    if not found:
        raise PluginError(
            f"{hook}: material '{name}' has no parameters; give it a tuple of palpate.Parameter"
        )
    for number, each in enumerate(found, 1):
        if not isinstance(each, Parameter):
            raise PluginError(
                f"{hook}: entry {number} of the parameters of material '{name}' is {each!r}; "
                "give a palpate.Parameter there"
            )
        _check_name(each.name, f"{hook}: parameter name {each.name!r} of material '{name}'")
        if each.name in [other.name for other in found[: number - 1]]:
            raise PluginError(f"{hook}: material '{name}' has two parameters '{each.name}'; rename one")


def _check_name(name: str, what: str) -> None:
    if not name.isidentifier():
        raise PluginError(f"{what} is no identifier; use letters, digits and _, such as my_name")


def _check_text(item: object, attribute: str, hook: str) -> None:
    text = getattr(item, attribute, None)
    if not isinstance(text, str) or not text.strip():
        raise PluginError(f"{hook}: {item!r} has no {attribute}; give it a non-empty string")
