"""Discovery of plugins, and the catalogues of what they provide.

A typed facade over pluggy. A plugin that cannot be imported, misspells a hook,
raises or returns the wrong thing is left out as a whole and listed in
:attr:`Plugins.broken` with the reason, and everything else works. The core
registers first, then the distributions released with it, then other entry points by name, then files
in the order given. Of two components with one name the first keeps it; the other is listed as left out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

from palpate.errors import PluginError
from palpate.plugins.registry import KINDS, MORE, Registry, registered, suggestion

if TYPE_CHECKING:
    import typer

    from palpate.domain import Channel, Scenario, StudyTemplate
    from palpate.domain.indenter import Indenter
    from palpate.domain.material import Material
    from palpate.plugins.execution import Executor
    from palpate.plugins.guard import BrokenPlugin
    from palpate.plugins.interfaces import ExperimentLoader, LimbSource, Sampler, SetFilter, Solver
    from palpate.plugins.motion import Motion
    from palpate.plugins.parametrisation import Parametrisation
    from palpate.plugins.score import Score
    from palpate.plugins.search import Search
    from palpate.plugins.sections import Section

T = TypeVar("T")


class UnknownNameError(PluginError, KeyError):
    """No plugin provides this name."""

    __str__ = Exception.__str__  # a KeyError would print its message quoted


class Catalogue(Mapping[str, T]):
    """Components of one kind that plugins provide, by name, in order of registration.

    Parameters
    ----------
    noun : str
        What an entry is called in messages.
    entries : mapping of name to (entry, name of its plugin)
    broken : sequence of BrokenPlugin
        Named when a name is missing, since one of them may be why.
    """

    def __init__(
        self, noun: str, entries: Mapping[str, tuple[T, str]], broken: Sequence[BrokenPlugin] = ()
    ) -> None:
        self.noun = noun
        self._entries = dict(entries)
        self._broken = tuple(broken)

    def __getitem__(self, name: str) -> T:
        return self._entry(name)[0]

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def __repr__(self) -> str:
        return f"Catalogue({self.noun}: {', '.join(self)})"

    def provider(self, name: str) -> str:
        """Name of the plugin that provides ``name``."""
        return self._entry(name)[1]

    def _entry(self, name: str) -> tuple[T, str]:
        if found := self._entries.get(name):
            return found
        close = suggestion(name, self._entries)
        # A broken plugin is the likely cause, so its reason comes before the names.
        cause = f" (plugins left out as broken: {'; '.join(map(str, self._broken))})" if self._broken else ""
        message = f"no {self.noun} '{name}'{cause}{close} (known: {', '.join(self._entries) or 'none'})"
        if self.noun == "stage":
            message += f"; {MORE}"
        else:
            message += "; if a file of yours provides it, give it as --plugin FILE or as [study] plugins"
        raise UnknownNameError(message)


class Plugins:
    """Everything that the core and its plugins provide.

    Build it with :meth:`load`. Each attribute is a :class:`Catalogue`.
    """

    studies: Catalogue[StudyTemplate]
    channels: Catalogue[Channel]
    loaders: Catalogue[type[ExperimentLoader]]
    limb_sources: Catalogue[type[LimbSource]]
    indenters: Catalogue[type[Indenter]]
    motions: Catalogue[type[Motion]]
    materials: Catalogue[type[Material]]
    samplers: Catalogue[type[Sampler]]
    set_filters: Catalogue[type[SetFilter]]
    solvers: Catalogue[type[Solver]]
    scores: Catalogue[type[Score]]
    executors: Catalogue[type[Executor]]
    parametrisations: Catalogue[type[Parametrisation]]
    searches: Catalogue[type[Search]]
    scenarios: Catalogue[Scenario]
    stages: Catalogue[Any]  # classes of palpate.stages.stage.Stage, which is above this room
    sections: Catalogue[type[Section]]

    def __init__(
        self, registry: Registry, files: Sequence[Path], load: Callable[[Sequence[Path]], Plugins]
    ) -> None:
        self._registry, self._load = registry, load
        self.files = tuple(files)
        self.broken = tuple(registry.broken)
        for kind, entries in registry.entries.items():
            setattr(self, kind, Catalogue(KINDS[kind].noun, entries, self.broken))

    @classmethod
    def load(
        cls,
        files: Sequence[Path] = (),
        *,
        entry_points: bool = True,
        without: Sequence[str] = (),
        modules: Sequence[object] = (),
        kinds: Collection[str] = KINDS.keys(),
    ) -> Plugins:
        """Find and import every plugin, and ask it for what it provides.

        Parameters
        ----------
        files : sequence of Path
            One-file plugins, as given with ``--plugin``.
        entry_points : bool
            False leaves out the installed distributions.
        without : sequence of str
            Names of plugins, or of their distributions, that are left out as if not installed.
        modules : sequence of module or object
            Plugins that are imported already.
        kinds : collection of str
            Names of the catalogues to fill; the others are missing.

        Raises
        ------
        PluginError
            A file does not exist. (A file that exists but does not work is
            listed as broken.)
        """
        registry = registered(files, entry_points=entry_points, without=without, modules=modules)
        registry.collect(kinds)
        again = partial(cls.load, entry_points=entry_points, without=without, modules=modules, kinds=kinds)
        return cls(registry, list(dict.fromkeys(path.resolve() for path in files)), again)

    def with_files(self, files: Sequence[Path]) -> Plugins:
        """The same with more one-file plugins; itself where it has them all."""
        more = [path for path in files if path.resolve() not in self.files]
        return self._load([*self.files, *more]) if more else self

    def catalogue(self, kind: str) -> Catalogue[Any]:
        """Catalogue by the name of its attribute, one of ``KINDS``."""
        if kind not in KINDS:
            known = ", ".join(KINDS)
            raise PluginError(f"no kind of plugin '{kind}'{suggestion(kind, KINDS)} (known: {known})")
        return cast("Catalogue[Any]", getattr(self, kind))

    def add_commands(self, app: typer.Typer) -> tuple[BrokenPlugin, ...]:
        """Let every plugin add its commands to ``app``; returns those that could not."""
        return self._registry.add_commands(app)

    def outputs(self) -> dict[str, Callable[[], Any]]:
        """Functions that import the types of the JSON of plugins' commands, by the command's name."""
        return self._registry.outputs()

    def commands(self, app: typer.Typer) -> dict[str, str]:
        """Add the commands of every plugin to ``app``; returns the plugin of each by its name."""
        self._registry.add_commands(app)
        return dict(self._registry.commands)
