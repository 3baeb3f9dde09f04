"""Findings about this machine: what it has, what is missing, and what is slow and why."""

import importlib.metadata
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Literal

import numpy as np

from palpate import __version__, _core
from palpate.errors import PalpateError
from palpate.executors.machine import THREAD_VARIABLES, free_memory, n_cores
from palpate.plugins.catalogue import Plugins
from palpate.plugins.guard import answering_for
from palpate.plugins.registry import GROUP, installed_points, owner_of

LIBRARIES = ("numpy", "scipy", "polars", "jax", "jaxlib", "pydantic", "pluggy")
"""Libraries on which results or their speed depend."""

NETWORK_FILE_SYSTEMS = frozenset(
    {"9p", "afs", "beegfs", "ceph", "cifs", "fuse.sshfs", "gpfs", "lustre", "nfs", "nfs4", "smb3", "vboxsf"}
)

SLOW_WRITE_S = 0.02
"""A write that reaches the disk should take less; the ledger makes one for each simulation."""

SLOW_SCORE_S = 0.02
"""Scoring 1,000 curves of 100 points takes a few milliseconds where the core was built for release."""

SLOW_PLUGINS_S = 3.0
"""Finding all that plugins provide should take less."""

FEW_FREE_MB = 2_000.0
"""Free memory and free disk below which a sweep may fail."""

Level = Literal["fine", "note", "wrong"]

LABELS: Mapping[Level, str] = MappingProxyType({"fine": "", "note": "note", "wrong": "WRONG"})
"""How a level is shown."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    Parameters
    ----------
    topic : str
        "versions", "plugins", "solvers", "machine" or "speed".
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


def examine(plugins: Plugins, folder: Path, plugins_s: float) -> list[Finding]:
    """Look at everything that a run depends on.

    Parameters
    ----------
    folder : Path
        Where runs are kept, or will be: its disk is tried with a small file that is removed.
    plugins_s : float
        How long it took to load the plugins.
    """
    return [
        *_versions(),
        *_plugins(plugins),
        *_solvers(plugins),
        *_machine(folder),
        *_speed(folder, plugins_s, plugins.import_s),
    ]


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
    for name, states in plugins.restored.items():
        advice = "it was restored; let the plugin leave what all plugins share"
        yield Finding("plugins", name, f"changes at import: {', '.join(states)}", "note", advice)
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
    held = {name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ}
    found = ", ".join(f"{name}={value}" for name, value in held.items()) or "not set: workers share the cores"
    yield Finding("machine", "thread settings", found)
    memory_MB = free_memory()
    if memory_MB is not None:
        yield _room("free memory", memory_MB, "ask for fewer workers (solver.n_workers) or a smaller mesh")
    disk_MB = shutil.disk_usage(_existing(folder)).free * 1e-6
    yield _room(f"free disk of {folder}", disk_MB, "make room, or keep runs elsewhere (--out FOLDER)")
    kind = file_system(_existing(folder))
    if kind in NETWORK_FILE_SYSTEMS:
        advice = "a network file system: runs are safe on it and slower; a local disk is better"
        yield Finding("machine", f"file system of {folder}", kind, "note", advice)


def _room(what: str, free_MB: float, advice: str) -> Finding:
    return _judged("machine", what, f"{free_MB * 1e-3:.1f} GB", advice, fine=free_MB >= FEW_FREE_MB)


def _judged(topic: str, what: str, found: str, advice: str, *, fine: bool) -> Finding:
    """A note with what to do, unless it is fine."""
    return Finding(topic, what, found) if fine else Finding(topic, what, found, "note", advice)


def file_system(folder: Path, mounts: Path = Path("/proc/self/mounts")) -> str:
    """Type of the file system that holds a folder, such as ext4 or nfs4; empty if unknown."""
    try:
        lines = mounts.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    places = [(place.replace("\\040", " "), kind) for _, place, kind, *_ in map(str.split, lines)]
    above = [(Path(place), kind) for place, kind in places if folder.resolve().is_relative_to(place)]
    return max(above, key=lambda each: len(each[0].parts), default=(folder, ""))[1]


def _speed(
    folder: Path, plugins_s: float, import_s: Mapping[str, float] = MappingProxyType({})
) -> Iterator[Finding]:
    slowest = sorted(import_s.items(), key=lambda each: -each[1])[:3]
    took = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in slowest)
    advice = f"the slowest to import, each with what it was first to need: {took}; see python -X importtime"
    yield _timed("finding plugins", plugins_s, SLOW_PLUGINS_S, advice)
    yield _timed(
        "scoring 1,000 curves", _score_s(), SLOW_SCORE_S, "the core may be a debug build; install a release"
    )
    try:
        write_s = _write_s(_existing(folder))
    except OSError as error:
        advice = "make the folder writable, or keep runs elsewhere (--out FOLDER)"
        yield Finding("speed", f"a write to {folder}", f"failed: {error.strerror}", "wrong", advice)
    else:
        advice = "the disk is slow or busy: it adds this to each simulation; keep runs on a local disk"
        yield _timed(f"a write to {folder}", write_s, SLOW_WRITE_S, advice)


def _timed(what: str, seconds: float, limit_s: float, advice: str) -> Finding:
    found = f"{seconds:.2g} s" if seconds >= 1.0 else f"{seconds * 1e3:.2g} ms"
    return _judged("speed", what, found, advice, fine=seconds <= limit_s)


def _score_s() -> float:
    rng = np.random.default_rng(1)
    depth, measured, simulated = np.arange(100.0), rng.normal(size=100), rng.normal(size=(1000, 100))
    begin = perf_counter()
    _core.Measured(depth, measured).along(depth).score(simulated)
    return perf_counter() - begin


def _write_s(folder: Path, n_writes: int = 5) -> float:
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".palpate-doctor-") as file:
        begin = perf_counter()
        for _ in range(n_writes):
            file.write(b"palpate" * 100)
            file.flush()
            os.fsync(file.fileno())
        return (perf_counter() - begin) / n_writes


def _existing(folder: Path) -> Path:
    # Unlike Path.is_dir this is False, and raises nothing, where the folder may not be looked into.
    return next(place for place in (folder, *folder.resolve().parents) if os.path.isdir(place))
