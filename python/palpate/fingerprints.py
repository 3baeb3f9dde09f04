"""Identity of the code that decides a result: part of each simulation's key and of the manifest.

A package counts as a whole, since any of its modules may decide what a class of it computes: its
distribution with version, and one hash of its code (Python files and extension modules). A module
outside a package, such as a one-file plugin, counts by its file. Palpate itself counts by its version.
Data files and other distributions that a package imports are not covered; a component whose result
depends on them overrides :meth:`palpate.domain.component.Component.fingerprint`.
"""

import functools
import hashlib
import importlib.metadata
import importlib.util
import sys
from collections.abc import Callable, Iterator
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES
from pathlib import Path

from palpate.errors import PluginError

CORE = "palpate"

DIGITS = 16
"""Hexadecimal digits of a hash that are kept: no two sources ever share them by accident."""

CONTENT_HASH = "__content_hash__"
"""Attribute of a one-file plugin's module: hash of the file as it was imported."""


Code = type | Callable[..., object]
"""A class or a function."""


def code_fingerprint(code: Code) -> str:
    """Distribution, version and hash of the code of a class and its bases; empty within palpate itself.

    A PluginError where it is in no file, so that another version of it could not be distinguished.
    """
    found = dict.fromkeys(_fingerprint_of(each) for each in getattr(code, "__mro__", (code,)))
    return "; ".join(text for text in found if text)


def content_hash(content: bytes) -> str:
    """First digits of the SHA-256 of a file's content."""
    return hashlib.sha256(content).hexdigest()[:DIGITS]


def _fingerprint_of(cls: Code) -> str:
    """Fingerprint of one class or function alone; empty for one of palpate or of Python."""
    top, module = cls.__module__.partition(".")[0], sys.modules.get(cls.__module__)
    if top == CORE or (top in sys.stdlib_module_names and getattr(module, cls.__name__, None) is cls):
        return ""
    # What is typed into an interactive session is in no file, even where __main__ has one.
    if module is None or (cls.__module__ == "__main__" and hasattr(sys, "ps1")):
        raise _no_file(cls)
    bases = cls.__mro__ if isinstance(cls, type) else ()
    if not bases or any(base.__module__.partition(".")[0] == CORE for base in bases):
        return _of_package(cls.__module__) or _of_module(cls)
    return _of_module(cls)  # a base from a library, which may be huge


def _of_package(module: str) -> str:
    """Fingerprint of the outermost package with a folder of its own; empty where there is none."""
    parts = module.split(".")
    for n in range(1, len(parts) + 1):
        package = sys.modules.get(".".join(parts[:n]))
        folder = Path(getattr(package, "__file__", None) or "").parent
        if hasattr(package, "__path__") and folder.name and folder.is_dir():
            known = distributions().get(parts[0])
            return ", ".join([*([" ".join(known)] if known else []), f"source {_hash_of(folder)}"])
    return ""


def _of_module(cls: Code) -> str:
    module = sys.modules[cls.__module__]
    if known := getattr(module, CONTENT_HASH, ""):
        return f"source {known}"
    file = Path(getattr(module, "__file__", None) or "")
    if not file.is_file():
        raise _no_file(cls)
    return f"source {_hash_of(file)}"


def code_hash(path: Path) -> str:
    """Hash of a file, or of the code in a folder and those below it."""
    if path.is_file():
        return content_hash(path.read_bytes())
    digest = hashlib.sha256()
    for file in sorted(_code_files(path)):
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        digest.update(f"{file.relative_to(path).as_posix()}\0{content}\n".encode())
    return digest.hexdigest()[:DIGITS]


_hash_of = functools.cache(code_hash)
"""Once per process, like the import itself."""


def _code_files(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.is_dir():
            yield from () if path.name == "__pycache__" else _code_files(path)
        elif path.name.endswith((*SOURCE_SUFFIXES, *EXTENSION_SUFFIXES)):
            yield path


def installed_code() -> dict[str, str]:
    """Version and hash of the code of each installed distribution with plugins, none imported for it."""
    found = {}
    for package, (name, version) in distributions().items():
        spec = importlib.util.find_spec(package)
        origin = Path(spec.origin) if spec and spec.origin else Path()
        if origin.is_file():
            source = _hash_of(origin.parent if spec and spec.submodule_search_locations else origin)
            found[name] = f"{version}, source {source}"
    return found


@functools.cache
def distributions() -> dict[str, tuple[str, str]]:
    """Name and version of the distribution that each package with plugins comes with."""
    points = importlib.metadata.entry_points()
    groups = sorted(group for group in points.groups if group.partition(".")[0] == CORE)
    return {
        point.module.partition(".")[0]: (point.dist.name, point.dist.version)
        for group in groups
        for point in points.select(group=group)
        if point.dist
    }


def _no_file(cls: Code) -> PluginError:
    kind = "class" if isinstance(cls, type) else "function"
    return PluginError(
        f"{kind} {cls.__qualname__} ({cls.__module__}) is in no file, so that results of two versions "
        "could not be distinguished; put it in a Python file (--plugin FILE), "
        "or override fingerprint()"
    )
