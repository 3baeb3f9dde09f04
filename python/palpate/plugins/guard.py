"""The guard around every call of a plugin: whatever goes wrong there is a PluginError that names it."""

import contextlib
import inspect
import os
import sys
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from palpate.errors import NUMPY_IN_ENERGY, PalpateError, PluginError
from palpate.plugins.versions import THIS_VERSION

if TYPE_CHECKING:
    from palpate.domain.component import Component


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokenPlugin:
    """A plugin that is left out, where it comes from, and why.

    ``component`` names the one part that is left out of a plugin of which the rest works.
    """

    name: str
    source: str
    reason: str
    component: str = ""
    traceback: str = ""
    """Of the exception in the plugin's code, if there was one."""

    @classmethod
    def of(cls, error: PluginError, name: str, source: str, component: str = "") -> "BrokenPlugin":
        """Broken plugin, with the reason and the traceback of an error."""
        cause = "".join(traceback.format_exception(error.__cause__)) if error.__cause__ else ""
        return cls(name=name, source=source, reason=str(error), component=component, traceback=cause)

    def __str__(self) -> str:
        return f"{self.name} ({self.source}): {self.reason}"

    @property
    def headline(self) -> str:
        """The same, and whether all of it is left out."""
        return f"{'component' if self.component else 'plugin'} left out: {self}"


@contextlib.contextmanager
def _own_state() -> Iterator[None]:
    try:
        folder = os.getcwd()  # five times as fast as with Path, and once for every trial
    except FileNotFoundError:  # removed; absolute paths are valid without it
        folder = ""
    numpy = sys.modules.get("numpy")  # the list of commands needs none
    errors = contextlib.nullcontext() if numpy is None else numpy.errstate()
    with contextlib.redirect_stdout(sys.stderr), errors:
        try:
            yield
        finally:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                os.chdir(folder)


@contextlib.contextmanager
def answering_for(component: "Component | type[Component]", doing: str) -> Iterator[None]:
    """Turn what a plugin's component raises other than a PalpateError into one that names it.

    What it prints goes to stderr; the working directory and NumPy's error state are restored.

    Parameters
    ----------
    component : Component
        Or its class.
    doing : str
        What it was asked to do, with the file if there is one: ``"reading p1.csv"``.

    Raises
    ------
    PluginError
    """
    try:
        with _own_state():
            yield
    except PalpateError:
        raise
    except (Exception, SystemExit) as error:
        kind = component if isinstance(component, type) else type(component)
        where = f"{kind.__module__}.{kind.__qualname__}"
        line = line_of(error, kind.__module__.partition(".")[0]) or _definition(kind)
        reason, remedy = f": {error}{line}", "correct the plugin, or tell its author"
        if _reads_files(kind):
            remedy = "check the file, or tell the plugin's author"
        if type(error).__name__ == "TracerArrayConversionError":
            reason, remedy = "", NUMPY_IN_ENERGY
        raise PluginError(
            f"{doing}: '{component.name}' ({where}) raised {type(error).__name__}{reason}; {remedy}"
        ) from error


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """Turn whatever a plugin does wrong while it is imported or asked into a PluginError.

    What it prints goes to stderr; the working directory and NumPy's error state are restored.
    """
    try:
        with _own_state():
            yield
    except (PluginError, KeyboardInterrupt):
        raise
    except SystemExit as error:
        raise PluginError(f"called sys.exit({error.code!r}){line_of(error)}") from error
    except BaseException as error:
        if isinstance(error, ImportError) and error.name == "palpate.api":
            raise PluginError(f"{error.msg}; {THIS_VERSION}") from error
        raise PluginError(f"{type(error).__name__}: {error}{line_of(error)}") from error


def _reads_files(kind: type) -> bool:
    from palpate.plugins.interfaces import ExperimentLoader, LimbSource

    return issubclass(kind, (ExperimentLoader, LimbSource))


def _definition(kind: type) -> str:
    """Place of a class, for a call that failed before a line of it ran."""
    try:
        return f" (class at line {inspect.getsourcelines(kind)[1]} of {inspect.getsourcefile(kind)})"
    except (OSError, TypeError):  # made in no file
        return ""


def line_of(error: BaseException, package: str = "") -> str:
    """Last line of the plugin in a traceback, as `` (line 3 of mine.py)``; empty if there is none.

    The plugin is a plugin file, else ``package``; without a package, the first one called from palpate.
    """
    if isinstance(error, SyntaxError):
        return ""  # its text has the line
    places = [
        (str(frame.f_globals.get("__name__")).partition(".")[0], frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
    ]
    # Packages between palpate and the first line of a plugin.
    between = ("palpate", "typer", "click", "pluggy", "importlib", "_frozen_importlib")
    packages = [place[0] for place in places if place[0] not in (*between, "_frozen_importlib_external")]
    files = [each for each in packages if each.startswith("palpate_plugin_")]  # as load_file calls them
    plugin = files[-1:] or ([package] if package else packages[:1])
    last = [(file, line) for name, file, line in places if name in plugin][-1:]
    return "".join(f" (line {line} of {file})" for file, line in last)
