"""Findings about this machine: what it has, and what is missing."""

import importlib.metadata
import os
import platform
import shutil
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from palpate import __version__
from palpate.errors import PalpateError
from palpate.executors.machine import free_memory, n_cores
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.plugins.registry import GROUP, installed_points, owner_of

LIBRARIES = ("numpy", "scipy", "polars", "jax", "jaxlib", "pydantic", "pluggy")
"""Libraries on which results or their speed depend."""

Level = Literal["fine", "note", "wrong"]

LABELS: Mapping[Level, str] = MappingProxyType({"fine": "", "note": "note", "wrong": "WRONG"})
"""How a level is shown."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Parameters
    ----------
    topic : str
        "versions", "plugins", "solvers" or "machine".
    level : {"fine", "note", "wrong"}
        A note does not stop anybody; what is wrong leaves something out.
    advice : str
        What to do; empty where it is fine.
    """

    topic: str
    what: str
    found: str
    level: Level = "fine"
    advice: str = ""


def examine(plugins: Plugins, folder: Path) -> list[Finding]:
    """Look at everything that a run in ``folder``, which need not exist, depends on."""
    return [*_versions(), *_plugins(plugins), *_solvers(plugins), *_machine(folder)]


def _versions() -> Iterator[Finding]:
    system = f"{platform.system()} {platform.machine()}"
    python = f"{platform.python_implementation()} {platform.python_version()}"
    yield Finding("versions", "palpate", __version__)
    yield Finding("versions", "python", f"{python} on {system}")
    for name in LIBRARIES:
        try:
            found = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            advice = f"install it into this Python: {sys.executable} -m pip install {name}"
            yield Finding("versions", name, "missing", "wrong", advice)
        else:
            yield Finding("versions", name, found)


def _plugins(plugins: Plugins) -> Iterator[Finding]:
    points = {point.name if point.group == GROUP else owner_of(point): point for point in installed_points()}
    broken = {each.name for each in plugins.broken if not each.component}
    for name in sorted(set(points) - broken):
        package = points[name].dist
        found = f"{package.name} {package.version}" if package else points[name].value
        yield Finding("plugins", name, found)
    for each in plugins.broken:
        advice = f"correct it, or do without {each.source}"
        yield Finding("plugins", each.name, f"left out: {each.reason}", "wrong", advice)


def _solvers(plugins: Plugins) -> Iterator[Finding]:
    for name, solver in plugins.solvers.items():
        needed = [key for key, info in solver.Settings.model_fields.items() if info.is_required()]
        if needed:
            yield Finding("solvers", name, f"needs its settings {', '.join(needed)}")
            continue
        try:
            with answering_for(solver, "asking for its version"):
                version = solver().version()
            yield Finding("solvers", name, f"version {version}")
        except PalpateError as error:
            yield Finding("solvers", name, "not usable", "note", str(error))


def _machine(folder: Path) -> Iterator[Finding]:
    yield Finding("machine", "cores", str(n_cores()))
    memory_MB = free_memory()
    if memory_MB is not None:
        yield _room("free memory", memory_MB, "ask for fewer workers (solver.n_workers) or a smaller mesh")
    # Unlike Path.is_dir this is False, and raises nothing, where the folder may not be looked into.
    place = next(place for place in (folder, *folder.resolve().parents) if os.path.isdir(place))
    if not os.access(place, os.W_OK):
        advice = "make the folder writable, or keep runs elsewhere (--out FOLDER)"
        yield Finding("machine", f"runs in {folder}", f"{place} may not be written to", "wrong", advice)
    disk_MB = shutil.disk_usage(place).free * 1e-6
    yield _room(f"free disk of {folder}", disk_MB, "make room, or keep runs elsewhere (--out FOLDER)")


def _room(what: str, free_MB: float, advice: str) -> Finding:
    found = f"{free_MB * 1e-3:.1f} GB"
    # Below it a sweep may fail.
    if free_MB >= 2_000.0:
        return Finding("machine", what, found)
    return Finding("machine", what, found, "note", advice)
