"""A worker process: :func:`main` takes jobs on stdin and answers on stdout.

Messages are pickles behind their length. What a solver prints goes to stderr, so
that it cannot garble the answers.
"""

import contextlib
import io
import os
import pickle
import signal
import struct
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import IO, Any

from palpate.domain import Limb
from palpate.domain.component import Component
from palpate.executors.attempts import WORKER, Result, Task, attempt, spent_on_jobs_here
from palpate.plugins.interfaces import Solver
from palpate.plugins.registry import load_file

_LENGTH = struct.Struct("<Q")

OUT_OF_TIME = getattr(signal, "SIGPROF", None)
"""Signal by which the system ends a worker whose jobs have taken all of their processor time."""


class _Pickler(pickle.Pickler):
    """Sends a component as its class and settings, so that nothing it has cached travels.

    A class with a ``__reduce__`` of its own is sent by that.
    """

    def reducer_override(self, obj: object) -> Any:  # noqa: ANN401 - as pickle declares it
        if isinstance(obj, MappingProxyType):
            return _frozen, (dict(obj),)  # the type itself has no name to be found by
        if isinstance(obj, Component) and type(obj).__reduce__ is object.__reduce__:
            return type(obj), (obj.settings,)
        return NotImplemented


def _frozen(items: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(items)


def packed(value: object) -> bytes:
    """Pickle a value of the domain."""
    buffer = io.BytesIO()
    _Pickler(buffer, protocol=pickle.HIGHEST_PROTOCOL).dump(value)
    return buffer.getvalue()


def send(stream: IO[bytes], message: object) -> None:
    """Write one message."""
    content = packed(message)
    stream.write(_LENGTH.pack(len(content)) + content)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:  # noqa: ANN401 - whatever the other side sent
    """Read one message; an EOFError where the other side is gone."""
    head = stream.read(_LENGTH.size)
    content = stream.read(_LENGTH.unpack(head)[0]) if len(head) == _LENGTH.size else b""
    if not content:
        raise EOFError
    return pickle.loads(content)


def main() -> None:
    """Serve until the parent closes its end or is gone."""
    inbox = os.fdopen(os.dup(0), "rb")
    outbox = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)

    def tell(*message: object) -> None:
        send(outbox, message)

    try:
        _serve(inbox, tell)
    except (EOFError, BrokenPipeError):
        # The exit handlers of a numerical library may wait for threads that nobody needs any more.
        with contextlib.suppress(BrokenPipeError):  # the parent reads the output too
            sys.stderr.flush()
        os._exit(0)


def _serve(inbox: IO[bytes], tell: Callable[..., None]) -> None:
    try:
        plugin_files, solver_pickle, memory_MB = receive(inbox)
        for path, source in plugin_files:
            load_file(path, source)
        solver = pickle.loads(solver_pickle)
        if memory_MB:
            _limit_memory(memory_MB)
    except EOFError:
        raise
    except Exception as error:
        tell("unable", f"{type(error).__name__}: {error}")
        return
    tell("ready")
    limbs: dict[str, Limb] = {}
    told_s = 0.0

    def charged(result: Result) -> Result:
        """Result with what this process has spent besides on jobs since the last one."""
        nonlocal told_s
        index, simulation = result
        before_s, told_s = told_s, time.process_time() - spent_on_jobs_here()
        spent = {**simulation.diagnostics, WORKER: told_s - before_s}
        return index, replace(simulation, diagnostics=spent)

    while True:
        kind, *content = receive(inbox)
        if kind == "limb":
            name, limb_pickle, others = content
            limbs = {other: limbs[other] for other in others} | {name: pickle.loads(limb_pickle)}
        else:
            has_limb, tasks = content[0], pickle.loads(content[1])
            limb = limbs[tasks[0][1].limb_name] if has_limb else None
            for result in _limited(solver, limb, tasks, content[2], tell):
                tell("done", charged(result))
            tell("idle")


def _limited(
    solver: Solver, limb: Limb | None, tasks: list[Task], limit_s: float, tell: Callable[..., None]
) -> Iterator[Result]:
    """Results of jobs that may each take so much processor time."""
    in_flight: set[int] = set()

    def started(index: int) -> None:
        in_flight.add(index)
        _limit_time(limit_s * len(in_flight))
        tell("started", index)

    for result in attempt(solver, limb, tasks, started):
        in_flight.discard(result[0])
        _limit_time(limit_s * len(in_flight))
        yield result


def _limit_time(seconds: float) -> None:
    """Have the system end this process after so much more processor time of its threads; 0: no limit."""
    if OUT_OF_TIME is not None:
        signal.setitimer(signal.ITIMER_PROF, min(seconds, 1e9))


def _limit_memory(memory_MB: float) -> None:
    """Limit the address space to what is mapped now plus this much."""
    import resource

    mapped_pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = mapped_pages * resource.getpagesize() + int(memory_MB * 1e6)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
